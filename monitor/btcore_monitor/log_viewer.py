"""Logs and recordings in the viewer: the part of `btcore replay` that needs rerun."""

import uuid
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Annotated, Final

from btcore.errors import SettingsError
from btcore.logs import Recording
from btcore.logs.moments import Moment
from btcore.options import option
from btcore_monitor.console import print_message
from btcore_monitor.environment_checks import check_installed
from btcore_monitor.errors import RecordingError
from btcore_monitor.events import (
    NODE_TYPES,
    BlackboardEvent,
    DataSource,
    Event,
    ExceptionEvent,
    LeavesEvent,
    MissingDataEvent,
    ObservedNode,
    ObservedTree,
    SavedSceneEvent,
    TickEvent,
    TransitionEvent,
    TreeEvent,
    infer_node_type,
)
from btcore_monitor.process_end import abandon, wait_for_stop
from btcore_monitor.viewer_options import ViewerOptions

_NOT_KEPT: Final = "not in a log file"
LOG_FILE: Final = DataSource(
    "a log file", {"ticks": _NOT_KEPT, "exceptions": _NOT_KEPT, "blackboard": _NOT_KEPT}
)
"""The source of a tree that is read from a log file, with the data that a log file does not contain."""
RECORDING: Final = DataSource("a recording", {"ticks": "their durations are not recorded"})
"""The source of a run that is run again."""


class LogViewer(ViewerOptions):
    """Shows logs in the viewer.

    It satisfies the protocol of the entry point group `btcore.replay`, which `btcore replay` declares.
    """

    scene: (
        Annotated[
            Path,
            option(
                "Show a recording with the scene of its run, which `btcore run --save` wrote.",
                metavar="FILE.rrd",
            ),
        ]
        | None
    ) = None

    def show(self, recording: Recording, window: range, moments: Iterable[Moment] = ()) -> None:
        """Show the transitions of *recording* with an index in *window*, where the options say.

        *moments* are those of a recording that is run again, in order.
        """
        check_installed("rerun", "numpy")
        self.quiet_viewer()
        from btcore_monitor.screen.rerun_process import ScreenError
        from btcore_monitor.screen.robot_layouts import SingleRobotLayout

        opens_viewer = not self.outputs
        shown = events(recording, window, moments)
        if self.scene is not None:
            shown = _with_scene(shown, self.scene)
        try:
            with self.open_sinks(opens_viewer) as sinks:
                view = self.create_view(SingleRobotLayout(sinks))
                for event in shown:
                    view.process_event(event)
                view.close()
                viewer = sinks.viewer
                if viewer is not None and not viewer.is_open and (failure := viewer.wait_for_failure()):
                    raise ScreenError(f"the viewer (rerun) failed: {failure}")
                if self.save is not None:
                    print_message(f"the recording is {self.save}")
                self.take_screenshot(view.files)
                if self.serve_web is not None:
                    wait_for_stop()
        except RecordingError as error:
            abandon(error)
        except ScreenError as error:
            raise ScreenError(f"{error}, or --text for lines" if opens_viewer else str(error)) from None


def _with_scene(events: Iterator[Event], file: Path) -> Iterator[Event]:
    """Yield *events*, and after the tree the scene in *file*."""
    tree = next(events)
    before: list[Event] = []
    tick: TickEvent | None = None
    while tick is None:
        event = next(events, None)
        if event is None:
            raise SettingsError("--scene needs a recording with a tick: a log has no ticks")
        before.append(event)
        tick = event if isinstance(event, TickEvent) else None
    yield tree
    yield SavedSceneEvent(file, tick.tick, tick.stamp)
    yield from chain(before, events)


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


def events(recording: Recording, window: range, moments: Iterable[Moment] = ()) -> Iterator[Event]:
    """Yield the transitions of *recording* with an index in *window*, and the *moments*, as events."""
    first = recording.transitions[window.start].stamp if window.start else recording.start
    stamp, wall = first - recording.start, first
    statuses = dict(recording.statuses(window.start))
    since = stamp
    known = (moment for moment in moments if moment.time >= since)
    moment = next(known, None)
    source = LOG_FILE if moment is None else RECORDING
    yield TreeEvent(observed_tree(recording), stamp, wall, statuses, source=source)
    # A gap's `at` is the index of the transition that follows the gap.
    gaps = [gap for gap in recording.gaps if window.start <= gap.at <= window.stop]
    for index in window:
        before, (wall, uid, previous, status) = stamp, recording.transitions[index]
        stamp = wall - recording.start
        while moment is not None and moment.time < stamp:
            yield from _moment_events(moment, recording.start)
            moment = next(known, None)
        while gaps and gaps[0].at <= index:
            yield MissingDataEvent(stamp, wall, before, "transitions", gaps.pop(0).reason)
        yield TransitionEvent(index + 1, stamp, wall, 0, uid, previous, status)
    ends = [gap.reason for gap in gaps]
    is_whole = window.stop == len(recording.transitions)
    while moment is not None and (is_whole or moment.time <= stamp):
        yield from _moment_events(moment, recording.start)
        moment = next(known, None)
    if recording.damage and is_whole:
        ends.append(recording.damage)
    for reason in ends:
        yield MissingDataEvent(stamp, wall, stamp, "transitions", reason)


def _moment_events(moment: Moment, start: int) -> Iterator[Event]:
    wall = start + moment.time
    yield TickEvent(moment.tick, moment.time, wall, 0, int(moment.root))
    boards: dict[str, dict[str, str]] = {}
    for path, key, text in moment.entries:
        boards.setdefault(path, {})[key] = text
    yield BlackboardEvent(moment.time, wall, boards)
    yield LeavesEvent(moment.time, wall, moment.tick, tuple(moment.leaves))
    for _, path, _, _, _, error in moment.leaves:
        if error:
            yield ExceptionEvent(moment.time, wall, path, error)
