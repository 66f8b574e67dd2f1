"""The layouts of a viewer: a recording for each tree of a robot, or a shared recording for several robots.

A shared layout has a tab with all robots side by side, and for each robot a tab with all its views. It
uses wall time, because the clocks of the trees are unrelated.
"""

import math
import re
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import rerun as rr
import rerun.blueprint as rrb

from btcore_monitor.screen import blueprint
from btcore_monitor.screen.blueprint import Pane
from btcore_monitor.screen.font import legible
from btcore_monitor.screen.row_buffer import WALL_TIMELINE
from btcore_monitor.screen.sinks import RecordingSinks

SHARED_VIEW_SIZE: Final = (960.0, 505.0)
"""Width and height (pixels) of a tree's view beside another view; in its own tab the tree has more room."""
MAX_EARLIER_PANES: Final = 6
"""Number of trees from before a restart that keep a tab."""
_MAX_SIDE_BY_SIDE: Final = 3
"""Greatest number of robots side by side with log and lanes; more robots have only lanes, in several rows."""


class SingleRobotLayout:
    """A recording for each tree, so that a restarted robot does not overwrite earlier data.

    It has the same methods as a `SharedLayoutSlot`.
    """

    label = ""

    def __init__(self, sinks: RecordingSinks) -> None:
        self._sinks = sinks

    @property
    def is_live(self) -> bool:
        """Whether a viewer shows the recordings while they are made."""
        return self._sinks.is_live

    def begin_recording(self, name: str) -> tuple[rr.RecordingStream, str, Path | None]:
        """Return a recording for the tree *name*, the entity above all its entities, and its file, or None.

        The entity is empty, because the recording has a single tree.
        """
        recording = _create_recording(f"btcore {name}", name)
        return recording, "", self._sinks.attach(recording)

    def show_pane(self, recording: rr.RecordingStream, pane: Pane) -> None:
        """Show *pane* as the only content of the viewer."""
        recording.send_blueprint(blueprint.create_blueprint(blueprint.create_layout(pane), pane.timeline))

    def end_recording(self, recording: rr.RecordingStream) -> None:
        """Finish the recording."""
        self._sinks.finish(recording)


class SharedLayout:
    """A layout for several robots, with a shared recording that begins with the first tree.

    *labels* are the names of the robots for users. The class is thread-safe.
    """

    def __init__(self, sinks: RecordingSinks, labels: Sequence[str]) -> None:
        self.slots = [SharedLayoutSlot(self, label) for label in labels]
        """The part of the layout of each robot."""
        self.files: list[Path] = []
        """The file of the recording, once it has begun."""
        self._sinks = sinks
        self._name = " and ".join(labels)
        self._recording: rr.RecordingStream | None = None
        self._lock = threading.Lock()
        self._prefixes: set[str] = set()
        self._earlier_panes: list[Pane] = []

    @property
    def is_live(self) -> bool:
        """Whether a viewer shows the recording while it is made."""
        return self._sinks.is_live

    def begin_recording(self, slot: "SharedLayoutSlot") -> tuple[rr.RecordingStream, str, Path | None]:
        """Return the recording, a new entity for all entities of a tree, and the file, or None."""
        with self._lock:
            if self._recording is None:
                self._recording = _create_recording(f"btcore {self._name}", self._name)
                file = self._sinks.attach(self._recording)
                self.files += [file] if file is not None else []
            count, first = 1, re.sub(r"[^A-Za-z0-9]+", "_", slot.label).strip("_") or "robot"
            prefix = first
            while prefix in self._prefixes:
                count += 1
                prefix = f"{first}_{count}"
            self._prefixes.add(prefix)
            return self._recording, prefix, self.files[0] if self.files else None

    def show_pane(self, recording: rr.RecordingStream, slot: "SharedLayoutSlot", pane: Pane) -> None:
        """Show *pane* in *slot*; an earlier tree of the slot moves to a tab behind the others."""
        with self._lock:
            # A pane with the same prefix is a newer version of the same tree's pane.
            if slot.pane is not None and slot.pane.entity_path_prefix != pane.entity_path_prefix:
                self._earlier_panes = [*self._earlier_panes, slot.pane][-MAX_EARLIER_PANES:]
            slot.pane = pane
            panes = [slot.pane for slot in self.slots if slot.pane is not None]
            tabs = [blueprint.create_layout(pane, pane.name) for pane in panes]
            tabs += [blueprint.create_layout(pane, f"{pane.name}, earlier") for pane in self._earlier_panes]
            recording.send_blueprint(
                blueprint.create_blueprint(rrb.Tabs(_side_by_side(panes), *tabs), WALL_TIMELINE)
            )

    def close(self) -> None:
        """Finish the recording of all robots."""
        recording, self._recording = self._recording, None
        if recording is not None:
            self._sinks.finish(recording)


class SharedLayoutSlot:
    """A robot's part of a shared layout."""

    def __init__(self, layout: SharedLayout, label: str) -> None:
        self.label = label
        """The robot's name for users."""
        self.pane: Pane | None = None
        """The present content."""
        self._layout = layout

    @property
    def is_live(self) -> bool:
        """Whether a viewer shows the recording while it is made."""
        return self._layout.is_live

    def begin_recording(self, name: str) -> tuple[rr.RecordingStream, str, Path | None]:
        """Return the shared recording, a new entity for all entities of the tree, and the file, or None."""
        return self._layout.begin_recording(self)

    def show_pane(self, recording: rr.RecordingStream, pane: Pane) -> None:
        """Show *pane* without changing other robots' panes."""
        self._layout.show_pane(recording, self, pane)

    def end_recording(self, recording: rr.RecordingStream) -> None:
        """Do nothing: other robots may still write to the recording."""


RobotLayout = SingleRobotLayout | SharedLayoutSlot
"""The layout of a robot's successive trees: alone in the viewer, or beside other robots."""


def _side_by_side(panes: Sequence[Pane]) -> rrb.Container:
    if len(panes) > _MAX_SIDE_BY_SIDE:
        small = [
            rrb.Vertical(
                blueprint.create_tree_views(pane), blueprint.create_lanes_view(pane), row_shares=[0.68, 0.32]
            )
            for pane in panes
        ]
        return rrb.Grid(*small, grid_columns=math.ceil(math.sqrt(len(panes))), name="All robots")
    columns = [
        rrb.Vertical(
            blueprint.create_tree_views(pane),
            blueprint.create_lanes_view(pane),
            rrb.Horizontal(
                blueprint.create_now_view(pane), blueprint.create_log_view(pane), column_shares=[0.38, 0.62]
            ),
            row_shares=[0.5, 0.28, 0.22],
        )
        for pane in panes
    ]
    return rrb.Horizontal(*columns, name="All robots")


def _create_recording(application: str, name: str) -> rr.RecordingStream:
    # The viewer keeps a blueprint for each application name, so layouts with different trees need different
    # names.
    recording = rr.RecordingStream(re.sub(r"[^A-Za-z0-9_ -]+", "_", application))
    # Without the timelines that rerun adds by itself, which have no meaning here.
    recording.set_log_tick_enabled(False)
    recording.set_log_time_enabled(False)
    recording.send_recording_name(legible(name))
    return recording
