"""Subscribing to what happens in a tree: transitions, ticks and errors.

Telemetry never ticks: an observer may be slow or wrong, the tree does not notice. One that
raises is dropped, with a warning in the log.
"""

import logging
from collections.abc import Callable

from mypy_extensions import mypyc_attr

from btcore.clock import Clock
from btcore.errors import NodeRaised
from btcore.status import Status, Transition

_log = logging.getLogger("btcore")


@mypyc_attr(allow_interpreted_subclasses=True)
class Observer:
    """What an observer may hear. Subclass it and override what you need.

    Every method runs on the thread that ticks, between two steps of the tree: be brief, and hand
    over to a thread of your own what takes time.
    """

    def transition(self, change: Transition) -> None:
        """A node's stored status changed."""

    def ticked(self, tick: int, stamp: int, duration_ns: int, status: Status) -> None:
        """Tick number *tick* of the root ended with *status*.

        *stamp* is the tree clock's time (ns) at its end, *duration_ns* what it took in real time.
        """

    def raised(self, error: NodeRaised, stamp: int) -> None:
        """A node raised; the tree is still as it was at that moment, and is halted next."""


class Observers:
    """The observers of one tree, and the numbers of what they were told."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.number = 0
        self.tick = 0
        self.listeners: list[Observer] = []

    def changed(self, uid: int, previous: Status, status: Status) -> None:
        """Tell everybody of a transition of node *uid*."""
        self.number += 1
        change = Transition(self.number, self.clock.now(), self.tick, uid, previous, status)
        for listener in self.listeners:
            try:
                listener.transition(change)
            except Exception as fault:
                self._drop(listener, fault)

    def ticked(self, duration_ns: int, status: Status) -> None:
        """Tell everybody that the root's tick ended."""
        stamp = self.clock.now()
        for listener in self.listeners:
            try:
                listener.ticked(self.tick, stamp, duration_ns, status)
            except Exception as fault:
                self._drop(listener, fault)

    def raised(self, error: NodeRaised) -> None:
        """Tell everybody that a node raised."""
        stamp = self.clock.now()
        for listener in self.listeners:
            try:
                listener.raised(error, stamp)
            except Exception as fault:
                self._drop(listener, fault)

    def add(self, listener: Observer) -> Callable[[], None]:
        """Let *listener* hear; the callable returned ends that."""
        self.listeners = [*self.listeners, listener]
        return Unsubscribe(self, listener)

    def remove(self, listener: Observer) -> None:
        """Let *listener* hear no more. A new list, so that a telling under way goes on undisturbed."""
        self.listeners = [other for other in self.listeners if other is not listener]

    def _drop(self, listener: Observer, fault: Exception) -> None:
        self.remove(listener)
        _log.warning("observer %r raised and is dropped: %r", listener, fault)


class Unsubscribe:
    """Ends one subscription when called; calling it again does nothing."""

    def __init__(self, observers: Observers, listener: Observer) -> None:
        self.observers = observers
        self.listener = listener

    def __call__(self) -> None:
        """End the subscription."""
        self.observers.remove(self.listener)
