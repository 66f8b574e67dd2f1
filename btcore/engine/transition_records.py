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

from collections.abc import Callable, Iterator
from typing import Any, Final, cast

from mypy_extensions import i64

from btcore.clock import FAST_NOW, Clock
from btcore.engine.node_config import NodeConfig
from btcore.status import IDLE, SUCCESS, Status, Transition

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
        """The number of the first transition."""
        self.tick = tick
        self._records = records
        self._count = count
        self._transitions: list[Transition] | None = None

    def checksum(self, start: i64) -> i64:
        """Return a number of 32 bits that depends on *start*, the nodes and the statuses, not on times."""
        # A loop of its own: creating the Transition objects by `to_list` takes five times as long (compiled).
        checksum = start
        records = self._records
        count, at = len(records), 0
        while at < count:
            node = records[at + 1]
            third = records[at + 2] if at + 2 < count else 0
            if type(third) is int:
                checksum = _add_to_checksum(checksum, node, SUCCESS)
                at += 2
            elif type(third) is list:
                for config, previous in zip(cast(list[object], node), third, strict=False):
                    if previous is not IDLE:
                        checksum = _add_to_checksum(checksum, config, IDLE)
                at += 4
            else:
                checksum = _add_to_checksum(checksum, node, cast(Status, records[at + 3]))
                at += 4
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


class TransitionRecorder:
    """Records the transitions of a tree.

    Attributes:
        now: Returns the time (ns) of the tree's clock.
        tick: The number of the latest tick that has started.
        notifies_at_once: Whether `notify_at_once` is called after each transition.
        has_checksum: Whether `checksum` is computed.
        checksum: The checksum of all transitions, except those since the last call of `take_transitions`.
        only_sums: Whether transitions are only added to the checksum, and not recorded.
    """

    def __init__(self, clock: Clock) -> None:
        self.now: Callable[[], Any] = FAST_NOW.get(type(clock), clock.now)
        self.tick = 0
        self.notifies_at_once = False
        self.has_checksum = False
        self.checksum: i64 = 0
        self.only_sums = False
        self._first = 1  # the number of the first recorded transition
        self._records: list[object] = []
        self._count = 0  # of the recorded transitions

    def record_success(self, config: NodeConfig) -> None:
        """Record the transition from IDLE to SUCCESS of the node with *config*."""
        if self.only_sums:
            self._add_to_checksum(config, SUCCESS)
            return
        stamp = self.now()
        records = self._records
        records.append(stamp)
        records.append(config)
        self._count += 1
        if self.notifies_at_once:
            self.notify_at_once(self._latest(stamp, config, IDLE, SUCCESS))

    def record_transition(self, config: NodeConfig, previous: Status, status: Status) -> None:
        """Record a transition of the node with *config*."""
        if self.only_sums:
            self._add_to_checksum(config, status)
            return
        self._record(self.now(), config, previous, status)

    def _record(self, stamp: object, config: NodeConfig, previous: Status, status: Status) -> None:
        # *stamp* is typed as object because mypyc would unbox and box an int again.
        records = self._records
        records.append(stamp)
        records.append(config)
        records.append(previous)
        records.append(status)
        self._count += 1
        if self.notifies_at_once:
            self.notify_at_once(self._latest(stamp, config, previous, status))

    def record_resets(self, configs: list[NodeConfig], before: list[Status], count: int) -> None:
        """Record that children of a node were reset.

        Args:
            configs: The configs of all children.
            before: The previous statuses of the first children, or of all; IDLE = the child was not reset.
            count: The number of children that were reset.
        """
        if self.only_sums:
            for index in range(len(before)):  # compiled, this is faster than zip()
                if before[index] is not IDLE:
                    self._add_to_checksum(configs[index], IDLE)
            return
        stamp = self.now()
        if self.notifies_at_once:
            for config, previous in zip(configs, before, strict=False):
                if previous is not IDLE:
                    self._record(stamp, config, previous, IDLE)
            return
        records = self._records
        records.append(stamp)
        records.append(configs)
        records.append(before)
        records.append(IDLE)
        self._count += count

    def _add_to_checksum(self, config: NodeConfig, status: Status) -> None:
        self.checksum = _add_to_checksum(self.checksum, config, status)
        self._first += 1

    def notify_at_once(self, change: Transition) -> None:
        """Handle a transition when it is recorded. Subclasses override this method."""

    @property
    def records(self) -> list[object]:
        """The records since the last call of `take_transitions`."""
        return self._records

    @property
    def has_records(self) -> bool:
        """Whether transitions were recorded since the last call of `take_transitions`."""
        return bool(self._records)

    def take_transitions(self) -> Transitions:
        """Return the transitions that were recorded since the last call."""
        changes = Transitions(self._first, self.tick, self._records, self._count)
        if self.has_checksum:
            self.checksum = changes.checksum(self.checksum)
        self._first += self._count
        self._records = []
        self._count = 0
        return changes

    def _latest(self, stamp: object, config: NodeConfig, previous: Status, status: Status) -> Transition:
        number = self._first + self._count - 1
        return _create_transition(number, stamp, self.tick, config, previous, status)


def _add_to_checksum(checksum: i64, config: object, status: Status) -> i64:
    # The factor of a linear congruential generator, VAX MTH$RANDOM. The products have at most 49 bits, but
    # mypyc multiplies an int of more than 30 bits many times slower than an i64.
    return (checksum * 69069 + cast(NodeConfig, config).uid * 8 + cast(i64, status) + 1) & 0xFFFFFFFF


def decode_transitions(number: int, tick: int, records: list[object]) -> list[Transition]:
    """Return the transitions in *records*; *number* is the number of the first."""
    transitions: list[Transition] = []
    count, at = len(records), 0
    while at < count:
        stamp, node = records[at], records[at + 1]
        third = records[at + 2] if at + 2 < count else 0
        following = number + len(transitions)
        if type(third) is int:
            transitions.append(_create_transition(following, stamp, tick, node, IDLE, SUCCESS))
            at += 2
        elif type(third) is list:
            for config, previous in zip(cast(list[object], node), third, strict=False):
                if previous is not IDLE:
                    transitions.append(_create_transition(following, stamp, tick, config, previous, IDLE))
                    following += 1
            at += 4
        else:
            transitions.append(_create_transition(following, stamp, tick, node, third, records[at + 3]))
            at += 4
    return transitions


def _create_transition(
    number: int, stamp: object, tick: int, config: object, previous: object, status: object
) -> Transition:
    values = (number, stamp, tick, cast(NodeConfig, config).uid, previous, status)
    transition: Transition = _new_tuple(Transition, values)
    return transition
