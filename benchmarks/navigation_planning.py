"""How long planning and costmap updates take, compared with direct calls of the libraries that they use.

    python benchmarks/navigation_planning.py [--pairs 15] [--world house] [--quick] [--json]

Plans lead from waypoint to waypoint. "first" is the first plan to a goal. "again" is a later plan to the same
goal: the robot is a metre closer each time, and the costmap contains the marks of a laser with noise (6 cm)
at a pose with an error of some centimetres. The reference is scikit-image's `route_through_array` on the same
grid, which finds the same cells but does not smooth the path. The reference of a costmap's update is the
inflation of the whole costmap with scipy's exact distances. A pair consists of btcore's function ("own") and
the reference ("peer"), directly after each other; ratios are computed within a pair, and times are processor
times. The share of a core is computed for the rate at which Nav2 plans or updates the costmap.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from skimage.graph import route_through_array

from btcore.clock import NS_PER_MS, NS_PER_S
from btcore_navigation.costmap import INSCRIBED, LETHAL, Costmap, GlobalCostmap, LocalCostmap
from btcore_navigation.grid_search import grid_costs
from btcore_navigation.planner import Planner
from btcore_robot.occupancy_map import OccupancyMap
from btcore_robot.robot import LaserScan, Pose2D
from btcore_sim.map_rasteriser import rasterise
from btcore_sim.worlds import load_world_description
from measure.paired_timing import Work, measure_rounds
from measure.report import Report, create_parser

RADIUS, INFLATION_RADIUS, SCALING = 0.30, 0.55, 3.0  # m, m, 1/m: the defaults of the costmaps
RAYS, HALF_VIEW, NOISE = 666, math.radians(110), 0.06  # Tiago's laser: number of rays, rad, m

Pair = Mapping[str, Work]


def scan(map: OccupancyMap, pose: Pose2D, random: np.random.Generator) -> LaserScan:
    """Return a scan, with noise, of a laser at *pose* (m, rad) in *map*."""
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
    """Return the same path, planned by scikit-image alone."""
    costs = grid_costs(costmap.costs)
    first, last = costmap.cell(start.x, start.y), costmap.cell(goal.x, goal.y)
    route: object = route_through_array(costs, first, last)  # type: ignore[no-untyped-call]
    return route


def peer_inflation(costs: NDArray[np.uint8], resolution: float) -> object:
    """Return the costs around the lethal cells of a costmap, computed with scipy and numpy alone."""
    distance = distance_transform_edt(costs != LETHAL) * resolution
    graded = (INSCRIBED - 1) * np.exp(-SCALING * (distance - RADIUS))
    zones = [distance == 0, distance <= RADIUS, distance <= INFLATION_RADIUS]
    return np.select(zones, [LETHAL, INSCRIBED, graded], 0)


def first_plans(costmap: GlobalCostmap, legs: list[tuple[Pose2D, Pose2D]]) -> Iterator[Pair]:
    """Yield, for each leg (start and goal), a pair that plans with a new planner."""
    for start, goal in legs:
        planner = Planner(costmap)
        yield {
            "peer": partial(peer_route, costmap, start, goal),
            "own": partial(planner.plan, start, goal, 0),
        }


def plans_again(
    map: OccupancyMap, legs: list[tuple[Pose2D, Pose2D]], random: np.random.Generator
) -> Iterator[Pair]:
    """Yield pairs that plan again, from poses along the path to the goal of each leg."""
    costmap = GlobalCostmap(map)
    planner = Planner(costmap)
    for start, goal in legs:
        path = planner.plan(start, goal, 0)
        planner.plan(start, goal, 0)  # computes the lower bounds, which later plans to the goal use
        for index in range(20, len(path) - 10, 20):
            at = path[index]
            off = random.normal(0, (0.05, 0.05, 0.02))
            costmap.observe(scan(map, at, random), Pose2D(at.x + off[0], at.y + off[1], at.yaw + off[2]))
            costmap.update(index, at)
            yield {
                "peer": partial(peer_route, costmap, at, goal),
                "own": partial(planner.plan, at, goal, 0),
            }


def updates(
    map: OccupancyMap, costmap: GlobalCostmap | LocalCostmap, rounds: int, random: np.random.Generator
) -> Iterator[Pair]:
    """Yield pairs that update the costmap while the robot drives forward."""
    for index in range(10 * rounds):
        at = Pose2D(0.02 * (index % 50), 0.0, 0.01 * (index % 50))
        yield {
            "peer": partial(peer_inflation, costmap.costs, costmap.resolution),
            "own": partial(observe_and_update, costmap, scan(map, at, random), at, index),
        }


def observe_and_update(
    costmap: GlobalCostmap | LocalCostmap, seen: LaserScan, at: Pose2D, stamp: int
) -> None:
    """Mark the obstacles of a scan, and update the costmap."""
    costmap.observe(seen, at)
    costmap.update(stamp, at)


def add_row(report: Report, name: str, pairs: Iterable[Pair], hertz: float) -> None:
    """Measure *pairs*, and add a row with the share of a core at *hertz* calls per second (Hz)."""
    measured = measure_rounds(pairs, warm_up=0)
    peer, own = measured.time("peer").median, measured.time("own").median  # ns
    figures = {
        "pairs": f"{len(measured.rounds['own'])}",
        "peer": f"{peer / NS_PER_MS:.2f} ms",
        "own": f"{own / NS_PER_MS:.2f} ms",
        "share of a core": f"{100 * own * hertz / NS_PER_S:.2f} % at {hertz:g} Hz",
    }
    report.add(f"{name}: own / peer", measured.ratio("own", "peer"), None, figures)


def main() -> None:
    """Run the benchmark."""
    parser = create_parser(__doc__ or "", pairs=15)
    parser.add_argument("--world", default="house")
    options = parser.parse_args()
    cv2.setNumThreads(1)  # processor time is the sum of all threads
    random = np.random.default_rng(0)
    description = load_world_description(options.world)
    map = rasterise(description)
    places = [Pose2D(x, y, 0.0) for x, y in (description.waypoints[f"wp{number}"] for number in (1, 2, 3))]
    legs = [(places[index], places[(index + 1) % 3]) for index in range(1 if options.quick else 3)]
    still = GlobalCostmap(map)
    question = f"The time for planning in {options.world}, {map.height} × {map.width} cells"
    report = Report("navigation_planning", question, options.pairs)
    add_row(report, "plan, first", first_plans(still, legs * options.pairs), 1.0)
    add_row(report, "plan, again", plans_again(map, legs, random), 1.0)
    add_row(report, "global costmap", updates(map, GlobalCostmap(map), options.pairs, random), 1.0)
    local = LocalCostmap(keepout=map.keepout)
    add_row(report, "local costmap", updates(map, local, options.pairs, random), 5.0)
    report.output(options.json)


if __name__ == "__main__":
    main()
