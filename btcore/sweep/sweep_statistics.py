"""What the rows of a sweep come to: rates of success with their intervals, times, who failed."""

import json
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import NormalDist, fmean, median
from typing import Any, Final

from btcore.sweep.definition import SweepDefinition
from btcore.sweep.table import (
    LEADING_COLUMNS,
    RESULT_COLUMNS,
    TRAILING_COLUMNS,
    Row,
)

CONFIDENCE: Final = 0.95
LEVEL: Final = f"{100 * CONFIDENCE:g} %"
"""The confidence as people write it."""
MOST_SETTINGS: Final = 60
"""Settings that are told of one by one."""


@dataclass(frozen=True, slots=True)
class SuccessRate:
    """*good* of *count* episodes, and the interval *low* … *high* that holds the true rate (see `wilson`)."""

    count: int
    good: int
    low: float
    high: float

    @property
    def share(self) -> float:
        """The part that was good, from 0 to 1; nan of none."""
        return self.good / self.count if self.count else math.nan


@dataclass(frozen=True, slots=True)
class FailingNode:
    """A node that failed: how many episodes *ended* by it, in how many it *failed*, and *times* in all."""

    node: str
    ended: int
    failed: int
    times: int


@dataclass(frozen=True, slots=True)
class FigureSummary:
    """A figure over all episodes that have it."""

    name: str
    count: int
    least: float
    median: float
    mean: float
    most: float


@dataclass(frozen=True, slots=True)
class SweepStatistics:
    """All that is told of a sweep.

    *by* has a rate for each value of each parameter, *settings* one for each combination where there are
    several parameters; *times* are the episodes' (s, simulated) with whether each was a success.
    """

    rate: SuccessRate
    by: dict[str, dict[str, SuccessRate]]
    settings: list[tuple[dict[str, str], SuccessRate]]
    statuses: dict[str, int]
    times: list[tuple[float, bool]]
    failing: list[FailingNode]
    spreads: list[FigureSummary]
    failed: list[Row]


def compute_statistics(rows: Sequence[Row], definition: SweepDefinition) -> SweepStatistics:
    """The figures of *rows*, which know whether they are a success."""
    several = 1 < len(definition.settings) <= MOST_SETTINGS and len(definition.varied) > 1
    setting = _grouped(rows, lambda one: one["episode"] % len(definition.settings)) if several else {}
    numbers = [(float(one["time_s"]), bool(one["success"])) for one in rows if one["time_s"] is not None]
    return SweepStatistics(
        rate(rows),
        {key: _by_value(rows, definition, key) for key in definition.varied},
        [(definition.settings[place], rate(group)) for place, group in sorted(setting.items())],
        dict(Counter(str(one["status"]) for one in rows).most_common()),
        numbers,
        _failing(rows),
        _spreads(rows),
        [one for one in rows if not one["success"]],
    )


def rate(rows: Sequence[Row]) -> SuccessRate:
    """How many of *rows* are a success."""
    good = sum(bool(one["success"]) for one in rows)
    return SuccessRate(len(rows), good, *wilson(good, len(rows)))


def wilson(good: int, count: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Wilson's score interval for the probability of which *good* out of *count* were seen.

    E. B. Wilson, Probable inference, the law of succession, and statistical inference, JASA 22 (1927). It
    holds for few episodes, and for rates at 0 and 1, where the usual ± is nothing.
    """
    if count == 0:
        return 0.0, 1.0
    z = NormalDist().inv_cdf(0.5 + confidence / 2)
    share, weight = good / count, z * z / count
    middle = (share + weight / 2) / (1 + weight)
    half = z / (1 + weight) * math.sqrt(share * (1 - share) / count + weight / (4 * count))
    # At the ends it is exact, and rounding isn't.
    return (0.0 if good == 0 else middle - half), (1.0 if good == count else middle + half)


def _by_value(rows: Sequence[Row], definition: SweepDefinition, key: str) -> dict[str, SuccessRate]:
    groups = _grouped(rows, lambda one: definition.settings[one["episode"] % len(definition.settings)][key])
    return {value: rate(groups[value]) for value in definition.varied[key] if value in groups}


def _grouped(rows: Sequence[Row], key: Callable[[Row], Any]) -> dict[Any, list[Row]]:
    groups: dict[Any, list[Row]] = {}
    for one in rows:
        groups.setdefault(key(one), []).append(one)
    return groups


def _failing(rows: Sequence[Row]) -> list[FailingNode]:
    ended = Counter(str(one["failed_at"]) for one in rows if one["failed_at"] is not None)
    failed: Counter[str] = Counter()
    times: Counter[str] = Counter()
    for one in rows:
        for path, count in json.loads(one["failures"] or "{}").items():
            failed[path] += 1
            times[path] += count
    found = [FailingNode(path, ended[path], failed[path], times[path]) for path in {*ended, *failed}]
    return sorted(found, key=lambda one: (-one.ended, -one.failed, -one.times, one.node))


def _spreads(rows: Sequence[Row]) -> list[FigureSummary]:
    """Of the time, the ticks, and each figure that is a number."""
    known = {*LEADING_COLUMNS, *RESULT_COLUMNS, *TRAILING_COLUMNS} - {"time_s", "ticks"}
    names = dict.fromkeys(key for one in rows for key in one if key not in known)
    found = []
    for name in names:
        values = [one[name] for one in rows if _is_number(one.get(name))]
        if values and not name.startswith("param."):
            numbers = min(values), median(values), fmean(values), max(values)
            found.append(FigureSummary(name, len(values), *map(float, numbers)))
    return found


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
