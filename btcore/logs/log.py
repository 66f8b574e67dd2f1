"""What all logs have in common: attached in one line, written once at the end of each tick."""

import logging
import time
from collections.abc import Callable
from types import TracebackType
from typing import ClassVar, Self

from btcore.engine.observers import Observer, Transitions
from btcore.status import IDLE, Transition
from btcore.tree.tree import Tree

_log = logging.getLogger("btcore")


class AttachedObserver(Observer):
    """An observer that hears *tree* until it is closed; ``with`` closes it.

    *epoch* is the wall time (ns since 1970) at which it was made, *start* the tree clock's time (ns)
    then. Stamps are the one plus the tree clock's time since the other: on a simulated clock a log
    lasts as long as the simulated run did.
    """

    def __init__(self, tree: Tree) -> None:
        self.tree = tree
        self.start = tree.clock.now()
        self.epoch = time.time_ns()
        self.closed = False
        self._unsubscribe: Callable[[], None] | None = None

    def attach(self) -> None:
        """Hear from now on. The constructors of logs call it when all else is done."""
        self._unsubscribe = self.tree.subscribe(self)

    def wall(self, stamp: int) -> int:
        """The moment *stamp* (ns, tree's clock) in ns since 1970."""
        return self.epoch + stamp - self.start

    def close(self) -> None:
        """Hear no more. Closing again does nothing."""
        self.closed = True
        if self._unsubscribe is not None:
            self._unsubscribe()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class Log(AttachedObserver):
    """Writes the transitions of a tick at its end, and those of a halt after it.

    So a process that is killed loses at most the tick in progress. A log that can't be written any more
    (a full disk) ends with a warning of the logger ``btcore``; the tree does not notice.
    """

    write_errors: ClassVar[tuple[type[Exception], ...]] = (OSError,)
    """What writing may raise for reasons that are the world's, not the program's."""

    def __init__(self, tree: Tree, name: str, *, idle: bool = True) -> None:
        self.name = name
        self.idle = idle
        super().__init__(tree)

    def transitions(self, changes: Transitions) -> None:
        """Write *changes*."""
        kept = [change for change in changes if change.status is not IDLE or self.idle]
        if self.closed or not kept:
            return
        try:
            self.write(kept)
        except self.write_errors as error:
            self._give_up(error)

    def close(self) -> None:
        """Write what isn't written yet, and end the log. Closing again does nothing."""
        if self.closed:
            return
        self.tree.flush_observers()
        if self.closed:
            return
        try:
            self.finish()
        except self.write_errors as error:
            self._give_up(error)
        super().close()
        self.release()

    def write(self, changes: list[Transition]) -> None:
        """Write *changes*, all at once."""
        raise NotImplementedError

    def finish(self) -> None:
        """Write what belongs to the end of the log."""

    def release(self) -> None:
        """Let go of the file."""

    def _give_up(self, error: Exception) -> None:
        if self.closed:
            return
        why = getattr(error, "strerror", None) or str(error)
        _log.warning("the log %s ends here, it can't be written any more: %s", self.name, why)
        super().close()
        self.release()
