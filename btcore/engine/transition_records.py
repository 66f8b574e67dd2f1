"""The recorded transitions of a tree: a flat list, which observers read as a lazy sequence of `Transition`.

To save time, the thread that ticks the tree appends only pairs of values: the time (ns) and the `NodeConfig`
of the node, then the previous and the new Status. The second pair is omitted from IDLE to SUCCESS, the most
frequent transition. The Transition objects are created on first access, on any thread.

If the children of a node are reset together, the config and the previous status are lists: the configs of all
children, and the previous statuses of the first children, or of all; IDLE = the child was not reset.

A tick in which 100 leaves succeed and are reset takes 5 % longer if no pair is omitted (compiled), and 10 %
longer if each child has its own record of the reset (pure).
"""

from collections.abc import Iterator
from typing import Any, Final, cast

from mypy_extensions import i64

from btcore.engine.node_config import NodeConfig
from btcore.status import IDLE, SUCCESS, Transition

# The constructor of Transition calls it too, but by way of an interpreted function, which takes much longer.
_new_tuple: Final[Any] = tuple.__new__


class Transitions:
    """Transitions of one tick, or of a halt, in chronological order: a lazy sequence of `Transition`.

    Args:
        first: The number of the first transition, counted from the start of the tree.
        tick: The number of the tick.
        records: The records of all transitions.
        count: The number of transitions.
    """

    def __init__(self, first: int, tick: int, records: list[object], count: int) -> None:
        self.first = first
        self.tick = tick
        self._records = records
        self._count = count
        self._transitions: list[Transition] | None = None

    def checksum(self, start: i64) -> i64:
        """Return the checksum of the transitions that follow those with the checksum *start*."""
        checksum = start
        for change in self.to_list():
            checksum = next_checksum(checksum, change.uid, change.status)
        return checksum

    def to_list(self) -> list[Transition]:
        """Return all transitions in a list."""
        transitions = self._transitions
        if transitions is None:
            self._transitions = transitions = decode_transitions(self.first, self.tick, self._records)
        return transitions

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[Transition]:
        return iter(self.to_list())

    def __getitem__(self, index: int) -> Transition:
        return self.to_list()[index]


def next_checksum(checksum: i64, uid: i64, status: i64) -> i64:
    """Return a number of 32 bits that depends on *checksum* and on a transition, but not on its time."""
    # The factor of a linear congruential generator, VAX MTH$RANDOM. The products have at most 49 bits, but
    # mypyc multiplies an int of more than 30 bits many times slower than an i64.
    return (checksum * 69069 + uid * 8 + status + 1) & 0xFFFFFFFF


def decode_transitions(number: int, tick: int, records: list[object]) -> list[Transition]:
    """Return the transitions in *records*; *number* is the number of the first."""
    transitions: list[Transition] = []
    count, at = len(records), 0
    while at < count:
        stamp, config = records[at], records[at + 1]
        previous: object = IDLE
        status: object = SUCCESS
        at += 2
        if at < count and type(records[at]) is not int:
            previous, status = records[at], records[at + 1]
            at += 2
        if type(config) is not list:
            transitions.append(create_transition(number, stamp, tick, config, previous, status))
            number += 1
            continue
        for child, before in zip(config, cast(list[object], previous), strict=False):
            if before is not IDLE:
                transitions.append(create_transition(number, stamp, tick, child, before, IDLE))
                number += 1
    return transitions


def create_transition(
    number: int, stamp: object, tick: int, config: object, previous: object, status: object
) -> Transition:
    """Return a transition, whose arguments are typed as objects because they come from the records."""
    values = (number, stamp, tick, cast(NodeConfig, config).uid, previous, status)
    transition: Transition = _new_tuple(Transition, values)
    return transition
