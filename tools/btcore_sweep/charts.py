"""The charts of the report, as SVG whose colours come from the style sheet of the page."""

import math
from collections.abc import Sequence
from html import escape
from typing import Final

from btcore_sweep.sweep_statistics import LEVEL, SuccessRate

_MAX_BINS: Final = 24


def interval(rate: SuccessRate) -> str:
    """Return an SVG chart of a success rate on a line from 0 to 100 %.

    A dot marks the rate, and a bar its confidence interval.
    """
    width, height = 360, 18
    low, high, at = (6 + (width - 12) * part for part in (rate.low, rate.high, rate.share))
    middle = height / 2
    ends = f"{percent(rate.low)} and {percent(rate.high)}"
    title = f"{percent(rate.share)}, between {ends} at {LEVEL} confidence"
    ticks = "".join(
        f'<line class="grid" x1="{6 + (width - 12) * part:.1f}" x2="{6 + (width - 12) * part:.1f}" '
        f'y1="0" y2="{height}"/>'
        for part in (0.0, 0.25, 0.5, 0.75, 1.0)
    )
    return (
        f'<svg class="rate" viewBox="0 0 {width} {height}" role="img" aria-label="{escape(title)}">'
        f"<title>{escape(title)}</title>{ticks}"
        f'<line class="axis" x1="6" x2="{width - 6}" y1="{middle}" y2="{middle}"/>'
        f'<rect class="whisker" x="{low:.1f}" y="{middle - 3}" width="{max(high - low, 1.0):.1f}" '
        'height="6" rx="3"/>'
        f'<circle class="dot" cx="{at:.1f}" cy="{middle}" r="4.5"/></svg>'
    )


def histogram(times: Sequence[tuple[float, bool]], unit: str) -> str:
    """Return an SVG histogram of the durations of episodes; successes are stacked below other episodes.

    Args:
        times: The duration of each episode, and whether it was a success.
        unit: The unit of the durations, for the labels.
    """
    width, height, left, bottom, top = 860, 230, 44, 34, 8
    low, high = min(time for time, _ in times), max(time for time, _ in times)
    edges = _edges(low, high, _MAX_BINS)
    good, bad = [0] * (len(edges) - 1), [0] * (len(edges) - 1)
    for time, success in times:
        place = min(int((time - edges[0]) / (edges[1] - edges[0])), len(good) - 1)
        (good if success else bad)[place] += 1
    most = max(map(sum, zip(good, bad, strict=True)))
    marks = _round_marks(0, most, 4)
    ceiling = max(most, marks[-1])
    across = (width - left - 10) / len(good)

    def y(count: float) -> float:
        return top + (height - top - bottom) * (1 - count / ceiling)

    parts = [
        f'<line class="grid" x1="{left}" x2="{width - 10}" y1="{y(mark):.1f}" y2="{y(mark):.1f}"/>'
        f'<text class="label" x="{left - 8}" y="{y(mark) + 4:.1f}" text-anchor="end">{mark:g}</text>'
        for mark in marks
        if mark == int(mark)
    ]
    for place, (successes, failures) in enumerate(zip(good, bad, strict=True)):
        x = left + place * across
        title = f"{edges[place]:g}–{edges[place + 1]:g} {unit}: {successes} ✔, {failures} ✘"
        for css_class, base, count in (("good", 0, successes), ("bad", successes, failures)):
            if count:
                parts.append(
                    f'<rect class="{css_class}" x="{x + 1:.1f}" y="{y(base + count):.1f}" '
                    f'width="{across - 2:.1f}" height="{y(base) - y(base + count):.1f}">'
                    f"<title>{escape(title)}</title></rect>"
                )
    scale = (width - left - 10) / (edges[-1] - edges[0])
    for mark in _round_marks(edges[0], edges[-1], 8):
        x = left + (mark - edges[0]) * scale
        if x <= width - 9:
            parts.append(
                f'<text class="label" x="{x:.1f}" y="{height - bottom + 18}" text-anchor="middle">'
                f"{mark:g}</text>"
            )
    parts.append(
        f'<line class="axis" x1="{left}" x2="{width - 10}" y1="{height - bottom}" y2="{height - bottom}"/>'
        f'<text class="label" x="{width - 10}" y="{height - 2}" text-anchor="end">{unit}, simulated</text>'
    )
    return f'<svg class="wide" viewBox="0 0 {width} {height}" role="img">{"".join(parts)}</svg>'


def percent(share: float) -> str:
    """Return *share* (0 to 1) as a percentage; "–" for NaN."""
    if math.isnan(share):
        return "–"
    return f"{100 * share:.0f} %" if share in (0.0, 1.0) else f"{100 * share:.1f} %"


def _edges(low: float, high: float, bins: int) -> list[float]:
    """Return the edges of at most *bins* bins of a round width that include *low* and *high*."""
    step = _round_up((high - low) / bins) if high > low else max(_round_up(abs(high) / bins), 0.1)
    start = math.floor(low / step)
    count = max(1, math.floor(high / step) - start + (high > math.floor(high / step) * step or high == low))
    return [round((start + number) * step, 9) for number in range(count + 1)]


def _round_marks(low: float, high: float, most: int) -> list[float]:
    """Return at most *most* + 1 multiples of a round step between *low* and *high*, for an axis."""
    step = _round_up((high - low) / most) if high > low else 1.0
    first = math.ceil(low / step - 1e-9)  # the tolerance keeps a multiple that rounding moved out of range
    last = math.floor(high / step + 1e-9)
    return [round(number * step, 9) for number in range(first, last + 1)]


def _round_up(value: float) -> float:
    """Return the next number at or above *value* that is 1, 2, 2.5 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value)) if value > 0 else 1.0
    return next(part * power for part in (1.0, 2.0, 2.5, 5.0, 10.0) if part * power >= value * (1 - 1e-9))
