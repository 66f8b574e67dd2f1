"""The summary of a run at its end, on stderr, and the object of `--json`."""

import os
import traceback
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from rich.text import Text

import btcore
from btcore.builds import env_flag
from btcore.cli import terminal
from btcore.diagnostics import excerpt
from btcore.engine.node import tick_counts_of
from btcore.errors import NodeExecutionError
from btcore.runs.run import Run
from btcore.runs.run_end import EndReason
from btcore.suggestions import counted
from btcore.tree.drawing import node_depths
from btcore.tree.tree import Tree

END_REASON_TEXT: Final[dict[EndReason | None, str]] = {
    None: "",
    "done": "",
    "raised": "",
    "duration": ", stopped by --duration",
    "end_of_time": ", until the end of the recording",
    "interrupted": ", interrupted",
    "program_error": ", ended by an error of the program",
}
"""The end of a heading, by the reason why the run ended."""

_COUNT_STYLES: Final = {
    "ticks": "",
    "success": "green",
    "failure": "red",
    "skipped": "cyan",
    "halted": "yellow",
}
"""The columns of the tick counts, and their styles."""

_MAX_NODES: Final = 40  # in the summary
_MAX_ITEMS: Final = 8  # of a list of names or numbers in the summary
# Widths in the summary, in characters: between two columns, outside of the table, and the least of a name.
_GAP: Final = 3
_MARGINS: Final = 2
_MIN_NAME: Final = 8


def print_summary(name: str, run: Run) -> None:
    """Print the summary of a run that has ended on stderr.

    Args:
        name: The name of the tree, for the heading.
    """
    tree = run.tree
    console = terminal.stderr_console()
    table = terminal.new_table()
    table.add_column("node", no_wrap=True)
    for title, style in _COUNT_STYLES.items():
        table.add_column(title, justify="right", style=style, no_wrap=True)
    depths = node_depths(tree)
    # `_tick_counts` lists the nodes in the order of the tree.
    rows = list(zip(tree.nodes, _tick_counts(tree).values(), strict=True))[:_MAX_NODES]
    widths = [max(len(title), *(len(str(row[title])) for _, row in rows)) for title in _COUNT_STYLES]
    room = max(console.width - sum(widths) - _GAP * len(widths) - _MARGINS, _MIN_NAME)
    for node, counts in rows:
        never_ticked = not counts["ticks"]
        symbol = terminal.node_symbol(node.spec.symbol, node.spec.node_type)
        label = Text.assemble("  " * depths[node.config.uid], symbol)
        label.append(node.name, style="dim" if never_ticked else "")
        if node.name != node.config.id:
            label.append(f" {node.config.id}", style="dim")
        label.truncate(room, overflow="ellipsis")
        columns = [str(counts[key] or "·") for key in _COUNT_STYLES]
        table.add_row(label, *columns, style="dim" if never_ticked else "")
    console.print(_format_heading(name, run), soft_wrap=True)
    console.print()
    console.print(table)
    if len(tree.nodes) > _MAX_NODES:
        console.print(f"  … and {len(tree.nodes) - _MAX_NODES} more nodes; --json lists all", style="dim")
    print_reports(run.report)


def _format_heading(name: str, run: Run) -> Text:
    result = terminal.format_status(run.status if run.error is None else None)
    ticks = counted(run.tree.ticks, "tick")
    duration = f"{run.elapsed_s:.1f} s, {ticks}, ×{_real_time_factor(run):.1f} real time"
    return Text.assemble(result, "  ", (name, "bold"), "  ", duration, END_REASON_TEXT[run.end_reason])


def _real_time_factor(run: Run) -> float:
    """Return the speed of the run as a multiple of real time."""
    return run.elapsed_s / run.wall_s if run.wall_s > 0 else 0.0


def _tick_counts(tree: Tree) -> dict[str, dict[str, object]]:
    """Return the ID and the tick counts of each node, by full path.

    Equal paths are distinguished by `#1`, `#2` ….
    """
    rows: dict[str, dict[str, object]] = {}
    for key, node in tree.nodes_by_path().items():
        counts = tick_counts_of(node)
        assert counts is not None, "`btcore run` counts the ticks of each of its trees"
        rows[key] = {"id": node.config.id, **counts.by_name()}
    return rows


