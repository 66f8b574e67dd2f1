"""The navigation as plain data for whoever draws it: what it knows, plans, and takes for its place.

The keys are those of the monitor's scene: ``grids`` of cells, rows of ``poses``, ``notes`` in words. What
lasts is told when it has changed, large things not more often than somebody looks.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from btcore_robot.navigation.costmap import LayeredCostmap
from btcore_robot.navigation.localiser import Localiser
from btcore_robot.navigation.occupancy_map import OccupancyMap
from btcore_robot.navigation.path import NavPath
from btcore_robot.navigation.servers import MAP, ODOM, Servers
from btcore_robot.rigid_transform import Transform
from btcore_robot.robot import Pose2D

PARTICLES_AT_MOST = 500
"""So many of the particles are told, evenly chosen."""

GLOBAL_EVERY, LOCAL_EVERY, MAP_EVERY = 1_000_000_000, 250_000_000, 2_000_000_000
"""The least time (ns) between two tellings of a costmap, or of a map that grows."""

_NOBODY = np.zeros((0, 3))


class NavigationScene:
    """Tells what the servers know. *static* begins anew; *moving* gives what is new since the last call."""

    def __init__(self, servers: Servers) -> None:
        self._servers = servers
        self._begin()

    def _begin(self) -> None:
        self._shown: dict[str, object] = {}
        self._next: dict[str, int] = {}
        self._start: Transform | None = None

    def static(self) -> dict[str, Any]:
        """The map as it is now, and where to keep out of."""
        self._begin()
        self._shown["map"] = known = self._known_map()
        areas = [
            {"name": f"keepout_{index}", "frame": MAP, "corners": list(corners)}
            for index, corners in enumerate(known.keepout)
        ]
        return {"grids": [occupancy(known)], "areas": areas}

    def moving(self, now: int) -> dict[str, Any]:
        """What is new at *now* (ns)."""
        localiser = self._servers.localiser
        told: dict[str, Any] = {"grids": self._grids(now), "poses": self._paths(), "notes": self._notes()}
        if isinstance(localiser, Localiser) and self._is_new("particles", localiser.particles):
            step = max(1, math.ceil(len(localiser.particles) / PARTICLES_AT_MOST))
            told["poses"].append(rows("particles", "cloud", localiser.particles[::step]))
        told["poses"] += self._beliefs()
        placed = self._placed()
        if placed is not None:
            told["frames"] = [[ODOM, MAP, list(placed.position), list(placed.quaternion)]]
        return told

    def _known_map(self) -> OccupancyMap:
        return self._servers.global_costmap.map

    def _placed(self) -> Transform | None:
        """Where odom is in the map, as far as that is known."""
        here = self._servers.pose()
        if here is None:
            return None
        return Transform.from_pose(here) * Transform.from_pose(self._servers.robot.odometry().pose).inverse()

    def _beliefs(self) -> list[dict[str, Any]]:
        """Where the robot takes itself to be, and where it would by its wheels alone since it first knew."""
        here, placed = self._servers.pose(), self._placed()
        if here is None or placed is None:
            return []
        told = [rows("estimate", "estimate", [here])]
        if self._start is None and self._servers.localiser.confident:
            self._start = placed
        if self._start is not None:
            reckoned = (self._start * Transform.from_pose(self._servers.robot.odometry().pose)).to_pose()
            told.append(rows("odometry", "odometry", [reckoned]))
        return told

    def _paths(self) -> list[dict[str, Any]]:
        """The path and the goals of a navigator at work, or else of who drives; none where nobody does."""
        handle, path = self._at_work(), self._driven()
        goals: tuple[Pose2D, ...] = (path[-1],) if path is not None else ()
        sort: object = path
        if handle is not None:
            goals = sort = handle.goal.goals
            path = self._servers.compute_path.newest
        told = []
        if self._is_new("path", path):
            told.append(rows("path", "path", path.poses if path is not None else _NOBODY))
        if self._is_new("goals", sort):
            told.append(rows("goal", "goal", goals if goals else _NOBODY))
        return told

    def _driven(self) -> NavPath | None:
        """The path that is driven along, say, for a tree of Nav2's nodes without a navigator around it."""
        current = self._servers.follow_path.current
        if current is None or current.done or not len(current.goal.path):
            return None
        return current.goal.path

    def _at_work(self) -> Any:
        """The goal of a navigator that has one to go to, as its handle; None where nobody navigates."""
        for navigator in self._servers.navigators.values():
            current = getattr(navigator, "current", None)
            if current is not None and not current.done:
                return current
        return None

    def _grids(self, now: int) -> list[dict[str, Any]]:
        servers, told = self._servers, []
        known = self._known_map()
        if known is not self._shown.get("map") and self._is_due("map", now, MAP_EVERY):
            self._shown["map"] = known
            told.append(occupancy(known))
        for name, costmap, every in (
            ("global_costmap", servers.global_costmap, GLOBAL_EVERY),
            ("local_costmap", servers.local_costmap, LOCAL_EVERY),
        ):
            if self._shown.get(name) != costmap.version and self._is_due(name, now, every):
                self._shown[name] = costmap.version
                told.append(costs(name, costmap))
        return told

    def _notes(self) -> dict[str, str]:
        localiser = self._servers.localiser
        if localiser.searching:
            state = "**lost**: turns, and searches the map"
        elif localiser.confident:
            state = "sure"
        else:
            state = "**in doubt**: stands still"
        return {"localisation": state, "goal": self._way()}

    def _way(self) -> str:
        handle = self._at_work()
        if handle is not None and handle.feedback is not None:
            goal, feedback = handle.goal.goals[-1], handle.feedback
            tail = f", {feedback.number_of_recoveries} recoveries" if feedback.number_of_recoveries else ""
            return f"({goal.x:.1f}, {goal.y:.1f}), {feedback.distance_remaining:.1f} m to go{tail}"
        path = self._driven()
        if path is not None:
            goal = path[-1]
            return f"({goal.x:.1f}, {goal.y:.1f}), {self._servers.remaining(path):.1f} m to go"
        return "–"

    def _is_new(self, name: str, thing: object) -> bool:
        if name in self._shown and self._shown[name] is thing:
            return False
        self._shown[name] = thing
        return True

    def _is_due(self, name: str, now: int, every: int) -> bool:
        if now < self._next.get(name, now):
            return False
        self._next[name] = now + every
        return True


def rows(name: str, kind: str, poses: Any) -> dict[str, Any]:
    """Poses in the frame map, an array of shape ``(n, 3)`` or several `Pose2D`, as plain data."""
    array: NDArray[np.float64] = (
        poses if isinstance(poses, np.ndarray) else np.array([[one.x, one.y, one.yaw] for one in poses])
    )
    return {"name": name, "kind": kind, "frame": MAP, "rows": array.astype("<f4").tobytes()}


def occupancy(map: OccupancyMap) -> dict[str, Any]:
    """A map as plain data."""
    return {
        "name": "map",
        "kind": "occupancy",
        "frame": MAP,
        "resolution": map.resolution,
        "origin": list(map.origin),
        "size": [map.width, map.height],
        "cells": map.cells.tobytes(),
    }


def costs(name: str, costmap: LayeredCostmap) -> dict[str, Any]:
    """A costmap as plain data."""
    height, width = costmap.costs.shape
    return {
        "name": name,
        "kind": "costs",
        "frame": costmap.frame,
        "resolution": costmap.resolution,
        "origin": list(costmap.origin),
        "size": [width, height],
        "cells": costmap.costs.tobytes(),
    }
