"""Parts that fail on purpose: ``laser:20-25`` is a laser that is dead from 20 s to 25 s of simulated time."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from btcore_robot.field_reader import did_you_mean
from btcore_sim.errors import SimError

PARTS = {
    "laser": "no new scan comes",
    "odometry": "no new odometry comes",
    "camera": "no new picture comes",
    "wheel": "the motor of the left wheel doesn't turn",
}
"""What can fail, and what that means."""

_FORM = re.compile(r"(?P<part>[^:]*):(?P<start>\d+(?:\.\d+)?)-(?P<end>\d+(?:\.\d+)?)?")


@dataclass(frozen=True, slots=True)
class Fault:
    """*part* is dead from *start* to *end* (ns); *start* belongs to it, *end* does not."""

    part: str
    start: float
    end: float


class FaultSchedule:
    """All that fails in one run."""

    def __init__(self, faults: Sequence[Fault] = ()) -> None:
        self._faults = tuple(faults)

    def dead(self, part: str, now: int) -> bool:
        """Whether *part* fails at *now* (ns)."""
        return any(fault.part == part and fault.start <= now < fault.end for fault in self._faults)


def parse_fault(text: str) -> Fault:
    """The fault written ``PART:START-END`` (s; without END it lasts); raises `SimError`."""
    found = _FORM.fullmatch(text.strip())
    if found is None:
        raise SimError(f"fault '{text}': the form is PART:START-END in seconds, like laser:20-25")
    part = found["part"]
    if part not in PARTS:
        raise SimError(f"fault '{text}': {did_you_mean(part, PARTS)}what can fail is {', '.join(PARTS)}")
    start = float(found["start"]) * 1e9
    end = float(found["end"]) * 1e9 if found["end"] else math.inf
    if end <= start:
        raise SimError(f"fault '{text}': it ends before it starts")
    return Fault(part, start, end)
