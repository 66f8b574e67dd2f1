"""Simulated failures: with `laser:20-25` the laser fails from 20 s to 25 s of simulated time."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from btcore.clock import NS_PER_S
from btcore.suggestions import did_you_mean
from btcore_sim.errors import SimError

__all__ = ["Fault", "parse_fault"]

PARTS = {
    "laser": "no new scan comes",
    "odometry": "no new odometry comes",
    "camera": "no new picture comes",
    "wheel": "the motor of the left wheel doesn't turn",
}
"""The parts that can fail, each with the effect of its failure."""

_FORM = re.compile(r"(?P<part>[^:]*):(?P<start>\d+(?:\.\d+)?)-(?P<end>\d+(?:\.\d+)?)?")


@dataclass(frozen=True, slots=True)
class Fault:
    """A failure of *part* from *start* (inclusive) to *end* (exclusive, None = of the run), in ns."""

    part: str
    start: int
    end: int | None

    def __str__(self) -> str:
        """Return the fault in the form of the option `--fault`."""
        end = "" if self.end is None else f"{self.end / NS_PER_S:g}"
        return f"{self.part}:{self.start / NS_PER_S:g}-{end}"


class FaultSchedule:
    """The failures of a run: which part has failed at which time.

    Attributes:
        faults: The failures, which may be replaced.
    """

    def __init__(self, faults: Sequence[Fault] = ()) -> None:
        self.faults = faults

    def has_failed(self, part: str, now: int) -> bool:
        """Return whether a part has failed.

        Args:
            part: The part, a key of `PARTS`.
            now: The simulated time (ns).
        """
        return any(
            fault.part == part and fault.start <= now and (fault.end is None or now < fault.end)
            for fault in self.faults
        )

    def begun(self, now: int) -> list[Fault]:
        """Return the failures that began before *now* (ns), also those that have ended."""
        return [fault for fault in self.faults if fault.start < now]


def parse_fault(text: str) -> Fault:
    """Parse a fault of the option `--fault`.

    Args:
        text: `PART:START-END`, with the times in s. Without END the fault lasts until the end of the run.

    Returns:
        The fault.

    Raises:
        SimError: *text* has another form, an unknown part, or an end before its start.

    Examples:
        >>> from btcore_sim.faults import parse_fault
        >>> parse_fault("laser:10-20").part
        'laser'
    """
    match = _FORM.fullmatch(text.strip())
    if match is None:
        raise SimError(f"invalid fault '{text}': use PART:START-END in seconds, like laser:20-25")
    part = match["part"]
    if part not in PARTS:
        raise SimError(
            f"fault '{text}': unknown part '{part}': parts are {', '.join(PARTS)}{did_you_mean(part, PARTS)}"
        )
    start = round(float(match["start"]) * NS_PER_S)
    end = round(float(match["end"]) * NS_PER_S) if match["end"] else None
    if end is not None and end <= start:
        raise SimError(f"fault '{text}': it ends before it starts")
    return Fault(part, start, end)
