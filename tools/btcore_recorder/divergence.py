"""Comparing two runs: finding the first transition that differs."""

from dataclasses import dataclass
from itertools import zip_longest
from typing import NamedTuple

from btcore.logs import Recording
from btcore.status import IDLE, Status


class Step(NamedTuple):
    """A transition, for comparisons.

    Attributes:
        since: The time (ns) since the first transition of the run.
        path: The path of the node.
        previous: The status before the transition.
        status: The status after the transition.
    """

    since: int
    path: str
    previous: Status
    status: Status


@dataclass(frozen=True, slots=True)
class Divergence:
    """The first difference between two runs.

    Attributes:
        common: The number of transitions before the difference.
        first: The next transition of the first run; None if the first run has no more transitions.
        second: The next transition of the second run; None if the second run has no more transitions.
        by_time: Whether the two transitions differ only in their times.
    """

    common: int
    first: Step | None
    second: Step | None
    by_time: bool = False


def steps(recording: Recording, *, idle: bool = True) -> list[Step]:
    """Return the transitions of a recording for a comparison.

    Nodes are identified by their paths, since UIDs may differ between programs. Times count from the first
    transition, since some formats do not contain the start of the log.

    Args:
        recording: The recording.
        idle: Whether to include transitions to IDLE.
    """
    keys = recording.keys()
    origin = recording.transitions[0].stamp if recording.transitions else 0
    return [
        Step(stamp - origin, keys[uid], previous, status)
        for stamp, uid, previous, status in recording.transitions
        if idle or status is not IDLE
    ]


def find_divergence(first: list[Step], second: list[Step], tolerance: int | None = None) -> Divergence | None:
    """Return the first difference between two runs in node, status or order; None if there is none.

    Args:
        first: The transitions of the first run.
        second: The transitions of the second run.
        tolerance: The largest difference (ns) between the times of a transition; None to ignore times.

    Examples:
        >>> import btcore
        >>> from btcore.logs import open_log, read_log
        >>> from btcore_recorder import find_divergence, steps
        >>> b = btcore.Builder()
        >>> for name, leaf in ("a", b.AlwaysSuccess()), ("b", b.AlwaysFailure()):
        ...     tree = b.build(b.Inverter(leaf))
        ...     with open_log(tree, f"{name}.btlog"):
        ...         tree.tick_while_running()
        <Status.FAILURE: 3>
        <Status.SUCCESS: 2>
        >>> difference = find_divergence(steps(read_log("a.btlog")), steps(read_log("b.btlog")))
        >>> difference.common
        1
    """
    for common, (first_step, second_step) in enumerate(zip_longest(first, second)):
        if first_step is None or second_step is None or first_step[1:] != second_step[1:]:
            return Divergence(common, first_step, second_step)
        if tolerance is not None and abs(first_step.since - second_step.since) > tolerance:
            return Divergence(common, first_step, second_step, by_time=True)
    return None
