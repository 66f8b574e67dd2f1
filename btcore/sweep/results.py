"""The results of a sweep: the table, the report, the summary on stderr, and the object of ``--json``."""

from pathlib import Path
from typing import Any, Final, NamedTuple

from btcore.cli import files
from btcore.cli.exit_codes import ExitCode
from btcore.script.program import Program
from btcore.sweep import success, table
from btcore.sweep.definition import SweepDefinition
from btcore.sweep.episode_runner import ExecutionSummary
from btcore.sweep.journal import Journal
from btcore.sweep.report import ReportData, render_report
from btcore.sweep.summary import print_sweep_summary
from btcore.sweep.sweep_statistics import SuccessRate, SweepStatistics, compute_statistics
from btcore.sweep.table import Row

REPORT: Final = "report.html"


class SweepResults(NamedTuple):
    """The object of ``--json``, and the exit *code*."""

    json_object: dict[str, Any]
    code: ExitCode


def write_results(
    journal: Journal, script: Program | None, suffix: str, played: ExecutionSummary
) -> SweepResults:
    """Write the table and the report to the sweep's folder, and print a summary on stderr.

    Args:
        journal: The journal of the sweep.
        script: The condition for a success, or None.
        suffix: The file format of the table: csv or parquet.
        played: The result of `run_sweep`.

    Raises:
        click.ClickException: A file cannot be written.
    """
    sweep = journal.definition
    rows = []
    for number in sorted(journal.done):
        row = table.row(sweep.episode(number), journal.done[number])
        rows.append({**row, "success": success.is_success(row, script)})
    results, report = journal.folder / f"results.{suffix}", journal.folder / REPORT
    table.write(results, rows, table.columns(rows, sweep))
    walls = [record["wall_s"] for record in journal.done.values() if record.get("wall_s")]
    script_text = None if script is None else script.text
    data = ReportData(sweep, compute_statistics(rows, sweep), script_text, tuple(walls))
    files.write(report, render_report(data).encode())
    print_sweep_summary(data, played, results, report)
    return SweepResults(_object(data, played, results, report), _code(rows, played))


def _code(rows: list[Row], played: ExecutionSummary) -> ExitCode:
    if played.interrupted:
        return ExitCode.INTERRUPTED
    if any(row["status"] == "RAISED" for row in rows):
        return ExitCode.LEAF_ERROR
    return ExitCode.SUCCESS if all(row["success"] for row in rows) else ExitCode.FAILURE


def _object(data: ReportData, played: ExecutionSummary, results: Path, report: Path) -> dict[str, Any]:
    statistics, sweep = data.figures, data.definition
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
        "failed": _failed(statistics, sweep),
        "workers": {
            "count": played.workers,
            "deaths": played.deaths,
            "wall_s": round(played.wall, 3),
            "busy": round(played.busy, 4),
        },
        "table": str(results),
        "report": str(report),
    }


def _rate(rate: SuccessRate) -> dict[str, Any]:
    share = round(rate.share, 6) if rate.count else None
    return {
        "succeeded": rate.good,
        "of": rate.count,
        "rate": share,
        "interval": [round(rate.low, 6), round(rate.high, 6)],
    }


def _failed(statistics: SweepStatistics, sweep: SweepDefinition) -> list[dict[str, Any]]:
    failed = []
    for row in statistics.failed:
        episode = sweep.episode(row["episode"])
        failed.append(
            {
                "episode": episode.number,
                "seed": episode.seed,
                "params": dict(episode.values),
                "status": row["status"],
                "failed_at": row["failed_at"],
                "error": row["error"],
                "replay": episode.replay,
            }
        )
    return failed
