"""Subscribing to what happens in a tree: transitions, ticks and errors.

Telemetry never ticks: an observer may be slow or wrong, the tree does not notice. One that
raises is dropped, with a warning in the log.
"""

from collections.abc import Callable, Iterator
from typing import Any, Final, cast

from mypy_extensions import mypyc_attr

from btcore.clock import Clock, now_function
from btcore.engine.node_config import NodeConfig
from btcore.errors import NodeExecutionError
from btcore.status import (
    IDLE,
    SUCCESS,
    Status,
    Transition,
)

# What Transition(…) calls in the end, by way of a function in Python, which takes far longer.
_new_tuple: Final[Any] = tuple.__new__


class Transitions:
    """Transitions in the order in which they came, all of one tick; made when they are looked at.

    So the thread that ticks notes little more than references, and who records them has the rest done
    whenever it suits, on whatever thread.
    """

    def __init__(self, first: int, tick: int, noted: list[object], count: int) -> None:
        self.first = first
        """The number of the first one."""
        self.tick = tick
        # For each: the moment (ns), the node's config, its previous and its new status; these two are left
        # out where a node was IDLE and is SUCCESS. Of nodes that were reset together: the moment, a list of
        # their configs, one of the previous statuses of the first of them, and IDLE.
        self._noted = noted
        self._count = count
        self._made: list[Transition] | None = None

    def to_list(self) -> list[Transition]:
        """All of them."""
        made = self._made
        if made is None:
            made = _made(self.first, self.tick, self._noted)
            self._made = made
        return made

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[Transition]:
        return iter(self.to_list())

    def __getitem__(self, index: int) -> Transition:
        return self.to_list()[index]


def _made(number: int, tick: int, noted: list[object]) -> list[Transition]:
    """What is *noted*, in full; the first has this *number*."""
    made: list[Transition] = []
    at = 0
    while at < len(noted):
        moment, config = noted[at], noted[at + 1]
        previous = noted[at + 2] if at + 2 < len(noted) else None
        if isinstance(previous, Status):
            made.append(_transition(number + len(made), moment, tick, config, previous, noted[at + 3]))
            at += 4
        elif isinstance(previous, list):
            for one, status in zip(cast(list[object], config), cast(list[object], previous), strict=False):
                if status is not IDLE:
                    made.append(_transition(number + len(made), moment, tick, one, status, IDLE))
            at += 4
        else:
            made.append(_transition(number + len(made), moment, tick, config, IDLE, SUCCESS))
            at += 2
    return made


def _transition(
    number: int, moment: object, tick: int, config: object, previous: object, status: object
) -> Transition:
    values = (number, moment, tick, cast(NodeConfig, config).uid, previous, status)
    made: Transition = _new_tuple(Transition, values)
    return made


@mypyc_attr(allow_interpreted_subclasses=True)
class Observer:
    """What an observer may hear. Subclass it and override what you need.

    Every method runs on the thread that ticks, between two steps of the tree: be brief, and hand
    over to a thread of your own what takes time.
    """

    def transition(self, change: Transition) -> None:
        """A node's stored status changed, this very moment."""

    def transitions(self, changes: Transitions) -> None:
        """What changed, told after each tick, before an error, and after a halt.

        For who keeps them: it costs a fraction of what :meth:`transition` does.
        """

    def ticked(self, tick: int, stamp: int, duration_ns: int, status: Status) -> None:
        """Tick number *tick* of the root ended with *status*.

        *stamp* is the tree clock's time (ns) at its end, *duration_ns* what it took in real time.
        """

    def raised(self, error: NodeExecutionError, stamp: int) -> None:
        """A node raised; the tree is still as it was at that moment, and is halted next."""


