"""The summary of a sweep in the terminal."""

from pathlib import Path
from typing import Final

from rich import box
from rich.table import Table
from rich.text import Text

from btcore.cli import terminal
from btcore.sweep.charts import percent
from btcore.sweep.episode_runner import ExecutionSummary
from btcore.sweep.report import ReportData
from btcore.sweep.sweep_statistics import LEVEL, SuccessRate

_MOST: Final = 8
"""The largest number of nodes, and of failed episodes, in the summary."""


def print_sweep_summary(data: ReportData, played: ExecutionSummary, results: Path, report: Path) -> None:
    """Print the summary of a sweep on stderr.

    Args:
        data: The data of the report.
        played: The result of `run_sweep`.
        results: The file of the table.
        report: The file of the report.
    """
    console = terminal.stderr_console()
    sweep, statistics = data.definition, data.figures
    rate = statistics.rate
    if rate.count:
        style = "bold green" if rate.good == rate.count else "bold yellow"
        head = Text.assemble((percent(rate.share), style), f" of {rate.count} episodes of ")
        head.append(Path(sweep.tree).stem, style="bold")
        head.append(f" succeeded ({percent(rate.low)} … {percent(rate.high)} at {LEVEL})")
        console.print(head.append(_took(played)), soft_wrap=True)
    for key, rates in statistics.by.items():
        table = _table(key, "success", "interval", "episodes")
        for value, value_rate in rates.items():
            table.add_row(value or "(omitted)", *_cells(value_rate))
        console.print()
        console.print(table)
    ended = [node for node in statistics.failing if node.ended]
    if ended:
        table = _table("node", "ended episodes", "failed in", "failures")
        for node in ended[:_MOST]:
            table.add_row(node.node, f"{node.ended}", f"{node.failed}", f"{node.times}")
        console.print()
        console.print(table)
    if statistics.failed:
        console.print(f"\n{len(statistics.failed)} without success; commands to replay them:", style="bold")
        for row in statistics.failed[:_MOST]:
            line = Text.assemble(
                ("  ", ""), sweep.episode(row["episode"]).replay, (f"  {row['status']}", "red")
            )
            console.print(line, soft_wrap=True)
        if len(statistics.failed) > _MOST:
            console.print(f"  … and {len(statistics.failed) - _MOST} more, in the report", style="dim")
    if played.deaths:
        died = "1 worker" if played.deaths == 1 else f"{played.deaths} workers"
        terminal.print_warning(f"{died} died; their episodes were run again, except those with status KILLED")
    console.print()
    if played.interrupted:
        terminal.print_labelled(
            "interrupted",
            f"after {rate.count} of {len(sweep)} episodes: run the same command again to continue",
        )
    terminal.print_labelled("report", str(report))
    terminal.print_labelled("table ", str(results))


def _took(played: ExecutionSummary) -> str:
    if not played.episodes:
        return ""
    workers = "1 worker" if played.workers == 1 else f"{played.workers} workers"
    return f"; {played.episodes} run in {played.wall:.1f} s on {workers}"


def _table(first: str, *others: str) -> Table:
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), show_edge=False)
    table.add_column(first, overflow="fold")
    for name in others:
        table.add_column(name, justify="right")
    return table


def _cells(rate: SuccessRate) -> list[str]:
    return [
        percent(rate.share),
        f"{percent(rate.low)} … {percent(rate.high)}",
        f"{rate.good} of {rate.count}",
    ]
