"""Worlds that are made from maps of ROS 2's map_server: `--world map.yaml`.

Occupied cells become walls. Unknown cells are not floor: neither the start nor a waypoint is there. The
waypoints are in the file `map.waypoints.yaml` beside the map; without this file they are random free places.
The areas in `map.keepout.yaml` are the world's keep-out areas.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from btcore_robot.occupancy_map import MapError, load_map
from btcore_robot.robot import Pose2D, Waypoints
from btcore_robot.waypoint_file import load_waypoints, waypoints_path
from btcore_sim.clearance_map import ClearanceMap, Point
from btcore_sim.errors import SimError
from btcore_sim.map_walls import MapWalls
from btcore_sim.world import random_generator
from btcore_sim.world_description import WorldDescription

MAX_CELLS = 16_000_000
"""The largest number of cells of a map that becomes a world: 200 m x 200 m with cells of 5 cm."""

MAX_PIECES = 100_000
"""The largest number of rectangles of wall. A scan of the laser takes about 0.2 ms for each 1,000."""

RANDOM_WAYPOINTS = ("recharge", "wp1", "wp2", "wp3")
"""The names of the waypoints at random places: those that the patrol trees use."""

MARGIN = 0.1
"""Room (m) beside the robot at a random place, and on the whole way between two random places."""

APART = 1.0
"""Smallest distance (m) between two random places."""

_PHYSICS_RATE = 120
_FLOOR = (141, 146, 151, 255)
_CANDIDATES = 8  # random places, of which the one farthest from the earlier places becomes a waypoint


def load_map_world(
    path: Path, seed: int, radius: float, waypoints: Waypoints | None = None
) -> WorldDescription:
    """Return the world of a map, with waypoints and a start pose.

    The robot starts at the waypoint `start`, or otherwise at a random free place that is connected with
    the waypoints.

    Args:
        path: The YAML file of the map.
        seed: The seed of the random places.
        radius: The radius (m) of the robot that has to reach the random places.
        waypoints: The waypoints; None for those in the file beside the map, or random ones.

    Raises:
        SimError: The map or its waypoints cannot be read, the map is too large, or it has no free floor.
    """
    try:
        map = load_map(path)
        if waypoints is None and waypoints_path(path).exists():
            waypoints = load_waypoints(waypoints_path(path))
    except MapError as error:
        raise SimError(str(error)) from error
    if map.cells.size > MAX_CELLS:
        raise SimError(
            f"{path}: the map has {map.cells.size:,} cells, but a world can have at most {MAX_CELLS:,}: crop "
            "the image, or use a coarser resolution"
        )
    walls = MapWalls(map)
    if len(walls.rectangles) > MAX_PIECES:
        raise SimError(
            f"{path}: the occupied cells form {len(walls.rectangles):,} rectangles, but a world can have at "
            f"most {MAX_PIECES:,}: remove the noise from the image, or use a higher occupied_thresh"
        )
    description = WorldDescription(
        name=path.stem,
        description=f"the map {path.name}",
        objects=(),
        area=walls.known,
        clearance=MARGIN,
        pose=None,
        floor=_FLOOR,
        keepout=map.keepout,
        physics_rate=_PHYSICS_RATE,
        walls=walls,
    )
    places = dict(waypoints.places) if waypoints is not None else {}
    points = [(pose.x, pose.y) for pose in places.values()]
    floor = ClearanceMap.of(description)
    region = _region(floor, radius + MARGIN, points)
    if not region.any():
        raise SimError(f"{path}: the map has no free floor with room for a robot of {radius:g} m radius")
    random = random_generator(seed, "places on the map")
    start = places.get("start")
    if start is None:
        start = Pose2D(*_cell(floor, region, random), float(random.uniform(-math.pi, math.pi)))
    if not places:
        places = _random_waypoints(floor, region, random, (start.x, start.y))
    return replace(with_waypoints(description, Waypoints(places)), pose=start)


def with_waypoints(description: WorldDescription, waypoints: Waypoints) -> WorldDescription:
    """Return *description* with *waypoints* instead of its own."""
    return replace(
        description,
        waypoints={name: (pose.x, pose.y) for name, pose in waypoints.places.items()},
        headings={name: pose.yaw for name, pose in waypoints.places.items() if pose.yaw != 0.0},
    )


def _region(floor: ClearanceMap, clearance: float, points: Sequence[Point]) -> NDArray[np.bool_]:
    """Return the cells of the connected region that contains most of *points*; without any, the largest.

    Args:
        floor: The clearance of each cell.
        clearance: The smallest clearance (m) of the region's cells.
        points: Positions (m).
    """
    passable = (floor.clearances >= clearance).astype(np.uint8)
    _, labels, statistics, _ = cv2.connectedComponentsWithStats(passable, connectivity=4)
    sizes = statistics[:, cv2.CC_STAT_AREA].astype(np.int64)
    sizes[0] = 0  # label 0 has the cells without enough clearance
    inside = [labels[floor.map.cell(*point)] for point in points if floor.map.inside(*point)]
    votes = np.bincount(inside, minlength=len(sizes)) if inside else np.zeros(len(sizes), dtype=np.int64)
    votes[0] = 0
    # lexsort sorts by its last key first: votes, then sizes.
    best = np.lexsort((sizes, votes))[-1]
    mask: NDArray[np.bool_] = (labels == best) & (sizes[best] > 0)
    return mask


def _cell(floor: ClearanceMap, region: NDArray[np.bool_], random: np.random.Generator) -> Point:
    cells = np.flatnonzero(region)
    row, col = divmod(int(cells[random.integers(len(cells))]), region.shape[1])
    return floor.map.center(row, col)


def _random_waypoints(
    floor: ClearanceMap, region: NDArray[np.bool_], random: np.random.Generator, start: Point
) -> dict[str, Pose2D]:
    """Return waypoints at random cells of *region*, and `start`; fewer waypoints if the region is small."""
    places = [start]
    for _ in RANDOM_WAYPOINTS:
        candidates = [_cell(floor, region, random) for _ in range(_CANDIDATES)]
        place = max(candidates, key=lambda point: min(math.dist(point, other) for other in places))
        if min(math.dist(place, other) for other in places) >= APART:
            places.append(place)
    poses = [Pose2D(round(x, 3), round(y, 3), 0.0) for x, y in places]
    return dict(zip(("start", *RANDOM_WAYPOINTS), poses, strict=False))
