"""The statistics of a sweep: success rates with their intervals, durations, and failing nodes."""

import json
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import NormalDist, fmean, median
from typing import Any, Final

from btcore_sweep.definition import SweepDefinition
from btcore_sweep.table import LEADING_COLUMNS, RESULT_COLUMNS, TRAILING_COLUMNS, Row

CONFIDENCE: Final = 0.95
LEVEL: Final = f"{100 * CONFIDENCE:g} %"
"""The confidence as a percentage."""
MAX_COMBINATIONS: Final = 60
"""With more combinations of parameter values than this, the report contains no table of them."""


@dataclass(frozen=True, slots=True)
class SuccessRate:
    """*good* of *count* episodes, and the confidence interval *low* … *high* of the rate (see `wilson`)."""

    count: int
    good: int
    low: float
    high: float

    @property
    def share(self) -> float:
        """The fraction of successes, from 0 to 1; NaN without episodes."""
        return self.good / self.count if self.count else math.nan


@dataclass(frozen=True, slots=True)
class FailingNode:
    """A node that failed.

    Attributes:
        node: The path of the node.
        ended: The number of episodes in which it made the tree fail, or raised an exception.
        failed: The number of episodes in which it failed at least once.
        times: The number of its failures in all episodes together.
    """

    node: str
    ended: int
    failed: int
    times: int


@dataclass(frozen=True, slots=True)
class FigureSummary:
    """The distribution of a numeric result, such as `robot.distance_m`, over the episodes that have it."""

    name: str
    least: float
    median: float
    mean: float
    most: float


@dataclass(frozen=True, slots=True)
class SweepStatistics:
    """The statistics of a sweep.

    Attributes:
        rate: The success rate of all episodes.
        by: The success rate for each value of each parameter.
        combinations: The success rate for each combination of parameter values, if there are several
            parameters.
        statuses: The number of episodes with each status.
        times: The simulated duration (s) of each episode, and whether it was a success.
        failing: The nodes that failed.
        spreads: The distribution of each numeric result.
        failed: The rows of the episodes without success.
    """

    rate: SuccessRate
    by: dict[str, dict[str, SuccessRate]]
    combinations: list[tuple[dict[str, str], SuccessRate]]
    statuses: dict[str, int]
    times: list[tuple[float, bool]]
    failing: list[FailingNode]
    spreads: list[FigureSummary]
    failed: list[Row]


def compute_statistics(rows: Sequence[Row], definition: SweepDefinition) -> SweepStatistics:
    """Return the statistics of a sweep.

    Args:
        rows: The rows of the finished episodes, with the column `success`.
    """
    combinations = definition.combinations
    several = 1 < len(combinations) <= MAX_COMBINATIONS and len(definition.varied) > 1
    # Episodes are numbered seed by seed, so that the remainder is the index of the combination.
    groups = _grouped(rows, lambda row: row["episode"] % len(combinations)) if several else {}
    times = [(float(row["time_s"]), bool(row["success"])) for row in rows if row["time_s"] is not None]
    return SweepStatistics(
        rate(rows),
        {key: _by_value(rows, definition, key) for key in definition.varied},
        [(combinations[number], rate(group)) for number, group in sorted(groups.items())],
        dict(Counter(str(row["status"]) for row in rows).most_common()),
        times,
        _failing(rows),
        _spreads(rows),
        [row for row in rows if not row["success"]],
    )


def rate(rows: Sequence[Row]) -> SuccessRate:
    """Return the success rate of *rows*."""
    good = sum(bool(row["success"]) for row in rows)
    return SuccessRate(len(rows), good, *wilson(good, len(rows)))


def wilson(good: int, count: int) -> tuple[float, float]:
    """Return Wilson's score interval for the probability of a success, at the level `CONFIDENCE`.

    E. B. Wilson, "Probable inference, the law of succession, and statistical inference", JASA 22 (1927). The
    interval is also valid for few episodes, and for rates of 0 and 1, where the normal approximation has a
    width of 0.

    Args:
        good: The number of successes.
        count: The number of episodes.

    Returns:
        The lower and the upper end of the interval.
    """
    if count == 0:
        return 0.0, 1.0
    z = NormalDist().inv_cdf(0.5 + CONFIDENCE / 2)
    share, weight = good / count, z * z / count
    middle = (share + weight / 2) / (1 + weight)
    half = z / (1 + weight) * math.sqrt(share * (1 - share) / count + weight / (4 * count))
    # At rates of 0 and 1 an end of the interval is exactly 0 or 1, which rounding errors would miss.
    return (0.0 if good == 0 else middle - half), (1.0 if good == count else middle + half)


def _by_value(rows: Sequence[Row], definition: SweepDefinition, key: str) -> dict[str, SuccessRate]:
    combinations = definition.combinations
    groups = _grouped(rows, lambda row: combinations[row["episode"] % len(combinations)][key])
    return {value: rate(groups[value]) for value in definition.varied[key] if value in groups}


def _grouped(rows: Sequence[Row], key: Callable[[Row], Any]) -> dict[Any, list[Row]]:
    groups: dict[Any, list[Row]] = {}
    for row in rows:
        groups.setdefault(key(row), []).append(row)
    return groups


def _failing(rows: Sequence[Row]) -> list[FailingNode]:
    ended = Counter(str(row["failed_at"]) for row in rows if row["failed_at"] is not None)
    failed: Counter[str] = Counter()
    times: Counter[str] = Counter()
    for row in rows:
        for path, count in json.loads(row["failures"] or "{}").items():
            failed[path] += 1
            times[path] += count
    nodes = [FailingNode(path, ended[path], failed[path], times[path]) for path in {*ended, *failed}]
    return sorted(nodes, key=lambda node: (-node.ended, -node.failed, -node.times, node.node))


def _spreads(rows: Sequence[Row]) -> list[FigureSummary]:
    """Return the distributions of the duration, the ticks, and each numeric result of the extensions."""
    known = {*LEADING_COLUMNS, *RESULT_COLUMNS, *TRAILING_COLUMNS} - {"time_s", "ticks"}
    names = dict.fromkeys(key for row in rows for key in row if key not in known)
    summaries = []
    for name in names:
        values = [row[name] for row in rows if _is_number(row.get(name))]
        if values and not name.startswith("param."):
            numbers = min(values), median(values), fmean(values), max(values)
            summaries.append(FigureSummary(name, *map(float, numbers)))
    return summaries


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
