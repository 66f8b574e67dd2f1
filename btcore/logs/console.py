"""Transitions as lines of text, in the format of BehaviorTree.CPP's StdCoutLogger (groot2.md §14)."""

import os
import sys
from typing import ClassVar, Final, TextIO

from btcore.clock import NS_PER_S
from btcore.logs.log import Log
from btcore.status import (
    FAILURE,
    IDLE,
    RUNNING,
    SKIPPED,
    SUCCESS,
    Status,
    Transition,
)
from btcore.tree.tree import Tree

_COLOURS: Final = {SUCCESS: 32, FAILURE: 31, RUNNING: 33, SKIPPED: 34, IDLE: 36}
_NAME_WIDTH: Final = 25


class ConsoleLog(Log):
    """Prints ``[seconds]: name  PREVIOUS -> STATUS`` for every transition of *tree*, as StdCoutLogger does.

    *stream* is stdout if none is given. Seconds count from 1970, or from the log's start if *relative*.
    *idle* false leaves out the transitions to IDLE. Statuses are coloured on a terminal, unless the
    environment has ``NO_COLOR``; *colours* decides otherwise.
    """

    # A closed stream raises ValueError.
    write_errors: ClassVar[tuple[type[Exception], ...]] = (OSError, ValueError)

    def __init__(
        self,
        tree: Tree,
        stream: TextIO | None = None,
        *,
        idle: bool = True,
        relative: bool = False,
        colours: bool | None = None,
    ) -> None:
        self.stream = sys.stdout if stream is None else stream
        self.relative = relative
        if colours is None:
            colours = self.stream.isatty() and not os.environ.get("NO_COLOR")
        self._words = {status: _word(status, colours) for status in _COLOURS}
        self._names = {node.uid: node.name for node in tree.nodes}
        super().__init__(tree, str(getattr(self.stream, "name", "console")), idle=idle)
        self.attach()

    def write(self, changes: list[Transition]) -> None:
        """Print *changes*, and see that they are out."""
        origin = self.wall(self.start) if not self.relative else 0
        words, names = self._words, self._names
        text = "".join(
            f"[{(origin + stamp - self.start) / NS_PER_S:.3f}]: {names[uid]:<{_NAME_WIDTH}} "
            f"{words[previous]} -> {words[status]}\n"
            for _, stamp, _, uid, previous, status in changes
        )
        encoding = self.stream.encoding or "utf-8"
        self.stream.write(text.encode(encoding, "backslashreplace").decode(encoding))
        self.stream.flush()


def _word(status: Status, colours: bool) -> str:
    return f"\x1b[{_COLOURS[status]}m{status.name}\x1b[0m" if colours else status.name


def format_transition(since: int, path: str, previous: Status, status: Status, width: int = 0) -> str:
    """The transition *since* ns from the start, with *path* in at least *width* characters."""
    return f"{since / NS_PER_S:12.6f}  {path:<{width}}  {previous.name:>7} → {status.name}"
