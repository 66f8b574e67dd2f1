"""``btcore bench``: the project's benchmarks, run on this machine, beside their targets.

Each benchmark is a file of its own, and runs in a process of its own: so one whose libraries aren't
installed takes no other with it, and none warms up another's caches.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import click
from rich.table import Table
from rich.text import Text

import btcore
from btcore.cli import files, terminal
from btcore.suggestions import join_names, nearest_name

_MISSING: Final = re.compile(r"^ModuleNotFoundError: No module named '([^']+)'", re.MULTILINE)
_PLOT: Final = Path("measure") / "plot.py"

BenchmarkData = Mapping[str, Any]
"""What a benchmark says of itself, as its ``--json`` has it."""


@dataclass(frozen=True, slots=True)
class BenchmarkResult:
    """What became of one benchmark: what it told, or why it told nothing."""

    name: str
    data: BenchmarkData | None = None
    lacks: str = ""
    """The module that isn't there."""
    failed: str = ""
    """Its last words."""


@click.command(short_help="Measure how fast trees are here.")
@click.argument("names", nargs=-1, metavar="[NAME]…")
@click.option("--pairs", type=click.IntRange(1), metavar="N", help="How many paired runs.")
@click.option("--quick", is_flag=True, help="Tiny sizes: to see that all of it runs, not how fast.")
@click.option(
    "--json",
    "json_file",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Write everything that was measured.",
)
@click.option(
    "--beside",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Show another run, which --json wrote, side by side; of the other build, for instance.",
)
@click.option(
    "--plot",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Draw the ratios that have a target, with those of --beside.",
)
@click.option("--list", "only_list", is_flag=True, help="List the benchmarks, and run none.")
def bench(
    names: Sequence[str],
    pairs: int | None,
    quick: bool,
    json_file: Path | None,
    beside: Path | None,
    plot: Path | None,
    only_list: bool,
) -> None:
    """Run the benchmarks called NAME, or all, and print ratios: with spread, and with their targets.

    Every ratio is between two things measured in turns, in one process. BTCORE_PURE=1 measures the pure
    build of an install that is compiled.
    """
    here = folder()
    known = benchmarks(here)
    if unknown := [name for name in names if name not in known]:
        meant = nearest_name(unknown[0], known)
        hint = f"Did you mean '{meant}'?" if meant else f"There are {join_names(list(known))}."
        raise click.UsageError(f"there is no benchmark '{unknown[0]}'. {hint}")
    if only_list:
        for name, file in known.items():
            click.echo(f"{name:<22} {first_line(file)}")
        return
    other = _read(beside) if beside is not None else []
    outcomes = []
    for name in names or known:
        outcomes.append(_run(known[name], pairs, quick))
        click.echo()
    told = [one.data for one in outcomes if one.data is not None]
    if json_file is not None:
        files.write(json_file, json.dumps(told, ensure_ascii=False, indent=1).encode())
    if any("target" in row for one in [*told, *other] for row in one["rows"]):
        terminal.stdout_console().print(targets([*other, *told]))
    for one in outcomes:
        if one.lacks:
            terminal.print_warning(f"'{one.name}' was not run: {_remedy(one.lacks)}")
    if plot is not None:
        _draw(here, plot, [*other, *told])
    if failed := [one for one in outcomes if one.failed]:
        raise click.ClickException("\n".join(f"'{one.name}' failed:\n{one.failed}" for one in failed))


def folder() -> Path:
    """Where the benchmarks lie: inside the package when installed, beside it in a checkout."""
    package = Path(btcore.__file__).parent
    installed = package / "benchmarks"
    return installed if installed.is_dir() else package.parent / "benchmarks"


def benchmarks(here: Path) -> dict[str, Path]:
    """The benchmarks in the folder *here*, by name."""
    return {path.stem: path for path in sorted(here.glob("*.py")) if path.stem != "__init__"}


def first_line(file: Path) -> str:
    """The first sentence of a benchmark's docstring."""
    return file.read_text(encoding="utf-8").removeprefix('"""').split("\n", 1)[0]


