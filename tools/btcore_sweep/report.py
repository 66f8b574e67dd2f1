"""The report of a sweep: a self-contained HTML file."""

import shlex
from collections.abc import Iterable, Sequence
from html import escape
from statistics import median
from typing import Final, NamedTuple

from btcore_sweep import charts, parameters
from btcore_sweep.charts import percent
from btcore_sweep.definition import SweepDefinition
from btcore_sweep.sweep_statistics import LEVEL, SuccessRate, SweepStatistics

MAX_FAILED: Final = 200
"""The largest number of failed episodes in the report; the table contains all of them."""

_MAX_NODES: Final = 40

# Success and failure are blue and orange, which colour-blind readers can distinguish.
_STYLE: Final = """
:root { --ink: #1b1f24; --dim: #626b76; --page: #fff; --panel: #f5f7f9; --line: #dde2e8;
  --good: #2f74c0; --bad: #d9722b; --soft: #a9c8ea; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e9ed; --dim: #98a2ae; --page: #14171b;
  --panel: #1d2227; --line: #333b44; --good: #5b9ee0; --bad: #e8924f; --soft: #2f527a; } }
body { margin: 0; background: var(--page); color: var(--ink);
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
main { max-width: 960px; margin: 0 auto; padding: 32px 24px 64px; }
h1 { font-size: 30px; margin: 0 0 4px; letter-spacing: -0.01em; }
h2 { font-size: 19px; margin: 40px 0 10px; }
code { font: 13px/1.5 ui-monospace, "SF Mono", Menlo, "DejaVu Sans Mono", monospace; }
h2 code { font-size: 17px; }
.command { margin: 0 0 24px; color: var(--dim); overflow-wrap: anywhere; }
.warning { border-left: 4px solid var(--bad); background: var(--panel); padding: 8px 14px; }
.dim { color: var(--dim); font-size: 13.5px; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(200px, 1fr)); gap: 14px; }
.tile { background: var(--panel); border: 1px solid var(--line); border-radius: 10px; padding: 14px 18px; }
.figure { font-size: 32px; font-weight: 650; line-height: 1.25; font-variant-numeric: tabular-nums; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th { text-align: left; font-weight: 600; font-size: 13px; color: var(--dim); white-space: nowrap; }
th, td { padding: 5px 12px 5px 0; border-bottom: 1px solid var(--line); vertical-align: middle; }
td { white-space: nowrap; }
.number { text-align: right; }
.replay { user-select: all; white-space: normal; overflow-wrap: anywhere; }
.legend { color: var(--dim); font-size: 13.5px; margin: 0 0 6px; }
.legend i { display: inline-block; width: 11px; height: 11px; border-radius: 2px; margin: 0 4px 0 12px; }
.legend i.good { background: var(--good); margin-left: 0; }
.legend i.bad { background: var(--bad); }
svg.wide { width: 100%; height: auto; display: block; }
svg.rate { display: block; width: 100%; min-width: 220px; max-width: 420px; margin: 0 auto; }
svg .grid { stroke: var(--line); }
svg .axis { stroke: var(--dim); stroke-width: 1; }
svg.rate .axis { stroke: var(--line); }
svg .whisker { fill: var(--soft); }
svg .dot, svg .good { fill: var(--good); }
svg .bad { fill: var(--bad); }
svg .label { fill: var(--dim); font-size: 12px; }
"""


class ReportData(NamedTuple):
    """The data of a report.

    Attributes:
        definition: The sweep.
        statistics: The statistics of the sweep.
        script: The script of `--success-if`, or None.
        walls: The duration of each episode (s of real time).
    """

    definition: SweepDefinition
    statistics: SweepStatistics
    script: str | None
    walls: Sequence[float]


def render_report(data: ReportData) -> str:
    """Return the report as HTML."""
    sweep, statistics = data.definition, data.statistics
    title = f"{sweep.tree}: {percent(statistics.rate.share)} of {statistics.rate.count}"
    parts = [
        f"<h1>{escape(sweep.tree)}</h1>",
        _lead(data),
        _tiles(data),
        *(_rates(key, values) for key, values in statistics.by.items()),
        _combinations(statistics),
        _times(statistics),
        _nodes(statistics),
        _spreads(statistics),
        _failed(data),
    ]
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head>\n<body><main>\n"
        + "\n".join(part for part in parts if part)
        + "\n</main></body></html>\n"
    )


def _lead(data: ReportData) -> str:
    sweep = data.definition
    words = ["btcore", "sweep", sweep.tree, "--seeds", parameters.format_seeds(sweep.seeds), *sweep.arguments]
    for key, values in sweep.varied.items():
        words += ["--param", f"{key}={','.join(_quoted(value) for value in values)}"]
    if data.script is not None:
        words += ["--success-if", data.script]
    lines = [f'<p class="command"><code>{escape(shlex.join(words))}</code></p>']
    missing = len(sweep) - data.statistics.rate.count
    if missing:
        lines.append(
            f'<p class="warning">{missing} of {len(sweep)} episodes are not finished: run the same command '
            "again to continue.</p>"
        )
    return "\n".join(lines)


def _quoted(value: str) -> str:
    return '"' + value.replace('"', '""') + '"' if "," in value or '"' in value else value


