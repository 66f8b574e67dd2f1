"""Drawings of navigation data in the scene: path, goal, particles, poses, arrows and boxes."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from btcore_monitor.screen.row_buffer import RowBuffer, Series, entity_part, rounded
from btcore_monitor.wire.scene_schema import MAX_NUMBER
from btcore_scene import UPRIGHT, Arrow, BoundingBox, MovingScene, Poses

ARROWS: Final = "arrows"
BOXES: Final = "boxes"
_RING_SEGMENTS: Final = 24
_GOAL_RADIUS, _GOAL_HEIGHT = 0.3, 1.2  # m
_PARTICLE_LENGTH: Final = 0.14  # m
_PLACE_STEP: Final = 1 / 512
"""Distance (m) to which drawn coordinates are rounded, about 2 mm."""
_HEADING_LENGTH: Final = 1.5
"""Length of the line that shows a heading, in multiples of the ring's radius."""
_BOX_LINE_RADIUS: Final = 0.02  # m
_BOX_COLOUR: Final = (255, 213, 74, 255)
_ARROW_RADIUS: Final = 0.025  # m
_ARROW_COLOUR: Final = (255, 171, 51, 255)

Rows = NDArray[np.float32]
Strips = list[NDArray[np.float32]]


@dataclass(frozen=True, slots=True)
class PoseStyle:
    """The style of one kind of poses: *colour*, and *radius* of the lines (m; negative values are pixels).

    *strips* returns the lines for poses (x, y, yaw; shape `(n, 3)`) and the robot's radius (m).
    """

    colour: int
    radius: float
    strips: Callable[[Rows, float], Strips]


def _draw_path(rows: Rows, robot_radius: float) -> Strips:
    return [_lift(rows[:, :2], 0.05)] if len(rows) > 1 else []


def _draw_cloud(rows: Rows, robot_radius: float) -> Strips:
    ends = rows[:, :2] + _PARTICLE_LENGTH * _ahead(rows)
    return list(np.stack((_lift(rows[:, :2], 0.045), _lift(ends, 0.045)), axis=1))


def _draw_goal(rows: Rows, robot_radius: float) -> Strips:
    poles = [np.array([[x, y, 0.0], [x, y, _GOAL_HEIGHT]], dtype=np.float32) for x, y in rows[:, :2].tolist()]
    return [*_draw_rings(rows, _GOAL_RADIUS, 0.06), *poles]


def _draw_stance(rows: Rows, robot_radius: float) -> Strips:
    return _draw_rings(rows, robot_radius, 0.07)


def _draw_rings(rows: Rows, radius: float, z: float) -> Strips:
    turn = np.linspace(0.0, 2 * np.pi, _RING_SEGMENTS + 1)
    circle = radius * np.stack((np.cos(turn), np.sin(turn)), axis=1)
    strips: Strips = []
    for pose, ahead in zip(rows, _ahead(rows), strict=True):
        strips.append(_lift(pose[:2] + circle, z))
        strips.append(_lift(np.stack((pose[:2], pose[:2] + _HEADING_LENGTH * radius * ahead)), z))
    return strips


def _ahead(rows: Rows) -> Rows:
    return np.stack((np.cos(rows[:, 2]), np.sin(rows[:, 2])), axis=1)


def _lift(points: NDArray[np.floating], z: float) -> NDArray[np.float32]:
    return rounded(np.concatenate((points, np.full((len(points), 1), z)), axis=1), _PLACE_STEP)


POSE_STYLES: Final[Mapping[str, PoseStyle]] = {
    "path": PoseStyle(0xB9F24AFF, 0.03, _draw_path),
    "goal": PoseStyle(0xB9F24AFF, 0.03, _draw_goal),
    "cloud": PoseStyle(0xFF7AB8A0, 0.004, _draw_cloud),
    "estimate": PoseStyle(0xFFFFFFFF, 0.018, _draw_stance),
    "odometry": PoseStyle(0xFF6B62FF, 0.018, _draw_stance),
}