def _run(file: Path, pairs: int | None, quick: bool) -> BenchmarkResult:
    """Run one benchmark, which prints its table itself."""
    with tempfile.TemporaryDirectory() as scratch:
        answer = Path(scratch) / "told.json"
        options = ["--json", str(answer)]
        if pairs is not None:
            options += ["--pairs", str(pairs)]
        if quick:
            options.append("--quick")
        lacks, failed = _python(file, options)
        if lacks or failed:
            return BenchmarkResult(file.stem, lacks=lacks, failed=failed)
        return BenchmarkResult(file.stem, json.loads(answer.read_text(encoding="utf-8")))


def _python(file: Path, options: Sequence[str]) -> tuple[str, str]:
    """Run *file* with this Python. If it fails: the name of the module that it lacks, or its last words."""
    environment = dict(os.environ)
    checkout = Path(btcore.__file__).parent.parent
    if file.is_relative_to(checkout / "benchmarks"):
        # It may be a checkout that isn't installed.
        paths = [str(checkout), environment.get("PYTHONPATH", "")]
        environment["PYTHONPATH"] = os.pathsep.join(path for path in paths if path)
    sys.stdout.flush()
    done = subprocess.run([sys.executable, str(file), *options], env=environment, stderr=subprocess.PIPE)
    said = done.stderr.decode(errors="replace").strip()
    if done.returncode == 0:
        return "", ""
    if found := _MISSING.search(said):
        return found[1], ""
    return "", said or f"exit code {done.returncode}"


def _remedy(module: str) -> str:
    """What to do about a *module* that isn't installed."""
    return f"the module '{module}' isn't installed; you can have it: pip install 'btcore[all,bench]'"


def _read(path: Path) -> list[BenchmarkData]:
    """What another run told. Raises :class:`click.UsageError` when *path* is no such file."""
    try:
        told: list[BenchmarkData] = json.loads(path.read_text(encoding="utf-8"))
        if all("rows" in one and "build" in one for one in told):
            return told
    except (ValueError, TypeError):
        pass
    raise click.UsageError(f"'{path}' was not written by 'btcore bench --json'.")


def targets(told: Sequence[BenchmarkData]) -> Table:
    """Every ratio that has a target, a line each; the builds side by side."""
    builds = list(dict.fromkeys(one["build"] for one in told))
    lines: dict[tuple[str, str], dict[str, BenchmarkData]] = {}
    for one in told:
        for row in one["rows"]:
            lines.setdefault((one["benchmark"], row["what"]), {})[one["build"]] = row
    table = Table(box=None, pad_edge=False, header_style="dim")
    table.add_column("ratios with targets")
    for build in builds:
        table.add_column(build, justify="right")
        table.add_column("spread", justify="right", style="dim")
        table.add_column("target", justify="right")
    for (benchmark, what), rows in lines.items():
        if not any("target" in row for row in rows.values()):
            continue
        cells: list[str | Text] = [f"{benchmark}: {what}"]
        for build in builds:
            cells += _cells(rows.get(build))
        table.add_row(*cells)
    return table


def _cells(row: BenchmarkData | None) -> list[str | Text]:
    """Ratio, spread and target of one build."""
    if row is None:
        return ["", "", ""]
    ratio = Text(_short(row["median"]), style="bold")
    spread = f"{_short(row['low'])} – {_short(row['high'])}"
    if "target" not in row:
        return [ratio, spread, ""]
    sign, style = ("✓", "green") if row["met"] else ("✗", "red")
    return [ratio, spread, Text(f"{row['target']} {sign}", style=style)]


def _short(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def _draw(here: Path, plot: Path, told: Sequence[BenchmarkData]) -> None:
    """Draw what was *told* into the file *plot*."""
    with tempfile.TemporaryDirectory() as scratch:
        data = Path(scratch) / "told.json"
        data.write_text(json.dumps(told), encoding="utf-8")
        lacks, failed = _python(here / _PLOT, [str(data), str(plot)])
    if lacks or failed:
        raise click.ClickException(f"nothing is drawn: {_remedy(lacks) if lacks else failed}")
    terminal.print_labelled("drawn:", str(plot))
