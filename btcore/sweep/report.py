"""The report of a sweep: one HTML file that needs no other."""

import shlex
from collections.abc import Iterable, Sequence
from html import escape
from statistics import median
from typing import Final, NamedTuple

from btcore.sweep import charts, seeds
from btcore.sweep.charts import percent
from btcore.sweep.definition import SweepDefinition
from btcore.sweep.style import STYLE
from btcore.sweep.sweep_statistics import LEVEL, SuccessRate, SweepStatistics

MOST_FAILED: Final = 200
"""Failed episodes that are told of one by one; the table has them all."""

_MOST_NODES: Final = 40


class ReportData(NamedTuple):
    """What a report tells: the sweep, its figures, the *script* of ``--success-if``.

    *walls* is how long (s) each episode took in real time.
    """

    definition: SweepDefinition
    figures: SweepStatistics
    script: str | None
    walls: Sequence[float]


def render_report(told: ReportData) -> str:
    """The report."""
    sweep, found = told.definition, told.figures
    title = f"{sweep.tree}: {percent(found.rate.share)} of {found.rate.count}"
    parts = [
        f"<h1>{escape(sweep.tree)}</h1>",
        _lead(told),
        _tiles(told),
        *(_rates(key, values) for key, values in found.by.items()),
        _settings(found),
        _times(found),
        _nodes(found),
        _spreads(found),
        _failed(told),
    ]
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{STYLE}</style></head>\n<body><main>\n"
        + "\n".join(part for part in parts if part)
        + "\n</main></body></html>\n"
    )


def _lead(told: ReportData) -> str:
    sweep = told.definition
    words = ["btcore", "sweep", sweep.tree, "--seeds", seeds.format_seeds(sweep.seeds), *sweep.arguments]
    for key, values in sweep.varied.items():
        words += ["--param", f"{key}={','.join(_quoted(value) for value in values)}"]
    if told.script is not None:
        words += ["--success-if", told.script]
    lines = [f'<p class="command"><code>{escape(shlex.join(words))}</code></p>']
    missing = len(sweep) - told.figures.rate.count
    if missing:
        lines.append(
            f'<p class="warning">{missing} of {len(sweep)} episodes are not done yet: the same command goes '
            "on with them.</p>"
        )
    return "\n".join(lines)


def _quoted(value: str) -> str:
    return '"' + value.replace('"', '""') + '"' if "," in value or '"' in value else value


def _tiles(told: ReportData) -> str:
    found = told.figures
    rate = found.rate
    times = [time for time, _ in found.times]
    tiles = [
        (
            percent(rate.share),
            "succeeded",
            f"{percent(rate.low)} … {percent(rate.high)} ({LEVEL} confidence)",
        ),
        (f"{rate.count}", "episodes", ", ".join(f"{many} {name}" for name, many in found.statuses.items())),
    ]
    if times:
        spread = f"from {min(times):g} s to {max(times):g} s" if min(times) < max(times) else "each of them"
        tiles.append((f"{median(times):g} s", "simulated, in the median", spread))
    if times and told.walls and median(told.walls) > 0:
        wall = median(told.walls)
        factor = f"{sum(times) / sum(told.walls):.0f} times as fast as real time"
        tiles.append((f"{wall:.2g} s", "on a core, in the median", factor))
    inner = "".join(
        f'<div class="tile"><div class="figure">{escape(figure)}</div><div>{escape(name)}</div>'
        f'<div class="dim">{escape(more)}</div></div>'
        for figure, name, more in tiles
    )
    return f'<div class="tiles">{inner}</div>'


def _rates(key: str, values: dict[str, SuccessRate]) -> str:
    rows = [[_code(value or "(left out)"), *_rate(rate)] for value, rate in values.items()]
    return f"<h2>By {_code(key)}</h2>" + _table([key, *_RATE], rows, numbers={1, 2, 4})


_RATE: Final = ("success", f"{LEVEL} interval", "0 … 100 %", "episodes")


def _rate(rate: SuccessRate) -> list[str]:
    return [
        f"<b>{percent(rate.share)}</b>",
        f"{percent(rate.low)} … {percent(rate.high)}",
        charts.interval(rate),
        f"{rate.good} of {rate.count}",
    ]


