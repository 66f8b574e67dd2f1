"""``btcore replay``: a log file, in the viewer with time travel, or as lines of text."""

import contextlib
import tempfile
import threading
import uuid
from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Final

import click

from btcore.clock import NS_PER_S
from btcore.logs import Recording, read_log
from btcore.logs.console import format_transition
from btcore.status import FAILURE, RUNNING, SUCCESS, NodeType, Status
from btcore.suggestions import nearest_name
from btcore_monitor.display_options import DisplayOptions
from btcore_monitor.events import (
    DataMissed,
    DataSource,
    Event,
    Kind,
    ObservedNode,
    ObservedTree,
    StatusChanged,
    TreeSeen,
)
from btcore_monitor.viewer_setup import (
    check_folder,
    check_installed,
    open_sinks,
    save_screenshot,
    stop_on_signals,
    viewer_options,
)

_KINDS: Final[dict[NodeType, Kind]] = {
    NodeType.ACTION: "action",
    NodeType.CONDITION: "condition",
    NodeType.CONTROL: "control",
    NodeType.DECORATOR: "decorator",
    NodeType.SUBTREE: "subtree",
}
_NOT_KEPT: Final = "not in a log file"
LOG_FILE: Final = DataSource(
    "a log file", {"ticks": _NOT_KEPT, "exceptions": _NOT_KEPT, "blackboard": _NOT_KEPT}
)
"""The data source of a log file."""

_COLOURS: Final[dict[Status, str]] = {RUNNING: "yellow", SUCCESS: "green", FAILURE: "red"}


@click.command(short_help="Show a log file again: in the viewer, or as text.")
@click.argument("log", metavar="LOG")
@click.option("--text", is_flag=True, help="Print a line for each transition instead: time, path, old → new.")
@click.option(
    "--node",
    "patterns",
    multiple=True,
    metavar="PATTERN",
    help="With --text: only nodes whose path matches, such as 'Patrol/*'; may be given several times.",
)
@click.option(
    "--from",
    "begin",
    type=float,
    metavar="SECONDS",
    help="Time of the first transition.  [default: the start]",
)
@click.option(
    "--to", "end", type=float, metavar="SECONDS", help="Time of the last transition.  [default: the end]"
)
@viewer_options
def replay(
    log: str,
    text: bool,
    patterns: Sequence[str],
    begin: float | None,
    end: float | None,
    save: Path | None,
    serve_web: int | None,
    screenshot: Path | None,
    at: float | None,
    size: tuple[int, int],
    memory_limit: str,
    display: DisplayOptions,
) -> None:
    """Show LOG: a .btlog, an SQLite log (.db3, .btdb; FILE.db3#2 for session 2) or a format-3 .fbl.

    Without options it opens the viewer, where the time can be moved back and forth. --save, --serve-web and
    --screenshot need no display. Times are in seconds since the log began. A truncated file is shown up to
    its end.
    """
    shown = [option for option, given in _given(save, serve_web, screenshot) if given]
    if text and shown:
        raise click.UsageError(f"--text and {shown[0]} are two answers: ask for one.")
    if patterns and not text:
        raise click.UsageError("--node selects lines, so it needs --text.")
    if begin is not None and end is not None and begin > end:
        raise click.UsageError(f"--from {begin:g} is after --to {end:g}.")
    recording = read_log(log)
    for remark in recording.warnings:
        click.echo(f"warning: {remark}", err=True)
    window = _window(recording, begin, end)
    if text:
        _print(recording, window, patterns)
        return
    check_installed("rerun", "numpy")
    _show(recording, window, save, serve_web, screenshot, at, size, memory_limit, display)


def observed_tree(recording: Recording) -> ObservedTree:
    """Return the tree of *recording* as the monitor draws it."""
    parents = {child: node.uid for node in recording.nodes.values() for child in node.children}
    inside: dict[int, str] = {}
    trees: dict[str, str] = {}
    nodes: list[ObservedNode] = []
    for uid, node in recording.nodes.items():
        parent = parents.get(uid, 0)
        subtree = inside[uid] = inside.get(parent, "")
        kind = _KINDS.get(node.type, "control" if node.children else "action")
        if kind == "subtree":
            trees[node.path] = node.name
            # The nodes below look up their parent's subtree.
            inside[uid] = node.path
        nodes.append(
            ObservedNode(uid, node.name, node.id, kind, node.path, parent, node.children, node.ports, subtree)
        )
    name = recording.path.name
    return ObservedTree(uuid.uuid4().hex, name, tuple(nodes), {"": name, **trees})