def results_as_data(run: Run) -> dict[str, object]:
    """Return the object of `--json` for a run that has ended, with the reports of providers."""
    data: dict[str, object] = {
        "status": run.status.name,
        "ticks": run.tree.ticks,
        "time_s": run.elapsed_s,
        "real_time_factor": round(_real_time_factor(run), 3),
        "nodes": _tick_counts(run.tree),
        **run.report,
    }
    if run.error is not None:
        frame = _find_leaf_frame(run.error.cause)
        data["error"] = {
            "node": run.error.path,
            "id": run.error.node_id,
            "while": run.error.doing,
            "exception": type(run.error.cause).__name__,
            "message": str(run.error.cause),
            "at": f"{frame.filename}:{frame.lineno}" if frame is not None else None,
        }
    return data


def _find_leaf_frame(error: BaseException) -> traceback.FrameSummary | None:
    """Return the frame of the leaf's code that raised *error*, or None if btcore itself raised it."""
    package = str(Path(btcore.__file__).parent)
    for frame in traceback.extract_tb(error.__traceback__):
        # The compiled build has relative names.
        if not frame.filename.startswith((package + os.sep, f"btcore{os.sep}")):
            return frame
    return None


def print_leaf_error(error: NodeExecutionError, tree: Tree) -> None:
    """Print *error* on stderr, with the line of the leaf's code, and the entry of *tree* that it lacked.

    With BTCORE_DEBUG=1 also print the traceback.
    """
    is_debugged = env_flag("BTCORE_DEBUG")
    if is_debugged:
        terminal.stderr_console().print(Text("".join(traceback.format_exception(error))), soft_wrap=True)
    terminal.print_error(str(error))
    frame = _find_leaf_frame(error.cause)
    if frame is not None:
        console = terminal.stderr_console()
        place = f"{frame.filename}:{frame.lineno}: in {frame.name}()"
        console.print(Text(place, style="bold"), soft_wrap=True)
        if frame.line:
            console.print(Text(excerpt(frame.line, frame.lineno or 0, 0), style="dim"), soft_wrap=True)
        if not is_debugged:
            console.print("Set BTCORE_DEBUG=1 to print the traceback.", style="dim", highlight=False)
    hint = _unwritten_entry_hint(tree, error)
    terminal.print_notes([hint] if hint else [])


def _unwritten_entry_hint(tree: Tree, error: NodeExecutionError) -> str:
    """Return how to set the entry that a node of *tree* needed, but that was never written; "" otherwise."""
    key = getattr(error.cause, "unwritten_key", "")
    board = next((node._blackboard for node in tree.nodes if node.config.path == error.path), None)
    if not key or board is None:
        return ""
    if board is not tree.blackboard:
        # The key in the main tree may be another key.
        entry = board.find(key)
        entries = tree.blackboard.local_entries().items()
        key = next((outer for outer, other in entries if other is entry), "")
    return f"to set the entry before the first tick, use --set {key}=VALUE" if key else ""


def print_reports(reports: Mapping[str, object]) -> None:
    """Print the reports of providers on stderr: a line for each heading."""
    for heading, report in reports.items():
        line = Text.assemble("\n ", (f"{heading}  ", "bold"), *_format_report(report))
        line.rstrip()
        terminal.stderr_console().print(line, soft_wrap=True)


def _format_report(report: object) -> list[tuple[str, str]]:
    """Return the names and values of a report as (text, style), without values that are None."""
    if isinstance(report, Mapping):
        known = {key: value for key, value in report.items() if value is not None}
        if report and not known:
            return [("not measured  ", "dim")]
        return [part for key, value in known.items() for part in ((f"{key} ", "dim"), *_format_report(value))]
    return [(f"{_format_value(report)}  ", "")]


def _format_value(value: object) -> str:
    if isinstance(value, Mapping):
        known = ((key, item) for key, item in value.items() if item is not None)
        return " ".join(f"{key} {_format_value(item)}" for key, item in known)
    if isinstance(value, (list, tuple)):
        if any(isinstance(item, Mapping) for item in value):
            return "; ".join(map(_format_value, value))
        shown = ", ".join(map(_format_value, value[:_MAX_ITEMS]))
        return f"{shown}, … ({len(value)} in all)" if len(value) > _MAX_ITEMS else shown or "none"
    if value is None:
        return "not measured"
    return f"{value:g}" if isinstance(value, float) else str(value)
