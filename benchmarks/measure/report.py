"""The report of a benchmark, as a table or as JSON. A row contains a ratio of times and its target."""

import argparse
import json
import os
import platform
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from btcore import builds
from btcore.extras import describe_missing
from measure.paired_timing import Spread

PAIRS = 9
NO_PY_TREES = describe_missing("py_trees")


@dataclass(frozen=True, slots=True)
class Target:
    """The smallest or largest acceptable ratio.

    Attributes:
        sense: "≥" if the limit is the smallest acceptable ratio, "≤" if it is the largest.
        by_build: The limit for each build (pure, compiled); other builds have no target.
        aim: A multiple of the limit that the compiled build should reach, but need not.
    """

    sense: str
    by_build: Mapping[str, float]
    aim: float = 1.0

    def text(self, build: str) -> str:
        """Return the target for *build* as text."""
        limit = self.by_build[build]
        aim = f", aim {self.aim * limit:g}" if self.aim != 1.0 and build == "compiled" else ""
        return f"{self.sense} {limit:g}{aim}"

    def is_met(self, build: str, ratio: float) -> bool:
        """Return whether *ratio* meets the target for *build*."""
        limit = self.by_build[build]
        return ratio >= limit if self.sense == "≥" else ratio <= limit


def at_least(*, aim: float = 1.0, **by_build: float) -> Target:
    """Return a target with the smallest acceptable ratio for each build, see `Target`."""
    return Target("≥", by_build, aim)


def at_most(**by_build: float) -> Target:
    """Return a target with the largest acceptable ratio for each build."""
    return Target("≤", by_build)


@dataclass(slots=True)
class Report:
    """The report of a benchmark.

    Attributes:
        name: The name of the benchmark.
        question: The heading, which describes the comparison.
        pairs: The number of paired runs.
        rows: The rows as JSON data.
        remarks: Lines that are printed below the table.
    """

    name: str
    question: str
    pairs: int
    rows: list[dict[str, Any]] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    def add(
        self,
        label: str,
        ratio: Spread,
        target: Target | None = None,
        figures: Mapping[str, str] | None = None,
    ) -> None:
        """Add a row.

        Args:
            label: The two things that are compared.
            ratio: The ratio of the two things.
            target: The target of the ratio.
            figures: The texts of further columns, such as absolute times on this machine, by heading.
        """
        build = builds.active_build()
        row = {"what": label, **asdict(ratio), "figures": dict(figures or {})}
        if target is not None and build in target.by_build:
            row["target"] = target.text(build)
            row["limit"] = target.by_build[build]
            row["met"] = target.is_met(build, ratio.median)
        self.rows.append(row)

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
        return {
            "benchmark": self.name,
            "question": self.question,
            "build": builds.active_build(),
            "python": platform.python_version(),
            "cores": os.cpu_count(),
            "load": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
            "pairs": self.pairs,
            "rows": self.rows,
            "remarks": self.remarks,
        }

    def _print(self) -> None:
        data = self.as_data()
        console = Console(highlight=False, width=None if sys.stdout.isatty() else 140)
        console.print(f"[bold]{self.question}[/]")
        console.print(
            f"btcore: {data['build']}; Python {data['python']}; "
            f"{data['cores']} cores at load {data['load']}; medians of {self.pairs} pairs, quartiles"
        )
        table = Table(box=None, pad_edge=False, header_style="dim")
        columns = list(dict.fromkeys(name for row in self.rows for name in row["figures"]))
        table.add_column("")
        for name in [*columns, "ratio", "spread", "target"]:
            table.add_column(name, justify="right", no_wrap=True)
        for row in self.rows:
            target = ""
            if "target" in row:
                colour, sign = ("green", "✓") if row["met"] else ("red", "✗")
                target = f"[{colour}]{row['target']} {sign}[/]"
            table.add_row(
                row["what"],
                *(row["figures"].get(name, "") for name in columns),
                f"[bold]{in_short(row['median'])}[/]",
                f"{in_short(row['low'])} – {in_short(row['high'])}",
                target,
            )
        console.print(table)
        for remark in self.remarks:
            console.print(remark, markup=False)


def in_short(value: float) -> str:
    """Return *value* as text with about three significant digits."""
    if value >= 100:
        return f"{value:,.0f}"
    return f"{value:.1f}" if value >= 10 else f"{value:.2f}"


def create_parser(about: str, pairs: int = PAIRS) -> argparse.ArgumentParser:
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
