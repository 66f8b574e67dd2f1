"""``btcore stats``: what a log says of each node."""

import json
from collections.abc import Callable, Sequence
from typing import Any, Final

import click
from rich import box
from rich.table import Table
from rich.text import Text

from btcore.cli import terminal
from btcore.clock import NS_PER_S
from btcore.logs import (
    RecordedStatistics,
    Recording,
    read_log,
    recorded_statistics,
)
from btcore.status import FAILURE, SUCCESS

SLOWEST: Final = 3
"""How many leaves are named under the table."""

_ORDERS: Final[dict[str, Callable[[RecordedStatistics], Any]]] = {
    "total": lambda one: one.total,
    "mean": lambda one: one.mean,
    "max": lambda one: one.longest,
    "count": lambda one: one.results + one.halted,
    "failures": lambda one: one.failure,
}


@click.command(short_help="Count what a log's nodes did, and for how long.")
@click.argument("log", metavar="LOG")
@click.option(
    "--sort",
    type=click.Choice(["tree", *_ORDERS]),
    default="tree",
    show_default=True,
    help="By what the nodes are ordered, the largest first; tree: from the root on.",
)
@click.option("--top", type=click.IntRange(min=1), metavar="N", help="Show only the first N.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def stats(log: str, sort: str, top: int | None, as_json: bool) -> None:
    """Count what each node of LOG did: results, share of success, and the time it was RUNNING.

    LOG is a .btlog, an SQLite log (.db3, .btdb; its last session, or FILE.db3#2 for session 2) or
    a format-3 .fbl. A node that comes to its result at once is never RUNNING, and takes no time.
    A file that was cut off counts up to the cut.
    """
    recording = read_log(log)
    for remark in recording.warnings:
        terminal.print_warning(remark)
    found = recorded_statistics(recording)
    shown = found if sort == "tree" else sorted(found, key=_ORDERS[sort], reverse=True)
    if as_json:
        click.echo(json.dumps(_as_data(recording, shown[:top]), ensure_ascii=False, indent=2))
        return
    length = (recording.end - recording.start) / NS_PER_S
    head = f"{len(recording.transitions)} transitions of {len(found)} nodes in {length:.3f} s"
    terminal.stdout_console().print(Text.assemble((log, "bold"), "  ", head))
    terminal.stdout_console().print(_table(shown[:top]))
    slowest = _slowest(found)
    if slowest:
        terminal.stdout_console().print(Text.assemble(("slowest leaves  ", "bold"), slowest))


def _table(rows: Sequence[RecordedStatistics]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), show_edge=False)
    table.add_column("node", overflow="fold", ratio=1)
    for name in ("success", "failure", "skipped", "halted", "rate", "total s", "mean s", "max s"):
        table.add_column(name, justify="right", no_wrap=True)
    for one in rows:
        label = Text(
            terminal.recorded_symbol(one.node.id, one.node.type) + " ",
            style=terminal.KIND_STYLE.get(one.node.type, ""),
        )
        label.append(one.path, style="" if one.results or one.runs else "dim")
        if one.running:
            label.append(" ▶", style="bold yellow")
        rate = "" if one.rate is None else f"{100 * one.rate:.0f} %"
        times = [_seconds(ns) for ns in (one.total, one.mean, one.longest)] if one.runs else [""] * 3
        table.add_row(
            label,
            _count(one.success, terminal.STATUS_STYLE[SUCCESS]),
            _count(one.failure, terminal.STATUS_STYLE[FAILURE]),
            _count(one.skipped),
            _count(one.halted),
            rate,
            *times,
        )
    return table


def _slowest(found: Sequence[RecordedStatistics]) -> str:
    leaves = [one for one in found if not one.node.children and one.total]
    leaves.sort(key=lambda one: one.total, reverse=True)
    return ", ".join(f"{one.path} {_seconds(one.total)} s" for one in leaves[:SLOWEST])


def _count(number: int, style: str = "") -> Text:
    return Text(str(number), style=style if number else "dim")


def _seconds(ns: float) -> str:
    return f"{ns / NS_PER_S:.3f}"


def _as_data(recording: Recording, rows: Sequence[RecordedStatistics]) -> dict[str, object]:
    return {
        "log": str(recording.path),
        "time_s": (recording.end - recording.start) / NS_PER_S,
        "transitions": len(recording.transitions),
        "damage": recording.damage or None,
        "gaps": [{"before": gap.at + 1, "said": gap.reason} for gap in recording.gaps],
        "nodes": {
            one.path: {
                "id": one.node.id,
                "success": one.success,
                "failure": one.failure,
                "skipped": one.skipped,
                "halted": one.halted,
                "rate": one.rate,
                "runs": one.runs,
                "total_s": one.total / NS_PER_S,
                "mean_s": one.mean / NS_PER_S,
                "max_s": one.longest / NS_PER_S,
                "running": one.running,
            }
            for one in rows
        },
    }
