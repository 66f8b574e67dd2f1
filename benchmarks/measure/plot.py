"""Plot the ratios that have targets, as bars with marks at the targets.

python benchmarks/measure/plot.py PICTURE.png MEASURED.json…
"""

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("agg")

from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter

COLOURS = {"pure": "#7f9bab", "compiled": "#1f5f8b"}
TARGET = "#c8553d"
FASTER = ("py_trees / btcore", "ordinary / batch")
"""A ratio whose name ends with any of these texts is larger if btcore is faster."""
BAR = 0.36  # the height of a bar on a line with two bars, as a fraction of the line

Row = Mapping[str, Any]


def main() -> None:
    """Plot the reports of benchmarks, written by their option `--json`, to the first file."""
    picture, *sources = sys.argv[1:]
    results = [json.loads(Path(source).read_text(encoding="utf-8")) for source in sources]
    faster: dict[str, dict[str, Row]] = {}
    slower: dict[str, dict[str, Row]] = {}
    for data in results:
        for row in data["rows"]:
            group = faster if row["what"].endswith(FASTER) else slower
            group.setdefault(row["what"], {})[data["build"]] = row
    slower = {label: rows for label, rows in slower.items() if any("target" in row for row in rows.values())}
    charts = [
        ("times as fast as py_trees (batch: as a tree for each agent), longer is better", faster),
        ("times as long as the peer, shorter is better", slower),
    ]
    charts = [(title, rows) for title, rows in charts if rows]
    heights = [len(rows) + 1.5 for _, rows in charts]
    figure, axes = pyplot.subplots(
        len(charts), 1, figsize=(9, 0.45 * sum(heights) + 0.6), height_ratios=heights, squeeze=False
    )
    for axis, (title, rows) in zip(axes[:, 0], charts, strict=True):
        draw(axis, title, rows)
    marks = [pyplot.Rectangle((0, 0), 1, 1, color=COLOURS[build]) for build in COLOURS]
    marks.append(pyplot.Line2D([], [], color=TARGET, linewidth=2))
    figure.legend(marks, [*COLOURS, "target"], fontsize=8, frameon=False, loc="upper left", ncols=3)
    figure.text(0.995, 0.004, describe(results), ha="right", va="bottom", fontsize=7, color="#777777")
    figure.tight_layout(rect=(0, 0.01, 1, 0.98))
    figure.savefig(picture, dpi=140)


def draw(axis: Axes, title: str, lines: Mapping[str, Mapping[str, Row]]) -> None:
    """Draw a chart with a line for each ratio, a bar for each build, and a mark at each target."""
    builds = [build for build in COLOURS if any(build in rows for rows in lines.values())]
    bar = BAR if len(builds) == 2 else 2 * BAR
    for place, rows in enumerate(lines.values()):
        for number, build in enumerate(builds):
            if build in rows:
                height = place + (number - (len(builds) - 1) / 2) * bar
                _draw_bar(axis, height, bar, build, rows[build])
    names = [label.removesuffix(": py_trees / btcore") for label in lines]
    axis.set_yticks(range(len(lines)), names, fontsize=8)
    axis.invert_yaxis()
    axis.set_xscale("log")
    axis.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.xaxis.set_minor_formatter(FuncFormatter(lambda value, _: ""))
    ratios = [row["median"] for rows in lines.values() for row in rows.values()]
    axis.set_xlim(0.8 * min(1.0, *ratios), 1.6 * max(ratios))
    axis.set_title(title, loc="right", fontsize=9, fontweight="bold")
    axis.grid(axis="x", color="#e4e4e4")
    axis.set_axisbelow(True)
    axis.spines[["top", "right", "left"]].set_visible(False)
    axis.tick_params(left=False, labelsize=8)


def _draw_bar(axis: Axes, height: float, bar: float, build: str, row: Row) -> None:
    """Draw the bar of a build, with its spread, its value and its target."""
    ratio = row["median"]
    spread = [[max(0.0, ratio - row["low"])], [max(0.0, row["high"] - ratio)]]
    axis.barh(height, ratio, bar * 0.9, color=COLOURS[build], xerr=spread, error_kw={"lw": 0.8, "alpha": 0.6})
    shown = f"{ratio:.0f}" if ratio >= 100 else f"{ratio:.3g}"
    met = {True: " ✓", False: " ✗", None: ""}[row.get("met")]
    beside = axis.get_yaxis_transform()
    axis.text(1.01, height, shown + met, transform=beside, va="center", fontsize=7, color=COLOURS[build])
    if "target" in row:
        limits = [row["limit"]] * 2
        axis.plot(limits, [height - bar / 2, height + bar / 2], color=TARGET, linewidth=2)


def describe(results: Sequence[Row]) -> str:
    """Return a line about the method of the measurement."""
    pairs = min(data["pairs"] for data in results)
    python = sorted({data["python"] for data in results})
    return f"medians of {pairs} paired runs or more, quartiles; Python {', '.join(python)}"


if __name__ == "__main__":
    main()
