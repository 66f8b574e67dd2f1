"""Find the node that made a recorded tree fail, and the path from the root to it."""

from bisect import bisect_left
from collections import defaultdict
from typing import NamedTuple

from btcore.logs.recording import RecordedNode, Recording
from btcore.status import IDLE, RUNNING, Status


class FailureStep(NamedTuple):
    """A node on the path from the root to the node that made the tree fail.

    Attributes:
        node: The node.
        stamp: The time (ns since 1970) at which it failed.
        results: The last result of each child in the run of the node that failed, by UID; None for a child
            that had no result, because it was not ticked or because it was halted.
    """

    node: RecordedNode
    stamp: int
    results: dict[int, Status | None]


def find_failure(recording: Recording) -> list[FailureStep]:
    """Return the path from the root to the node that made the tree fail.

    The search starts at the last result of the root. It descends to the child that failed last, until a node
    has no failed child: a leaf, or a decorator whose child did not fail, such as an Inverter.

    Returns:
        The nodes from the root down; the last is the cause. Empty if the last result of the root is not
        FAILURE, or if the root has no result.
    """
    ends: dict[int, list[int]] = defaultdict(list)
    for number, change in enumerate(recording.transitions):
        if change.status is not RUNNING:
            ends[change.uid].append(number)

    def last_result(uid: int, after: int, before: int) -> int | None:
        """Return the index of the last result of a node between two transitions."""
        own = ends[uid]
        for number in reversed(own[: bisect_left(own, before)]):
            if number <= after:
                return None
            if recording.transitions[number].status is not IDLE:
                return number
        return None

    steps: list[FailureStep] = []
    node = next(iter(recording.nodes.values()), None)
    at = None if node is None else last_result(node.uid, -1, len(recording.transitions))
    while node is not None and at is not None and recording.transitions[at].status is Status.FAILURE:
        own = ends[node.uid]
        position = bisect_left(own, at)
        began = own[position - 1] if position else -1
        found = {uid: last_result(uid, began, at) for uid in node.children}
        results = {
            uid: None if number is None else recording.transitions[number].status
            for uid, number in found.items()
        }
        steps.append(FailureStep(node, recording.transitions[at].stamp, results))
        failed = [(number, uid) for uid, number in found.items() if number is not None]
        failed = [pair for pair in failed if results[pair[1]] is Status.FAILURE]
        at, child = max(failed, default=(None, None))
        node = None if child is None else recording.nodes[child]
    return steps
