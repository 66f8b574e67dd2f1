"""The robot's world in 3D (shapes in their frames, laser, trail), and the curves of speed and battery."""

import math
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from btcore_monitor.screen.camera_view import CameraView
from btcore_monitor.screen.floor import Floor
from btcore_monitor.screen.navigation_markers import NavigationMarkers
from btcore_monitor.screen.row_buffer import (
    RowBuffer,
    Series,
    create_curve_style,
    create_scalar_columns,
    entity_part,
    rounded,
)
from btcore_monitor.screen.shapes import archetypes, extent, surface
from btcore_monitor.screen.style import Palette
from btcore_scene import UPRIGHT, Laser, Mesh, MovingScene, Part, Quaternion, StaticScene, Vector
from btcore_scene.rotations import rotated

ORIGIN: Final = "scene"
TRAIL: Final = f"{ORIGIN}/trail"
POINTS: Final = f"{ORIGIN}/laser/points"
FAN: Final = f"{ORIGIN}/laser/fan"
SPEED: Final = "speed"
BATTERY: Final = "battery"
COLOURS: Final = "colours"
_COLOUR_LEGEND: Final = """
| | |
|:--|:--|
| green | goal and planned path |
| orange | trail: path driven |
| cyan dots | laser |
| white ring | estimated pose |
| pink strokes | particles: possible poses |
| red ring | pose by odometry alone |
| magenta | obstacle in the local costmap |
| cyan ground | too near to an obstacle |
| blue to red | cost of a place |
| hatched | keep-out area |
"""
_FAN_STEP: Final = 4
"""Number of drawn rays for each corner of the fan, the filled area that the laser sees to be free."""
_MAX_POINTS: Final = 400
"""Greatest number of drawn rays of a scan; of more rays, every second (third …) is drawn."""
_SCAN_STEP: Final = 1 / 64
"""Distance (m) to which coordinates of a scan are rounded: a quarter of the noise of Tiago's laser."""
_FAN_REACH: Final = 6.0
"""Length (m) of the fan for rays without an echo; a fan of the sensor's full range would hide the scene."""
_BODIES: Final = ("base_footprint", "base_link")
"""Frames that stand for the whole robot (names by REP 105)."""
_FRAMES_DEEP: Final = 100
_MESH: Final = "mesh"
_SPAN: Final = 6.0
"""Smallest extent (m) of the world that is in view."""
_TRAIL_STEP: Final = 0.02
"""Distance (m) between two points of the trail."""
_TRAIL_HEIGHT: Final = 0.06
"""Height (m) of the trail, above everything on the floor; it covers the driven part of the path."""

_STILL: Final = 2e-5
"""Smallest displayed change of a pose (m, and quaternion elements); simulated joints jitter by less."""

Pose = tuple[str, Vector, Quaternion]
"""A parent frame, a position (m) and a quaternion."""


@dataclass(frozen=True, slots=True)
class Eye:
    """The point from which the 3D view shows the scene, and the point at which it looks (m).

    *robot_entity* is the entity that a close-up follows; *has_pictures*, *has_battery* and *has_navigation*
    are True if there are camera pictures, a battery level and navigation data to show.
    """

    position: tuple[float, float, float]
    target: tuple[float, float, float]
    robot_entity: str = ""
    has_pictures: bool = False
    has_battery: bool = False
    has_navigation: bool = False


