"""Messages of `btcore_scene` that show the navigation: map, costmaps, path, goals and estimated pose.

Grids, paths and goals are sent when they have changed, and large grids at a limited rate.
"""

import math
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from btcore.clock import NS_PER_S
from btcore_navigation.action import GoalStatus
from btcore_navigation.localiser import Localiser
from btcore_navigation.path import NavPath
from btcore_navigation.servers import Servers
from btcore_robot.occupancy_map import Grid as CellGrid
from btcore_robot.occupancy_map import OccupancyMap
from btcore_robot.rigid_transform import Transform
from btcore_robot.robot import MAP_FRAME, ODOM_FRAME, GoalOutcome, Pose2D
from btcore_scene import Area, Frame, Grid, MovingScene, Poses, StaticScene

MAX_PARTICLES = 250
"""The maximum number of particles that are sent; of more particles, every n-th is sent."""

GLOBAL_INTERVAL_NS, LOCAL_INTERVAL_NS, MAP_INTERVAL_NS = 2_000_000_000, 250_000_000, 2_000_000_000
"""Minimum time (ns) between two messages with a costmap, or with a map that grows."""


class NavigationScene:
    """The scene messages of *servers* and of the *outcomes* of goals, to which new outcomes are appended.

    `static` returns the map and the keep-outs. `moving` returns the robot's poses, and the grids, paths and
    goals that have changed since the last call of either method.
    """

    def __init__(self, servers: Servers, outcomes: Sequence[GoalOutcome] = ()) -> None:
        self._servers = servers
        self._outcomes = outcomes
        self._forget()

    def _forget(self) -> None:
        self._sent: dict[str, object] = {}
        self._next: dict[str, int] = {}
        self._start: Transform | None = None

    def static(self) -> StaticScene:
        """Return the present map and its keep-out areas; `moving` then returns everything again."""
        self._forget()
        self._sent["map"] = known = self._map()
        areas = [
            Area(name=f"keepout_{index}", frame=MAP_FRAME, corners=corners)
            for index, corners in enumerate(known.keepout)
        ]
        return StaticScene(grids=[map_message(known)], areas=areas)

    def moving(self, now: int) -> MovingScene:
        """Return the messages that have changed at *now* (ns)."""
        localiser = self._servers.localiser
        poses = self._path_messages()
        if isinstance(localiser, Localiser) and self._take_if_new("particles", localiser.particles):
            step = max(1, math.ceil(len(localiser.particles) / MAX_PARTICLES))
            poses.append(pose_rows("particles", "cloud", localiser.particles[::step]))
        poses += self._pose_messages()
        placed = self._odom_in_map()
        return MovingScene(
            frames=()
            if placed is None
            else [Frame(ODOM_FRAME, MAP_FRAME, placed.position, placed.quaternion)],
            grids=self._grid_messages(now),
            poses=poses,
            notes=self._notes(),
        )

    def _map(self) -> OccupancyMap:
        return self._servers.global_costmap.map

    def _odom_in_map(self) -> Transform | None:
        """Return the pose of odom in the map, or None while the robot's pose is unknown."""
        here = self._servers.pose()
        if here is None:
            return None
        return Transform.from_pose(here) * Transform.from_pose(self._servers.robot.odometry().pose).inverse()

    def _pose_messages(self) -> list[Poses]:
        """Return the estimated pose, and the pose by odometry alone since the first confident estimate."""
        here, placed = self._servers.pose(), self._odom_in_map()
        if here is None or placed is None:
            return []
        messages = [pose_rows("estimate", "estimate", _rows([here]))]
        if self._start is None and self._servers.localiser.is_confident:
            self._start = placed
        if self._start is not None:
            reckoned = (self._start * Transform.from_pose(self._servers.robot.odometry().pose)).to_pose()
            messages.append(pose_rows("odometry", "odometry", _rows([reckoned])))
        return messages

    def _path_messages(self) -> list[Poses]:
        """Return the path and the goals of the active navigator, or else the path that is followed."""
        handle, path = self._active_goal(), self._followed_path()
        goals: tuple[Pose2D, ...] = (path[-1],) if path is not None else ()
        source: object = path
        if handle is not None:
            goals = source = handle.goal.goals
            path = self._servers.compute_path.latest_path
        messages = []
        if self._take_if_new("path", path):
            messages.append(pose_rows("path", "path", path.poses if path is not None else _rows(())))
        if self._take_if_new("goals", source):
            messages.append(pose_rows("goal", "goal", _rows(goals)))
        return messages

    def _followed_path(self) -> NavPath | None:
        """Return the path that the controller follows, for example in a tree without a navigator."""
        current = self._servers.follow_path.current
        if current is None or current.done or not len(current.goal.path):
            return None
        return current.goal.path

    def _active_goal(self) -> Any:
        """Return the handle of the active navigator's goal, or None without an active navigator."""
        for navigator in self._servers.navigators.values():
            current = getattr(navigator, "current", None)
            if current is not None and not current.done:
                return current
        return None

    def _grid_messages(self, now: int) -> list[Grid]:
        servers, messages = self._servers, []
        known = self._map()
        if self._take_if_new("map", known, now, MAP_INTERVAL_NS):
            messages.append(map_message(known))
        for name, costmap, interval in (
            ("global_costmap", servers.global_costmap, GLOBAL_INTERVAL_NS),
            ("local_costmap", servers.local_costmap, LOCAL_INTERVAL_NS),
        ):
            if self._take_if_new(name, costmap.version, now, interval):
                messages.append(grid_message(name, "costs", costmap.frame, costmap, costmap.costs))
        return messages

    def _notes(self) -> dict[str, str]:
        localiser = self._servers.localiser
        if localiser.is_searching:
            state = "**lost**: turns, and searches the map"
        elif localiser.is_confident:
            state = "sure"
        else:
            state = "**in doubt**: stands still"
        notes = {"localisation": state, "goal": self._goal_note()}
        failed = [outcome for outcome in self._outcomes if outcome.status == GoalStatus.ABORTED.name]
        if failed:
            cause = " ".join(failed[-1].cause.split())
            notes["failed goals"] = f"{len(failed)}, the last at {failed[-1].stamp / NS_PER_S:.0f} s: {cause}"
        return notes

    def _goal_note(self) -> str:
        handle = self._active_goal()
        if handle is not None and handle.feedback is not None:
            goal, feedback = handle.goal.goals[-1], handle.feedback
            tail = f", {feedback.number_of_recoveries} recoveries" if feedback.number_of_recoveries else ""
            return f"({goal.x:.1f}, {goal.y:.1f}), {feedback.distance_remaining:.1f} m to go{tail}"
        path = self._followed_path()
        if path is not None:
            goal = path[-1]
            return f"({goal.x:.1f}, {goal.y:.1f}), {self._servers.remaining(path):.1f} m to go"
        return "–"

    def _take_if_new(self, name: str, data: object, now: int = 0, interval: int = 0) -> bool:
        """Return whether a message with *data* is due; it then counts as sent for *interval* (ns)."""
        if self._sent.get(name, self) is data or now < self._next.get(name, now):
            return False
        self._sent[name] = data
        self._next[name] = now + interval
        return True


