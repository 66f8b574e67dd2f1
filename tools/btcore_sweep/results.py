"""The results of a sweep: the table, the report, the summary on stderr, and the object of `--json`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from rich.table import Table
from rich.text import Text

from btcore.cli import files, terminal
from btcore.exit_codes import ExitCode, code_of_signal
from btcore.script.program import Program
from btcore.suggestions import counted
from btcore_sweep.charts import percent
from btcore_sweep.definition import Episode
from btcore_sweep.episode_runner import ExecutionSummary
from btcore_sweep.report import ReportData, render_report
from btcore_sweep.sweep_folder import RECORDINGS, SweepFolder
from btcore_sweep.sweep_statistics import LEVEL, SuccessRate, compute_statistics
from btcore_sweep.table import Row, create_row, list_columns, write_table

REPORT: Final = "report.html"

_MAX_SHOWN: Final = 8
"""The largest number of nodes, and of failed episodes, in the summary."""


def write_results(
    folder: SweepFolder, script: Program | None, suffix: str, execution: ExecutionSummary
) -> tuple[dict[str, Any], ExitCode]:
    """Write the table and the report to the sweep's folder, and print a summary on stderr.

    Args:
        script: The condition for a success, or None.
        suffix: The file format of the table: csv or parquet.
        execution: The summary that `run_sweep` returned.

    Returns:
        The object of `--json`, and the exit code.

    Raises:
        click.ClickException: A file cannot be written.
    """
    sweep = folder.definition
    rows = [
        create_row(sweep.episode(number), record, script) for number, record in sorted(folder.done.items())
    ]
    results, report = folder.path / f"results.{suffix}", folder.path / REPORT
    write_table(results, rows, list_columns(rows, sweep))
    walls = [record["wall_s"] for record in folder.done.values() if record.get("wall_s")]
    script_text = None if script is None else script.text
    data = ReportData(sweep, compute_statistics(rows, sweep), script_text, tuple(walls))
    files.write(report, render_report(data).encode())
    recordings = {
        row["episode"]: file
        for row in data.statistics.failed
        if (file := folder.recording(row["episode"])).exists()
    }
    _print_summary(data, execution, results, report)
    if recordings:
        terminal.print_labelled("recordings", str(folder.path / RECORDINGS))
    return _to_json_data(data, execution, results, report, recordings), _exit_code(rows, execution)


def _exit_code(rows: list[Row], execution: ExecutionSummary) -> ExitCode:
    if execution.signal:
        return code_of_signal(execution.signal)
    if any(row["status"] == "RAISED" for row in rows):
        return ExitCode.LEAF_ERROR
    return ExitCode.SUCCESS if all(row["success"] for row in rows) else ExitCode.FAILURE


def _to_json_data(
    data: ReportData, execution: ExecutionSummary, results: Path, report: Path, recordings: Mapping[int, Path]
) -> dict[str, Any]:
    statistics, sweep = data.statistics, data.definition
    return {
        "episodes": len(sweep),
        "done": statistics.rate.count,
        **_rate(statistics.rate),
        "by": {
            key: {value: _rate(rate) for value, rate in rates.items()} for key, rates in statistics.by.items()
        },
        "statuses": statistics.statuses,
        "figures": {
            item.name: {
                "min": item.least,
                "median": item.median,
                "mean": round(item.mean, 6),
                "max": item.most,
            }
            for item in statistics.spreads
        },
        "failing": [
            {"node": node.node, "ended": node.ended, "episodes": node.failed, "failures": node.times}
            for node in statistics.failing
        ],
        "failed": [
            _failed_episode(sweep.episode(row["episode"]), row, recordings.get(row["episode"]))
            for row in statistics.failed
        ],
        "workers": {
            "count": execution.workers,
            "deaths": execution.deaths,
            "wall_s": round(execution.wall, 3),
            "busy": round(execution.busy, 4),
        },
        "table": str(results),
        "report": str(report),
    }


def _failed_episode(episode: Episode, row: Row, recording: Path | None) -> dict[str, Any]:
    return {
        "episode": episode.number,
        "seed": episode.seed,
        "params": dict(episode.values),
        **{column: row[column] for column in ("status", "failed_at", "error")},
        "replay": episode.replay,
        "recording": None if recording is None else str(recording),
    }


def _rate(rate: SuccessRate) -> dict[str, Any]:
    return {
        "succeeded": rate.good,
        "of": rate.count,
        "rate": round(rate.share, 6) if rate.count else None,
        "interval": [round(rate.low, 6), round(rate.high, 6)],
    }


def _print_summary(data: ReportData, execution: ExecutionSummary, results: Path, report: Path) -> None:
    """Print the summary of a sweep on stderr."""
    console = terminal.stderr_console()
    sweep, statistics = data.definition, data.statistics
    rate = statistics.rate
    if rate.count:
        style = "bold green" if rate.good == rate.count else "bold yellow"
        head = Text.assemble((percent(rate.share), style), f" of {rate.count} episodes of ")
        head.append(Path(sweep.tree).stem, style="bold")
        head.append(f" succeeded ({percent(rate.low)} … {percent(rate.high)} at {LEVEL})")
        console.print(head.append(_duration_text(execution)), soft_wrap=True)
    for key, rates in statistics.by.items():
        table = _new_table(key, "success", "interval", "episodes")
        for value, value_rate in rates.items():
            table.add_row(value or "(omitted)", *_rate_cells(value_rate))
        console.print()
        console.print(table)
    ended = [node for node in statistics.failing if node.ended]
    if ended:
        table = _new_table("node", "ended episodes", "failed in", "failures")
        for node in ended[:_MAX_SHOWN]:
            table.add_row(node.node, f"{node.ended}", f"{node.failed}", f"{node.times}")
        console.print()
        console.print(table)
    if statistics.failed:
        console.print(f"\n{len(statistics.failed)} without success; commands to replay them:", style="bold")
        for row in statistics.failed[:_MAX_SHOWN]:
            line = Text.assemble(
                ("  ", ""), sweep.episode(row["episode"]).replay, (f"  {row['status']}", "red")
            )
            console.print(line, soft_wrap=True)
        if len(statistics.failed) > _MAX_SHOWN:
            console.print(f"  … and {len(statistics.failed) - _MAX_SHOWN} more, in the report", style="dim")
    if execution.deaths:
        died = counted(execution.deaths, "worker")
        terminal.print_warning(f"{died} died; their episodes were run again, except those with status KILLED")
    console.print()
    if execution.signal:
        terminal.print_labelled(
            "interrupted",
            f"after {rate.count} of {len(sweep)} episodes: run the same command again to continue",
        )
    terminal.print_labelled("report", str(report))
    terminal.print_labelled("table", str(results))


def _duration_text(execution: ExecutionSummary) -> str:
    if not execution.episodes:
        return ""
    workers = counted(execution.workers, "worker")
    return f"; {execution.episodes} run in {execution.wall:.1f} s on {workers}"


def _new_table(first: str, *others: str) -> Table:
    table = terminal.new_table()
    table.add_column(first, overflow="fold")
    for name in others:
        table.add_column(name, justify="right")
    return table


def _rate_cells(rate: SuccessRate) -> tuple[str, str, str]:
    interval = f"{percent(rate.low)} … {percent(rate.high)}"
    return percent(rate.share), interval, f"{rate.good} of {rate.count}"
