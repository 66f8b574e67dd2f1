"""The arrangement of the views in the viewer's window (rerun calls this a blueprint)."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import TextLogColumn, TimelineColumn

from btcore_monitor.screen import blackboard_table, camera_view, panels, scene
from btcore_monitor.screen.folding import FoldedTreeView
from btcore_monitor.screen.lanes import Lanes
from btcore_monitor.screen.row_buffer import TREE_TIMELINE, WALL_TIMELINE
from btcore_monitor.screen.scene import Eye
from btcore_monitor.screen.style import Palette
from btcore_monitor.screen.tree import FOLDED, TreeView

_WINDOW: Final = (1920.0, 1000.0)
"""Window size (pixels) for which the tree is laid out: full HD without the viewer's own bars."""
_SMALL_HEIGHT: Final = 690.0
"""Height (pixels) of the window for which the lanes get their share; its width is 1280 pixels.

The titles of all views beside a scene fit into this window.
"""
_LANE: Final = 31.0
_LANES_FRAME: Final = 60.0
"""Height (pixels) of a lane with its name, and height of the title and the time axis of the lanes' view."""
_MAX_LANES: Final = 0.57
_SCROLLED: Final = 0.34
"""Shares of the window's height: the maximum for lanes, and the share of lanes that need more and scroll."""
_LEFT: Final = 0.5
_TREE_OF_WIDE: Final = 0.58
_PAST: Final = 24.0
_AHEAD: Final = 1.5
"""Time (s) that lanes and curves show before and after the time cursor of a long run."""
LIVE_SPAN_NS: Final = 25_000_000_000
"""Time (ns) from the beginning of a run that lanes and curves show while the run is shorter."""
MAX_WHOLE_SPAN_NS: Final = 60_000_000_000
"""Longest run (ns) that lanes and curves show as a whole."""
_LEAST: Final = 2_000_000_000
_TRAIL_SECONDS: Final = 120.0
_SPEED: Final = "Speed [m/s, rad/s]"
_BESIDE: Final = (1.35, -1.5, 1.75)
_BESIDE_TARGET: Final = (0.0, 0.0, 0.5)
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

    def at(self, entity: str) -> str:
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


def lanes_share(lanes: int) -> float:
    """Return the share of the window's height for a number of lanes below the tree.

    Lanes that need more than _MAX_LANES get _SCROLLED.
    """
    needed = (lanes * _LANE * 1.31 + _LANES_FRAME) / _SMALL_HEIGHT
    return max(0.16, needed) if needed <= _MAX_LANES else _SCROLLED


def tree_view_size(lanes: int, has_scene: bool) -> tuple[float, float]:
    """Return the width and height (pixels) of the tree's view.

    Args:
        lanes: The number of lanes below the tree.
        has_scene: Whether a scene is shown beside the tree.
    """
    width, height = _WINDOW
    if has_scene:
        return width * _LEFT, height * (1.0 - lanes_share(lanes)) - 30.0
    return width, height * _TREE_OF_WIDE - 30.0


def windowed(content: rrb.Container, timeline: str) -> rrb.Blueprint:
    """Return a window that contains only *content* and follows the newest data on *timeline*."""
    return rrb.Blueprint(
        content,
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline=timeline, play_state="following"),
        auto_views=False,
        auto_layout=False,
    )


def layout(pane: Pane, name: str | None = None) -> rrb.Container:
    """Return all views of a tree. With a scene if the pane has an eye, otherwise with a wider tree.

    Args:
        pane: The data for the views.
        name: The title of the tab that contains the views.
    """
    counts = rrb.TextDocumentView(origin=pane.at(panels.STATISTICS), name="Statistics")
    ticks: list[rrb.View] = []
    if pane.has_ticks:
        ticks = [
            _create_curve_view(pane, "Tick duration [ms]", "tick", legend=True),
            _create_curve_view(pane, "Tick rate [Hz]", "rate"),
        ]
    if pane.eye is not None:
        below = lanes_share(len(pane.lanes.entities))
        lane_view = rrb.Tabs(lanes(pane), counts, *ticks)
        return rrb.Horizontal(
            rrb.Vertical(trees(pane), lane_view, row_shares=[1.0 - below, below]),
            _beside_tree(pane, pane.eye),
            column_shares=[_LEFT, 1.0 - _LEFT],
            name=name,
        )
    lane_view = rrb.Tabs(lanes(pane), counts)
    words = [running(pane), *_create_table_views(pane)]
    narrow = 0.42 if len(words) > 1 else 0.32
    texts = rrb.Horizontal(_stack(words), log(pane), column_shares=[narrow, 1.0 - narrow])
    beside = rrb.Vertical(texts, rrb.Horizontal(*ticks), row_shares=[0.68, 0.32]) if ticks else texts
    return rrb.Vertical(
        trees(pane),
        rrb.Horizontal(lane_view, beside, column_shares=[0.44, 0.56]),
        row_shares=[_TREE_OF_WIDE, 1.0 - _TREE_OF_WIDE],
        name=name,
    )


