"""The recorded transitions of a tree: a flat list, which observers read as a lazy sequence of `Transition`.

To save time, the thread that ticks the tree appends only values that it has at hand. The Transition objects
are created on first access, on any thread. The list is a series of records of three forms:

    a transition         | time | config  | previous   | status |
    IDLE to SUCCESS      | time | config  |
    a reset of nodes     | time | configs | statuses   | IDLE   |

    time         the time (ns) of the tree's clock, an int
    config       the NodeConfig of the node
    previous     the previous Status
    status       the new Status
    configs      a list with the configs of the children of a node
    statuses     a list with the previous Status of each child, or of the first; IDLE = it was not reset

IDLE to SUCCESS is the most frequent transition. The third value distinguishes the forms: a Status, the time
of the next record or nothing, or a list. For example, a Sequence (s) with the leaves a and b succeeds:

    | 0 | s | IDLE | RUNNING | 3 | a | 5 | b | 7 | [a, b] | [SUCCESS, SUCCESS] | IDLE | ...
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
        stamp, node = records[at], records[at + 1]
        third = records[at + 2] if at + 2 < count else 0
        following = number + len(transitions)
        if type(third) is int:
            transitions.append(create_transition(following, stamp, tick, node, IDLE, SUCCESS))
            at += 2
        elif type(third) is list:
            for config, previous in zip(cast(list[object], node), third, strict=False):
                if previous is not IDLE:
                    transitions.append(create_transition(following, stamp, tick, config, previous, IDLE))
                    following += 1
            at += 4
        else:
            transitions.append(create_transition(following, stamp, tick, node, third, records[at + 3]))
            at += 4
    return transitions


def create_transition(
    number: int, stamp: object, tick: int, config: object, previous: object, status: object
) -> Transition:
    """Return a transition, whose arguments are typed as objects because they come from the records."""
    values = (number, stamp, tick, cast(NodeConfig, config).uid, previous, status)
    transition: Transition = _new_tuple(Transition, values)
    return transition
