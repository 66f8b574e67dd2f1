"""The base class of all logs, which write the transitions of a tree at the end of each tick."""

import logging
import time
from collections.abc import Callable
from typing import ClassVar, Self

from btcore.engine.observers import Observer
from btcore.engine.transition_records import Transitions
from btcore.status import IDLE, Transition
from btcore.tree.tree import Tree

_log = logging.getLogger("btcore")


class AttachedObserver(Observer):
    """An observer that is subscribed to a tree until it is closed, or until its `with` block ends.

    A wall time is computed as `epoch` plus the time of the tree's clock since `start`. Therefore a log of a
    simulated run has the duration of the simulated run.

    Attributes:
        tree: The observed tree.
        start: The time of the tree's clock (ns) at which the observer was created.
        epoch: The wall time (ns since 1970) at which the observer was created.
        closed: Whether the observer is closed.
    """

    def __init__(self, tree: Tree) -> None:
        self.tree = tree
        self.start = tree.clock.now()
        self.epoch = time.time_ns()
        self.closed = False
        self._unsubscribe: Callable[[], None] | None = None

    def attach(self) -> None:
        """Subscribe to the tree. Constructors call it last: transitions may follow at once."""
        self._unsubscribe = self.tree.subscribe(self)

    def wall(self, stamp: int) -> int:
        """Convert *stamp*, a time of the tree's clock (ns), to ns since 1970."""
        return self.epoch + stamp - self.start

    def close(self) -> None:
        """Unsubscribe from the tree. Closing again has no effect."""
        self.closed = True
        if self._unsubscribe is not None:
            self._unsubscribe()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Log(AttachedObserver):
    """The base class of logs: writes the transitions of a tick or a halt when the tick or the halt ends.

    A process that is killed loses at most the tick in progress. If writing fails, for example because the
    disk is full, the log is closed with a warning of the logger `btcore`; the tree is not affected.

    Args:
        tree: The tree to log.
        name: The name of the log in warnings.
        idle: Whether to log transitions to IDLE.

    Attributes:
        is_incomplete: Whether writing has failed, so that the log ends early.
    """

    write_errors: ClassVar[tuple[type[Exception], ...]] = (OSError,)
    """Errors of the environment, which close the log with a warning. Other exceptions propagate."""

    def __init__(self, tree: Tree, name: str, *, idle: bool = True) -> None:
        self.name = name
        self.idle = idle
        self.is_incomplete = False
        super().__init__(tree)

    def transitions(self, changes: Transitions) -> None:
        """Write the transitions of a tick or a halt, without those that `idle` excludes."""
        kept = [change for change in changes if change.status is not IDLE or self.idle]
        if self.closed or not kept:
            return
        try:
            self.write(kept)
        except self.write_errors as error:
            self._give_up(error)

    def close(self) -> None:
        """Write pending transitions, and close the log. Closing again has no effect."""
        if self.closed:
            return
        self.tree.flush_observers()
        if self.closed:  # writing the pending transitions has failed
            return
        try:
            self.finish()
        except self.write_errors as error:
            self._give_up(error)
        super().close()
        self.release()

    def write(self, changes: list[Transition]) -> None:
        """Write *changes*, from which excluded transitions are removed. Subclasses override this method."""
        raise NotImplementedError

    def finish(self) -> None:
        """Write the end of the log, if the format requires an end. Subclasses may override this method."""

    def release(self) -> None:
        """Close the file, if the log has a file. Subclasses may override this method."""

    def _give_up(self, error: Exception) -> None:
        if self.closed:
            return
        # A reader of stdout that has exited, such as `head`, needs no more.
        self.is_incomplete = not isinstance(error, BrokenPipeError)
        reason = getattr(error, "strerror", None) or str(error)
        _log.warning("the log %s is incomplete, writing failed: %s", self.name, reason)
        super().close()
        self.release()
