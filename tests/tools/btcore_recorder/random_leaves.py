"""Nodes that do anything at random: return, raise, write, wait, set statuses, and tick or halt children."""

import logging
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from random import Random

import btcore
from btcore import (
    FAILURE,
    RUNNING,
    SKIPPED,
    SUCCESS,
    Blackboard,
    Clock,
    NodeExecutionError,
    Put,
    Registry,
    Status,
)
from btcore.nodes.sequences_and_fallbacks import Sequence
from tests.conformance.recorded_cases import conformance_registry

_log = logging.getLogger(__name__)

NODE_IDS = ("Write", "Count", "Wait", "Check", "Hold", "Odd", "Anyhow", "OwnSequence")
"""The IDs of the nodes in this file."""


@dataclass
class Spot:
    """A user's type."""

    x: float
    y: float


class Colour(Enum):
    """A user's enum."""

    RED = 1
    BLUE = 2


def any_value(source: Random) -> object:
    """Return a value of any type that can be recorded."""
    values = [1, 2.5, "text", True, [1, 2], [1.5], (1, "a"), {"k": [1]}, b"bytes", float("inf"), SUCCESS]
    return source.choice([*values, Spot(source.random(), 2.0), Colour.RED])


def any_result(source: Random) -> object:
    """Return any end result, or raise. Log a message before."""
    if source.random() < 0.1:
        _log.warning("message %d", source.randrange(9))
    if source.random() < 0.05:
        raise source.choice([ValueError("bad"), KeyError("k"), RuntimeError()])
    return source.choice([True, False, SUCCESS, FAILURE, SKIPPED])


@btcore.action
def write(
    source: Random,
    board: Blackboard,
    out: Put[object],
    number: Put[int],
    spot: Put[Spot],
    colour: Put[Colour],
) -> object:
    """Write outputs and entries, and remove entries."""
    for _ in range(source.randrange(3)):
        try:
            match source.randrange(6):
                case 0:
                    out(any_value(source))
                case 1:
                    number(source.randrange(100))
                case 2:
                    spot(Spot(1.0, source.random()))
                case 3:
                    colour(source.choice(list(Colour)))
                case 4:
                    board[source.choice("abxyz")] = source.randrange(5)
                case 5:
                    board.unset(source.choice("xyz"))
        except btcore.BtcoreError:
            pass  # the entry has another type
    return any_result(source)


@btcore.action
def count(source: Random, out: Put[int]) -> Iterator[Status]:
    """Write an output in each tick."""
    for number in range(source.randrange(4)):
        out(number)
        yield RUNNING
    return any_result(source)


@btcore.action
async def wait(source: Random, clock: Clock) -> object:
    """Wait for the next tick, or for a time."""
    for _ in range(source.randrange(3)):
        await (btcore.running() if source.random() < 0.5 else btcore.sleep(0.02))
    return any_result(source)


@btcore.condition
def check(source: Random, board: Blackboard) -> bool:
    """Let another thread write an entry within the tick."""
    if source.random() < 0.3:
        number = source.randrange(9)
        thread = threading.Thread(target=lambda: board.set("a", number))
        thread.start()
        thread.join()
    return source.random() < 0.5


class Hold(btcore.StatefulAction):
    """Wakes the tree up, and writes or raises when it is halted."""

    source: Random
    out: Put[int]

    def on_start(self) -> Status:
        return RUNNING

    def on_running(self) -> object:
        if self.source.random() < 0.3:
            self.wake_up()
        return self.source.choice([RUNNING, RUNNING, True, False])

    def on_halted(self) -> None:
        if self.source.random() < 0.5:
            _log.error("halted")
            self.out = 7
        if self.source.random() < 0.2:
            raise ValueError("halted")


class Odd(btcore.DecoratorNode):
    """Ticks its child twice, halts it, forgets its exceptions, or returns RUNNING anyhow."""

    source: Random

    def tick(self) -> Status:
        source = self.source
        if source.random() < 0.3:
            self.set_status(RUNNING)
        if source.random() < 0.1:
            self.halt_child()
            return FAILURE
        try:
            status = self.child.execute_tick()
            if source.random() < 0.2:
                status = self.child.execute_tick()
        except NodeExecutionError:
            if source.random() < 0.5:
                raise
            return FAILURE
        if source.random() < 0.2:
            _log.warning("the child is reset")
            self.reset_child()
        return status if source.random() < 0.7 else RUNNING


class Anyhow(btcore.ControlNode):
    """Ticks some children in any order, and halts some."""

    source: Random

    def tick(self) -> Status:
        source = self.source
        order = list(range(len(self.children)))
        source.shuffle(order)
        self.set_status(RUNNING)
        status = SUCCESS
        for index in order[: source.randrange(1, 4)]:
            status = self.children[index].execute_tick()
            if source.random() < 0.2:
                self.halt_child(source.choice(order))
        if status is not RUNNING and source.random() < 0.8:
            self.reset_children()
        return status


class OwnSequence(Sequence):
    """A user's class that inherits the ticks of a built-in node."""


def random_registry() -> Registry:
    """Return the standard registry with the nodes of this file, and the mock leaves of the recorded cases."""
    nodes = conformance_registry()
    nodes.add_type(Spot)
    nodes.add(write, count, wait, check, Hold, Odd, Anyhow, OwnSequence)
    return nodes