class NavigationMarkers:
    """The drawing of poses, arrows and boxes below the entity *origin*."""

    def __init__(self, rows: RowBuffer, origin: str) -> None:
        self._rows = rows
        self._origin = origin
        self.robot_radius = 0.27
        """The robot's radius (m)."""
        self._series: dict[str, Series[Any]] = {}
        self._frames: dict[str, str] = {}
        self._shown: dict[str, object] = {}
        self._box_entities: list[str] = []

    def draw_moving(self, data: MovingScene, root: str) -> None:
        """Draw the poses that have changed. If *data* contains arrows or boxes, replace those that are shown.

        Args:
            data: The scene.
            root: The frame of objects without a frame of their own.
        """
        for poses in data.poses:
            self._show_poses(poses, root)
        if data.arrows is not None:
            self._show_arrows({entity_part(arrow.name): arrow for arrow in data.arrows}, root)
        if data.boxes is not None:
            self._show_boxes(data.boxes, root)

    def _show_poses(self, poses: Poses, root: str) -> None:
        entity = f"{self._origin}/poses/{entity_part(poses.name)}"
        # Comparing bytes is faster than drawing an unchanged path again.
        if self._shown.get(entity) == poses.rows:
            return
        self._shown[entity] = poses.rows
        style = POSE_STYLES[poses.kind]
        if entity not in self._series:
            self._series[entity] = self._rows.create_series(entity, _create_strip_columns)
            lines = rr.LineStrips3D.from_fields(colors=[style.colour], radii=[style.radius])
            self._rows.log(entity, lines, static=True)
        self._place(entity, poses.frame or root)
        rows = np.frombuffer(poses.rows, dtype="<f4").reshape(-1, 3)
        rows = rows[(np.abs(rows) <= MAX_NUMBER).all(axis=1)]  # without NaN and infinities, too
        self._series[entity].add(style.strips(rows, self.robot_radius))

    def _show_arrows(self, arrows: Mapping[str, Arrow], root: str) -> None:
        for name, arrow in arrows.items():
            entity = f"{self._origin}/{ARROWS}/{name}"
            if entity not in self._series:
                self._series[entity] = self._rows.create_series(entity, _create_arrow_columns)
            self._place(entity, arrow.frame or root)
        for entity, series in self._series.items():
            if entity.startswith(f"{self._origin}/{ARROWS}/"):
                shown = arrows.get(entity.rsplit("/", 1)[1])
                if self._shown.get(entity) != shown:
                    self._shown[entity] = shown
                    series.add(shown)

    def _show_boxes(self, boxes: Sequence[BoundingBox], root: str) -> None:
        by_frame: dict[str, list[BoundingBox]] = {entity: [] for entity in self._box_entities}
        for box in boxes:
            frame = box.frame or root
            entity = f"{self._origin}/{BOXES}/{frame}"
            by_frame.setdefault(entity, []).append(box)
            self._place(entity, frame)
        for entity, group in by_frame.items():
            if entity not in self._series:
                self._series[entity] = self._rows.create_series(entity, _create_box_columns)
                self._rows.log(entity, rr.Boxes3D.from_fields(show_labels=False), static=True)
                self._box_entities.append(entity)
            if self._shown.get(entity) != group:
                self._shown[entity] = group
                self._series[entity].add(group)

    def _place(self, entity: str, frame: str) -> None:
        if self._frames.get(entity) != frame:
            self._frames[entity] = frame
            self._rows.log(entity, self._rows.in_frame(frame), static=True)


def _create_box_columns(values: list[Sequence[BoundingBox]]) -> Iterable[Any]:
    boxes = [box for row in values for box in row]
    columns = rr.Boxes3D.columns(
        centers=_table([box.position for box in boxes], 3),
        half_sizes=_table([box.size for box in boxes], 3) / 2,
        quaternions=_table([box.quaternion or UPRIGHT for box in boxes], 4),
        colors=np.array([box.color or _BOX_COLOUR for box in boxes], dtype=np.uint8).reshape(-1, 4),
        radii=[_BOX_LINE_RADIUS] * len(boxes),
        labels=[box.name for box in boxes],
    )
    return columns.partition([len(row) for row in values])


def _create_strip_columns(values: list[Strips]) -> Iterable[Any]:
    columns = rr.LineStrips3D.columns(strips=[strip for row in values for strip in row])
    return columns.partition([len(row) for row in values])


def _create_arrow_columns(values: list[Arrow | None]) -> Iterable[Any]:
    arrows = [arrow for arrow in values if arrow is not None]
    starts = _table([arrow.start for arrow in arrows], 3)
    columns = rr.Arrows3D.columns(
        origins=starts,
        vectors=_table([arrow.end for arrow in arrows], 3) - starts,
        colors=np.array([arrow.color or _ARROW_COLOUR for arrow in arrows], dtype=np.uint8).reshape(-1, 4),
        radii=[_ARROW_RADIUS] * len(arrows),
    )
    # No arrow in a row removes the arrow of the row before.
    return columns.partition([int(arrow is not None) for arrow in values])


def _table(rows: Sequence[Sequence[float]], width: int) -> Rows:
    return np.array(rows, dtype=np.float32).reshape(-1, width)
