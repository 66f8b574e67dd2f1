"""The quality of a map, as far as the scans of which it was made reveal it.

A map is good if its scans agree with it: their rays end on its walls, no ray passes through a wall, and the
loops fit together. A map that is wrong as a whole without a contradiction, for example turned, or stretched
along a bare corridor, cannot be recognised in this way.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from btcore_navigation.likelihood import obstacle_distances
from btcore_navigation.mapping.key_scan import MAX_RANGE, KeyScan
from btcore_navigation.mapping.pose_arrays import Floats, relative_pose, transform_points
from btcore_navigation.mapping.pose_graph import PoseGraph
from btcore_navigation.ray_casting import RayCaster
from btcore_robot.occupancy_map import OccupancyMap

ON_WALL = 0.1
"""A ray fits if it ends at most this far (m) from the middle of an occupied cell."""
BEHIND_WALL = 0.2
"""A ray passes through a wall if it ends farther (m) than this behind the first occupied cell in its way."""
MIN_FIT = 0.98
"""A smaller share of fitting rays is a warning.

Measured: at least 0.992 in houses, offices, mazes of thin walls and a ring, whose maps are right; 0.82 to
0.89 in the same maps with a drift that moves half of the occupied cells by more than 10 cm.
"""
MAX_THROUGH_SHARE = 0.06
"""A larger share of rays through walls is a warning.

Measured: at most 0.041 in right maps, mostly at edges; 0.08 to 0.16 in a home and in a maze of thin walls
whose second half is displaced by 0.2 m or more.
"""
MAX_LOOP_ERROR = 0.3
"""A larger disagreement (m) of a loop with the poses of its scans is a warning: another place looks alike."""

_MAX_DISTANCE = 0.5  # m; a greater distance from a wall counts as this distance
_MAX_SCANS = 300  # of a map that are compared
_MAX_RAYS = 60  # of a scan


@dataclass(frozen=True, slots=True)
class MapQuality:
    """The agreement of a map with the scans of which it was made.

    Attributes:
        fit: The share (0 … 1) of rays that end on walls of the map.
        residual_m: The root mean square of the distances (m) of the rays' ends from the map's walls; a
            distance counts at most 0.5 m.
        through_walls: The share (0 … 1) of rays that pass through walls of the map.
        loops: The number of loops that were closed.
        loop_error_m: The greatest disagreement (m) of a loop with the poses of its scans; 0 without loops.
    """

    fit: float
    residual_m: float
    through_walls: float
    loops: int
    loop_error_m: float

    def problems(self) -> list[str]:
        """Return a sentence for each value that shows a poor map; empty for a good map."""
        problems = []
        if self.fit < MIN_FIT:
            problems.append(f"only {self.fit:.1%} of the laser's rays end on its walls")
        if self.through_walls > MAX_THROUGH_SHARE:
            problems.append(f"{self.through_walls:.1%} of the laser's rays pass through its walls")
        if self.loop_error_m > MAX_LOOP_ERROR:
            problems.append(f"a closed loop disagrees with it by {self.loop_error_m:.2f} m")
        return problems

    def warning(self) -> str:
        """Return a warning about a poor map, with a remedy; "" for a good map."""
        problems = self.problems()
        if not problems:
            return ""
        return (
            f"the map is poor: {', and '.join(problems)}: compare it with the place before robots use it, "
            "or map the place again by another way"
        )


def map_quality(field_map: OccupancyMap, scans: Sequence[KeyScan], graph: PoseGraph) -> MapQuality:
    """Return the quality of a map.

    Args:
        scans: The key scans of which the map was made.
        graph: The pose graph with the poses of the key scans.
    """
    origins, ends = _rays(scans, graph.poses)
    loop_errors = [
        float(np.hypot(*(relative_pose(graph.poses[edge.first], graph.poses[edge.last]) - edge.step)[:2]))
        for edge in graph.edges
        if edge.loop
    ]
    if len(ends):
        cells = field_map.indices(ends)
        inside = ((cells >= 0) & (cells < field_map.cells.shape)).all(axis=1)
        distances = np.full(len(ends), _MAX_DISTANCE)
        distances[inside] = obstacle_distances(field_map, _MAX_DISTANCE)[tuple(cells[inside].T)]
        rays = ends - origins
        lengths = np.maximum(np.hypot(rays[:, 0], rays[:, 1]), 1e-6)
        (x, y), (dx, dy) = origins.T, (rays / lengths[:, None]).T
        visible = RayCaster(field_map, MAX_RANGE).visible_range(x, y, dx, dy, lengths)
        fit = float(np.mean(distances <= ON_WALL + 1e-6))
        residual = float(np.sqrt(np.mean(distances**2)))
        through = float(np.mean(lengths - visible > BEHIND_WALL))
    else:
        fit, residual, through = 1.0, 0.0, 0.0
    loop_error = max(loop_errors, default=0.0)
    return MapQuality(
        round(fit, 4), round(residual, 4), round(through, 4), len(loop_errors), round(loop_error, 4)
    )


def _rays(scans: Sequence[KeyScan], poses: Floats) -> tuple[Floats, Floats]:
    """Return the origins and the ends of evenly chosen rays in the map (m), shape `(n, 2)` each."""
    origins, ends = [np.zeros((0, 2))], [np.zeros((0, 2))]
    step = -(-len(scans) // _MAX_SCANS) or 1
    for scan, pose in zip(scans[::step], poses[::step], strict=True):
        chosen = transform_points(scan.ends[:: max(1, len(scan.ends) // _MAX_RAYS)], pose)
        ends.append(chosen)
        # The first point of the outline of the free floor is the laser.
        origins.append(np.repeat(transform_points(scan.free_outline[:1], pose), len(chosen), axis=0))
    return np.concatenate(origins), np.concatenate(ends)
