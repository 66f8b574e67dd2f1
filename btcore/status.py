"""The words that every other file uses: what a node is, and how it stands."""

from enum import IntEnum
from typing import Final, NamedTuple


class Status(IntEnum):
    """How a node stands. The numbers are BehaviorTree.CPP's, on the wire and in logs."""

    IDLE = 0
    RUNNING = 1
    SUCCESS = 2
    FAILURE = 3
    SKIPPED = 4


class NodeType(IntEnum):
    """What family a node belongs to. The numbers are BehaviorTree.CPP's."""

    UNDEFINED = 0
    ACTION = 1
    CONDITION = 2
    CONTROL = 3
    DECORATOR = 4
    SUBTREE = 5


# An Enum look-up costs more than a tick's comparison does, so the engine uses these.
IDLE: Final = Status.IDLE
RUNNING: Final = Status.RUNNING
SUCCESS: Final = Status.SUCCESS
FAILURE: Final = Status.FAILURE
SKIPPED: Final = Status.SKIPPED


ANY_RESULT: Final = frozenset({SUCCESS, FAILURE, SKIPPED})
NO_RESULT: Final[frozenset[Status]] = frozenset()


class PossibleResults(NamedTuple):
    """The results that a node may give, for static checks. Any other result is certain not to happen.

    *in_first_tick* are the results of the tick that starts the node, *after_running* those of later ticks;
    *may_run* says whether the node can be RUNNING at all.
    """

    in_first_tick: frozenset[Status]
    after_running: frozenset[Status] = NO_RESULT
    may_run: bool = False

    @property
    def results(self) -> frozenset[Status]:
        """All results that may be."""
        return self.in_first_tick | self.after_running

    def passes(self, continue_on: Status) -> bool:
        """Whether the next child may follow, in a node that continues after *continue_on* and SKIPPED."""
        return continue_on in self.results or SKIPPED in self.results

    def mapped(self, changes: dict[Status, Status]) -> "PossibleResults":
        """The results after the replacements in *changes*."""
        return PossibleResults(
            frozenset([changes.get(status, status) for status in self.in_first_tick]),
            frozenset([changes.get(status, status) for status in self.after_running]),
            self.may_run,
        )


UNKNOWN_RESULTS: Final = PossibleResults(ANY_RESULT, ANY_RESULT, True)


class Transition(NamedTuple):
    """One change of one node's stored status.

    *number* counts from 1 within a tree and has no holes; *stamp* is the tree clock's time
    in ns; *tick* is the number of the tick that caused it (0 before the first).
    """

    number: int
    stamp: int
    tick: int
    uid: int
    previous: Status
    status: Status
