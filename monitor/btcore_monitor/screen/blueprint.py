"""The arrangement of the views in the viewer's window (rerun calls this a blueprint)."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import TextLogColumn, TimelineColumn

from btcore_monitor.screen import blackboard_table, camera_view, leaf_table, panels, scene_view
from btcore_monitor.screen.folding import FoldedTreeView
from btcore_monitor.screen.lanes import Lanes
from btcore_monitor.screen.row_buffer import TREE_TIMELINE, WALL_TIMELINE
from btcore_monitor.screen.scene_view import Eye
from btcore_monitor.screen.style import Palette
from btcore_monitor.screen.tree_view import FOLDED, TreeView

_WINDOW_SIZE: Final = (1920.0, 1000.0)
"""Window size (pixels) for which the tree is laid out: full HD without the viewer's own bars."""
_SMALL_HEIGHT: Final = 690.0
"""Height (pixels) of the window for which the lanes get their share; its width is 1280 pixels.

The titles of all views beside a scene fit into this window.
"""
_LANE_HEIGHT: Final = 31.0
_LANES_FRAME_HEIGHT: Final = 60.0
"""Height (pixels) of a lane with its name, and height of the title and the time axis of the lanes' view."""
_MAX_LANES_SHARE: Final = 0.57
_SCROLLED_LANES_SHARE: Final = 0.34
"""Shares of the window's height: the maximum for lanes, and the share of lanes that need more and scroll."""
_LEFT_SHARE: Final = 0.5
_TREE_SHARE: Final = 0.58
_PAST_S: Final = 24.0
_AHEAD_S: Final = 1.5
"""Time (s) that lanes and curves show before and after the time cursor of a long run."""
LIVE_SPAN_NS: Final = 25_000_000_000
"""Time (ns) from the beginning of a run that lanes and curves show while the run is shorter."""
MAX_WHOLE_SPAN_NS: Final = 60_000_000_000
"""Longest run (ns) that lanes and curves show as a whole."""
_MIN_SPAN_NS: Final = 2_000_000_000
_TRAIL_S: Final = 120.0
_SPEED_TITLE: Final = "Speed [m/s, rad/s]"
_CLOSE_UP_POSITION: Final = (1.35, -1.5, 1.75)
_CLOSE_UP_TARGET: Final = (0.0, 0.0, 0.5)
"""Position of the close-up's eye, and the point at which it looks, relative to the robot (m).

The eye is high enough to see the robot's base behind the walls, which are cut at a low height.
"""


@dataclass(frozen=True, slots=True)
class Pane:
    """The data for the views of a robot's tree, which has the title *name*.

    If there is a 3D scene to show, *eye* is its point of view. *has_ticks* is True if the robot sends the
    duration of its ticks. The log shows lines of *log_level* and above. In a window with several robots,
    *entity_path_prefix* is the entity above all entities of this robot. *time_span* is the time (ns) from the
    beginning to the known or expected end of the run. *filled_panels* are the entities of panels with data;
    panels without data give their place to others.
    """

    palette: Palette
    name: str
    tree_views: Sequence[TreeView | FoldedTreeView]
    lanes: Lanes
    eye: Eye | None = None
    has_ticks: bool = True
    log_level: str = panels.LEVELS[0]
    entity_path_prefix: str = ""
    time_span: tuple[int, int] = (0, 0)
    filled_panels: Collection[str] = ()

    def entity_path(self, entity: str) -> str:
        """Return the path of *entity* in the recording."""
        return f"{self.entity_path_prefix}/{entity}" if self.entity_path_prefix else entity

    @property
    def background(self) -> rrb.Background:
        """The background of views that contain a drawing."""
        return rrb.Background(color=self.palette.background, kind="SolidColor")

    @property
    def timeline(self) -> str:
        """The window's timeline: wall time with several robots, because their trees' clocks are unrelated."""
        return WALL_TIMELINE if self.entity_path_prefix else TREE_TIMELINE


def compute_lanes_share(lane_count: int) -> float:
    """Return the share of the window's height for a number of lanes below the tree.

    Lanes that need more than _MAX_LANES_SHARE get _SCROLLED_LANES_SHARE, and are scrolled.
    """
    needed = (lane_count * _LANE_HEIGHT * 1.31 + _LANES_FRAME_HEIGHT) / _SMALL_HEIGHT
    return max(0.16, needed) if needed <= _MAX_LANES_SHARE else _SCROLLED_LANES_SHARE


def compute_tree_view_size(lane_count: int, has_scene: bool) -> tuple[float, float]:
    """Return the width and height (pixels) of the tree's view.

    Args:
        lane_count: The number of lanes below the tree.
        has_scene: Whether a scene is shown beside the tree.
    """
    width, height = _WINDOW_SIZE
    if has_scene:
        return width * _LEFT_SHARE, height * (1.0 - compute_lanes_share(lane_count)) - 30.0
    return width, height * _TREE_SHARE - 30.0


