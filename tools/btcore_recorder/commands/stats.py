"""`btcore stats`: print statistics of each node in a log."""

from bisect import bisect_left
from collections import defaultdict, deque
from collections.abc import Callable, Sequence
from itertools import groupby
from typing import Any, Final, NamedTuple

import click
from rich.table import Table
from rich.text import Text

from btcore.cli import terminal
from btcore.clock import NS_PER_S
from btcore.logs import RecordedNode, Recording, read_log
from btcore.nodes.builtin_nodes import BUILTIN_NODES
from btcore.status import IDLE, RUNNING, Status
from btcore_recorder.statistics import RecordedStatistics, recorded_statistics

SLOWEST: Final = 3
"""The number of leaves that are listed under the table."""

CHANGES: Final = 500
"""The number of the last changes of results that are printed as JSON."""

_ORDERS: Final[dict[str, Callable[[RecordedStatistics], Any]]] = {
    "total": lambda row: row.total,
    "mean": lambda row: row.mean,
    "max": lambda row: row.longest,
    "count": lambda row: row.results + row.halted,
    "failures": lambda row: row.failure,
}


@click.command()
@click.argument("log", metavar="LOG")
@click.option(
    "--sort",
    type=click.Choice(["tree", *_ORDERS]),
    default="tree",
    show_default=True,
    help="Sort by this column, the largest value first; 'tree' is the order of the tree, from the root.",
)
@click.option("--top", type=click.IntRange(min=1), metavar="N", help="Show only the first N nodes.")
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object.")
def stats(log: str, sort: str, top: int | None, as_json: bool) -> None:
    """Print statistics of each node in LOG: results, success rate, and the time in RUNNING.

    If the tree failed at its last end, the node that made it fail is printed, too.

    LOG is a .btlog file, an SQLite file (.db3 or .btdb; the last session, or FILE.db3#2 for session 2), a
    bag of ROS 2 (.mcap) with `behavior_tree_log`, or a .fbl file of format 3. A truncated file is read up to
    the point of truncation. A node that returns its result in the tick in which it starts is never RUNNING;
    its time is 0.
    """
    recording = read_log(log)
    for warning in recording.warnings:
        terminal.print_warning(warning)
    rows = recorded_statistics(recording)
    ordered = rows if sort == "tree" else sorted(rows, key=_ORDERS[sort], reverse=True)
    if as_json:
        terminal.print_json(_as_data(recording, ordered[:top]), indent=2)
        return
    length = (recording.end - recording.start) / NS_PER_S
    head = f"{len(recording.transitions)} transitions of {len(rows)} nodes in {length:.3f} s"
    terminal.stdout_console().print(Text.assemble((log, "bold"), "  ", head))
    terminal.stdout_console().print(_create_table(ordered[:top]))
    slowest = _format_slowest(rows)
    if slowest:
        terminal.stdout_console().print(Text.assemble(("slowest leaves  ", "bold"), slowest))
    if failure := find_failure(recording):
        cause = failure[-1]
        place = f"{recording.keys()[cause.node.uid]} after {_format_seconds(cause.stamp - recording.start)} s"
        terminal.stdout_console().print(Text.assemble(("the tree failed at  ", "bold"), place))


def _create_table(rows: Sequence[RecordedStatistics]) -> Table:
    table = terminal.new_table()
    table.add_column("node", overflow="fold", ratio=1)
    for name in ("success", "failure", "skipped", "halted", "rate", "total s", "mean s", "max s"):
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        label = _node_symbol(row.node)
        label.append(row.path, style="" if row.results or row.runs else "dim")
        if row.running:
            label.append(" ▶", style="bold yellow")
        rate = "" if row.rate is None else f"{100 * row.rate:.0f} %"
        times = [_format_seconds(ns) for ns in (row.total, row.mean, row.longest)] if row.runs else [""] * 3
        table.add_row(
            label,
            _format_count(row.success, "bold green"),
            _format_count(row.failure, "bold red"),
            _format_count(row.skipped),
            _format_count(row.halted),
            rate,
            *times,
        )
    return table


def _node_symbol(node: RecordedNode) -> Text:
    """Return the symbol of *node*. A log contains no classes; those of built-in nodes are known."""
    cls = BUILTIN_NODES[4].get(node.id) or BUILTIN_NODES[3].get(node.id)
    return terminal.node_symbol("" if cls is None else cls.spec.symbol, node.type)


def _format_slowest(rows: Sequence[RecordedStatistics]) -> str:
    leaves = [row for row in rows if not row.node.children and row.total]
    leaves.sort(key=lambda row: row.total, reverse=True)
    return ", ".join(f"{row.path} {_format_seconds(row.total)} s" for row in leaves[:SLOWEST])