def trees(pane: Pane) -> rrb.View | rrb.Container:
    """Return the view of the tree; a big tree also has a view with folded subtrees, in another tab."""
    views = []
    for tree in pane.tree_views:
        x0, y0, x1, y1 = tree.bounds()
        still: Mapping[Any, Any] = {
            pane.at(entity): rrb.EntityBehavior(interactive=False) for entity in tree.drawn_only
        }
        views.append(
            rrb.Spatial2DView(
                origin=pane.at(tree.origin),
                name=f"{'Folded' if tree.origin == FOLDED else 'Behavior tree'} · {pane.name}",
                background=pane.background,
                visual_bounds=rrb.VisualBounds2D(x_range=[x0, x1], y_range=[y0, y1]),
                overrides=still,
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
            start=boundary.cursor_relative(seconds=-_PAST), end=boundary.cursor_relative(seconds=_AHEAD)
        )
    else:
        window = rr.TimeRange(
            start=boundary.absolute(nanos=begin), end=boundary.absolute(nanos=max(end, begin + _LEAST))
        )
    return rrb.TimeAxis(view_range=window)


def lanes(pane: Pane) -> rrb.View:
    """Return the view of the lanes."""
    contents = [f"+ /{pane.at(lane)}" for lane in pane.lanes.entities]
    return rrb.StateTimelineView(
        origin="/", contents=contents, name=pane.lanes.title, time_view=_create_axis(pane)
    )


def _create_curve_view(pane: Pane, name: str, origin: str, legend: bool = False) -> rrb.View:
    return rrb.TimeSeriesView(
        origin=pane.at(origin),
        name=name,
        axis_x=_create_axis(pane),
        plot_legend=rrb.PlotLegend(corner="LeftTop", visible=legend),
        background=rrb.archetypes.PlotBackground(color=pane.palette.background, show_grid=True),
    )


def running(pane: Pane) -> rrb.View:
    """Return the view of the nodes that run now."""
    return rrb.TextDocumentView(origin=pane.at(panels.NOW), name="Now")


def _create_table_views(pane: Pane) -> list[rrb.View]:
    """Return the views of the blackboard, if there are entries."""
    tabs: list[rrb.View] = []
    if blackboard_table.BLACKBOARD in pane.filled_panels:
        tabs.append(rrb.TextDocumentView(origin=pane.at(blackboard_table.BLACKBOARD), name="Blackboard"))
        tabs.append(_log_view(pane, blackboard_table.HISTORY, "History"))
    return tabs


def _stack(views: Sequence[rrb.View]) -> rrb.View | rrb.Container:
    """Return the first view above tabs with the others."""
    first, *tabs = views
    if not tabs:
        return first
    return rrb.Vertical(first, tabs[0] if len(tabs) == 1 else rrb.Tabs(*tabs), row_shares=[0.46, 0.54])


def log(pane: Pane) -> rrb.View:
    """Return the log of transitions. The user can change the displayed levels in the viewer."""
    rows = None
    if pane.log_level != panels.LEVELS[0]:
        rows = rrb.TextLogRows(filter_by_log_level=panels.LEVELS[panels.LEVELS.index(pane.log_level) :])
    return _log_view(pane, panels.LOG, "Transitions", rows)


def _log_view(pane: Pane, entity: str, name: str, rows: rrb.TextLogRows | None = None) -> rrb.View:
    columns: Sequence[TextLogColumn] = [
        TextLogColumn("Body", visible=True),
        TextLogColumn("EntityPath", visible=False),
        TextLogColumn("LogLevel", visible=False),
    ]
    # The viewer draws the time cursor into the list only if a column shows the cursor's timeline.
    times = [TimelineColumn(time, visible=time == pane.timeline) for time in (TREE_TIMELINE, WALL_TIMELINE)]
    return rrb.TextLogView(
        origin=pane.at(entity),
        contents=f"/{pane.at(entity)}",
        name=name,
        rows=rows,
        columns=rrb.TextLogColumns(timeline_columns=times, text_log_columns=columns),
        format_options=rrb.TextLogFormat(monospace_body=True),
    )


def _beside_tree(pane: Pane, eye: Eye) -> rrb.Container:
    """Return the views of a robot: its scene, its camera, the texts and the curves."""
    wide: rrb.View | rrb.Container = _create_space_view(pane, "Robot", eye.position, eye.target)
    if eye.robot_entity:
        close = _create_space_view(
            pane, "Close up", _BESIDE, _BESIDE_TARGET, follow=f"/{pane.at(eye.robot_entity)}"
        )
        wide = rrb.Horizontal(wide, close, column_shares=[0.56, 0.44])
    now: rrb.View | rrb.Container = running(pane)
    if eye.has_navigation:
        now = rrb.Tabs(now, rrb.TextDocumentView(origin=pane.at(scene.COLOURS), name="Colours"))
    tables = _create_table_views(pane)
    texts: rrb.View | rrb.Container = rrb.Tabs(log(pane), *tables) if tables else log(pane)
    curves: list[rrb.View] = []
    if eye.has_battery:
        curves.append(_create_curve_view(pane, "Battery [%]", scene.BATTERY))
    if scene.SPEED in pane.filled_panels:
        curves.append(_create_curve_view(pane, _SPEED, scene.SPEED))
    if eye.has_pictures:
        origin = pane.at(camera_view.CAMERA)
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
        start=rr.TimeRangeBoundary.cursor_relative(seconds=-_TRAIL_SECONDS),
        end=rr.TimeRangeBoundary.cursor_relative(),
    )
    return rrb.Spatial3DView(
        origin=pane.at(scene.ORIGIN),
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
        overrides={pane.at(scene.TRAIL): recent},
    )
