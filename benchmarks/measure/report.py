"""What a benchmark says: rows of ratios beside their targets, as a table or as JSON."""

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


@dataclass(frozen=True, slots=True)
class Target:
    """What a ratio is to be at least, or at most, on each build; a build that isn't named has no target.

    *aim* is how many times the target is wished for, though not asked for, on the compiled build.
    """

    sense: str  # "≥" or "≤"
    by_build: Mapping[str, float]
    aim: float = 1.0

    def text(self, build: str) -> str:
        """The target on *build* in words; "" where there is none."""
        if build not in self.by_build:
            return ""
        limit = self.by_build[build]
        wished = f", aim {self.aim * limit:g}" if self.aim != 1.0 and build == "compiled" else ""
        return f"{self.sense} {limit:g}{wished}"

    def is_met(self, build: str, ratio: float) -> bool | None:
        """Whether *ratio* meets the target on *build*; None where there is none."""
        if build not in self.by_build:
            return None
        limit = self.by_build[build]
        return ratio >= limit if self.sense == "≥" else ratio <= limit


def at_least(aim: float = 1.0, **by_build: float) -> Target:
    """A target that is reached from below."""
    return Target("≥", by_build, aim)


def at_most(**by_build: float) -> Target:
    """A target that is not to be exceeded."""
    return Target("≤", by_build)


@dataclass(frozen=True, slots=True)
class Row:
    """One ratio: *what* it is a ratio of, in words, its spread, and the figures that it comes from."""

    what: str
    ratio: Spread
    target: Target | None = None
    figures: Mapping[str, str] = field(default_factory=dict)
    """Further columns, in absolute terms: from this machine, at this moment."""


@dataclass(slots=True)
class Report:
    """The rows of one benchmark."""

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
        """Add one row."""
        self.rows.append(Row(what, ratio, target, figures or {}))

    def output(self, json_file: str | None = None) -> None:
        """Print the rows; *json_file* gets them too, or has them printed as JSON instead if it is ``-``."""
        text = json.dumps(self.as_data(), ensure_ascii=False, indent=1)
        if json_file == "-":
            print(text)
            return
        if json_file is not None:
            Path(json_file).write_text(text, encoding="utf-8")
        self._print()

    def as_data(self) -> dict[str, object]:
        """Everything, as JSON has it."""
        build = builds.active_build()
        rows = []
        for row in self.rows:
            told = {"what": row.what, **asdict(row.ratio), "figures": dict(row.figures)}
            if row.target is not None and row.target.text(build):
                told["target"] = row.target.text(build)
                told["limit"] = row.target.by_build[build]
                told["met"] = row.target.is_met(build, row.ratio.median)
            rows.append(told)
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
    """A number with three digits or so."""
    if value >= 100:
        return f"{value:,.0f}"
    return f"{value:.1f}" if value >= 10 else f"{value:.2f}"


def arguments(about: str, pairs: int = PAIRS) -> argparse.ArgumentParser:
    """A parser with the options that all benchmarks have."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--pairs", type=int, default=pairs, help="how many paired runs; default: %(default)s")
    parser.add_argument(
        "--json", nargs="?", const="-", metavar="FILE", help="write JSON; without a FILE instead of the table"
    )
    parser.add_argument("--quick", action="store_true", help="tiny: to see that it runs, not how fast")
    return parser
