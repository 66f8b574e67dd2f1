"""How the views stand in the window."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import TextLogColumn, TimelineColumn

from . import now, panels, scene, sight, statistics
from .lanes import Lanes
from .rows import TREE_TIME, WALL_TIME
from .style import Palette
from .tree import FOLDED, TreeView

_WINDOW: Final = (1920.0, 1000.0)
"""Pixels of the window that the views were proportioned for (full HD, less the viewer's own bars)."""
_LANE: Final = 31.0
_LANES_FRAME: Final = 84.0
"""Pixels: a lane with its name, and the view's title and time axis."""
_LEFT: Final = 0.53
_TREE_OF_WIDE: Final = 0.58
_PAST: Final = 24.0
_AHEAD: Final = 1.5
"""Seconds of past and future around the time cursor in lanes and curves."""
_TRAIL_SECONDS: Final = 120.0
_COLOURS: Final = " · green: the way to its goal · orange: the way it came · cyan: laser"
_BESIDE: Final = (1.5, -1.6, 1.5)
"""m; from where the close-up looks at the robot."""


@dataclass(frozen=True, slots=True)
class Eye:
    """Where the scene is looked at from, and where to (m).

    *robot* is the entity that a close-up follows; *pictures*, *battery* and *navigates* say whether there are
    pictures, a battery's level and a way to a goal to show.
    """

    position: tuple[float, float, float]
    target: tuple[float, float, float]
    robot: str = ""
    pictures: bool = False
    battery: bool = False
    navigates: bool = False


def lanes_share(lanes: int) -> float:
    """Share of the height that *lanes* lanes get under the tree: what they need, within reason."""
    _, height = _WINDOW
    return min(0.46, max(0.16, (lanes * _LANE * 1.31 + _LANES_FRAME) / height))


def tree_aspect(lanes: int, scene: bool) -> float:
    """Width over height of the tree's view, which its layout is made for."""
    width, height = _WINDOW
    if scene:
        return width * _LEFT / (height * (1.0 - lanes_share(lanes)) - 30.0)
    return width / (height * _TREE_OF_WIDE - 30.0)


def blueprint(
    palette: Palette,
    name: str,
    trees: Sequence[TreeView],
    lanes: Lanes,
    eye: Eye | None,
    costed: bool = True,
    several: bool = False,
) -> rrb.Blueprint:
    """The window of tree *name*: with a scene where there is an *eye*, else with a wider tree.

    *costed*: the robot tells what its ticks cost. *several*: other robots can be chosen at the left.
    """
    drawings = [_tree(palette, name, one) for one in trees]
    tree_view = drawings[0] if len(drawings) == 1 else rrb.Tabs(*drawings)
    counts = rrb.TextDocumentView(origin=statistics.STATISTICS, name="Statistics")
    lane_view = rrb.Tabs(_lanes(lanes.entities, lanes.title), counts)
    ticks = [_curve("Tick duration [ms]", "tick", palette), _curve("Tick rate [Hz]", "rate", palette)]
    if not costed:
        ticks = [rrb.TextDocumentView(origin=panels.UNSENT, name="Tick duration and rate")]
    below = lanes_share(len(lanes.entities))
    layout: rrb.Container
    if eye is not None:
        curves: list[rrb.View | rrb.Container] = [_curve("Speed", scene.SPEED, palette), rrb.Tabs(*ticks)]
        if eye.battery:
            curves.insert(0, _curve("Battery [%]", scene.BATTERY, palette))
        layout = rrb.Horizontal(
            rrb.Vertical(tree_view, lane_view, row_shares=[1.0 - below, below]),
            rrb.Vertical(
                _scene(palette, eye),
                rrb.Horizontal(_words(), _log(), column_shares=[0.42, 0.58]),
                rrb.Horizontal(*curves),
                row_shares=[0.49, 0.31, 0.2],
            ),
            column_shares=[_LEFT, 1.0 - _LEFT],
        )
    else:
        layout = rrb.Vertical(
            tree_view,
            rrb.Horizontal(
                lane_view,
                rrb.Vertical(
                    rrb.Horizontal(_words(), _log(), column_shares=[0.36, 0.64]),
                    rrb.Horizontal(*ticks),
                    row_shares=[0.62, 0.38] if costed else [0.86, 0.14],
                ),
                column_shares=[0.5, 0.5],
            ),
            row_shares=[_TREE_OF_WIDE, 1.0 - _TREE_OF_WIDE],
        )
    return rrb.Blueprint(
        layout,
        rrb.BlueprintPanel(state="expanded" if several else "hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline=TREE_TIME, play_state="following"),
        auto_views=False,
        auto_layout=False,
    )


def _tree(palette: Palette, name: str, tree: TreeView) -> rrb.View:
    x0, y0, x1, y1 = tree.bounds()
    still: Mapping[Any, Any] = {entity: rrb.EntityBehavior(interactive=False) for entity in tree.drawn_only}
    return rrb.Spatial2DView(
        origin=tree.origin,
        name=f"Folded · {name}" if tree.origin == FOLDED else f"Behavior tree · {name}",
        background=rrb.Background(color=palette.background, kind="SolidColor"),
        visual_bounds=rrb.VisualBounds2D(x_range=[x0, x1], y_range=[y0, y1]),
        overrides=still,
    )


def _axis() -> rrb.TimeAxis:
    window = rr.TimeRange(
        start=rr.TimeRangeBoundary.cursor_relative(seconds=-_PAST),
        end=rr.TimeRangeBoundary.cursor_relative(seconds=_AHEAD),
    )
    return rrb.TimeAxis(view_range=window)


def _lanes(lanes: Iterable[str], title: str) -> rrb.View:
    return rrb.StateTimelineView(
        origin="/", contents=[f"+ /{lane}" for lane in lanes], name=title, time_view=_axis()
    )


def _curve(name: str, origin: str, palette: Palette) -> rrb.View:
    return rrb.TimeSeriesView(
        origin=origin,
        name=name,
        axis_x=_axis(),
        plot_legend=rrb.PlotLegend(corner="LeftTop", visible=True),
        background=rrb.archetypes.PlotBackground(color=palette.background, show_grid=True),
    )


def _words() -> rrb.Container:
    return rrb.Vertical(
        rrb.TextDocumentView(origin=now.NOW, name="Now"),
        rrb.TextDocumentView(origin=panels.BLACKBOARD, name="Blackboard"),
        row_shares=[0.54, 0.46],
    )


def _log() -> rrb.View:
    columns: Sequence[TextLogColumn] = [
        TextLogColumn("Body", visible=True),
        TextLogColumn("EntityPath", visible=False),
        TextLogColumn("LogLevel", visible=False),
    ]
    times = [TimelineColumn(TREE_TIME, visible=False), TimelineColumn(WALL_TIME, visible=False)]
    return rrb.TextLogView(
        origin=panels.LOG,
        contents=f"/{panels.LOG}",
        name="Transitions",
        columns=rrb.TextLogColumns(timeline_columns=times, text_log_columns=columns),
        format_options=rrb.TextLogFormat(monospace_body=True),
    )


def _scene(palette: Palette, eye: Eye) -> rrb.Container:
    wide = _space(palette, f"Robot{_COLOURS * eye.navigates}", eye.position, eye.target)
    if not eye.robot:
        return rrb.Horizontal(wide)
    close: rrb.View | rrb.Container = _space(palette, "Close up", _BESIDE, (0.0, 0.0, 0.4), follow=eye.robot)
    if eye.pictures:
        close = rrb.Vertical(close, _camera(palette), row_shares=[0.5, 0.5])
    return rrb.Horizontal(wide, close, column_shares=[0.66, 0.34])


def _camera(palette: Palette) -> rrb.View:
    return rrb.Spatial2DView(
        origin=sight.CAMERA,
        name="Camera",
        background=rrb.Background(color=palette.background, kind="SolidColor"),
    )


def _space(
    palette: Palette,
    name: str,
    position: tuple[float, float, float],
    target: tuple[float, float, float],
    follow: str | None = None,
) -> rrb.View:
    recent = rrb.VisibleTimeRanges(
        timeline=TREE_TIME,
        start=rr.TimeRangeBoundary.cursor_relative(seconds=-_TRAIL_SECONDS),
        end=rr.TimeRangeBoundary.cursor_relative(),
    )
    return rrb.Spatial3DView(
        origin=scene.ORIGIN,
        name=name,
        background=rrb.Background(color=palette.background, kind="SolidColor"),
        line_grid=rrb.LineGrid3D(visible=True, spacing=1.0, color=0xFFFFFF14, stroke_width=1.0),
        eye_controls=rrb.EyeControls3D(
            kind="Orbital",
            position=position,
            look_target=target,
            eye_up=(0.0, 0.0, 1.0),
            tracking_entity=follow,
        ),
        overrides={scene.TRAIL: recent},
    )
