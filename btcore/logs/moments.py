"""The moments of a run that is run again from its recording: what tools that show a recording get of it."""

from collections.abc import Mapping
from typing import NamedTuple

from btcore.status import Status

Values = Mapping[str, str]
"""Values as texts, by the name of the port or the key."""


class LeafTick(NamedTuple):
    """The last tick of a leaf in a step.

    Attributes:
        uid: The number of the leaf.
        path: The path of the leaf.
        status: The result; IDLE if the leaf raised an exception.
        inputs: The values of its inputs, and of the entries that its script reads.
        outputs: The values of its outputs afterwards, of an external leaf only those that it wrote, and of
            the entries that its script writes; also the messages that it logged, as "logged".
        error: The text of the exception that the leaf raised, or "".
    """

    uid: int
    path: str
    status: Status
    inputs: Values
    outputs: Values
    error: str = ""


class Moment(NamedTuple):
    """The tree after a number of steps.

    Attributes:
        position: The number of steps.
        tick: The number of the tick; 0 for a halt, and before the first step.
        time: The time at which the tick began (ns since the recording began).
        root: The result of the tick.
        statuses: The status of each node, in the order of the tree.
        results: The last result of each node that is idle, or IDLE.
        entries: The entries of the blackboards as (path of the subtree, key, value as text).
        leaves: The leaves that were ticked in the step, in order.
        problem: Where the replay differs from the recording, so that it cannot continue, or "".
    """

    position: int
    tick: int
    time: int
    root: Status
    statuses: tuple[Status, ...]
    results: tuple[Status, ...]
    entries: tuple[tuple[str, str, str], ...]
    leaves: tuple[LeafTick, ...]
    problem: str


class Explanation(NamedTuple):
    """Why a node did what it did.

    Attributes:
        question: The question.
        answer: The answer in one or two sentences.
        links: The chain from the result to what it depends on: the number of the node (0 = outside of the
            tree), the number of the tick, why the node did what it did, and what was tried in a replay or "".
    """

    question: str
    answer: str
    links: tuple[tuple[int, int, str, str], ...]