def events(recording: Recording, window: range) -> Iterator[Event]:
    """Yield the transitions of *recording* with an index in *window*, as events of a robot."""
    first = recording.transitions[window.start].stamp if window.start else recording.start
    since, stamp = first - recording.start, first
    statuses = dict(recording.statuses(window.start))
    yield TreeSeen(observed_tree(recording), since, stamp, statuses, source=LOG_FILE)
    gaps = [gap for gap in recording.gaps if window.start <= gap.at <= window.stop]
    for index in window:
        before, (stamp, uid, previous, status) = since, recording.transitions[index]
        since = stamp - recording.start
        while gaps and gaps[0].at <= index:
            yield DataMissed(since, stamp, before, "transitions", gaps.pop(0).reason)
        yield StatusChanged(index + 1, since, stamp, 0, uid, previous, status)
    ends = [gap.reason for gap in gaps]
    if recording.damage and window.stop == len(recording.transitions):
        ends.append(recording.damage)
    for said in ends:
        yield DataMissed(since, stamp, since, "transitions", said)


def _given(save: Path | None, serve_web: int | None, screenshot: Path | None) -> list[tuple[str, bool]]:
    return [
        ("--save", save is not None),
        ("--serve-web", serve_web is not None),
        ("--screenshot", screenshot is not None),
    ]


def _window(recording: Recording, begin: float | None, end: float | None) -> range:
    """Return the indices of the changes between *begin* and *end* (s since the start, inclusive)."""
    since = [change.stamp - recording.start for change in recording.transitions]
    chosen = [
        index
        for index, ns in enumerate(since)
        if (begin is None or ns >= begin * NS_PER_S) and (end is None or ns <= end * NS_PER_S)
    ]
    if chosen:
        return range(chosen[0], chosen[-1] + 1)
    if not since:
        return range(0)
    length = since[-1] / NS_PER_S
    raise click.UsageError(
        f"{recording.path}: nothing happens in that time; its transitions are at "
        f"{since[0] / NS_PER_S:.3f} s to {length:.3f} s"
    )


def _print(recording: Recording, window: range, patterns: Sequence[str]) -> None:
    keys = recording.keys()
    for pattern in patterns:
        if not any(fnmatchcase(path, pattern) for path in keys.values()):
            guess = nearest_name(pattern, keys.values())
            hint = f"; did you mean '{guess}'?" if guess else ""
            raise click.UsageError(f"--node: no node's path is like '{pattern}'{hint}")
    chosen = {
        uid: path
        for uid, path in keys.items()
        if not patterns or any(fnmatchcase(path, pattern) for pattern in patterns)
    }
    width = max(map(len, chosen.values()), default=0)
    gaps = [gap for gap in recording.gaps if window.start <= gap.at <= window.stop]
    for index in window:
        while gaps and gaps[0].at <= index:
            click.echo(f"{'—':>12}  gap: {gaps.pop(0).reason}")
        stamp, uid, previous, status = recording.transitions[index]
        if uid in chosen:
            said = format_transition(stamp - recording.start, chosen[uid], previous, status, width)
            colour = _COLOURS.get(status)
            click.secho(said, fg=colour, dim=colour is None)
    for gap in gaps:
        click.echo(f"{'—':>12}  gap: {gap.reason}")
    if recording.damage and window.stop == len(recording.transitions):
        click.echo(f"{'—':>12}  {recording.damage}")


def _show(
    recording: Recording,
    window: range,
    save: Path | None,
    serve_web: int | None,
    screenshot: Path | None,
    at: float | None,
    size: tuple[int, int],
    memory_limit: str,
    display: DisplayOptions,
) -> None:
    from btcore_monitor.screen.sinks import ScreenError

    wants_window = save is None and serve_web is None and screenshot is None
    try:
        with contextlib.ExitStack() as stack:
            file = save
            if screenshot is not None:
                check_folder("--screenshot", screenshot)
                if file is None:
                    folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="btcore-"))
                    file = Path(folder) / "replay.rrd"
            sinks = open_sinks(file, serve_web, wants_window, memory_limit)
            screen = display.screen(sinks)
            for event in events(recording, window):
                screen.show(event)
            screen.close()
            if save is not None:
                click.echo(f"monitor: the recording is {save}", err=True)
            if screenshot is not None:
                save_screenshot(screen.files[-1], screenshot, at, size)
            if serve_web is not None:
                stop = threading.Event()
                click.echo("monitor: Ctrl-C ends it", err=True)
                with stop_on_signals(stop):
                    stop.wait()
    except ScreenError as fault:
        raise click.ClickException(f"{fault}, or --text for lines" if wants_window else str(fault)) from None
