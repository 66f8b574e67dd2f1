"""The report of a benchmark: rows of ratios with their targets, as a table or as JSON."""

import argparse
import json
import os
import platform
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

from rich.console import Console
from rich.table import Table

from btcore import builds
from measure.paired_timing import Spread

PAIRS = 9
NO_PY_TREES = "py_trees is not installed; install it with: pip install 'btcore[bench]'"


@dataclass(frozen=True, slots=True)
class Target:
    """The smallest or largest acceptable ratio.

    Attributes:
        sense: "≥" or "≤".
        by_build: The limit for each build; other builds have no target.
        aim: A multiple of the limit that the compiled build should reach, but need not.
    """

    sense: str
    by_build: Mapping[str, float]
    aim: float = 1.0

    def text(self, build: str) -> str:
        """Return the target for *build* as text; "" without a target."""
        if build not in self.by_build:
            return ""
        limit = self.by_build[build]
        aim = f", aim {self.aim * limit:g}" if self.aim != 1.0 and build == "compiled" else ""
        return f"{self.sense} {limit:g}{aim}"

    def is_met(self, build: str, ratio: float) -> bool | None:
        """Return whether *ratio* meets the target for *build*; None without a target."""
        if build not in self.by_build:
            return None
        limit = self.by_build[build]
        return ratio >= limit if self.sense == "≥" else ratio <= limit


def at_least(aim: float = 1.0, **by_build: float) -> Target:
    """Return a target with a lower limit for each build, see `Target`."""
    return Target("≥", by_build, aim)


def at_most(**by_build: float) -> Target:
    """Return a target with an upper limit for each build."""
    return Target("≤", by_build)


@dataclass(frozen=True, slots=True)
class Row:
    """A row of a report.

    Attributes:
        what: The two things that are compared.
        ratio: Their ratio.
        target: Its target.
        figures: Further columns with absolute values, which are valid for this machine only.
    """

    what: str
    ratio: Spread
    target: Target | None
    figures: Mapping[str, str]


@dataclass(slots=True)
class Report:
    """The report of a benchmark.

    Attributes:
        name: The name of the benchmark.
        question: The heading.
        pairs: The number of paired runs.
        rows: The rows.
        remarks: Lines that are printed below the table.
    """

    name: str
    question: str
    pairs: int
    rows: list[Row] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    def add(
        self,
        what: str,
        ratio: Spread,
        target: Target | None = None,
        figures: Mapping[str, str] | None = None,
    ) -> None:
        """Add a row; the arguments are described at `Row`."""
        self.rows.append(Row(what, ratio, target, figures or {}))

    def output(self, json_file: str | None = None) -> None:
        """Print the report as a table, and write it to *json_file*; if that is ``-``, print JSON instead."""
        text = json.dumps(self.as_data(), ensure_ascii=False, indent=1)
        if json_file == "-":
            print(text)
            return
        if json_file is not None:
            Path(json_file).write_text(text, encoding="utf-8")
        self._print()

    def as_data(self) -> dict[str, object]:
        """Return the report as JSON data."""
        build = builds.active_build()
        rows = []
        for row in self.rows:
            data = {"what": row.what, **asdict(row.ratio), "figures": dict(row.figures)}
            if row.target is not None and row.target.text(build):
                data["target"] = row.target.text(build)
                data["limit"] = row.target.by_build[build]
                data["met"] = row.target.is_met(build, row.ratio.median)
            rows.append(data)
        return {
            "benchmark": self.name,
            "question": self.question,
            "build": build,
            "python": platform.python_version(),
            "cores": os.cpu_count(),
            "load": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
            "pairs": self.pairs,
            "rows": rows,
            "remarks": self.remarks,
        }

    def _print(self) -> None:
        data = self.as_data()
        build = builds.active_build()
        console = Console(highlight=False, width=None if sys.stdout.isatty() else 140)
        console.print(f"[bold]{self.question}[/]")
        console.print(
            f"btcore: {build}; Python {data['python']}; {data['cores']} cores at load {data['load']}; "
            f"medians of {self.pairs} pairs, and their quartiles"
        )
        table = Table(box=None, pad_edge=False, header_style="dim")
        columns = list(dict.fromkeys(name for row in self.rows for name in row.figures))
        table.add_column("")
        for name in [*columns, "ratio", "spread", "target"]:
            table.add_column(name, justify="right", no_wrap=True)
        for row in self.rows:
            met = None if row.target is None else row.target.is_met(build, row.ratio.median)
            target = "" if row.target is None else row.target.text(build)
            colour = {True: "green", False: "red", None: "none"}[met]
            table.add_row(
                row.what,
                *(row.figures.get(name, "") for name in columns),
                f"[bold]{in_short(row.ratio.median)}[/]",
                f"{in_short(row.ratio.low)} – {in_short(row.ratio.high)}",
                f"[{colour}]{target}{' ✓' if met else ' ✗' if met is False else ''}[/]",
            )
        console.print(table)
        for remark in self.remarks:
            console.print(remark)


def in_short(value: float) -> str:
    """Return a number with about three digits."""
    if value >= 100:
        return f"{value:,.0f}"
    return f"{value:.1f}" if value >= 10 else f"{value:.2f}"


def arguments(about: str, pairs: int = PAIRS) -> argparse.ArgumentParser:
    """Return a parser with the options of all benchmarks.

    Args:
        about: The description of the benchmark.
        pairs: The default number of paired runs.
    """
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--pairs", type=int, default=pairs, help="paired runs; default: %(default)s")
    parser.add_argument(
        "--json",
        nargs="?",
        const="-",
        metavar="FILE",
        help="write JSON to FILE, or print only JSON",
    )
    parser.add_argument("--quick", action="store_true", help="use tiny sizes, to check the benchmark")
    return parser
