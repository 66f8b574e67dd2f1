"""Maps by exploration: explore both houses, compare the maps with the true maps, and patrol on them.

``python tests/acceptance/mapping.py`` prints a table, and exits with 1 on any miss.
"""

import argparse
import os
from pathlib import Path

import numpy as np
from cached_runs import RESULTS, Case, Result, failure_messages, run, sources
from numpy.typing import NDArray

from btcore_navigation.likelihood import obstacle_distances
from btcore_robot.occupancy_map import OccupancyMap, load_map
from btcore_sim.map_rasteriser import rasterise
from btcore_sim.worlds import load_world_description

HOUSES = ("house", "aws_house")
NEAR = 2
"""The largest allowed distance of a wall from its true place (cells)."""
LEAST_RIGHT, LEAST_FOUND = 0.95, 0.90
"""The least share of the map's walls that are true, and of the true visible walls that the map has."""


def distances_to_occupied(
    first: OccupancyMap, cells: NDArray[np.bool_], second: OccupancyMap
) -> NDArray[np.float64]:
    """Return the distance (m) of each of *cells* of *first* from the nearest occupied cell of *second*."""
    places = first.centers(*np.nonzero(cells))
    found = second.indices(places)
    on = (found >= 0).all(axis=1) & (found < second.cells.shape).all(axis=1)
    distance = np.full(len(places), np.inf)
    distance[on] = obstacle_distances(second)[found[on, 0], found[on, 1]]
    return distance


def visible_walls(map: OccupancyMap) -> NDArray[np.bool_]:
    """Return the occupied cells next to free floor, which a laser could see."""
    free = np.pad(map.free, 1)
    height, width = map.cells.shape
    beside = np.zeros(map.cells.shape, dtype=np.bool_)
    for row in (0, 1, 2):
        for col in (0, 1, 2):
            beside |= free[row : row + height, col : col + width]
    return map.occupied & beside


def exploration_case(house: str, file: Path) -> Case:
    """Return the case of exploring *house* and saving the map as *file*."""
    true = rasterise(load_world_description(house))

    def misses(result: Result) -> list[str]:
        robot = result["robot"]
        found = [f"{robot[kind]} {kind}" for kind in ("collisions", "grazes") if robot[kind]]
        if result["status"] != "SUCCESS":
            found.append(f"it ended with {result['status']}")
        map = load_map(file)
        limit = NEAR * true.resolution + 1e-3
        result["right"] = float(np.mean(distances_to_occupied(map, map.occupied, true) <= limit))
        result["found"] = float(np.mean(distances_to_occupied(true, visible_walls(true), map) <= limit))
        if result["right"] < LEAST_RIGHT:
            found.append(f"only {result['right']:.3f} of what is occupied is a wall")
        if result["found"] < LEAST_FOUND:
            found.append(f"only {result['found']:.3f} of the walls were found")
        return found

    arguments = (
        "mapping",
        "--world",
        house,
        "--camera",
        "off",
        "--duration",
        "1500",
        "--save-map",
        str(file),
    )
    return Case(f"mapping {house}", arguments, misses)


def patrol_case(house: str, file: Path) -> Case:
    """Return the case of patrolling *house* on the map in *file*."""

    def misses(result: Result) -> list[str]:
        robot = result["robot"]
        found = [f"{robot[kind]} {kind}" for kind in ("collisions", "grazes", "goals_failed") if robot[kind]]
        if len(robot["waypoints_visited"]) < 4:
            found.append(f"only {len(robot['waypoints_visited'])} waypoints")
        error = robot["localization_error_m"]
        if error["median"] > 0.15 or error["max"] > 0.40:
            found.append(f"localised within {error['median']} m (median), {error['max']} m at most")
        return found

    arguments = ("patrolling", "--world", house, "--camera", "off", "--map", str(file))
    return Case(f"on-map {house}", (*arguments, "--until", "success", "--duration", "300"), misses)


def main() -> int:
    """Run the cases, print the table, and return 1 if there is a miss, otherwise 0."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=5, help="explorations a house (default: %(default)s)")
    parser.add_argument("--only", default="", metavar="TEXT", help="the houses with TEXT in their name")
    options = parser.parse_args()
    print(
        f"{'house':12} {'seed':>4} {'time s':>7} {'way m':>6} {'right':>6} {'found':>6} {'off m':>6}"
        f" {'odom. m':>7} {'real time ×':>11} {'patrol off m':>12}"
    )
    missed: list[str] = []
    folder = RESULTS / f"maps-{sources()}"
    folder.mkdir(parents=True, exist_ok=True)
    for house in HOUSES:
        for seed in range(1, options.seeds + 1) if options.only in house else ():
            file = folder / f"{house}-{seed}.yaml"
            exploring, patrolling = exploration_case(house, file), patrol_case(house, file)
            row = run(exploring, seed)
            missed += failure_messages(exploring, [row])
            if "error" in row:
                continue
            patrol_row = run(patrolling, seed)
            missed += failure_messages(patrolling, [patrol_row])
            robot = row["robot"]
            errors = patrol_row.get("robot", {}).get("localization_error_m")
            patrol = f"{errors['median']:12.3f}" if errors else ""
            print(
                f"{house:12} {seed:4} {row['time_s']:7.0f} {robot['distance_m']:6.1f} {row['right']:6.3f}"
                f" {row['found']:6.3f} {robot['localization_error_m']['max']:6.3f}"
                f" {robot['odometry_error_m']:7.2f} {row['real_time_factor']:11.1f} {patrol}",
                flush=True,
            )
    for miss in missed:
        print(f"miss: {miss}")
    return 1 if missed else 0


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    raise SystemExit(main())
