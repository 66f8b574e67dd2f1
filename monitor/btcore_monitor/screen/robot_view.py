"""The view of a robot: converts the events of a running tree to rows of a rerun recording."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from btcore_monitor.events import (
    RUN_CHANNEL,
    BlackboardEvent,
    ConnectionEvent,
    DataSource,
    Event,
    ExceptionEvent,
    HooksEvent,
    LostTransitionsEvent,
    MissingDataEvent,
    MovingSceneEvent,
    StaticSceneEvent,
    TickEvent,
    TransitionEvent,
    TreeEvent,
)
from btcore_monitor.screen.blackboard_table import BLACKBOARD, BlackboardTable
from btcore_monitor.screen.blueprint import LIVE_SPAN_NS, MAX_WHOLE_SPAN_NS, Pane, tree_room
from btcore_monitor.screen.folding import FoldedTreeView
from btcore_monitor.screen.font import legible
from btcore_monitor.screen.lanes import Lanes
from btcore_monitor.screen.panels import (
    LEVELS,
    NowPanel,
    StatisticsTable,
    TickCost,
    TransitionLog,
)
from btcore_monitor.screen.row_buffer import RowBuffer
from btcore_monitor.screen.scene import SPEED, SceneView
from btcore_monitor.screen.sinks import RecordingSinks
from btcore_monitor.screen.style import GROOT, Palette
from btcore_monitor.screen.tick_states import TickStates
from btcore_monitor.screen.tree import FOLD_ABOVE_NODES, TreeView, matching
from btcore_monitor.screen.viewer_windows import ROOM, RobotWindow, SingleRobotWindow

_ENDLESS_NS: Final = 1 << 62
SEND_INTERVAL_S: Final = 0.2
"""Wall time (s) between two transmissions of buffered rows to a viewer while events arrive."""
WRITE_INTERVAL_S: Final = 10.0
"""Wall time (s) between two transmissions to a file alone.

