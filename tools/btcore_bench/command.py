"""`btcore bench`: run the project's benchmarks and compare their ratios with the targets.

Each benchmark is a file that runs in a separate process: a missing library affects only the benchmarks that
use it, and no benchmark warms up the caches of another benchmark.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import click
from rich.table import Table
from rich.text import Text

import btcore
from btcore.cli import files, terminal
from btcore.extras import describe_missing
from btcore.input_files import data_folder, read_file
from btcore.json_text import load_json
from btcore.suggestions import join_names, nearest_name

_MISSING: Final = re.compile(r"^ModuleNotFoundError: No module named '([^']+)'", re.MULTILINE)
_PLOT: Final = Path("measure") / "plot.py"  # runs in a separate process too, because it needs matplotlib

BenchmarkData = Mapping[str, Any]
"""The results of a benchmark, as written by its option `--json`."""


class BenchmarkError(Exception):
    """A benchmark failed. The message is the text that it wrote to stderr."""

    @property
    def remedy(self) -> str:
        """How to install the module that the benchmark failed to import; "" if it failed otherwise."""
        match = _MISSING.search(str(self))
        return "" if match is None else describe_missing(match[1])


@click.command(short_help="Run the benchmarks and compare them with their targets.")
@click.argument("names", nargs=-1, metavar="[NAME]…")
@click.option("--pairs", type=click.IntRange(1), metavar="N", help="Number of paired runs.")
@click.option("--quick", is_flag=True, help="Use tiny sizes, to check that every benchmark works.")
@click.option(
    "--json", "json_file", type=files.OUTPUT_FILE, metavar="FILE", help="Write all measurements to FILE."
)
@click.option(
    "--beside",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Show an earlier run, written by --json, next to this run: for example of the other build.",
)
@click.option(
    "--plot",
    type=files.OUTPUT_FILE,
    metavar="FILE",
    help="Plot the ratios that have a target, of this run and of --beside.",
)
@click.option("--list", "only_list", is_flag=True, help="List the benchmarks instead of running them.")
def bench(
    names: Sequence[str],
    pairs: int | None,
    quick: bool,
    json_file: Path | None,
    beside: Path | None,
    plot: Path | None,
    only_list: bool,
) -> None:
    """Run the benchmarks NAME, or all benchmarks, and print their ratios, spreads and targets.

    Each ratio compares two programs that are measured in turns, to cancel out changes of the machine's speed.
    Set BTCORE_PURE=1 to measure the pure build of a compiled installation.
    """
    here = data_folder("benchmarks")
    known = benchmarks(here)
    if unknown := [name for name in names if name not in known]:
        nearest = nearest_name(unknown[0], known)
        hint = f"Did you mean '{nearest}'?" if nearest else f"Available benchmarks: {join_names(known)}."
        raise click.UsageError(f"unknown benchmark '{unknown[0]}'. {hint}")
    if only_list:
        for name, file in known.items():
            summary = file.read_text(encoding="utf-8").removeprefix('"""').split("\n", 1)[0]
            click.echo(f"{name:<22} {summary}")
        return
    earlier = _read(beside) if beside is not None else []
    measured = []
    errors: dict[str, BenchmarkError] = {}
    for name in names or known:
        try:
            measured.append(_run(known[name], pairs, quick))
        except BenchmarkError as error:
            errors[name] = error
        click.echo()
    if json_file is not None:
        files.write(json_file, json.dumps(measured, ensure_ascii=False, indent=1).encode())
    if any("target" in row for data in [*measured, *earlier] for row in data["rows"]):
        terminal.stdout_console().print(targets([*earlier, *measured]))
    for name, failure in errors.items():
        if failure.remedy:
            terminal.print_warning(f"'{name}' was not run: {failure.remedy}")
    if plot is not None:
        _plot(here, plot, [*earlier, *measured])
    if failed := [f"'{name}' failed:\n{item}" for name, item in errors.items() if not item.remedy]:
        raise click.ClickException("\n".join(failed))


def benchmarks(here: Path) -> dict[str, Path]:
    """Return the files of the benchmarks in the folder *here*, by name."""
    return {path.stem: path for path in sorted(here.glob("*.py")) if path.stem != "__init__"}


def _run(file: Path, pairs: int | None, quick: bool) -> BenchmarkData:
    """Run a benchmark, which prints its own table, and return its results."""
    with tempfile.TemporaryDirectory() as scratch:
        measured = Path(scratch) / "measured.json"
        options = ["--json", str(measured)]
        if pairs is not None:
            options += ["--pairs", str(pairs)]
        if quick:
            options.append("--quick")
        _python(file, options)
        data: BenchmarkData = json.loads(measured.read_text(encoding="utf-8"))
        return data


def _python(file: Path, options: Sequence[str]) -> None:
    """Run *file* with this Python. Raise BenchmarkError if it fails."""
    environment = dict(os.environ)
    checkout = Path(btcore.__file__).parent.parent
    if file.is_relative_to(checkout / "benchmarks"):
        # The new process must find btcore also in a checkout that is not installed.
        paths = [str(checkout), environment.get("PYTHONPATH", "")]
        environment["PYTHONPATH"] = os.pathsep.join(path for path in paths if path)
    sys.stdout.flush()
    done = subprocess.run([sys.executable, str(file), *options], env=environment, stderr=subprocess.PIPE)
    if done.returncode:
        errors = done.stderr.decode(errors="replace").strip()
        raise BenchmarkError(errors or f"exit code {done.returncode}")


def _read(path: Path) -> list[BenchmarkData]:
    """Read the results of an earlier run. Raise click.UsageError if *path* holds no results."""
    try:
        results: list[BenchmarkData] = load_json(read_file(path).decode())
        if all("rows" in data and "build" in data for data in results):
            return results
    except (ValueError, TypeError):
        pass
    raise click.UsageError(f"'{path}' was not written by 'btcore bench --json'.")


def targets(results: Sequence[BenchmarkData]) -> Table:
    """Return a table: a line for each ratio with a target, columns for each build (pure, compiled)."""
    builds = list(dict.fromkeys(data["build"] for data in results))
    lines: dict[tuple[str, str], dict[str, BenchmarkData]] = {}
    for data in results:
        for row in data["rows"]:
            lines.setdefault((data["benchmark"], row["what"]), {})[data["build"]] = row
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
    """Return the ratio, spread and target of a build as table cells."""
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


def _plot(here: Path, plot: Path, results: Sequence[BenchmarkData]) -> None:
    """Plot *results* into the file *plot*."""
    with tempfile.TemporaryDirectory() as scratch:
        data = Path(scratch) / "measured.json"
        data.write_bytes(json.dumps(results).encode())
        try:
            _python(here / _PLOT, [str(data), str(plot)])
        except BenchmarkError as error:
            raise click.ClickException(f"cannot plot: {error.remedy or error}") from error
    terminal.print_labelled("plotted:", str(plot))
