"""What all logs have in common: attached in one line, written once at the end of each tick."""

import logging
import time
from collections.abc import Callable
from types import TracebackType
from typing import ClassVar, Self

from btcore.errors import NodeRaised
from btcore.observers import Observer
from btcore.status import IDLE, Status, Transition
from btcore.tree import Tree

_log = logging.getLogger("btcore")


class Attached(Observer):
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


class Log(Attached):
    """Collects the transitions of a tick, and writes them once, at its end.

    So a process that is killed loses at most the tick in progress. What changes between two ticks
    (a halt) is written at once. A log that can't be written any more (a full disk) ends with a
    warning of the logger ``btcore``; the tree does not notice.
    """

    failures: ClassVar[tuple[type[Exception], ...]] = (OSError,)
    """What writing may raise for reasons that are the world's, not the program's."""

    def __init__(self, tree: Tree, name: str, *, idle: bool = True) -> None:
        self.name = name
        self.idle = idle
        self._changes: list[Transition] = []
        # Ticks up to this one are over: nothing says when a halt ends, but it is outside of any.
        self._over = tree.ticks
        super().__init__(tree)

    def transition(self, change: Transition) -> None:
        """Keep *change* for the end of the tick."""
        if change.status is not IDLE or self.idle:
            self._changes.append(change)
            if change.tick <= self._over:
                self.flush()

    def ticked(self, tick: int, stamp: int, duration_ns: int, status: Status) -> None:
        """Write the tick's transitions."""
        self._over = tick
        self.flush()

    def raised(self, error: NodeRaised, stamp: int) -> None:
        """Write what there is: the tree is halted next."""
        self._over = self.tree.ticks
        self.flush()

    def flush(self) -> None:
        """Write what isn't written yet."""
        if self.closed or not self._changes:
            return
        changes, self._changes = self._changes, []
        try:
            self.write(changes)
        except self.failures as error:
            self._give_up(error)

    def close(self) -> None:
        """Write what isn't written yet, and end the log. Closing again does nothing."""
        if self.closed:
            return
        self.flush()
        if self.closed:
            return
        try:
            self.finish()
        except self.failures as error:
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