Each transmission adds about 4 kB for each entity to the file, whatever the number of rows.
"""
WRITE_TRANSITIONS_INTERVAL_S: Final = 0.7
"""Wall time (s) between two transmissions of transitions to a file alone: a killed recorder loses no more."""
_MAX_BUFFERED_EVENTS: Final = 2000
"""Number of events after which the rows are sent at the latest."""


class RobotView:
    """The view of a robot.

    Call `show` for each event in order, `pause` while no events arrive, and `close` at the
    end. A tree with a new id begins a new recording, so that a restarted robot does not overwrite the old
    data.

    Args:
        sinks: The destinations of the recordings, or the robot's part of a window with several robots.
        palette: The colours.
        find: Patterns such as `Dock*`. Nodes whose name or path matches are highlighted and have lanes.
        level: The lowest level of the log's lines (a member of LEVELS).
    """

    def __init__(
        self,
        sinks: RecordingSinks | RobotWindow,
        palette: Palette = GROOT,
        find: Sequence[str] = (),
        level: str = LEVELS[0],
    ) -> None:
        self.files: list[Path] = []
        self._window = SingleRobotWindow(sinks) if isinstance(sinks, RecordingSinks) else sinks
        self._palette = palette
        self._find = find
        self._level = level
        self._display: _TreeDisplay | None = None
        self._new_tree: TreeEvent | None = None
        self._scene: StaticSceneEvent | None = None
        self._sent = self._transitions_sent = time.monotonic()
        self._events = 0

    @property
    def tree(self) -> TreeView | None:
        """The drawing of the current tree, or None if no tree has been drawn."""
        return self._display.tree if self._display is not None else None

    def show(self, event: Event) -> None:
        """Process an event."""
        if isinstance(event, TreeEvent):
            self._draw()
            self._new_tree = event
        # Robots send the static scene right after the tree; it belongs to the tree that is drawn next.
        elif isinstance(event, StaticSceneEvent) and (self._new_tree is not None or self._display is None):
            self._scene = event
            self._draw()
        else:
            self._draw()
            if self._display is not None:
                self._display.show(event)
        self._events += 1
        self._send_if_due(SEND_INTERVAL_S)

    def pause(self) -> None:
        """Process a moment without events: a viewer receives the buffered rows now, a file later."""
        self._draw()
        if self._display is not None:
            self._display.settle()
        self._send_if_due(0.0)

    def _send_if_due(self, live_interval: float) -> None:
        """Send the rows whose time has come; *live_interval* (s) is the time between two for a viewer."""
        now = time.monotonic()
        interval = live_interval if self._window.is_live else WRITE_INTERVAL_S
        if now - self._sent >= interval or self._events >= _MAX_BUFFERED_EVENTS:
            self.flush()
        elif now - self._transitions_sent >= WRITE_TRANSITIONS_INTERVAL_S and not self._window.is_live:
            self._transitions_sent = now
            if self._display is not None:
                self._display.log.send()

    def flush(self) -> None:
        """Send the buffered rows."""
        self._sent = self._transitions_sent = time.monotonic()
        self._events = 0
        self._draw()
        if self._display is not None:
            self._display.settle()
            self._display.send()

    def close(self) -> None:
        """Send the buffered rows and finish the recording."""
        self._draw()
        self._finish()

    def _draw(self) -> None:
        """Draw the new tree, if there is any.

        A new tree is not drawn before the next event, which may be its scene: beside a scene, the tree has
        less room.
        """
        new, self._new_tree = self._new_tree, None
        if new is None:
            return
        if self._display is not None and self._display.is_of(new):
            self._display.resume(new)
        else:
            self._finish()
            scene = self._scene is not None
            self._display = _TreeDisplay(new, self._window, self._palette, scene, self._find, self._level)
            if self._display.file is not None:
                self.files.append(self._display.file)
        if self._scene is not None:
            self._display.show(self._scene)
            self._scene = None
        self._sent = time.monotonic()

    def _finish(self) -> None:
        if self._display is not None:
            self._display.close()
            self._display = None


class _TreeDisplay:
    """A displayed tree with its recording."""

    def __init__(
        self,
        event: TreeEvent,
        window: RobotWindow,
        palette: Palette,
        scene: bool,
        find: Sequence[str],
        level: str,
    ) -> None:
        tree = event.tree
        self.tree_id = tree.tree_id
        self.name = legible(f"{window.label} · {tree.name}" if window.label else tree.name)
        self.numbered = event.numbered
        self.source = DataSource("")
        self.window = window
        self.recording, self.place, self.file = window.begin(tree.name)
        # Other sources count the time from their beginning already.
        origin = event.stamp if event.source == RUN_CHANNEL else 0
        self.rows = RowBuffer(self.recording, self.place, origin)
        self.level = level
        self._palette = palette
        self.states = TickStates(tree)
        self._uids = {node.path: node.uid for node in tree.nodes}
        matches = {pattern: matching(tree, pattern) for pattern in find}
        found = {uid for uids in matches.values() for uid in uids}
        self.lanes = Lanes(self.rows, tree, palette, found)
        room = ROOM if self.place else tree_room(len(self.lanes.entities), scene)
        self.tree = TreeView(self.rows, tree, palette, room, found)
        self.trees: list[TreeView | FoldedTreeView] = [self.tree]
        if len(tree.nodes) > FOLD_ABOVE_NODES:
            self.trees.insert(0, FoldedTreeView(self.rows, tree, palette, room, found))
        self.log = TransitionLog(self.rows, tree, palette)
        self.blackboard = BlackboardTable(self.rows, tree, palette)
        self.cost = TickCost(self.rows, palette)
        self.now = NowPanel(self.rows, tree)
        self.statistics = StatisticsTable(self.rows, tree)
        self.scene = SceneView(self.rows, palette)
        self._stamp, self._wall = event.stamp, event.wall
        self._last_tick_stamp = event.stamp - 1
        self._begin = self._now
        self._end = self._begin + LIVE_SPAN_NS
        self._show_source(event.source, event.stamp, event.wall)
        for pattern, uids in matches.items():
            if not uids:
                self.log.add_unmatched_pattern(pattern, event.stamp, event.wall)
        self._is_rearranged = True
        self._shown_filled = self._list_filled()
        self._show_blueprint()
        for view in self.trees:
            view.draw()
        self.lanes.draw()
        self.cost.draw()
        self._restart(event)
        self._handlers: dict[type, Callable[..., None]] = {
            TransitionEvent: self._show_transition,
            TickEvent: self._show_tick,
            BlackboardEvent: self._show_blackboards,
            StaticSceneEvent: self._show_static_scene,
            MovingSceneEvent: self._show_moving_scene,
            ExceptionEvent: self._show_exception,
            LostTransitionsEvent: self._show_gap,
            MissingDataEvent: self._show_missing_data,
            HooksEvent: self.log.add_hooks,
            ConnectionEvent: self._show_connection,
        }

    def resume(self, event: TreeEvent) -> None:
        """Continue the same tree with the statuses in *event*. The transitions before it are unknown."""
        self._move_to(event.stamp, event.wall)
        self._restart(event)

    def is_of(self, event: TreeEvent) -> bool:
        """Return whether *event* has this tree, and comes from a source with the same clock and numbering."""
        return self.tree_id == event.tree.tree_id and self.numbered == event.numbered

    def _restart(self, event: TreeEvent) -> None:
        self._show_source(event.source, event.stamp, event.wall)
        self.states.start(event.stamp, event.wall, event.statuses)
        self._colour()
        self.blackboard.run(self.states)
        self.lanes.show(self.states, range(len(self.states.shown)))
        self.statistics.start(event.stamp, event.wall, event.statuses)
        if "ticks" in self.source.unavailable:
            self.now.show_states(self.states)

    def show(self, event: Event) -> None:
        handler = self._handlers.get(type(event))
        if handler is not None:
            handler(event)

    def _show_source(self, source: DataSource, stamp: int, wall: int) -> None:
        if source == self.source:
            return
        self.source = source
        self.now.show_source(source)
        self.log.show_source(source, stamp, wall)
        self.blackboard.note = source.unavailable.get("blackboard", "")
        if self.blackboard.note:
            self.blackboard.blank(stamp, wall)

    def settle(self) -> None:
        """Show the last changes of a robot that does not report the end of a tick."""
        if "ticks" in self.source.unavailable and self.states.is_open:
            self._end_tick(self._stamp, self._wall)

    def send(self) -> None:
        """Send the buffered rows, and the arrangement of the views if it has changed."""
        if self._is_rearranged:
            self._is_rearranged = False
            self.window.show(self.recording, self._create_pane())
        self.rows.send()

    def close(self) -> None:
        self._show_remaining()
        if self._now - self._begin <= MAX_WHOLE_SPAN_NS:
            self._end = self._now
            self._show_blueprint()
        self.statistics.show(self._stamp, self._wall)
        self.send()
        self.window.end(self.recording)

    def _show_remaining(self) -> None:
        """Show the changes after the last tick, for example of a tree that was halted."""
        if self.states.is_open:
            # A halt at the time of the last tick must not hide the states of that tick.
            self._stamp = self.states.stamp = max(self._stamp, self._last_tick_stamp + 1)
            self._end_tick(self._stamp, self._wall)
            self.now.show_states(self.states)

    @property
    def _now(self) -> int:
        """The time (ns) of the last event on the window's timeline."""
        return self._wall if self.place else self._stamp - self.rows.origin

    def _end_tick(self, stamp: int, wall: int) -> None:
        changed = self.states.close(stamp, wall)
        if changed:
            self._colour()
            self.blackboard.run(self.states)
            self.lanes.show(self.states, changed)
            if "ticks" in self.source.unavailable:
                self.now.show_states(self.states)

    def _colour(self) -> None:
        for view in self.trees:
            view.colour(self.states)

    def _move_to(self, stamp: int, wall: int) -> None:
        self._stamp, self._wall = stamp, wall
        if self._now > self._end:
            # The axes follow the cursor from now on.
            self._end = _ENDLESS_NS
            self._show_blueprint()

    def _show_transition(self, event: TransitionEvent) -> None:
        # First, because the states of the previous tick must not contain this event.
        if self.states.is_over(event):
            self._end_tick(self._stamp, self._wall)
        self._move_to(event.stamp, event.wall)
        self.states.change(event)
        self.log.add_transition(event)
        self.statistics.change(event)
        self.statistics.update(event.stamp, event.wall)

    def _show_tick(self, event: TickEvent) -> None:
        self._move_to(event.stamp, event.wall)
        self._last_tick_stamp = event.stamp
        self._end_tick(event.stamp, event.wall)
        self.cost.tick(event)
        self.now.show_tick(event, self.states)
        self.statistics.update(event.stamp, event.wall)

    def _show_blackboards(self, event: BlackboardEvent) -> None:
        self._move_to(event.stamp, event.wall)
        self.blackboard.show(event.stamp, event.wall, event.boards)
        self._show_filled_views()

    def _show_static_scene(self, event: StaticSceneEvent) -> None:
        if self.scene.static(self._stamp, self._wall, event.data):
            self._show_blueprint()

    def _show_moving_scene(self, event: MovingSceneEvent) -> None:
        self._move_to(event.stamp, event.wall)
        pictured = self.scene.pictured
        self.scene.moving(event.stamp, event.wall, event.data)
        self.now.keep_notes(event.data)
        if self.scene.pictured != pictured:
            self._show_blueprint()
        self._show_filled_views()

    def _show_exception(self, event: ExceptionEvent) -> None:
        self._move_to(event.stamp, event.wall)
        self.log.add_exception(event)
        self.now.show_exception(event, self.states)
        uid = self._uids.get(event.path)
        if uid is not None:
            for view in self.trees:
                view.raised(uid, event.stamp, event.wall)

    def _show_gap(self, event: LostTransitionsEvent) -> None:
        self.log.add_gap(event, self._stamp, self._wall)
        self.now.count_missing(event)

    def _show_missing_data(self, event: MissingDataEvent) -> None:
        self.log.add_missing_data(event)
        self.now.count_missing(event)

    def _show_connection(self, event: ConnectionEvent) -> None:
        self.log.add_connection(event, self._stamp, self._wall)
        if event.state == "ended":
            self._show_remaining()

    def _list_filled(self) -> frozenset[str]:
        """Return the entities of the panels that have data to show."""
        has = {
            BLACKBOARD: self.blackboard.has_entries or bool(self.blackboard.note),
            SPEED: self.scene.has_speed,
        }
        return frozenset(entity for entity, is_filled in has.items() if is_filled)

    def _show_filled_views(self) -> None:
        """Give a panel its place in the window when its first data arrive."""
        filled = self._list_filled()
        if filled != self._shown_filled:
            self._shown_filled = filled
            self._show_blueprint()

    def _show_blueprint(self) -> None:
        # Sent with the next rows: when a run begins, several panels get their first data at once.
        self._is_rearranged = True

    def _create_pane(self) -> Pane:
        return Pane(
            self._palette,
            self.name,
            self.trees,
            self.lanes,
            self.scene.eye(),
            costed="ticks" not in self.source.unavailable,
            level=self.level,
            place=self.place,
            span=(self._begin, self._end),
            filled=self._list_filled(),
        )