class SceneView:
    """The scene of a robot: `draw_static` draws its parts, and `draw_moving` updates their poses."""

    def __init__(self, rows: RowBuffer, palette: Palette) -> None:
        self._rows = rows
        self._palette = palette
        self._static = StaticScene()
        self.has_scene = False
        """Whether there is a scene to show."""
        self.has_speed = False
        """Whether the robot has sent its speed."""
        self._saved_eye: Eye | None = None
        self._frames: dict[str, Series[Pose]] = {}
        self._poses: dict[str, Pose] = {}
        self._points: Series[Any] = rows.create_series(POINTS, _create_position_columns)
        self._fan: Series[Any] = rows.create_series(FAN, _create_vertex_columns)
        self._trail: Series[Any] = rows.create_series(TRAIL, _create_strip_columns)
        self._v: Series[float] = rows.create_series(f"{SPEED}/v", create_scalar_columns)
        self._w: Series[float] = rows.create_series(f"{SPEED}/w", create_scalar_columns)
        self._battery: Series[float] = rows.create_series(f"{BATTERY}/level", create_scalar_columns)
        self._floor = Floor(rows, palette, ORIGIN)
        self._markers = NavigationMarkers(rows, ORIGIN)
        self._cameras = CameraView(rows, ORIGIN)
        self._rays = 0
        self._ray_step = 1
        self._directions: NDArray[np.float32] = np.zeros((0, 3), dtype=np.float32)
        self._scan_stamp = -1
        self._last_position: Vector | None = None

    def show_saved(self, eye: Eye, has_speed: bool) -> None:
        """Show a scene that was copied to the recording."""
        self._saved_eye, self.has_speed = eye, has_speed

    @property
    def has_pictures(self) -> bool:
        """Whether there are camera pictures to show."""
        return self._cameras.has_pictures

    def draw_static(self, data: StaticScene) -> None:
        """Draw the static scene, unless it was drawn before: robots send it again on request."""
        if self.has_scene and data == self._static:
            return
        self._static, self.has_scene = data, True
        log = self._rows.log
        log(ORIGIN, rr.ViewCoordinates.RIGHT_HAND_Z_UP, self._rows.in_frame(self._root), static=True)
        groups: dict[tuple[str, str], list[Part]] = defaultdict(list)
        for part in data.parts:
            groups[part.frame or self._root, part.kind].append(part)
        for (frame, _), parts in groups.items():
            for name, shape in archetypes(parts, around=frame == self._root):
                entity = f"{ORIGIN}/parts/{entity_part(frame)}/{name}"
                log(entity, self._rows.in_frame(frame), shape, static=True)
        surfaces: dict[str, list[Mesh]] = defaultdict(list)
        for mesh in data.meshes:
            surfaces[mesh.frame or self._root].append(mesh)
        for frame, meshes in surfaces.items():
            entity = f"{ORIGIN}/parts/{entity_part(frame)}/{_MESH}"
            shape = surface(meshes, around=frame == self._root)
            log(entity, self._rows.in_frame(frame), shape, static=True)
        if data.footprint_radius is not None:
            self._markers.robot_radius = data.footprint_radius
        self._draw_sensors()
        self._floor.draw_static(data, self._root)
        if data.grids:
            log(COLOURS, rr.TextDocument(_COLOUR_LEGEND, media_type="text/markdown"), static=True)
        self._cameras.draw_static(data)

    @property
    def _root(self) -> str:
        return self._static.frame or "map"

    def _draw_sensors(self) -> None:
        log, palette = self._rows.log, self._palette
        laser = self._static.laser
        if laser is not None:
            frame = self._rows.in_frame(laser.frame)
            log(POINTS, frame, rr.Points3D.from_fields(colors=[palette.laser], radii=[0.025]), static=True)
            log(
                FAN,
                frame,
                # The laser's colour with an opacity of 8 %.
                rr.Mesh3D.from_fields(albedo_factor=palette.laser & 0xFFFFFF00 | 0x14),
                static=True,
            )
        trail = rr.LineStrips3D.from_fields(colors=[palette.trail], radii=[0.014])
        log(TRAIL, self._rows.in_frame(self._root), trail, static=True)
        for entity, colour, label in (
            (f"{SPEED}/v", palette.trail, "v  m/s"),
            (f"{SPEED}/w", palette.laser, "ω  rad/s"),
            (f"{BATTERY}/level", int(palette.ink[2]), "battery  %"),
        ):
            log(entity, create_curve_style(label, colour), static=True)

    def draw_moving(self, data: MovingScene) -> None:
        """Draw the changes: moved frames, a new scan, the speed, and other new data."""
        # Frames first: the trail and the markers use the new poses.
        for child, parent, position, quaternion in data.frames:
            self._set_pose(child, (parent, position, quaternion))
        self._add_footprint()
        if data.scan is not None:
            scan_stamp = self._rows.stamp if data.scan.stamp is None else data.scan.stamp
            if scan_stamp != self._scan_stamp:
                self._scan_stamp = scan_stamp
                self._show_scan(np.frombuffer(data.scan.ranges, dtype="<f4"))
        if data.velocity is not None:
            self.has_speed = True
            self._v.add(float(data.velocity[0]))
            self._w.add(float(data.velocity[1]))
        if data.battery is not None:
            self._battery.add(float(data.battery))
        self._extend_trail()
        self._floor.draw_moving(data, self._root)
        self._markers.draw_moving(data, self._root)
        self._cameras.draw_moving(data)

    def _set_pose(self, child: str, pose: Pose) -> None:
        before = self._poses.get(child)
        if before is not None and _is_near(before, pose):
            return
        self._poses[child] = pose
        series = self._frames.get(child)
        if series is None:
            series = self._frames[child] = self._create_frame_series(child)
        series.add(pose)

    def _add_footprint(self) -> None:
        """Add the footprint's frame, on the floor, for a robot that sends only its base link."""
        footprint, link = _BODIES
        if footprint not in self._poses and link in self._poses:
            height = self._poses[link][1][2]
            self._set_pose(footprint, (link, (0.0, 0.0, -height), UPRIGHT))

    def _create_frame_series(self, child: str) -> Series[Pose]:
        rows = self._rows

        def encode(values: list[Pose]) -> Iterable[Any]:
            return rr.Transform3D.columns(
                translation=np.array([value[1] for value in values], dtype=np.float32),
                quaternion=np.array([value[2] for value in values], dtype=np.float32),
                parent_frame=[rows.frame_name(value[0]) for value in values],
                child_frame=[rows.frame_name(child)] * len(values),
            )

        return rows.create_series(f"{ORIGIN}/frames/{entity_part(child)}", encode)

    def _show_scan(self, ranges: NDArray[np.float32]) -> None:
        laser = self._static.laser
        if laser is None:
            return
        if len(ranges) != self._rays:
            self._set_directions(laser, len(ranges))
        ranges = ranges[:: self._ray_step]
        seen = np.isfinite(ranges) & (ranges >= (laser.range_min or 0.0))
        self._points.add(self._directions[seen] * ranges[seen, None])
        reach = _FAN_REACH if laser.range_max is None else min(_FAN_REACH, float(laser.range_max))
        free = np.where(np.isposinf(ranges), np.float32(reach), np.where(seen, ranges, np.float32(0.0)))
        corners = self._directions[::_FAN_STEP] * free[::_FAN_STEP, None]
        self._fan.add(np.concatenate((np.zeros((1, 3), dtype=np.float32), corners)))

    def _set_directions(self, laser: Laser, count: int) -> None:
        self._rays = count
        self._ray_step = max(1, -(-count // _MAX_POINTS))  # rounded up
        angles = laser.angle_min + laser.angle_increment * np.arange(0, count, self._ray_step)
        self._directions = np.stack((np.cos(angles), np.sin(angles), 0 * angles), axis=1).astype(np.float32)
        corners = np.arange(1, len(self._directions[::_FAN_STEP]), dtype=np.uint32)
        triangles = np.stack((0 * corners, corners, corners + 1), axis=1)
        self._rows.log(FAN, rr.Mesh3D.from_fields(triangle_indices=triangles), static=True)

    def _extend_trail(self) -> None:
        point = self._robot_position()
        if point is None:
            return
        if self._last_position is None:
            self._last_position = point
        elif math.dist(point, self._last_position) >= _TRAIL_STEP:
            self._trail.add(np.stack((self._last_position, point)).astype(np.float32))
            self._last_position = point

    def _robot_position(self) -> Vector | None:
        """Return the robot's position on the floor (m, root frame), or None if it is unknown."""
        frame: str | None = next((body for body in _BODIES if body in self._poses), None)
        if frame is None:
            return None
        point = (0.0, 0.0, 0.0)
        # A bounded loop, because the robot may send frames that form a cycle.
        for _ in range(min(len(self._poses), _FRAMES_DEEP)):
            parent, (x, y, z), quaternion = self._poses[frame]
            if math.isfinite(quaternion[3]):
                point = rotated(quaternion, point)
            point = (point[0] + x, point[1] + y, point[2] + z)
            if parent == self._root:
                return point[0], point[1], _TRAIL_HEIGHT
            if parent not in self._poses:
                return None
            frame = parent
        return None

    def create_eye(self) -> Eye | None:
        """Return the point of view, chosen by the extent of the world, or None if there is no scene."""
        if self._saved_eye is not None or not self.has_scene:
            return self._saved_eye
        data = self._static
        fixed = (None, self._root)
        (x0, y0), (x1, y1) = extent(
            [part for part in data.parts if part.frame in fixed],
            [grid for grid in data.grids if grid.frame in fixed],
        )
        x, y, span = (x0 + x1) / 2, (y0 + y1) / 2, max(x1 - x0, y1 - y0, _SPAN)
        return Eye(
            position=(x - 0.08 * span, y - 0.71 * span, 0.885 * span),
            target=(x, y - 0.05 * span, 0.0),
            robot_entity=self._body_entity(),
            has_pictures=self.has_pictures,
            has_battery=data.battery is not None,
            has_navigation=bool(data.grids),
        )

    def _body_entity(self) -> str:
        """Return the entity of the robot's body, which a close-up follows, or "" without a body."""
        frames = {mesh.frame or self._root: _MESH for mesh in self._static.meshes}
        frames |= {part.frame or self._root: part.kind for part in self._static.parts}
        for frame in (*_BODIES, *frames):
            if frame in frames and frame != self._root:
                return f"{ORIGIN}/parts/{entity_part(frame)}/{frames[frame]}"
        return ""


def _is_near(first: Pose, second: Pose) -> bool:
    if first[0] != second[0]:
        return False
    return all(
        abs(a - b) <= _STILL for a, b in zip((*first[1], *first[2]), (*second[1], *second[2]), strict=True)
    )


def _create_position_columns(values: list[Any]) -> Iterable[Any]:
    columns = rr.Points3D.columns(positions=rounded(np.concatenate(values), _SCAN_STEP))
    return columns.partition([len(row) for row in values])


def _create_vertex_columns(values: list[Any]) -> Iterable[Any]:
    columns = rr.Mesh3D.columns(vertex_positions=rounded(np.concatenate(values), _SCAN_STEP))
    return columns.partition([len(row) for row in values])


def _create_strip_columns(values: list[Any]) -> Iterable[Any]:
    return rr.LineStrips3D.columns(strips=values)
