"""Observers of a tree: they are notified of transitions, ticks and errors.

An observer cannot change a tick's result. An observer that raises is unsubscribed, and a warning is logged.
"""

import time
from collections.abc import Callable
from functools import partial

from mypy_extensions import mypyc_attr

from btcore.clock import Clock
from btcore.engine.transition_records import TransitionRecorder, Transitions
from btcore.errors import NodeExecutionError
from btcore.status import Status, Transition


@mypyc_attr(allow_interpreted_subclasses=True)
class Observer:
    """The base class of observers of a tree. Override the methods for the events that you need.

    All methods are called on the thread that ticks the tree, which waits until they return: hand over slow
    work to another thread.

    Examples:
        >>> import btcore
        >>> class Printer(btcore.Observer):
        ...     def transition(self, change):
        ...         print(change.uid, change.status.name)
        >>> b = btcore.Builder()
        >>> tree = b.build(b.Inverter(b.AlwaysSuccess()))
        >>> unsubscribe = tree.subscribe(Printer())
        >>> tree.tick_once()
        1 RUNNING
        2 SUCCESS
        2 IDLE
        1 FAILURE
        1 IDLE
        <Status.FAILURE: 3>
    """

    def transition(self, change: Transition) -> None:
        """Handle a change of a node's stored status. Called at once when the status changes.

        Override `transitions` instead unless you need each change at once: it is many times cheaper.
        """

    def transitions(self, changes: Transitions) -> None:
        """Handle all changes since the last call, in chronological order.

        Called after each tick and each halt, and before `raised`.
        """

    def ticked(self, tick: int, stamp: int, duration_ns: int, status: Status) -> None:
        """Handle the end of a tick of the root.

        Args:
            tick: The number of the tick, from 1.
            stamp: The time (ns) of the tree's clock at the end of the tick.
            duration_ns: The real time (ns) that the tick took, without the time at breakpoints.
            status: The result of the root.
        """

    def raised(self, error: NodeExecutionError, stamp: int) -> None:
        """Handle an error of a node.

        After an error in a tick, it is called before the tree is halted, so that the nodes still have their
        statuses. After an error in a halt, it is called when all nodes have been halted.

        Args:
            error: The error, which names the node.
            stamp: The time (ns) of the tree's clock.
        """


class Observers(TransitionRecorder):
    """The observers of one tree. They are notified of the recorded transitions after each tick."""

    def __init__(self, clock: Clock) -> None:
        super().__init__(clock)
        self.observers: list[Observer] = []
        # The observers that override `Observer.transition`, and those that override `Observer.transitions`.
        self._immediate_observers: list[Observer] = []
        self._batch_observers: list[Observer] = []
        self._flushing = False
        self._tick_start = 0  # ns of real time

    def notify_at_once(self, change: Transition) -> None:
        """Notify the observers that override `Observer.transition`."""
        for observer in self._immediate_observers:
            try:
                observer.transition(change)
            except Exception as error:
                self._unsubscribe_after_error(observer, error)

    def flush(self) -> None:
        """Notify the observers of all recorded transitions."""
        if self._flushing or not self.has_records:
            return
        self._flushing = True
        try:
            # An observer may cause further transitions: all observers get them afterwards, in order.
            while self.has_records:
                changes = self.take_transitions()
                for observer in self._batch_observers:
                    try:
                        observer.transitions(changes)
                    except Exception as error:
                        self._unsubscribe_after_error(observer, error)
        finally:
            self._flushing = False

    def begin_tick(self, tick: int) -> None:
        """Notify the observers of the recorded transitions, then start tick number *tick* of the root."""
        self.flush()
        self.tick = tick
        self._tick_start = time.perf_counter_ns()

    def end_tick(self, status: Status, stopped_ns: int) -> None:
        """Notify the observers of the end of a tick with the result *status*.

        Args:
            stopped_ns: How long breakpoints have stopped the tick (ns).
        """
        duration_ns = time.perf_counter_ns() - self._tick_start - stopped_ns
        self.flush()
        stamp: int = self.now()
        for observer in self.observers:
            try:
                observer.ticked(self.tick, stamp, duration_ns, status)
            except Exception as error:
                self._unsubscribe_after_error(observer, error)

    def notify_error(self, error: NodeExecutionError) -> None:
        """Notify the observers that a node raised *error*."""
        self.flush()
        stamp: int = self.now()
        for observer in self.observers:
            try:
                observer.raised(error, stamp)
            except Exception as problem:
                self._unsubscribe_after_error(observer, problem)

    def add(self, observer: Observer) -> Callable[[], None]:
        """Subscribe *observer*. Return a function that unsubscribes it; further calls have no effect."""
        self.flush()
        self._set_observers([*self.observers, observer])
        return partial(self.remove, observer)

    def remove(self, observer: Observer) -> None:
        """Unsubscribe *observer*, after it was notified of all recorded transitions."""
        if any(other is observer for other in self.observers):
            self.flush()
            self._set_observers([other for other in self.observers if other is not observer])

    def _set_observers(self, observers: list[Observer]) -> None:
        # New lists, because a caller may be iterating over the old lists.
        self.observers = observers
        self._immediate_observers = [
            observer for observer in observers if type(observer).transition is not Observer.transition
        ]
        self.notifies_at_once = bool(self._immediate_observers)
        self._batch_observers = [
            observer for observer in observers if type(observer).transitions is not Observer.transitions
        ]

    @property
    def only_need_checksum(self) -> bool:
        """Whether no observer is notified of transitions, and the checksum is needed."""
        return self.has_checksum and not self._batch_observers and not self.notifies_at_once

    def _unsubscribe_after_error(self, observer: Observer, error: Exception) -> None:
        self._set_observers([other for other in self.observers if other is not observer])
        import logging

        logging.getLogger("btcore").warning("observer %r raised and is unsubscribed: %r", observer, error)
