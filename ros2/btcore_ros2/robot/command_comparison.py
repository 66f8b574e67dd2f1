"""Comparison of the commands of a run on a bag with the commands that the bag contains."""

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from btcore.clock import NS_PER_S

TOLERANCE = 0.001
"""The greatest difference (m/s, rad/s, rad or m) of commands that agree."""

Values = Mapping[str, float]
"""A command: a velocity with *v* and *w*, or the positions of joints."""


class _Difference(NamedTuple):
    """Two commands at the time *stamp* (ns) that differ; None = there is no command at that time."""

    stamp: int
    sent: Values | None
    recorded: Values | None


class CommandComparison:
    """Collects commands by topic, and compares those that were sent with those that were recorded.

    A command that was sent is compared with the recorded command of the nearest stamp. Of several commands
    on a topic at the same time, the last counts.

    Args:
        window: The greatest difference (ns) of the stamps of two commands that are compared.
    """

    def __init__(self, window: int) -> None:
        self._window = window
        self._sent: dict[str, dict[int, Values]] = {}
        self._recorded: dict[str, dict[int, Values]] = {}

    def add_sent(self, topic: str, stamp: int, values: Values) -> None:
        """Add a command of this run.

        Args:
            topic: The topic of the command.
            stamp: The time (ns).
        """
        self._sent.setdefault(topic, {})[stamp] = values

    def add_recorded(self, topic: str, stamp: int, values: Values) -> None:
        """Add a command of the bag.

        Args:
            topic: The topic of the command.
            stamp: The time (ns).
        """
        self._recorded.setdefault(topic, {})[stamp] = values

    def report(self, start: int, end: int) -> dict[str, object]:
        """Return the result for each topic with commands, as JSON data; times are in s since *start*.

        Args:
            start: The time (ns) of the first commands to compare.
            end: The time (ns) before which the commands to compare were sent.
        """
        report: dict[str, object] = {}
        for topic in sorted({*self._sent, *self._recorded}):
            sent, recorded = (
                {stamp: values for stamp, values in side.get(topic, {}).items() if start <= stamp < end}
                for side in (self._sent, self._recorded)
            )
            if sent or recorded:
                report[topic] = self._compare(sent, recorded, start)
        return report

    def _compare(
        self, sent: Mapping[int, Values], recorded: Mapping[int, Values], start: int
    ) -> dict[str, object]:
        sent_stamps, recorded_stamps = sorted(sent), sorted(recorded)
        differences: list[_Difference] = []
        largest, agree, only_sent, only_recorded = 0.0, 0, 0, 0
        for stamp in sent_stamps:
            partner = self._nearest(recorded_stamps, stamp)
            if partner is None:
                only_sent += 1
                differences.append(_Difference(stamp, sent[stamp], None))
                continue
            ours, theirs = sent[stamp], recorded[partner]
            difference = max(abs(ours[name] - theirs[name]) for name in ours)
            largest = max(largest, difference)
            if difference <= TOLERANCE:
                agree += 1
            else:
                differences.append(_Difference(stamp, ours, theirs))
        for stamp in recorded_stamps:
            if self._nearest(sent_stamps, stamp) is None:
                only_recorded += 1
                differences.append(_Difference(stamp, None, recorded[stamp]))
        first = min(differences, key=lambda difference: difference.stamp, default=None)
        return {
            "sent": len(sent),
            "recorded": len(recorded),
            "agree": agree,
            "differ": len(sent) - agree - only_sent,
            "only_sent": only_sent,
            "only_recorded": only_recorded,
            "largest_difference": round(largest, 6),
            "first_difference": None if first is None else _as_data(first, start),
        }

    def _nearest(self, stamps: Sequence[int], stamp: int) -> int | None:
        """Return the stamp in the sorted *stamps* that is nearest to *stamp*, or None outside the window."""
        place = bisect_left(stamps, stamp)
        nearest = min(
            stamps[max(place - 1, 0) : place + 1], key=lambda other: abs(other - stamp), default=None
        )
        return None if nearest is None or abs(nearest - stamp) > self._window else nearest


def _as_data(difference: _Difference, start: int) -> dict[str, object]:
    sides = {"sent": difference.sent, "recorded": difference.recorded}
    return {
        "time_s": round((difference.stamp - start) / NS_PER_S, 3),
        **{side: None if values is None else dict(values) for side, values in sides.items()},
    }
