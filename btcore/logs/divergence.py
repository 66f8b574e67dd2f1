"""Where two runs part: the first of their transitions in which they differ."""

from dataclasses import dataclass
from itertools import zip_longest
from typing import NamedTuple

from btcore.logs.recording import Recording
from btcore.status import IDLE, Status


class Step(NamedTuple):
    """A transition as runs are compared: *since* the run's first one (ns), the node's path, the statuses."""

    since: int
    path: str
    previous: Status
    status: Status


@dataclass(frozen=True, slots=True)
class Divergence:
    """Two runs part after *common* transitions; *by_time* tells that there only the times differ.

    One of *first* and *second*, the steps there, is None where its run ends.
    """

    common: int
    first: Step | None
    second: Step | None
    by_time: bool = False


def steps(recording: Recording, *, idle: bool = True) -> list[Step]:
    """The transitions of *recording*, without those to IDLE if *idle* is false.

    Nodes are named by their paths, for uids may differ between programs; times count from the first
    transition, for not every format knows when its log began.
    """
    keys = recording.keys()
    origin = recording.transitions[0].stamp if recording.transitions else 0
    return [
        Step(stamp - origin, keys[uid], previous, status)
        for stamp, uid, previous, status in recording.transitions
        if idle or status is not IDLE
    ]


def find_divergence(first: list[Step], second: list[Step], tolerance: int | None = None) -> Divergence | None:
    """Where *first* and *second* part: by node, by status, by order; None if they don't.

    With a *tolerance* (ns) also where one comes so much earlier than the other.
    """
    for common, (one, other) in enumerate(zip_longest(first, second)):
        if one is None or other is None or one[1:] != other[1:]:
            return Divergence(common, one, other)
        if tolerance is not None and abs(one.since - other.since) > tolerance:
            return Divergence(common, one, other, by_time=True)
    return None
