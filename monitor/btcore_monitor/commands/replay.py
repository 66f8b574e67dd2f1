"""`btcore replay`: show a log file in the viewer, or print its transitions as text."""

import uuid
from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase
from typing import Final

import click

from btcore.clock import NS_PER_S
from btcore.escaping import escape_controls
from btcore.logs import Recording, read_log
from btcore.logs.recording import format_transition
from btcore.status import FAILURE, RUNNING, SUCCESS, Status
from btcore.suggestions import did_you_mean
from btcore_monitor.console import print_line, print_message
from btcore_monitor.environment_checks import check_installed
from btcore_monitor.errors import RecordingError
from btcore_monitor.events import (
    NODE_TYPES,
    DataSource,
    Event,
    MissingDataEvent,
    ObservedNode,
    ObservedTree,
    TransitionEvent,
    TreeEvent,
    infer_node_type,
)
from btcore_monitor.process_end import abandon, wait_for_stop
from btcore_monitor.viewer_options import ViewerOptions, pass_viewer_options

_NOT_KEPT: Final = "not in a log file"
LOG_FILE: Final = DataSource(
    "a log file", {"ticks": _NOT_KEPT, "exceptions": _NOT_KEPT, "blackboard": _NOT_KEPT}
)
"""The source of a tree that is read from a log file, with the data that a log file does not contain."""

_COLOURS: Final[dict[Status, str]] = {RUNNING: "yellow", SUCCESS: "green", FAILURE: "red"}


@click.command(short_help="Show a log file again: in the viewer, or as text.")
@click.argument("log", metavar="LOG")
@click.option("--text", is_flag=True, help="Print a line for each transition instead: time, path, old → new.")
@click.option(
    "--node",
    "node_patterns",
    multiple=True,
    metavar="PATTERN",
    help="With --text: only nodes whose path matches, such as 'Patrol/*'; may be given several times.",
)
@click.option(
    "--from",
    "from_s",
    type=float,
    metavar="SECONDS",
    help="Time of the first transition.  [default: the start]",
)
@click.option(
    "--to", "to_s", type=float, metavar="SECONDS", help="Time of the last transition.  [default: the end]"
)
@pass_viewer_options
def replay(
    log: str,
    text: bool,
    node_patterns: Sequence[str],
    from_s: float | None,
    to_s: float | None,
    options: ViewerOptions,
) -> None:
    """Show LOG: a .btlog, an SQLite log (.db3, .btdb; FILE.db3#2 for session 2), a bag (.mcap) or a .fbl.

    Without options it opens the viewer, where the time can be moved back and forth. --save, --serve-web and
    --screenshot need no display. Times are in seconds since the log began. A truncated file is shown up to
    its end.
    """
    if text and options.outputs:
        raise click.UsageError(f"--text and {options.outputs[0]} exclude each other: choose one.")
    if node_patterns and not text:
        raise click.UsageError("--node selects lines, so it needs --text.")
    if from_s is not None and to_s is not None and from_s > to_s:
        raise click.UsageError(f"--from {from_s:g} is after --to {to_s:g}.")
    recording = read_log(log)
    for warning in recording.warnings:
        print_line(f"warning: {warning}", err=True)
    window = _find_window(recording, from_s, to_s)
    if text:
        _print(recording, window, node_patterns)
        return
    check_installed("rerun", "numpy")
    _show_recording(recording, window, options)


def observed_tree(recording: Recording) -> ObservedTree:
    """Return the tree of *recording*, with a new tree ID, in the form that the monitor draws."""
    parents = {child: node.uid for node in recording.nodes.values() for child in node.children}
    inside: dict[int, str] = {}
    trees: dict[str, str] = {}
    nodes: list[ObservedNode] = []
    for uid, node in recording.nodes.items():
        parent = parents.get(uid, 0)
        subtree = inside[uid] = inside.get(parent, "")
        node_type = NODE_TYPES[node.type - 1] if node.type else infer_node_type(len(node.children))
        if node_type == "subtree":
            trees[node.path] = node.name
            # The nodes below look up their parent's subtree.
            inside[uid] = node.path
        nodes.append(
            ObservedNode(
                uid, node.name, node.id, node_type, node.path, parent, node.children, node.ports, subtree
            )
        )
    name = recording.path.name
    return ObservedTree(uuid.uuid4().hex, name, tuple(nodes), {"": name, **trees})


