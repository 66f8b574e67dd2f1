"""What a sweep leaves behind: the table, the report, a summary in the terminal, the object of ``--json``."""

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
    """The object of ``--json``, and the exit code."""

    json_object: dict[str, Any]
    code: ExitCode


def write_results(
    journal: Journal, script: Program | None, suffix: str, played: ExecutionSummary
) -> SweepResults:
    """Write the table, as *suffix* says, and the report into the sweep's folder, and sum up on stderr."""
    sweep = journal.definition
    rows = []
    for number in sorted(journal.done):
        one = table.row(sweep.episode(number), journal.done[number])
        rows.append({**one, "success": success.is_success(one, script)})
    results, report = journal.folder / f"results.{suffix}", journal.folder / REPORT
    table.write(results, rows, table.columns(rows, sweep))
    found = compute_statistics(rows, sweep)
    walls = [record["wall_s"] for record in journal.done.values() if record.get("wall_s")]
    told = ReportData(sweep, found, None if script is None else script.text, tuple(walls))
    files.write(report, render_report(told).encode())
    print_sweep_summary(told, played, results, report)
    return SweepResults(_object(told, played, results, report), _code(rows, played))


def _code(rows: list[Row], played: ExecutionSummary) -> ExitCode:
    if played.interrupted:
        return ExitCode.INTERRUPTED
    if any(one["status"] == "RAISED" for one in rows):
        return ExitCode.LEAF_ERROR
    return ExitCode.SUCCESS if all(one["success"] for one in rows) else ExitCode.FAILURE


def _object(told: ReportData, played: ExecutionSummary, results: Path, report: Path) -> dict[str, Any]:
    found, sweep = told.figures, told.definition
    return {
        "episodes": len(sweep),
        "done": found.rate.count,
        **_rate(found.rate),
        "by": {
            key: {value: _rate(rate) for value, rate in values.items()} for key, values in found.by.items()
        },
        "statuses": found.statuses,
        "figures": {
            one.name: {"min": one.least, "median": one.median, "mean": round(one.mean, 6), "max": one.most}
            for one in found.spreads
        },
        "failing": [
            {"node": one.node, "ended": one.ended, "episodes": one.failed, "failures": one.times}
            for one in found.failing
        ],
        "failed": _failed(found, sweep),
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


def _failed(found: SweepStatistics, sweep: SweepDefinition) -> list[dict[str, Any]]:
    told = []
    for one in found.failed:
        episode = sweep.episode(one["episode"])
        told.append(
            {
                "episode": episode.number,
                "seed": episode.seed,
                "params": dict(episode.values),
                "status": one["status"],
                "failed_at": one["failed_at"],
                "error": one["error"],
                "replay": episode.replay,
            }
        )
    return told
