"""What a sweep says in the terminal when it ends."""

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
"""Nodes, and failed episodes, that are told of."""


def print_sweep_summary(told: ReportData, played: ExecutionSummary, results: Path, report: Path) -> None:
    """Print, on stderr, what the sweep came to, and where the rest is to be read."""
    console = terminal.stderr_console()
    sweep, found = told.definition, told.figures
    rate = found.rate
    if rate.count:
        style = "bold green" if rate.good == rate.count else "bold yellow"
        head = Text.assemble((percent(rate.share), style), f" of {rate.count} episodes of ")
        head.append(Path(sweep.tree).stem, style="bold")
        head.append(f" succeeded ({percent(rate.low)} … {percent(rate.high)} at {LEVEL})")
        console.print(head.append(_took(played)), soft_wrap=True)
    for key, values in found.by.items():
        table = _table(key, "success", "interval", "episodes")
        for value, one in values.items():
            table.add_row(value or "(left out)", *_cells(one))
        console.print()
        console.print(table)
    ended = [one for one in found.failing if one.ended]
    if ended:
        table = _table("node", "ended episodes", "failed in", "failures")
        for node in ended[:_MOST]:
            table.add_row(node.node, f"{node.ended}", f"{node.failed}", f"{node.times}")
        console.print()
        console.print(table)
    if found.failed:
        console.print(f"\n{len(found.failed)} without success; to see them again:", style="bold")
        for row in found.failed[:_MOST]:
            line = Text.assemble(
                ("  ", ""), sweep.episode(row["episode"]).replay, (f"  {row['status']}", "red")
            )
            console.print(line, soft_wrap=True)
        if len(found.failed) > _MOST:
            console.print(f"  … and {len(found.failed) - _MOST} more, in the report", style="dim")
    if played.deaths:
        died = "1 worker" if played.deaths == 1 else f"{played.deaths} workers"
        terminal.print_warning(
            f"{died} died; what they played was played again, unless it is said to be KILLED"
        )
    console.print()
    if played.interrupted:
        terminal.print_labelled(
            "interrupted",
            f"with {rate.count} of {len(sweep)} episodes done: the same command goes on with the rest",
        )
    terminal.print_labelled("report", str(report))
    terminal.print_labelled("table ", str(results))


def _took(played: ExecutionSummary) -> str:
    if not played.episodes:
        return ""
    workers = "1 worker" if played.workers == 1 else f"{played.workers} workers"
    return f"; {played.episodes} played in {played.wall:.1f} s on {workers}"


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