def create_blueprint(content: rrb.Container, timeline: str) -> rrb.Blueprint:
    """Return a window that contains only *content* and follows the newest data on *timeline*."""
    return rrb.Blueprint(
        content,
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline=timeline, play_state="following"),
        auto_views=False,
        auto_layout=False,
    )


def create_layout(pane: Pane, name: str | None = None) -> rrb.Container:
    """Return all views of a tree. With a scene if the pane has an eye, otherwise with a wider tree.

    Args:
        pane: The data for the views.
        name: The title of the tab that contains the views.
    """
    counts = rrb.TextDocumentView(origin=pane.entity_path(panels.STATISTICS), name="Statistics")
    ticks: list[rrb.View] = []
    if pane.has_ticks:
        ticks = [
            _create_curve_view(pane, "Tick duration [ms]", "tick", legend=True),
            _create_curve_view(pane, "Tick rate [Hz]", "rate"),
        ]
    if pane.eye is not None:
        below = compute_lanes_share(len(pane.lanes.entities))
        lane_view = rrb.Tabs(create_lanes_view(pane), counts, *ticks)
        return rrb.Horizontal(
            rrb.Vertical(create_tree_views(pane), lane_view, row_shares=[1.0 - below, below]),
            _create_robot_views(pane, pane.eye),
            column_shares=[_LEFT_SHARE, 1.0 - _LEFT_SHARE],
            name=name,
        )
    lane_view = rrb.Tabs(create_lanes_view(pane), counts)
    rows: list[rrb.View | rrb.Container] = [create_now_view(pane), *_create_leaves_views(pane)]
    if tables := _create_blackboard_views(pane):
        rows.append(rrb.Tabs(*tables))
    width, heights = {1: (0.32, [1.0]), 2: (0.42, [0.46, 0.54]), 3: (0.42, [0.24, 0.4, 0.36])}[len(rows)]
    texts = rrb.Horizontal(
        rrb.Vertical(*rows, row_shares=heights), create_log_view(pane), column_shares=[width, 1.0 - width]
    )
    beside = rrb.Vertical(texts, rrb.Horizontal(*ticks), row_shares=[0.68, 0.32]) if ticks else texts
    return rrb.Vertical(
        create_tree_views(pane),
        rrb.Horizontal(lane_view, beside, column_shares=[0.44, 0.56]),
        row_shares=[_TREE_SHARE, 1.0 - _TREE_SHARE],
        name=name,
    )


def create_tree_views(pane: Pane) -> rrb.View | rrb.Container:
    """Return the view of the tree; a big tree also has a view with folded subtrees, in another tab."""
    views = []
    for tree in pane.tree_views:
        x0, y0, x1, y1 = tree.bounds()
        behaviours: Mapping[Any, Any] = {
            pane.entity_path(entity): rrb.EntityBehavior(interactive=False)
            for entity in tree.passive_entities
        }
        views.append(
            rrb.Spatial2DView(
                origin=pane.entity_path(tree.origin),
                name=f"{'Folded' if tree.origin == FOLDED else 'Behavior tree'} · {pane.name}",
                background=pane.background,
                visual_bounds=rrb.VisualBounds2D(x_range=[x0, x1], y_range=[y0, y1]),
                overrides=behaviours,
            )
        )
    return views[0] if len(views) == 1 else rrb.Tabs(*views)


def _create_axis(pane: Pane) -> rrb.TimeAxis:
    """Return the time axis of lanes and curves.

    It shows the whole run until the run is too long, and then the time around the cursor.
    """
    begin, end = pane.time_span
    boundary = rr.TimeRangeBoundary
    if end - begin > MAX_WHOLE_SPAN_NS:
        window = rr.TimeRange(
            start=boundary.cursor_relative(seconds=-_PAST_S), end=boundary.cursor_relative(seconds=_AHEAD_S)
        )
    else:
        window = rr.TimeRange(
            start=boundary.absolute(nanos=begin), end=boundary.absolute(nanos=max(end, begin + _MIN_SPAN_NS))
        )
    return rrb.TimeAxis(view_range=window)


def create_lanes_view(pane: Pane) -> rrb.View:
    """Return the view of the lanes."""
    contents = [f"+ /{pane.entity_path(lane)}" for lane in pane.lanes.entities]
    return rrb.StateTimelineView(
        origin="/", contents=contents, name=pane.lanes.title, time_view=_create_axis(pane)
    )


def _create_curve_view(pane: Pane, name: str, origin: str, legend: bool = False) -> rrb.View:
    return rrb.TimeSeriesView(
        origin=pane.entity_path(origin),
        name=name,
        axis_x=_create_axis(pane),
        plot_legend=rrb.PlotLegend(corner="LeftTop", visible=legend),
        background=rrb.archetypes.PlotBackground(color=pane.palette.background, show_grid=True),
    )


def create_now_view(pane: Pane) -> rrb.View:
    """Return the view of the nodes that run now."""
    return rrb.TextDocumentView(origin=pane.entity_path(panels.NOW), name="Now")