def _tiles(data: ReportData) -> str:
    statistics = data.statistics
    rate = statistics.rate
    statuses = ", ".join(f"{count} {name}" for name, count in statistics.statuses.items())
    times = [time for time, _ in statistics.times]
    tiles = [
        (
            percent(rate.share),
            "succeeded",
            f"{percent(rate.low)} … {percent(rate.high)} ({LEVEL} confidence)",
        ),
        (f"{rate.count}", "episodes", statuses),
    ]
    if times:
        spread = (
            f"from {min(times):g} s to {max(times):g} s" if min(times) < max(times) else "in all episodes"
        )
        tiles.append((f"{median(times):g} s", "simulated time (median)", spread))
    if times and data.walls and median(data.walls) > 0:
        factor = f"{sum(times) / sum(data.walls):.0f} times faster than real time"
        tiles.append((f"{median(data.walls):.2g} s", "real time on a core (median)", factor))
    inner = "".join(
        f'<div class="tile"><div class="figure">{escape(figure)}</div><div>{escape(name)}</div>'
        f'<div class="dim">{escape(note)}</div></div>'
        for figure, name, note in tiles
    )
    return f'<div class="tiles">{inner}</div>'


def _rates(key: str, values: dict[str, SuccessRate]) -> str:
    rows = [[_code(value or "(omitted)"), *_rate(rate)] for value, rate in values.items()]
    return f"<h2>By {_code(key)}</h2>" + _table([key, *_RATE], rows, numbers={1, 2, 4})


_RATE: Final = ("success", f"{LEVEL} interval", "0 … 100 %", "episodes")


def _rate(rate: SuccessRate) -> list[str]:
    return [
        f"<b>{percent(rate.share)}</b>",
        f"{percent(rate.low)} … {percent(rate.high)}",
        charts.interval(rate),
        f"{rate.good} of {rate.count}",
    ]


def _combinations(statistics: SweepStatistics) -> str:
    if not statistics.combinations:
        return ""
    keys = list(statistics.combinations[0][0])
    rows = [
        [*(_code(value or "(omitted)") for value in values.values()), *_rate(rate)]
        for values, rate in statistics.combinations
    ]
    right = {len(keys), len(keys) + 1, len(keys) + 3}
    return "<h2>By combination</h2>" + _table([*keys, *_RATE], rows, numbers=right)


def _times(statistics: SweepStatistics) -> str:
    if not statistics.times:
        return ""
    first = statistics.times[0][0]
    head = "<h2>Duration of the episodes</h2>"
    if all(time == first for time, _ in statistics.times):
        return f"{head}<p>Every episode took {first:g} s of simulated time.</p>"
    legend = '<p class="legend"><i class="good"></i> success <i class="bad"></i> no success</p>'
    return head + legend + charts.histogram(statistics.times, "s")


def _nodes(statistics: SweepStatistics) -> str:
    if not statistics.failing:
        return "<h2>Failures by node</h2><p>No node failed.</p>"
    shown = statistics.failing[:_MAX_NODES]
    count = statistics.rate.count
    rows = [
        [
            _code(node.node),
            f"<b>{node.ended}</b>" if node.ended else "·",
            f"{node.failed} <span class='dim'>({percent(node.failed / count)})</span>",
            f"{node.times}",
            f"{node.times / node.failed:.3g}" if node.failed else "·",
        ]
        for node in shown
    ]
    hidden = len(statistics.failing) - len(shown)
    omission = f"<p class='dim'>… and {hidden} more nodes; the table contains all.</p>" if hidden else ""
    lead = (
        "<p class='dim'>An episode is ended by the node that made the tree fail in its last tick, or that "
        "raised an exception. Other failures, such as those of conditions, are part of normal operation.</p>"
    )
    heads = ["node", "ended episodes", "failed in episodes", "failures", "failures per episode"]
    return "<h2>Failures by node</h2>" + lead + _table(heads, rows, numbers={1, 2, 3, 4}) + omission


def _spreads(statistics: SweepStatistics) -> str:
    rows = [
        [_code(item.name), *(f"{value:.5g}" for value in (item.least, item.median, item.mean, item.most))]
        for item in statistics.spreads
    ]
    heads = ["figure", "minimum", "median", "mean", "maximum"]
    return "<h2>Figures</h2>" + _table(heads, rows, numbers={1, 2, 3, 4}) if rows else ""


def _failed(data: ReportData) -> str:
    failed, sweep = data.statistics.failed, data.definition
    if not failed:
        return "<h2>Failed episodes</h2><p>None.</p>"
    rows = []
    for row in failed[:MAX_FAILED]:
        episode = sweep.episode(row["episode"])
        cause = [_code(str(row["failed_at"]))] if row["failed_at"] else []
        cause += [escape(str(row["error"]))] if row["error"] else []
        rows.append(
            [
                f"{episode.seed}",
                *(_code(value or "(omitted)") for value in episode.values.values()),
                f"{escape(str(row['status']))}",
                "<br>".join(cause) or "·",
                f'<code class="replay">{escape(episode.replay)}</code>',
            ]
        )
    hidden = len(failed) - len(rows)
    omission = f"<p class='dim'>… and {hidden} more; the table contains all.</p>" if hidden else ""
    heads = ["seed", *sweep.varied, "status", "node and error", "command to replay"]
    return f"<h2>Failed episodes ({len(failed)})</h2>" + _table(heads, rows, numbers={0}) + omission


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]], numbers: Iterable[int] = ()) -> str:
    """Return an HTML table; the columns with the indices *numbers* are aligned to the right."""
    right = set(numbers)
    classes = ['class="number"' if column in right else "" for column in range(len(heads))]
    head = "".join(
        f"<th {css_class}>{escape(text)}</th>" for css_class, text in zip(classes, heads, strict=True)
    )
    body = "".join(
        "<tr>"
        + "".join(f"<td {css_class}>{cell}</td>" for css_class, cell in zip(classes, row, strict=True))
        + "</tr>\n"
        for row in rows
    )
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>\n{body}</tbody></table></div>'


def _code(text: str) -> str:
    return f"<code>{escape(text)}</code>"
