"""``btcore diff``: where two runs part."""

from collections.abc import Sequence

import click
from rich.text import Text

from btcore.cli import terminal
from btcore.cli.exit_codes import ExitCode
from btcore.clock import NS_PER_S
from btcore.logs import (
    Divergence,
    Recording,
    Step,
    find_divergence,
    read_log,
    steps,
)
from btcore.logs.console import format_transition
from btcore.suggestions import join_names


@click.command(short_help="Find where two runs part.")
@click.argument("first", metavar="A")
@click.argument("second", metavar="B")
@click.option(
    "--times",
    "tolerance",
    type=click.FloatRange(min=0),
    metavar="TOLERANCE",
    help="Compare times too (since each run's first transition); so many seconds apart is still the same.",
)
@click.option("--no-idle", is_flag=True, help="Pass over the transitions to IDLE: a log may lack them.")
@click.option(
    "--context",
    type=click.IntRange(min=0),
    default=3,
    show_default=True,
    metavar="N",
    help="How many transitions before and after are shown.",
)
def diff(first: str, second: str, tolerance: float | None, no_idle: bool, context: int) -> int:
    """Find the first transition in which the runs in the logs A and B differ: in node, status or order.

    A and B are logs of any format: .btlog, SQLite (.db3, .btdb; FILE.db3#2 for session 2), .fbl. Nodes are
    the same if their paths are. The exit code is 0 if the runs are the same, 1 if they part, 2 for a mistake.
    """
    recordings = [read_log(name) for name in (first, second)]
    for recording in recordings:
        for remark in recording.warnings:
            terminal.print_warning(remark)
    _compare_trees(*recordings)
    one, other = (steps(recording, idle=not no_idle) for recording in recordings)
    found = find_divergence(one, other, None if tolerance is None else round(tolerance * NS_PER_S))
    out = terminal.stdout_console()
    if found is None:
        out.print(f"the same: {len(one)} transitions")
        return ExitCode.SUCCESS
    out.print(Text(_headline(found), style="bold"))
    begin, end = max(0, found.common - context), found.common + context + 1
    shown = one[begin:end] + other[begin:end]
    width = max((len(step.path) for step in shown), default=0)
    for step in one[begin : found.common]:
        _print("  ", step, width, "dim")
    _print_side("A ", one[found.common : end], width, "red", first)
    _print_side("B ", other[found.common : end], width, "green", second)
    return ExitCode.FAILURE


def _headline(found: Divergence) -> str:
    after = "no common transition" if not found.common else f"{found.common} common transitions"
    if found.common == 1:
        after = "1 common transition"
    if found.first is not None and found.second is not None and found.by_time:
        apart = abs(found.first.since - found.second.since) / NS_PER_S
        return f"the runs part after {after}: the next is the same, but {apart:.6f} s apart"
    if found.first is None or found.second is None:
        ended, other = ("A", "B") if found.first is None else ("B", "A")
        return f"the runs part after {after}: {ended} ends, and {other} goes on"
    return f"the runs part after {after}"


def _print_side(mark: str, side: Sequence[Step], width: int, style: str, name: str) -> None:
    for number, step in enumerate(side):
        _print(mark, step, width, style if number else f"bold {style}")
    if not side:
        terminal.stdout_console().print(Text(f"{mark}     (the end of {name})", style=style))


def _print(mark: str, step: Step, width: int, style: str) -> None:
    text = Text(mark + format_transition(*step, width=width), style=style)
    terminal.stdout_console().print(text, soft_wrap=True)


def _compare_trees(first: Recording, second: Recording) -> None:
    """Say where the trees differ: it may be the reason."""
    paths = [list(recording.keys().values()) for recording in (first, second)]
    for name, mine, others in (("A", *paths), ("B", *reversed(paths))):
        only = [path for path in mine if path not in set(others)]
        if only:
            terminal.print_notes([f"only the tree of {name} has {join_names(only, most=4)}"])
