"""Statuses, node types and transitions: the basic types that all other modules use."""

from enum import IntEnum
from typing import Final, NamedTuple

from btcore.enum_members import cache_members


class _NamedNumber(IntEnum):
    """An enum whose members are numbers, but are printed and formatted as their names."""

    def __str__(self) -> str:
        return self.name

    def __format__(self, format_spec: str) -> str:
        return format(self.name, format_spec)


class Status(_NamedNumber):
    """The status of a node. The numbers are those of BehaviorTree.CPP's protocols and logs.

    The *result* of a tick is any status but IDLE. The *end results* SUCCESS, FAILURE and SKIPPED end a node.

    Attributes:
        IDLE: The node is not active.
        RUNNING: The node is not finished and needs further ticks.
        SUCCESS: The node finished with success.
        FAILURE: The node finished with failure.
        SKIPPED: The node did nothing, because a pre-condition skipped it, or all its children were skipped.

    Examples:
        >>> from btcore import SUCCESS, Status
        >>> Status.RUNNING, Status(2), Status["FAILURE"].value
        (<Status.RUNNING: 1>, <Status.SUCCESS: 2>, 3)
        >>> SUCCESS is Status.SUCCESS
        True
    """

    IDLE = 0
    RUNNING = 1
    SUCCESS = 2
    FAILURE = 3
    SKIPPED = 4


cache_members(Status)


class NodeType(_NamedNumber):
    """The type of a node. The numbers are those of BehaviorTree.CPP.

    Attributes:
        UNDEFINED: The type is not known.
        ACTION: A leaf that acts.
        CONDITION: A leaf that checks.
        CONTROL: A node with several children.
        DECORATOR: A node with one child.
        SUBTREE: A node whose child is another tree.

    Examples:
        >>> import btcore
        >>> b = btcore.Builder()
        >>> b.build(b.Sequence(b.AlwaysSuccess())).root.type
        <NodeType.CONTROL: 3>
    """

    UNDEFINED = 0
    ACTION = 1
    CONDITION = 2
    CONTROL = 3
    DECORATOR = 4
    SUBTREE = 5


IDLE: Final = Status.IDLE
"""The member `Status.IDLE`."""
RUNNING: Final = Status.RUNNING
"""The member `Status.RUNNING`."""
SUCCESS: Final = Status.SUCCESS
"""The member `Status.SUCCESS`."""
FAILURE: Final = Status.FAILURE
"""The member `Status.FAILURE`."""
SKIPPED: Final = Status.SKIPPED
"""The member `Status.SKIPPED`."""


ANY_RESULT: Final = frozenset({SUCCESS, FAILURE, SKIPPED})
"""All end results."""
NO_RESULT: Final[frozenset[Status]] = frozenset()


class PossibleResults(NamedTuple):
    """The end results that a node may return, for static checks. All other end results are impossible.

    Attributes:
        in_first_tick: The possible end results of the tick that starts the node.
        after_running: The possible end results of later ticks.
        may_run: Whether the node can be RUNNING.
    """

    in_first_tick: frozenset[Status]
    after_running: frozenset[Status] = NO_RESULT
    may_run: bool = False

    @property
    def results(self) -> frozenset[Status]:
        """The possible end results of a tick, be it the first or a later tick."""
        return self.in_first_tick | self.after_running

    def passes(self, continue_on: Status) -> bool:
        """Return whether a parent that continues after *continue_on* may tick its next child."""
        return continue_on in self.results or SKIPPED in self.results

    def replace_results(self, changes: dict[Status, Status]) -> "PossibleResults":
        """Return a copy, with each status that is a key of *changes* replaced by its value there."""
        return PossibleResults(
            frozenset([changes.get(status, status) for status in self.in_first_tick]),
            frozenset([changes.get(status, status) for status in self.after_running]),
            self.may_run,
        )


UNKNOWN_RESULTS: Final = PossibleResults(ANY_RESULT, ANY_RESULT, True)


class Transition(NamedTuple):
    """One change of the stored status of one node.

    Attributes:
        number: The number of the transition within its tree, from 1 without gaps.
        stamp: The time (ns) of the tree's clock.
        tick: The number of the latest tick that had started; 0 before the first tick.
        uid: The uid of the node.
        previous: The previous status.
        status: The new status.

    Examples:
        >>> import btcore
        >>> class Last(btcore.Observer):
        ...     def transition(self, change):
        ...         self.change = change
        >>> b = btcore.Builder()
        >>> tree = b.build(b.AlwaysSuccess())
        >>> last = Last()
        >>> unsubscribe = tree.subscribe(last)
        >>> _ = tree.tick_once()
        >>> last.change.uid, last.change.previous.name, last.change.status.name
        (1, 'SUCCESS', 'IDLE')
    """

    number: int
    stamp: int
    tick: int
    uid: int
    previous: Status
    status: Status