def pose_rows(
    name: str, kind: Literal["path", "cloud", "goal", "estimate", "odometry"], rows: NDArray[np.float64]
) -> Poses:
    """Return poses in the frame map as a message.

    Args:
        name: The name of the poses. A message replaces the earlier message of the same name.
        kind: How a viewer draws the poses.
        rows: The poses: x, y (m) and yaw (rad), shape `(n, 3)`; without rows the earlier poses are removed.
    """
    return Poses(name=name, kind=kind, frame=MAP_FRAME, rows=rows.astype("<f4").tobytes())


def grid_message(
    name: str, kind: Literal["occupancy", "costs"], frame: str, grid: CellGrid, cells: NDArray[Any]
) -> Grid:
    """Return a grid as a message.

    Args:
        name: The name of the grid. A message replaces the earlier message of the same name.
        kind: The meaning of the cells, as in `btcore_scene.Grid`.
        frame: The frame of the grid.
        grid: The source of the resolution and the origin.
        cells: The values of the cells, shape `(height, width)`, row 0 with the lowest y: int8 for an
            `occupancy` grid, uint8 for `costs`.
    """
    height, width = cells.shape
    return Grid(
        name=name,
        kind=kind,
        frame=frame,
        resolution=grid.resolution,
        origin=grid.origin,
        size=(width, height),
        cells=cells.tobytes(),
    )


def map_message(map: OccupancyMap) -> Grid:
    """Return a map as a message."""
    return grid_message("map", "occupancy", MAP_FRAME, map, map.cells)


def _rows(poses: Sequence[Pose2D]) -> NDArray[np.float64]:
    return np.array([[pose.x, pose.y, pose.yaw] for pose in poses]).reshape(-1, 3)