def _format_count(number: int, style: str = "") -> Text:
    return Text(str(number), style=style if number else "dim")


def _format_seconds(ns: float) -> str:
    return f"{ns / NS_PER_S:.3f}"


def _as_data(recording: Recording, rows: Sequence[RecordedStatistics]) -> dict[str, object]:
    return {
        "log": str(recording.path),
        "time_s": (recording.end - recording.start) / NS_PER_S,
        "transitions": len(recording.transitions),
        "damage": recording.damage or None,
        "gaps": [{"before": gap.at + 1, "reason": gap.reason} for gap in recording.gaps],
        "failure": _failure_as_data(recording),
        "changes": _last_changes(recording),
        "nodes": {
            row.path: {
                "id": row.node.id,
                "success": row.success,
                "failure": row.failure,
                "skipped": row.skipped,
                "halted": row.halted,
                "rate": row.rate,
                "runs": row.runs,
                "total_s": row.total / NS_PER_S,
                "mean_s": row.mean / NS_PER_S,
                "max_s": row.longest / NS_PER_S,
                "running": row.running,
            }
            for row in rows
        },
    }


def _last_changes(recording: Recording) -> list[dict[str, object]]:
    """Return when the results of nodes changed; the result of a node that was halted is null.

    A reactive node ticks its children again in each tick, which repeats their results. These repetitions are
    omitted.
    """
    keys = recording.keys()
    last: dict[int, Status] = {}
    changes: deque[tuple[int, int, Status]] = deque(maxlen=CHANGES)
    for stamp, together in groupby(recording.transitions, key=lambda change: change.stamp):
        results = {
            change.uid: change.status
            for change in together
            if change.status is not IDLE or change.previous is RUNNING
        }
        for uid, result in results.items():
            if last.get(uid) is not result:
                last[uid] = result
                changes.append((stamp, uid, result))
    return [
        {
            "time_s": (stamp - recording.start) / NS_PER_S,
            "node": keys[uid],
            "result": None if result is IDLE else result.name,
        }
        for stamp, uid, result in changes
    ]


def _failure_as_data(recording: Recording) -> list[dict[str, object]]:
    """Return the nodes from the root to the node that made the tree fail; [] if it did not fail."""
    keys = recording.keys()
    return [
        {
            "node": keys[step.node.uid],
            "id": step.node.id,
            "type": step.node.type.name,
            "ports": dict(step.node.ports),
            "time_s": (step.stamp - recording.start) / NS_PER_S,
            "children": {
                keys[uid]: None if result is None else result.name for uid, result in step.results.items()
            },
        }
        for step in find_failure(recording)
    ]


class FailureStep(NamedTuple):
    """A node on the path from the root to the node that made the tree fail.

    Attributes:
        node: The node.
        stamp: The time (ns since 1970) at which it failed.
        results: The last result of each child in the run of the node that failed, by UID; None for a child
            that had no result, because it was not ticked or because it was halted.
    """

    node: RecordedNode
    stamp: int
    results: dict[int, Status | None]


def find_failure(recording: Recording) -> list[FailureStep]:
    """Return the path from the root to the node that made the tree fail.

    The search starts at the last result of the root. It descends to the child that failed last, until a node
    has no failed child: a leaf, or a decorator whose child did not fail, such as an Inverter.

    Returns:
        The nodes from the root down; the last is the cause. Empty if the last result of the root is not
        FAILURE, or if the root has no result.
    """
    ends: dict[int, list[int]] = defaultdict(list)
    for number, change in enumerate(recording.transitions):
        if change.status is not RUNNING:
            ends[change.uid].append(number)

    def last_result(uid: int, after: int, before: int) -> int | None:
        """Return the index of the last result of a node between two transitions."""
        own = ends[uid]
        for number in reversed(own[: bisect_left(own, before)]):
            if number <= after:
                return None
            if recording.transitions[number].status is not IDLE:
                return number
        return None

    steps: list[FailureStep] = []
    node = next(iter(recording.nodes.values()), None)
    at = None if node is None else last_result(node.uid, -1, len(recording.transitions))
    while node is not None and at is not None and recording.transitions[at].status is Status.FAILURE:
        own = ends[node.uid]
        position = bisect_left(own, at)
        began = own[position - 1] if position else -1
        last_results = {uid: last_result(uid, began, at) for uid in node.children}
        results = {
            uid: None if number is None else recording.transitions[number].status
            for uid, number in last_results.items()
        }
        steps.append(FailureStep(node, recording.transitions[at].stamp, results))
        failed = [(number, uid) for uid, number in last_results.items() if number is not None]
        failed = [pair for pair in failed if results[pair[1]] is Status.FAILURE]
        at, child = max(failed, default=(None, None))
        node = None if child is None else recording.nodes[child]
    return steps
