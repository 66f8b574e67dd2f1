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
