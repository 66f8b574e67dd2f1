"""Printing transitions as text, in the format of BehaviorTree.CPP's StdCoutLogger.

See src/loggers/bt_cout_logger.cpp.
"""

import sys
from typing import ClassVar, Final, TextIO

from btcore.clock import NS_PER_S
from btcore.escaping import escape_controls
from btcore.logs.log import Log
from btcore.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Transition
from btcore.tree.drawing import shows_colours
from btcore.tree.tree import Tree

_COLOURS: Final = {SUCCESS: 32, FAILURE: 31, RUNNING: 33, SKIPPED: 34, IDLE: 36}
_NAME_WIDTH: Final = 25


class ConsoleLog(Log):
    """A log that prints `[seconds]: name  PREVIOUS -> STATUS` for each transition of a tree.

    Args:
        tree: The tree to log.
        stream: The output stream; None for stdout.
        idle: Whether to print transitions to IDLE.
        relative: Whether times are seconds since the start of the log instead of seconds since 1970.
        colours: Whether statuses are coloured; None for colours on a terminal, unless the environment
            variable `NO_COLOR` is set.

    Examples:
        >>> import btcore
        >>> from btcore.logs import ConsoleLog
        >>> b = btcore.Builder()
        >>> tree = b.build(b.AlwaysSuccess(name="door"), clock=btcore.SimClock())
        >>> with ConsoleLog(tree, idle=False, relative=True):
        ...     tree.tick_while_running()
        [0.000]: door                      IDLE -> SUCCESS
        <Status.SUCCESS: 2>
    """

    # Writing to a closed stream raises ValueError.
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
            colours = shows_colours(self.stream)
        self._words = {
            status: f"\x1b[{colour}m{status.name}\x1b[0m" if colours else status.name
            for status, colour in _COLOURS.items()
        }
        self._names = {node.config.uid: escape_controls(node.name, one_line=True) for node in tree.nodes}
        super().__init__(tree, str(getattr(self.stream, "name", "console")), idle=idle)
        self.attach()

    def write(self, changes: list[Transition]) -> None:
        """Print the transitions *changes*, and flush the stream."""
        origin = self.wall(self.start) if not self.relative else 0
        words, names = self._words, self._names
        text = "".join(
            f"[{(origin + stamp - self.start) / NS_PER_S:.3f}]: {names[uid]:<{_NAME_WIDTH}} "
            f"{words[previous]} -> {words[status]}\n"
            for _, stamp, _, uid, previous, status in changes
        )
        # Names may contain characters that the stream cannot encode.
        encoding = self.stream.encoding or "utf-8"
        self.stream.write(text.encode(encoding, "backslashreplace").decode(encoding))
        self.stream.flush()