class Observers:
    """The observers of one tree, and the numbers of what they were told."""

    def __init__(self, clock: Clock) -> None:
        self.now: Callable[[], Any] = now_function(clock)
        self.tick = 0
        self.listeners: list[Observer] = []
        self.immediate_listeners: list[Observer] = []
        """Those who hear of each transition this very moment."""
        self._later: list[Observer] = []
        self._first = 1
        self._noted: list[object] = []
        # How many transitions these are more than one for every two places in the list.
        self._more = 0
        self._telling = False

    def record_success(self, config: NodeConfig) -> None:
        """Note that the node with *config* was IDLE and is SUCCESS, and tell it to who hears it at once."""
        moment = self.now()
        noted = self._noted
        noted.append(moment)
        noted.append(config)
        if self.immediate_listeners:
            self._tell(moment, config, IDLE, SUCCESS)

    def record_transition(self, moment: object, config: NodeConfig, previous: Status, status: Status) -> None:
        """Note another transition at *moment* of the node with *config*, and tell it in the same way."""
        noted = self._noted
        noted.append(moment)
        noted.append(config)
        noted.append(previous)
        noted.append(status)
        self._more -= 1
        if self.immediate_listeners:
            self._tell(moment, config, previous, status)

    def record_reset(self, configs: list[NodeConfig], before: list[Status], count: int) -> None:
        """Note that nodes are IDLE, of which *count* were not *before*; nobody is to hear it at once."""
        noted = self._noted
        noted.append(self.now())
        noted.append(configs)
        noted.append(before)
        noted.append(IDLE)
        self._more += count - 2

    def _tell(self, moment: object, config: NodeConfig, previous: Status, status: Status) -> None:
        """Tell of the last one."""
        number = self._first + len(self._noted) // 2 + self._more - 1
        change = _transition(number, moment, self.tick, config, previous, status)
        for listener in self.immediate_listeners:
            try:
                listener.transition(change)
            except Exception as fault:
                self._drop(listener, fault)

    def flush(self) -> None:
        """Tell what was noted and not told yet."""
        if self._telling or not self._noted:
            return
        self._telling = True
        try:
            # Again, if a listener made something change: everybody hears all in order.
            while self._noted:
                noted = self._noted
                count = len(noted) // 2 + self._more
                changes = Transitions(self._first, self.tick, noted, count)
                self._first += count
                self._noted = []
                self._more = 0
                for listener in self._later:
                    try:
                        listener.transitions(changes)
                    except Exception as fault:
                        self._drop(listener, fault)
        finally:
            self._telling = False

    def begin(self, tick: int) -> None:
        """Number *tick* of the root begins."""
        self.flush()
        self.tick = tick

    def notify_tick(self, duration_ns: int, status: Status) -> None:
        """Tell everybody that the root's tick ended."""
        self.flush()
        stamp: int = self.now()
        for listener in self.listeners:
            try:
                listener.ticked(self.tick, stamp, duration_ns, status)
            except Exception as fault:
                self._drop(listener, fault)

    def notify_error(self, error: NodeExecutionError) -> None:
        """Tell everybody that a node raised."""
        self.flush()
        stamp: int = self.now()
        for listener in self.listeners:
            try:
                listener.raised(error, stamp)
            except Exception as fault:
                self._drop(listener, fault)

    def add(self, listener: Observer) -> Callable[[], None]:
        """Let *listener* hear; the callable returned ends that."""
        self.flush()
        self._are([*self.listeners, listener])
        return Unsubscribe(self, listener)

    def remove(self, listener: Observer) -> None:
        """Let *listener* hear no more."""
        if any(one is listener for one in self.listeners):
            self.flush()
            self._are([other for other in self.listeners if other is not listener])

    def _are(self, listeners: list[Observer]) -> None:
        # New lists, so that a telling under way goes on undisturbed.
        self.listeners = listeners
        self.immediate_listeners = [
            one for one in listeners if type(one).transition is not Observer.transition
        ]
        self._later = [one for one in listeners if type(one).transitions is not Observer.transitions]

    def _drop(self, listener: Observer, fault: Exception) -> None:
        self._are([other for other in self.listeners if other is not listener])
        import logging

        logging.getLogger("btcore").warning("observer %r raised and is dropped: %r", listener, fault)


class Unsubscribe:
    """Ends one subscription when called; calling it again does nothing."""

    def __init__(self, observers: Observers, listener: Observer) -> None:
        self.observers = observers
        self.listener = listener

    def __call__(self) -> None:
        """End the subscription."""
        self.observers.remove(self.listener)
