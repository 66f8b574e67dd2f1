"""What a plan over the house and the upkeep of costmaps cost beside plain calls of the libraries under them.

    python benchmarks/navigation_planning.py [--pairs 15] [--world house] [--json]

Plans go from waypoint to waypoint. "first" is a plan for a goal never asked for; "again" one for a goal that
is being driven to, a metre further on each time, with what a laser with noise of 6 cm and a position off by
some centimetres has marked. Their peer is scikit-image's `route_through_array` on the same grid, which finds
the same cells and smooths nothing. The peer of a costmap's update is the inflation of that costmap as a
whole over scipy's exact distances. Each pair is one of both, one right after another, and ratios are taken
pair by pair; times are of the processor. A share is what remains of the period at which Nav2 runs it.
"""

import math
import statistics
import time
from collections.abc import Callable, Iterator
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from skimage.graph import route_through_array

from btcore_robot.navigation.costmap import LETHAL, Costmap, GlobalCostmap, LocalCostmap
from btcore_robot.navigation.grid_search import grid_costs
from btcore_robot.navigation.occupancy_map import OccupancyMap
from btcore_robot.navigation.planner import Planner
from btcore_robot.robot import LaserScan, Pose2D
from btcore_sim.map_rasteriser import rasterise
from btcore_sim.scene import load_scene
from measure.paired_timing import Spread
from measure.report import Report, arguments

MILLISECOND = 1e6
RAYS, HALF_VIEW, NOISE = 666, math.radians(110), 0.06  # Tiago's laser

Pair = tuple[int, int]


def processor_time(work: Callable[[], object]) -> int:
    """How long *work* takes (ns of processor time)."""
    start = time.process_time_ns()
    work()
    return time.process_time_ns() - start


def scan(map: OccupancyMap, pose: Pose2D, random: np.random.Generator) -> LaserScan:
    """What a laser at *pose* sees of *map*, with noise."""
    angles = np.linspace(-HALF_VIEW, HALF_VIEW, RAYS)
    along = np.arange(0.1, 12.0, 0.02)
    x = pose.x + np.cos(angles + pose.yaw)[:, None] * along
    y = pose.y + np.sin(angles + pose.yaw)[:, None] * along
    rows = np.clip((y - map.origin[1]) / map.resolution, 0, map.height - 1).astype(int)
    cols = np.clip((x - map.origin[0]) / map.resolution, 0, map.width - 1).astype(int)
    hit = map.occupied[rows, cols]
    ranges = np.where(hit.any(axis=1), along[hit.argmax(axis=1)] + random.normal(0, NOISE, RAYS), np.inf)
    step = float(angles[1] - angles[0])
    return LaserScan(ranges.astype(np.float32), 0, -HALF_VIEW, step, 0.05, 25.0, "base_laser_link")


def peer_route(costmap: Costmap, start: Pose2D, goal: Pose2D) -> object:
    """The same way by scikit-image alone."""
    costs = grid_costs(costmap.costs)
    first, last = costmap.cell(start.x, start.y), costmap.cell(goal.x, goal.y)
    found: object = route_through_array(costs, first, last)  # type: ignore[no-untyped-call]
    return found


def peer_inflation(costs: NDArray[np.uint8], resolution: float) -> object:
    """Costs about the lethal cells of a whole costmap, by scipy and numpy alone."""
    distance = distance_transform_edt(costs != LETHAL) * resolution
    graded = 252 * np.exp(-3.0 * (distance - 0.3))
    return np.select([distance == 0, distance <= 0.3, distance <= 0.55], [254, 253, graded], 0)


def first_plans(costmap: GlobalCostmap, legs: list[tuple[Pose2D, Pose2D]]) -> Iterator[Pair]:
    """Pairs of plans for goals that were never asked for."""
    for start, goal in legs:
        planner = Planner(costmap)
        peer = processor_time(partial(peer_route, costmap, start, goal))
        yield peer, processor_time(partial(planner.plan, start, goal, 0))


def plans_again(
    map: OccupancyMap, legs: list[tuple[Pose2D, Pose2D]], random: np.random.Generator
) -> Iterator[Pair]:
    """Pairs of plans while a goal is driven to."""
    costmap = GlobalCostmap(map)
    planner = Planner(costmap)
    for start, goal in legs:
        path = planner.plan(start, goal, 0)
        planner.plan(start, goal, 0)
        for index in range(20, len(path) - 10, 20):
            at = path[index]
            off = random.normal(0, (0.05, 0.05, 0.02))
            costmap.observe(scan(map, at, random), Pose2D(at.x + off[0], at.y + off[1], at.yaw + off[2]))
            costmap.update(index, at)
            peer = processor_time(partial(peer_route, costmap, at, goal))
            yield peer, processor_time(partial(planner.plan, at, goal, 0))


def updates(
    map: OccupancyMap, costmap: GlobalCostmap | LocalCostmap, rounds: int, random: np.random.Generator
) -> Iterator[Pair]:
    """Pairs of updates while the robot drives ahead."""
    for index in range(10 * rounds):
        at = Pose2D(0.02 * (index % 50), 0.0, 0.01 * (index % 50))
        seen = scan(map, at, random)
        peer = processor_time(lambda: peer_inflation(costmap.costs, costmap.resolution))

        def update(seen: LaserScan = seen, at: Pose2D = at, index: int = index) -> None:
            costmap.observe(seen, at)
            costmap.update(index, at)

        yield peer, processor_time(update)


def add(report: Report, name: str, pairs: list[Pair], hertz: float) -> None:
    """Add a row for *pairs* of what the peer and what our part took."""
    peer, own = (statistics.median(column) / MILLISECOND for column in zip(*pairs, strict=True))
    figures = {
        "pairs": f"{len(pairs)}",
        "peer": f"{peer:.2f} ms",
        "own": f"{own:.2f} ms",
        "share of a core": f"{own * hertz / 10:.2f} % at {hertz:g} Hz",
    }
    report.add(f"{name}: own / peer", Spread.of([mine / theirs for theirs, mine in pairs]), None, figures)


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "", pairs=15)
    parser.add_argument("--world", default="house")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    random = np.random.default_rng(0)
    scene = load_scene(given.world)
    map = rasterise(scene)
    places = [Pose2D(x, y, 0.0) for x, y in (scene.waypoints[f"wp{number}"] for number in (1, 2, 3))]
    legs = [(places[index], places[(index + 1) % 3]) for index in range(1 if given.quick else 3)]
    still = GlobalCostmap(map)
    question = f"What planning takes in {given.world}, {map.height} × {map.width} cells"
    report = Report("navigation_planning", question, given.pairs)
    add(report, "plan, first", list(first_plans(still, legs * given.pairs)), 1.0)
    add(report, "plan, again", list(plans_again(map, legs, random)), 1.0)
    add(report, "global costmap", list(updates(map, GlobalCostmap(map), given.pairs, random)), 1.0)
    local = LocalCostmap(keepout=map.keepout)
    add(report, "local costmap", list(updates(map, local, given.pairs, random)), 5.0)
    report.output(given.json)


if __name__ == "__main__":
    main()
