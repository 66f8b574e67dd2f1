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
    LeavesEvent,
    LostTransitionsEvent,
    MissingDataEvent,
    MovingSceneEvent,
    SavedSceneEvent,
    StaticSceneEvent,
    TickEvent,
    TransitionEvent,
    TreeEvent,
)
from btcore_monitor.screen.blackboard_table import BLACKBOARD, BlackboardTable
from btcore_monitor.screen.blueprint import LIVE_SPAN_NS, MAX_WHOLE_SPAN_NS, Pane, compute_tree_view_size
from btcore_monitor.screen.folding import FoldedTreeView
from btcore_monitor.screen.font import legible
from btcore_monitor.screen.lanes import Lanes
from btcore_monitor.screen.leaf_table import LEAVES, LeafTable
from btcore_monitor.screen.panels import (
    LEVELS,
    NowPanel,
    StatisticsTable,
    TickPlots,
    TransitionLog,
)
from btcore_monitor.screen.robot_layouts import SHARED_VIEW_SIZE, RobotLayout
from btcore_monitor.screen.row_buffer import RowBuffer
from btcore_monitor.screen.saved_scene import SavedScene
from btcore_monitor.screen.scene_view import SPEED, SceneView
from btcore_monitor.screen.style import GROOT, Palette
from btcore_monitor.screen.tick_states import TickStates
from btcore_monitor.screen.tree_view import FOLD_ABOVE_NODES, TreeView, match_nodes

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

    Call `process_event` for each event in order, `process_idle` while no events arrive, and `close` at the
    end. A tree with a new id begins a new recording, so that a restarted robot does not overwrite the old
    data.

    Args:
        robot_layout: Creates the recordings and arranges the view in the viewer.
        palette: The colours.
        find_patterns: Patterns such as `Dock*`. Matching names or paths are highlighted and have lanes.
        log_level: The lowest level of the log's lines (a member of LEVELS).
    """

    def __init__(
        self,
        robot_layout: RobotLayout,
        palette: Palette = GROOT,
        find_patterns: Sequence[str] = (),
        log_level: str = LEVELS[0],
    ) -> None:
        self.files: list[Path] = []
        self._robot_layout = robot_layout
        self._palette = palette
        self._find_patterns = find_patterns
        self._log_level = log_level
        self._panels: _TreePanels | None = None
        self._undrawn_tree: TreeEvent | None = None
        self._scene: StaticSceneEvent | SavedSceneEvent | None = None
        self._sent_at = self._transitions_sent_at = time.monotonic()
        self._buffered_events = 0

    @property
    def tree_view(self) -> TreeView | None:
        """The drawing of the current tree, or None if no tree has been drawn."""
        return self._panels.tree_view if self._panels is not None else None

    def process_event(self, event: Event) -> None:
        """Process an event."""
        if isinstance(event, TreeEvent):
            self._draw_new_tree()
            self._undrawn_tree = event
        # Robots send the static scene right after the tree; it belongs to the tree that is drawn next.
        elif isinstance(event, StaticSceneEvent | SavedSceneEvent) and (
            self._undrawn_tree is not None or self._panels is None
        ):
            self._scene = event
            self._draw_new_tree()
        else:
            self._draw_new_tree()
            if self._panels is not None:
                self._panels.process_event(event)
        self._buffered_events += 1
        self._send_if_due(SEND_INTERVAL_S)

    def process_idle(self) -> None:
        """Process a moment without events: a viewer receives the buffered rows now, a file later."""
        self._draw_new_tree()
        if self._panels is not None:
            self._panels.end_unreported_tick()
        self._send_if_due(0.0)

    def _send_if_due(self, live_interval: float) -> None:
        """Send the rows whose time has come; *live_interval* (s) is the time between two for a viewer."""
        now = time.monotonic()
        is_live = self._robot_layout.is_live
        interval = live_interval if is_live else WRITE_INTERVAL_S
        if now - self._sent_at >= interval or self._buffered_events >= _MAX_BUFFERED_EVENTS:
            self.flush()
        elif now - self._transitions_sent_at >= WRITE_TRANSITIONS_INTERVAL_S and not is_live:
            self._transitions_sent_at = now
            if self._panels is not None:
                self._panels.transition_log.send()

    def flush(self) -> None:
        """Send the buffered rows."""
        self._sent_at = self._transitions_sent_at = time.monotonic()
        self._buffered_events = 0
        self._draw_new_tree()
        if self._panels is not None:
            self._panels.end_unreported_tick()
            self._panels.send()

    def close(self) -> None:
        """Send the buffered rows and finish the recording."""
        self._draw_new_tree()
        self._close_panels()

    def _draw_new_tree(self) -> None:
        """Draw the new tree, if there is any.

        A new tree is not drawn before the next event, which may be its scene: beside a scene, the tree has
        less room.
        """
        new, self._undrawn_tree = self._undrawn_tree, None
        if new is None:
            return
        if self._panels is not None and self._panels.is_same_tree(new):
            self._panels.resume(new)
        else:
            self._close_panels()
            has_scene = self._scene is not None
            self._panels = _TreePanels(
                new, self._robot_layout, self._palette, has_scene, self._find_patterns, self._log_level
            )
            if self._panels.file is not None:
                self.files.append(self._panels.file)
        if self._scene is not None:
            self._panels.process_event(self._scene)
            self._scene = None
        self._sent_at = time.monotonic()

    def _close_panels(self) -> None:
        if self._panels is not None:
            self._panels.close()
            self._panels = None


class _TreePanels:
    """All panels of a tree, and their recording."""

    def __init__(
        self,
        event: TreeEvent,
        robot_layout: RobotLayout,
        palette: Palette,
        has_scene: bool,
        find_patterns: Sequence[str],
        log_level: str,
    ) -> None:
        tree = event.tree
        self.tree_id = tree.tree_id
        self.name = legible(f"{robot_layout.label} · {tree.name}" if robot_layout.label else tree.name)
        self.has_transition_numbers = event.has_transition_numbers
        self.source = DataSource("")
        self.robot_layout = robot_layout
        self.recording, self.entity_path_prefix, self.file = robot_layout.begin_recording(tree.name)
        self.log_level = log_level
        self._palette = palette
        self._uids = {node.path: node.uid for node in tree.nodes}
        # Other sources count the time from their beginning already.
        start_stamp = event.stamp if event.source == RUN_CHANNEL else 0
        rows = self.rows = RowBuffer(self.recording, self.entity_path_prefix, start_stamp)
        rows.move_to(event.stamp, event.wall)
        matches = {pattern: match_nodes(tree, pattern) for pattern in find_patterns}
        highlighted = {uid for uids in matches.values() for uid in uids}

        self.states = TickStates(tree)
        self.lanes = Lanes(rows, tree, palette, highlighted)
        lane_count = len(self.lanes.entities)
        view_size = (
            SHARED_VIEW_SIZE if self.entity_path_prefix else compute_tree_view_size(lane_count, has_scene)
        )
        self.tree_view = TreeView(rows, tree, palette, view_size, highlighted)
        self.tree_views: list[TreeView | FoldedTreeView] = [self.tree_view]
        if len(tree.nodes) > FOLD_ABOVE_NODES:
            self.tree_views.insert(0, FoldedTreeView(rows, tree, palette, view_size, highlighted))
        self.transition_log = TransitionLog(rows, tree, palette)
        self.blackboard_table = BlackboardTable(rows, tree, palette)
        self.leaf_table = LeafTable(rows, tree)
        self.tick_plots = TickPlots(rows, palette)
        self.now_panel = NowPanel(rows, tree)
        self.statistics_table = StatisticsTable(rows, tree)
        self.scene_view = SceneView(rows, palette)
        self._handlers: dict[type, Callable[..., None]] = {
            TransitionEvent: self._show_transition,
            TickEvent: self._show_tick,
            BlackboardEvent: self._show_blackboard,
            LeavesEvent: self.leaf_table.show,
            StaticSceneEvent: self._show_static_scene,
            SavedSceneEvent: self._show_saved_scene,
            MovingSceneEvent: self._show_moving_scene,
            ExceptionEvent: self._show_exception,
            LostTransitionsEvent: self._show_lost_transitions,
            MissingDataEvent: self._show_missing_data,
            HooksEvent: self.transition_log.add_hooks,
            ConnectionEvent: self._show_connection,
        }

        self._last_tick_stamp = event.stamp - 1
        self._begin_time = self._current_time
        self._end_time = self._begin_time + LIVE_SPAN_NS
        self._shown_pane: Pane | None = None
        self._draw_beginning(event, [pattern for pattern, uids in matches.items() if not uids])

    def _draw_beginning(self, event: TreeEvent, unmatched_patterns: Sequence[str]) -> None:
        self._show_source(event.source)
        for pattern in unmatched_patterns:
            self.transition_log.add_unmatched_pattern(pattern)
        for view in self.tree_views:
            view.draw()
        self.lanes.draw()
        self.tick_plots.draw()
        self._restart(event)

    def resume(self, event: TreeEvent) -> None:
        """Continue the same tree with the statuses in *event*. The transitions before it are unknown."""
        self._move_to(event.stamp, event.wall)
        self._restart(event)

    def is_same_tree(self, event: TreeEvent) -> bool:
        """Return whether *event* has this tree, and comes from a source with the same clock and numbering."""
        return (
            self.tree_id == event.tree.tree_id and self.has_transition_numbers == event.has_transition_numbers
        )

    def _restart(self, event: TreeEvent) -> None:
        self._show_source(event.source)
        self.states.begin(event.stamp, event.wall, event.statuses)
        self._colour()
        self.blackboard_table.show_running(self.states)
        self.lanes.show_states(self.states, range(len(self.states.shown)))
        self.statistics_table.begin(event.statuses)
        if not self._has_ticks:
            self.now_panel.show_states(self.states)

    def process_event(self, event: Event) -> None:
        handler = self._handlers.get(type(event))
        if handler is not None:
            handler(event)

    def _show_source(self, source: DataSource) -> None:
        if source == self.source:
            return
        self.source = source
        self.now_panel.show_source(source)
        self.transition_log.show_source(source)
        self.blackboard_table.note = source.unavailable.get("blackboard", "")
        if self.blackboard_table.note:
            self.blackboard_table.show_note()

    def end_unreported_tick(self) -> None:
        """Show the last changes of a robot that does not report the end of a tick."""
        if not self._has_ticks and self.states.has_open_tick:
            self._end_tick()

    def send(self) -> None:
        """Send the buffered rows, and the arrangement of the views if it has changed."""
        pane = self._create_pane()
        if pane != self._shown_pane:
            self._shown_pane = pane
            self.robot_layout.show_pane(self.recording, pane)
        self.rows.send()

    def close(self) -> None:
        self._end_last_tick()
        if self._current_time - self._begin_time <= MAX_WHOLE_SPAN_NS:
            self._end_time = self._current_time
        self.statistics_table.update()
        self.send()
        self.robot_layout.end_recording(self.recording)

    def _end_last_tick(self) -> None:
        """Show the changes after the last tick, for example of a tree that was halted."""
        if self.states.has_open_tick:
            # A halt at the time of the last tick must not hide the states of that tick.
            self.rows.stamp = self.states.stamp = max(self.rows.stamp, self._last_tick_stamp + 1)
            self._end_tick()
            self.now_panel.show_states(self.states)

    @property
    def _has_ticks(self) -> bool:
        """Whether the source reports the end of each tick, and its duration."""
        return "ticks" not in self.source.unavailable

    @property
    def _current_time(self) -> int:
        """The time (ns) of the last event on the view's timeline."""
        rows = self.rows
        return rows.wall if self.entity_path_prefix else rows.stamp - rows.start_stamp

    def _end_tick(self) -> None:
        changed = self.states.end_tick(self.rows.stamp, self.rows.wall)
        if not changed:
            return
        with self.rows.at(self.states.stamp, self.states.wall):
            self._colour()
            self.blackboard_table.show_running(self.states)
            self.lanes.show_states(self.states, changed)
            if not self._has_ticks:
                self.now_panel.show_states(self.states)

    def _colour(self) -> None:
        for view in self.tree_views:
            view.colour(self.states)

    def _move_to(self, stamp: int, wall: int) -> None:
        self.rows.move_to(stamp, wall)
        if self._current_time > self._end_time:
            # The axes follow the cursor from now on.
            self._end_time = _ENDLESS_NS

    def _show_transition(self, event: TransitionEvent) -> None:
        # First, because the states of the previous tick must not contain this event.
        if self.states.is_of_later_tick(event):
            self._end_tick()
        self._move_to(event.stamp, event.wall)
        self.states.apply_transition(event)
        self.transition_log.add_transition(event)
        self.statistics_table.count_transition(event)
        self.statistics_table.update_if_due()

    def _show_tick(self, event: TickEvent) -> None:
        self._move_to(event.stamp, event.wall)
        self._last_tick_stamp = event.stamp
        self._end_tick()
        if self._has_ticks:
            self.tick_plots.add_tick(event)
        self.now_panel.show_tick(event, self.states)
        self.statistics_table.update_if_due()

    def _show_blackboard(self, event: BlackboardEvent) -> None:
        self._move_to(event.stamp, event.wall)
        self.blackboard_table.show(event.boards)

    def _show_static_scene(self, event: StaticSceneEvent) -> None:
        self.scene_view.draw_static(event.data)

    def _show_saved_scene(self, event: SavedSceneEvent) -> None:
        scene = SavedScene(event.file, event.tick, event.stamp)
        scene.copy_to(self.recording)
        self.scene_view.show_saved(scene.eye, scene.has_speed)

    def _show_moving_scene(self, event: MovingSceneEvent) -> None:
        self._move_to(event.stamp, event.wall)
        self.scene_view.draw_moving(event.data)
        self.now_panel.keep_notes(event.data)

    def _show_exception(self, event: ExceptionEvent) -> None:
        self._move_to(event.stamp, event.wall)
        self.transition_log.add_exception(event)
        self.now_panel.show_exception(event, self.states)
        uid = self._uids.get(event.path)
        if uid is not None:
            for view in self.tree_views:
                view.mark_exception(uid)

    def _show_lost_transitions(self, event: LostTransitionsEvent) -> None:
        self.transition_log.add_gap(event)
        self.now_panel.count_missing(event)

    def _show_missing_data(self, event: MissingDataEvent) -> None:
        with self.rows.at(event.stamp, event.wall):
            self.transition_log.add_missing_data(event)
        self.now_panel.count_missing(event)

    def _show_connection(self, event: ConnectionEvent) -> None:
        self.transition_log.add_connection(event)
        if event.state == "ended":
            self._end_last_tick()

    def _create_pane(self) -> Pane:
        has_data = {
            BLACKBOARD: self.blackboard_table.has_entries or bool(self.blackboard_table.note),
            LEAVES: self.leaf_table.has_leaves,
            SPEED: self.scene_view.has_speed,
        }
        return Pane(
            self._palette,
            self.name,
            self.tree_views,
            self.lanes,
            self.scene_view.create_eye(),
            has_ticks=self._has_ticks,
            log_level=self.log_level,
            entity_path_prefix=self.entity_path_prefix,
            time_span=(self._begin_time, self._end_time),
            filled_panels=frozenset(entity for entity, is_filled in has_data.items() if is_filled),
        )
