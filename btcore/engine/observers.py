"""Observers of a tree: they are notified of transitions, ticks and errors.

An observer cannot change a tick's result. An observer that raises is unsubscribed, and a warning is logged.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Final, cast

from mypy_extensions import mypyc_attr

from btcore.clock import Clock, now_function
from btcore.engine.node_config import NodeConfig
from btcore.errors import NodeExecutionError
from btcore.status import IDLE, SUCCESS, Status, Transition

# The constructor of Transition calls it too, but by way of an interpreted function, which takes much longer.
_new_tuple: Final[Any] = tuple.__new__


class Transitions:
    """The transitions of one tick in chronological order, a lazy sequence of `Transition`.

    To save time, the thread that ticks the tree records only times, nodes and statuses. The Transition
    objects are created on first access, on any thread.

    Args:
        tick: The number of the tick.
        first: The number of the first transition, counted from the start of the tree.
        records: The recorded data of all transitions.
        count: The number of transitions; *records* may grow.
    """

    def __init__(self, first: int, tick: int, records: list[object], count: int) -> None:
        self.first = first
        """The number of the first transition."""
        self.tick = tick
        # A flat list. A transition is: time (ns), config of the node, previous status, new status. The most
        # frequent transition, from IDLE to SUCCESS, is: time, config. A reset of several nodes is: time, list
        # of configs, list of previous statuses (IDLE there: the node was not reset), IDLE.
        self._records = records
        self._count = count
        self._transitions: list[Transition] | None = None

    def to_list(self) -> list[Transition]:
        """Return all transitions in a list."""
        transitions = self._transitions
        if transitions is None:
            self._transitions = transitions = _transitions(self.first, self.tick, self._records)
        return transitions

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[Transition]:
        return iter(self.to_list())

    def __getitem__(self, index: int) -> Transition:
        return self.to_list()[index]


def _transitions(number: int, tick: int, records: list[object]) -> list[Transition]:
    """Return the transitions in *records*; *number* is the number of the first."""
    transitions: list[Transition] = []
    at = 0
    while at < len(records):
        moment, config = records[at], records[at + 1]
        previous = records[at + 2] if at + 2 < len(records) else None
        following = number + len(transitions)
        if isinstance(previous, Status):
            transitions.append(_transition(following, moment, tick, config, previous, records[at + 3]))
            at += 4
        elif isinstance(previous, list):
            for node, status in zip(cast(list[object], config), cast(list[object], previous), strict=False):
                if status is not IDLE:
                    transitions.append(_transition(following, moment, tick, node, status, IDLE))
                    following += 1
            at += 4
        else:
            transitions.append(_transition(following, moment, tick, config, IDLE, SUCCESS))
            at += 2
    return transitions


def _transition(
    number: int, moment: object, tick: int, config: object, previous: object, status: object
) -> Transition:
    values = (number, moment, tick, cast(NodeConfig, config).uid, previous, status)
    transition: Transition = _new_tuple(Transition, values)
    return transition


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
    """The observers of one tree, and the recorded transitions that were not delivered to them yet."""

    def __init__(self, clock: Clock) -> None:
        self.now: Callable[[], Any] = now_function(clock)
        self.tick = 0
        self.listeners: list[Observer] = []
        self.immediate_listeners: list[Observer] = []
        """The observers that override `Observer.transition`."""
        self._batch_listeners: list[Observer] = []
        self._first = 1
        self._records: list[object] = []
        # The difference between the number of transitions in _records and half the length of _records.
        self._surplus = 0
        self._flushing = False

    def record_success(self, config: NodeConfig) -> None:
        """Record the transition from IDLE to SUCCESS of the node with *config*."""
        moment = self.now()
        records = self._records
        records.append(moment)
        records.append(config)
        if self.immediate_listeners:
            self._notify_at_once(moment, config, IDLE, SUCCESS)

    def record_transition(self, moment: object, config: NodeConfig, previous: Status, status: Status) -> None:
        """Record a transition of the node with *config*, at *moment* (ns).

        *moment* is typed as object because mypyc would unbox and box an int again.
        """
        records = self._records
        records.append(moment)
        records.append(config)
        records.append(previous)
        records.append(status)
        self._surplus -= 1
        if self.immediate_listeners:
            self._notify_at_once(moment, config, previous, status)

    def record_reset(self, configs: list[NodeConfig], before: list[Status], count: int) -> None:
        """Record a reset of several nodes. Call it only if there are no immediate listeners.

        Args:
            configs: The configs of the nodes.
            before: The previous statuses of the nodes.
            count: The number of nodes whose previous status was not IDLE.
        """
        records = self._records
        records.append(self.now())
        records.append(configs)
        records.append(before)
        records.append(IDLE)
        self._surplus += count - 2

    def _notify_at_once(self, moment: object, config: NodeConfig, previous: Status, status: Status) -> None:
        """Notify the immediate listeners of the last record."""
        number = self._first + len(self._records) // 2 + self._surplus - 1
        change = _transition(number, moment, self.tick, config, previous, status)
        for listener in self.immediate_listeners:
            try:
                listener.transition(change)
            except Exception as error:
                self._drop(listener, error)

    def flush(self) -> None:
        """Notify the observers of all recorded transitions."""
        if self._flushing or not self._records:
            return
        self._flushing = True
        try:
            # A listener may cause further transitions: all listeners get them afterwards, in order.
            while self._records:
                records = self._records
                count = len(records) // 2 + self._surplus
                changes = Transitions(self._first, self.tick, records, count)
                self._first += count
                self._records = []
                self._surplus = 0
                for listener in self._batch_listeners:
                    try:
                        listener.transitions(changes)
                    except Exception as error:
                        self._drop(listener, error)
        finally:
            self._flushing = False

    def begin(self, tick: int) -> None:
        """Notify the observers of the recorded transitions, then start tick number *tick* of the root."""
        self.flush()
        self.tick = tick

    def notify_tick(self, duration_ns: int, status: Status) -> None:
        """Notify the observers of the end of a tick, which took *duration_ns* (ns, real time)."""
        self.flush()
        stamp: int = self.now()
        for listener in self.listeners:
            try:
                listener.ticked(self.tick, stamp, duration_ns, status)
            except Exception as error:
                self._drop(listener, error)

    def notify_error(self, error: NodeExecutionError) -> None:
        """Notify the observers that a node raised *error*."""
        self.flush()
        stamp: int = self.now()
        for listener in self.listeners:
            try:
                listener.raised(error, stamp)
            except Exception as problem:
                self._drop(listener, problem)

    def add(self, listener: Observer) -> Callable[[], None]:
        """Subscribe *listener*. Return a function that unsubscribes it; further calls have no effect."""
        self.flush()
        self._set_listeners([*self.listeners, listener])
        return partial(self.remove, listener)

    def remove(self, listener: Observer) -> None:
        """Unsubscribe *listener*, after it was notified of all recorded transitions."""
        if any(other is listener for other in self.listeners):
            self.flush()
            self._set_listeners([other for other in self.listeners if other is not listener])

    def _set_listeners(self, listeners: list[Observer]) -> None:
        # New lists, because a caller may be iterating over the old lists.
        self.listeners = listeners
        self.immediate_listeners = [
            listener for listener in listeners if type(listener).transition is not Observer.transition
        ]
        self._batch_listeners = [
            listener for listener in listeners if type(listener).transitions is not Observer.transitions
        ]

    def _drop(self, listener: Observer, error: Exception) -> None:
        self._set_listeners([other for other in self.listeners if other is not listener])
        import logging

        logging.getLogger("btcore").warning("observer %r raised and is unsubscribed: %r", listener, error)