def _create_leaves_views(pane: Pane) -> list[rrb.View]:
    """Return the view of the leaves of a recording, if there is a recording."""
    if leaf_table.LEAVES not in pane.filled_panels:
        return []
    return [rrb.TextDocumentView(origin=pane.entity_path(leaf_table.LEAVES), name="Leaves")]


def _create_blackboard_views(pane: Pane) -> list[rrb.View]:
    """Return the views of the blackboard and of its history, if there are entries."""
    if blackboard_table.BLACKBOARD not in pane.filled_panels:
        return []
    table = rrb.TextDocumentView(origin=pane.entity_path(blackboard_table.BLACKBOARD), name="Blackboard")
    return [table, _create_text_log_view(pane, blackboard_table.HISTORY, "History")]


def create_log_view(pane: Pane) -> rrb.View:
    """Return the log of transitions. The user can change the displayed levels in the viewer."""
    rows = None
    if pane.log_level != panels.LEVELS[0]:
        rows = rrb.TextLogRows(filter_by_log_level=panels.LEVELS[panels.LEVELS.index(pane.log_level) :])
    return _create_text_log_view(pane, panels.LOG, "Transitions", rows)


def _create_text_log_view(
    pane: Pane, entity: str, name: str, rows: rrb.TextLogRows | None = None
) -> rrb.View:
    columns: Sequence[TextLogColumn] = [
        TextLogColumn("Body", visible=True),
        TextLogColumn("EntityPath", visible=False),
        TextLogColumn("LogLevel", visible=False),
    ]
    # The viewer draws the time cursor into the list only if a column shows the cursor's timeline.
    times = [TimelineColumn(time, visible=time == pane.timeline) for time in (TREE_TIMELINE, WALL_TIMELINE)]
    return rrb.TextLogView(
        origin=pane.entity_path(entity),
        contents=f"/{pane.entity_path(entity)}",
        name=name,
        rows=rows,
        columns=rrb.TextLogColumns(timeline_columns=times, text_log_columns=columns),
        format_options=rrb.TextLogFormat(monospace_body=True),
    )


def _create_robot_views(pane: Pane, eye: Eye) -> rrb.Container:
    """Return the views of a robot: its scene, its camera, the texts and the curves."""
    wide: rrb.View | rrb.Container = _create_space_view(pane, "Robot", eye.position, eye.target)
    if eye.robot_entity:
        close = _create_space_view(
            pane,
            "Close up",
            _CLOSE_UP_POSITION,
            _CLOSE_UP_TARGET,
            follow=f"/{pane.entity_path(eye.robot_entity)}",
        )
        wide = rrb.Horizontal(wide, close, column_shares=[0.56, 0.44])
    now: rrb.View | rrb.Container = create_now_view(pane)
    if eye.has_navigation:
        now = rrb.Tabs(now, rrb.TextDocumentView(origin=pane.entity_path(scene_view.COLOURS), name="Colours"))
    tables = [*_create_leaves_views(pane), *_create_blackboard_views(pane)]
    texts: rrb.View | rrb.Container = (
        rrb.Tabs(create_log_view(pane), *tables) if tables else create_log_view(pane)
    )
    curves: list[rrb.View] = []
    if eye.has_battery:
        curves.append(_create_curve_view(pane, "Battery [%]", scene_view.BATTERY))
    if scene_view.SPEED in pane.filled_panels:
        curves.append(_create_curve_view(pane, _SPEED_TITLE, scene_view.SPEED))
    if eye.has_pictures:
        origin = pane.entity_path(camera_view.CAMERA)
        camera = rrb.Spatial2DView(origin=origin, name="Camera", background=pane.background)
        now = rrb.Horizontal(camera, now, column_shares=[0.3, 0.7])
    elif len(curves) > 1:
        # Without a picture, a curve gets its place.
        now = rrb.Horizontal(now, curves.pop(), column_shares=[0.62, 0.38])
    if curves:
        texts = rrb.Horizontal(texts, rrb.Vertical(*curves), column_shares=[0.62, 0.38])
    return rrb.Vertical(wide, now, texts, row_shares=[0.45, 0.22, 0.33])


def _create_space_view(
    pane: Pane,
    name: str,
    position: tuple[float, float, float],
    target: tuple[float, float, float],
    follow: str | None = None,
) -> rrb.View:
    recent = rrb.VisibleTimeRanges(
        timeline=pane.timeline,
        start=rr.TimeRangeBoundary.cursor_relative(seconds=-_TRAIL_S),
        end=rr.TimeRangeBoundary.cursor_relative(),
    )
    return rrb.Spatial3DView(
        origin=pane.entity_path(scene_view.ORIGIN),
        name=name,
        background=pane.background,
        line_grid=rrb.LineGrid3D(visible=True, spacing=1.0, color=0xFFFFFF14, stroke_width=1.0),
        eye_controls=rrb.EyeControls3D(
            kind="Orbital",
            position=position,
            look_target=target,
            eye_up=(0.0, 0.0, 1.0),
            tracking_entity=follow,
        ),
        overrides={pane.entity_path(scene_view.TRAIL): recent},
    )