def events(recording: Recording, window: range) -> Iterator[Event]:
    """Yield the transitions of *recording* with an index in *window*, as events of a robot."""
    first = recording.transitions[window.start].stamp if window.start else recording.start
    stamp, wall = first - recording.start, first
    statuses = dict(recording.statuses(window.start))
    yield TreeEvent(observed_tree(recording), stamp, wall, statuses, source=LOG_FILE)
    # A gap's `at` is the index of the transition that follows the gap.
    gaps = [gap for gap in recording.gaps if window.start <= gap.at <= window.stop]
    for index in window:
        before, (wall, uid, previous, status) = stamp, recording.transitions[index]
        stamp = wall - recording.start
        while gaps and gaps[0].at <= index:
            yield MissingDataEvent(stamp, wall, before, "transitions", gaps.pop(0).reason)
        yield TransitionEvent(index + 1, stamp, wall, 0, uid, previous, status)
    ends = [gap.reason for gap in gaps]
    if recording.damage and window.stop == len(recording.transitions):
        ends.append(recording.damage)
    for reason in ends:
        yield MissingDataEvent(stamp, wall, stamp, "transitions", reason)


def _find_window(recording: Recording, from_s: float | None, to_s: float | None) -> range:
    """Return the indices of the transitions between *from_s* and *to_s* (s since the start, inclusive)."""
    since = [change.stamp - recording.start for change in recording.transitions]
    chosen = [
        index
        for index, ns in enumerate(since)
        if (from_s is None or ns >= from_s * NS_PER_S) and (to_s is None or ns <= to_s * NS_PER_S)
    ]
    if chosen:
        return range(chosen[0], chosen[-1] + 1)
    if not since:
        return range(0)
    length = since[-1] / NS_PER_S
    raise click.UsageError(
        f"{recording.path}: there are no transitions in this time range; the transitions are at "
        f"{since[0] / NS_PER_S:.3f} s to {length:.3f} s"
    )


def _print(recording: Recording, window: range, patterns: Sequence[str]) -> None:
    keys = recording.keys()
    for pattern in patterns:
        if not any(fnmatchcase(path, pattern) for path in keys.values()):
            hint = did_you_mean(pattern, keys.values())
            raise click.UsageError(f"--node: no node's path matches '{pattern}'{hint}")
    chosen = {
        uid: escape_controls(path, one_line=True)
        for uid, path in keys.items()
        if not patterns or any(fnmatchcase(path, pattern) for pattern in patterns)
    }
    width = max(map(len, chosen.values()), default=0)
    for event in events(recording, window):
        if isinstance(event, MissingDataEvent):
            label = "" if event.reason == recording.damage else "gap: "
            print_line(f"{'—':>12}  {label}{event.reason}")
        elif isinstance(event, TransitionEvent) and event.uid in chosen:
            status = Status(event.status)
            line = format_transition(event.stamp, chosen[event.uid], Status(event.previous), status, width)
            colour = _COLOURS.get(status)
            print_line(line, colour=colour, dim=colour is None)


def _show_recording(recording: Recording, window: range, options: ViewerOptions) -> None:
    from btcore_monitor.screen.rerun_process import ScreenError
    from btcore_monitor.screen.robot_layouts import SingleRobotLayout

    opens_viewer = not options.outputs
    try:
        with options.open_sinks(opens_viewer) as sinks:
            view = options.create_view(SingleRobotLayout(sinks))
            for event in events(recording, window):
                view.process_event(event)
            view.close()
            viewer = sinks.viewer
            if viewer is not None and not viewer.is_open and (failure := viewer.wait_for_failure()):
                raise ScreenError(f"the viewer (rerun) failed: {failure}")
            if options.save is not None:
                print_message(f"the recording is {options.save}")
            options.take_screenshot(view.files)
            if options.serve_web is not None:
                wait_for_stop()
    except RecordingError as error:
        abandon(error)
    except ScreenError as error:
        raise ScreenError(f"{error}, or --text for lines" if opens_viewer else str(error)) from None
