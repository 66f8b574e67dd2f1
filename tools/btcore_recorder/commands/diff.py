"""`btcore diff`: find the first difference between two logged runs."""

from collections.abc import Sequence

import click
from rich.text import Text

from btcore.cli import terminal
from btcore.clock import NS_PER_S
from btcore.exit_codes import ExitCode
from btcore.logs import Recording, read_log
from btcore.logs.recording import format_transition
from btcore.suggestions import counted, join_names
from btcore_recorder.divergence import Divergence, Step, find_divergence, steps


@click.command()
@click.argument("first", metavar="A")
@click.argument("second", metavar="B")
@click.option(
    "--times",
    type=click.FloatRange(min=0),
    metavar="TOLERANCE",
    help="Also compare the times since the first transition; ignore differences up to TOLERANCE seconds.",
)
@click.option("--no-idle", is_flag=True, help="Ignore transitions to IDLE, which some logs do not contain.")
@click.option(
    "--context",
    type=click.IntRange(min=0),
    default=3,
    show_default=True,
    metavar="N",
    help="Show N transitions before and after the difference.",
)
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object.")
def diff(first: str, second: str, times: float | None, no_idle: bool, context: int, as_json: bool) -> int:
    """Find the first transition that differs between the logs A and B, in node, status or order.

    Logs can be .btlog files, SQLite files (.db3 or .btdb; the last session, or FILE.db3#2 for session 2),
    bags of ROS 2 (.mcap) with `behavior_tree_log`, and .fbl files of format 3. Nodes are identified by
    their paths.

    \b
    Exit codes:
      0  no difference
      1  the logs differ
      2  a log cannot be read, or the command line is invalid
    """
    recordings = [read_log(name) for name in (first, second)]
    for recording in recordings:
        for warning in recording.warnings:
            terminal.print_warning(warning)
    _compare_trees(*recordings)
    steps_a, steps_b = (steps(recording, idle=not no_idle) for recording in recordings)
    divergence = find_divergence(steps_a, steps_b, None if times is None else round(times * NS_PER_S))
    if as_json:
        data = _as_data(recordings, (steps_a, steps_b), divergence, context)
        terminal.print_json(data, indent=2)
        return ExitCode.SUCCESS if divergence is None else ExitCode.FAILURE
    out = terminal.stdout_console()
    if divergence is None:
        out.print(f"no difference: {len(steps_a)} transitions")
        return ExitCode.SUCCESS
    out.print(Text(_format_headline(divergence), style="bold"))
    common = divergence.common
    begin, end = max(0, common - context), common + context + 1
    width = max((len(step.path) for step in steps_a[begin:end] + steps_b[begin:end]), default=0)
    for step in steps_a[begin:common]:
        _print("  ", step, width, "dim")
    _print_side("A ", steps_a[common:end], width, "red", first)
    _print_side("B ", steps_b[common:end], width, "green", second)
    return ExitCode.FAILURE


def _as_data(
    recordings: Sequence[Recording],
    sides: Sequence[Sequence[Step]],
    divergence: Divergence | None,
    context: int,
) -> dict[str, object]:
    """Return the result as JSON data; the lists begin with the transition that differs."""
    common = len(sides[0]) if divergence is None else divergence.common
    end = common if divergence is None else common + context + 1
    return {
        "equal": divergence is None,
        "common": common,
        "by_time": divergence is not None and divergence.by_time,
        "before": [_step_as_data(step) for step in sides[0][max(0, common - context) : common]],
        "a": [_step_as_data(step) for step in sides[0][common:end]],
        "b": [_step_as_data(step) for step in sides[1][common:end]],
        "only_in_a": _find_missing_nodes(recordings[0], recordings[1]),
        "only_in_b": _find_missing_nodes(recordings[1], recordings[0]),
    }


def _step_as_data(step: Step) -> dict[str, object]:
    return {
        "time_s": step.since / NS_PER_S,
        "node": step.path,
        "previous": step.previous.name,
        "status": step.status.name,
    }


def _find_missing_nodes(recording: Recording, other: Recording) -> list[str]:
    """Return the paths of the nodes of *recording* that the tree of *other* does not have."""
    known = set(other.keys().values())
    return [path for path in recording.keys().values() if path not in known]


def _format_headline(divergence: Divergence) -> str:
    count = divergence.common
    first, second = divergence.first, divergence.second
    headline = f"the runs differ after {counted(count, 'common transition', zero='no')}"
    if first is None or second is None:
        shorter, longer = ("A", "B") if first is None else ("B", "A")
        return f"{headline}: {shorter} ends, {longer} continues"
    if divergence.by_time:
        apart = abs(first.since - second.since) / NS_PER_S
        return f"{headline}: the next transition is the same, but {apart:.6f} s apart"
    return headline


def _print_side(mark: str, side: Sequence[Step], width: int, style: str, name: str) -> None:
    for number, step in enumerate(side):
        _print(mark, step, width, style if number else f"bold {style}")
    if not side:
        terminal.stdout_console().print(Text(f"{mark}     (end of {name})", style=style))


def _print(mark: str, step: Step, width: int, style: str) -> None:
    text = Text(mark + format_transition(*step, width=width), style=style)
    terminal.stdout_console().print(text, soft_wrap=True)


def _compare_trees(first: Recording, second: Recording) -> None:
    """Print the nodes that only one tree has: different trees may explain different runs."""
    for name, recording, compared in (("A", first, second), ("B", second, first)):
        only = _find_missing_nodes(recording, compared)
        if only:
            terminal.print_notes([f"only the tree of {name} contains {join_names(only, most=4)}"])