def _settings(found: SweepStatistics) -> str:
    if not found.settings:
        return ""
    keys = list(found.settings[0][0])
    rows = [
        [*(_code(value or "(left out)") for value in values.values()), *_rate(rate)]
        for values, rate in found.settings
    ]
    right = {len(keys), len(keys) + 1, len(keys) + 3}
    return "<h2>By setting</h2>" + _table([*keys, *_RATE], rows, numbers=right)


def _times(found: SweepStatistics) -> str:
    if not found.times:
        return ""
    first = found.times[0][0]
    head = "<h2>How long episodes took</h2>"
    if all(time == first for time, _ in found.times):
        return f"{head}<p>Every episode took {first:g} s of simulated time.</p>"
    legend = '<p class="legend"><i class="good"></i> success <i class="bad"></i> no success</p>'
    return head + legend + charts.histogram(found.times, "s")


def _nodes(found: SweepStatistics) -> str:
    if not found.failing:
        return "<h2>Failures by node</h2><p>No node ever failed.</p>"
    shown = found.failing[:_MOST_NODES]
    count = found.rate.count
    rows = [
        [
            _code(one.node),
            f"<b>{one.ended}</b>" if one.ended else "·",
            f"{one.failed} <span class='dim'>({percent(one.failed / count)})</span>",
            f"{one.times}",
            f"{one.times / one.failed:.3g}" if one.failed else "·",
        ]
        for one in shown
    ]
    more = len(found.failing) - len(shown)
    rest = f"<p class='dim'>… and {more} more nodes; the table has them all.</p>" if more else ""
    lead = (
        "<p class='dim'>The node that made the tree fail in its last tick, or that raised, ended the episode."
        " A condition that fails now and then is nothing bad.</p>"
    )
    heads = ["node", "ended episodes", "failed in episodes", "failures", "an episode"]
    return "<h2>Failures by node</h2>" + lead + _table(heads, rows, numbers={1, 2, 3, 4}) + rest


def _spreads(found: SweepStatistics) -> str:
    rows = [
        [_code(one.name), f"{one.least:.5g}", f"{one.median:.5g}", f"{one.mean:.5g}", f"{one.most:.5g}"]
        for one in found.spreads
    ]
    heads = ["figure", "least", "median", "mean", "most"]
    return "<h2>Figures</h2>" + _table(heads, rows, numbers={1, 2, 3, 4}) if rows else ""


def _failed(told: ReportData) -> str:
    found, sweep = told.figures, told.definition
    if not found.failed:
        return "<h2>Failed episodes</h2><p>None.</p>"
    rows = []
    for one in found.failed[:MOST_FAILED]:
        episode = sweep.episode(one["episode"])
        why = [_code(str(one["failed_at"]))] if one["failed_at"] else []
        why += [escape(str(one["error"]))] if one["error"] else []
        rows.append(
            [
                f"{episode.seed}",
                *(_code(value or "(left out)") for value in episode.values.values()),
                f"{escape(str(one['status']))}",
                "<br>".join(why) or "·",
                f'<code class="replay">{escape(episode.replay)}</code>',
            ]
        )
    more = len(found.failed) - len(rows)
    rest = f"<p class='dim'>… and {more} more; the table has them all.</p>" if more else ""
    heads = ["seed", *sweep.varied, "status", "where, and why", "to see it again"]
    return f"<h2>Failed episodes ({len(found.failed)})</h2>" + _table(heads, rows, numbers={0}) + rest


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]], numbers: Iterable[int] = ()) -> str:
    """A table of cells in HTML; the columns *numbers* stand to the right."""
    right = set(numbers)
    classes = ['class="number"' if place in right else "" for place in range(len(heads))]
    head = "".join(f"<th {kind}>{escape(text)}</th>" for kind, text in zip(classes, heads, strict=True))
    body = "".join(
        "<tr>"
        + "".join(f"<td {kind}>{cell}</td>" for kind, cell in zip(classes, row, strict=True))
        + "</tr>\n"
        for row in rows
    )
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>\n{body}</tbody></table></div>'


def _code(text: str) -> str:
    return f"<code>{escape(text)}</code>"
