"""Observers of a tree: they are notified of transitions, ticks and errors.

An observer cannot change a tick's result. An observer that raises is unsubscribed, and a warning is logged.
"""

import time
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

from mypy_extensions import mypyc_attr

from btcore.clock import FAST_NOW, Clock
from btcore.engine.node_config import NodeConfig
from btcore.engine.transition_records import Transitions, create_transition
from btcore.errors import NodeExecutionError
from btcore.status import IDLE, SUCCESS, Status, Transition

if TYPE_CHECKING:
    from btcore.engine.journal import Journal  # imported when a recording begins


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


class Observers:
    """The observers of one tree, which are notified of its transitions after each tick.

    Attributes:
        observers: The observers.
        records: The transitions since the last notification, in the form of `transition_records.py`.
        tick: The number of the latest tick that has started.
        journal: Gets each transition at once, while the tree is recorded; or None.
        before_tick: Called on the thread that ticks before each tick of the root, or None. Unlike an
            observer, it may write to the blackboard.
    """

    def __init__(self, clock: Clock) -> None:
        self.observers: list[Observer] = []
        self.records: list[object] = []
        self.tick = 0
        self.journal: Journal | None = None
        self.before_tick: Callable[[], object] | None = None
        self._now: Callable[[], Any] = FAST_NOW.get(type(clock), clock.now)
        self._first = 1  # the number of the first transition in `records`
        self._count = 0  # of the transitions in `records`
        self._immediate_observers: list[Observer] = []  # those that override `Observer.transition`
        self._has_readers = False  # whether any observer overrides it, or `Observer.transitions`
        self._is_flushing = False
        self._tick_start = 0  # ns of real time

    # --- transitions

    def record_transition(self, config: NodeConfig, previous: Status, status: Status) -> None:
        """Record a transition of the node with *config*."""
        if self.journal is not None:
            self.journal.add_transition(config, status)
        if not self._has_readers:
            self._first += 1
            return
        stamp = self._now()
        records = self.records
        records.append(stamp)
        records.append(config)
        if previous is not IDLE or status is not SUCCESS:
            records.append(previous)
            records.append(status)
        self._count += 1
        if self._immediate_observers:
            number = self._first + self._count - 1
            self._notify_at_once(create_transition(number, stamp, self.tick, config, previous, status))

    def record_resets(self, configs: list[NodeConfig], before: list[Status], count: int) -> None:
        """Record that children of a node were reset.

        Args:
            configs: The configs of all children.
            before: The previous statuses of the first children, or of all; IDLE = the child was not reset.
            count: The number of children that were reset.
        """
        if self.journal is not None or self._immediate_observers:
            for index, previous in enumerate(before):
                if previous is not IDLE:
                    self.record_transition(configs[index], previous, IDLE)
            return
        if not self._has_readers:
            self._first += count
            return
        records = self.records
        records.append(self._now())
        records.append(configs)
        records.append(before)
        records.append(IDLE)
        self._count += count

    def _notify_at_once(self, change: Transition) -> None:
        for observer in self._immediate_observers:
            try:
                observer.transition(change)
            except Exception as error:
                self._unsubscribe_after_error(observer, error)

    def flush(self) -> None:
        """Notify the observers of all recorded transitions."""
        if self._is_flushing or not self.records:
            return
        self._is_flushing = True
        try:
            # An observer may cause further transitions: all observers get them afterwards, in order.
            while self.records:
                changes = Transitions(self._first, self.tick, self.records, self._count)
                self._first += self._count
                self.records = []
                self._count = 0
                for observer in self.observers:
                    try:
                        observer.transitions(changes)
                    except Exception as error:
                        self._unsubscribe_after_error(observer, error)
        finally:
            self._is_flushing = False

    # --- ticks and errors

    def begin_tick(self, tick: int) -> None:
        """Notify the observers of the recorded transitions, then start tick number *tick* of the root."""
        self.flush()
        if self.before_tick is not None:
            self.before_tick()
        self.tick = tick
        self._tick_start = time.perf_counter_ns()

    def exclude_time(self, nanoseconds: int) -> None:
        """Do not count *nanoseconds* of the present tick in its duration."""
        self._tick_start += nanoseconds

    def end_tick(self, status: Status) -> None:
        """Notify the observers of the end of a tick with the result *status*."""
        duration_ns = time.perf_counter_ns() - self._tick_start
        self.flush()
        stamp: int = self._now()
        for observer in self.observers:
            try:
                observer.ticked(self.tick, stamp, duration_ns, status)
            except Exception as error:
                self._unsubscribe_after_error(observer, error)

    def notify_error(self, error: NodeExecutionError) -> None:
        """Notify the observers that a node raised *error*."""
        self.flush()
        stamp: int = self._now()
        for observer in self.observers:
            try:
                observer.raised(error, stamp)
            except Exception as problem:
                self._unsubscribe_after_error(observer, problem)

    # --- subscriptions

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
        self._has_readers = bool(self._immediate_observers) or any(
            type(observer).transitions is not Observer.transitions for observer in observers
        )

    def _unsubscribe_after_error(self, observer: Observer, error: Exception) -> None:
        self._set_observers([other for other in self.observers if other is not observer])
        import logging

        logging.getLogger("btcore").warning("observer %r raised and is unsubscribed: %r", observer, error)
