"""The patrol of both houses: alone, with the camera, among people, past dropped boxes, and kidnapped.

``python tests/acceptance/patrolling.py`` makes all runs, and exits with 1 on any miss; ``--sample`` makes one
patrol of 300 s a house, from a battery of 25.
"""

import argparse
import math
import os
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

from cached_runs import Case, Result, failure_messages, run_seeds, safety_misses

HOUSES = ("house", "aws_house")
ROUND = ("wp1", "wp2", "wp3")
PATROL = ("patrolling", "--until", "success", "--duration")


@dataclass(frozen=True)
class Group:
    """A *case* with its *seeds*, of which *allowed* may miss."""

    case: Case
    seeds: Sequence[int]
    allowed: int = 0


def patrol_misses(result: Result, least: int) -> list[str]:
    """Return the misses of a patrol that requires *least* waypoints in their order, and a recharge."""
    robot, misses = result["robot"], safety_misses(result)
    visited = robot["waypoints_visited"]
    if len(visited) < least:
        misses.append(f"only {len(visited)} waypoints")
    misses += order_misses(visited, robot["recharges"])
    if not robot["recharges"]:
        misses.append("no recharge")
    if robot["battery_min"] <= 3.0:
        misses.append(f"the battery went down to {robot['battery_min']}")
    if robot["goals_failed"]:
        misses.append(f"{robot['goals_failed']} goals failed")
    return misses + localisation_misses(robot)


def order_misses(visited: Sequence[str], recharges: int) -> list[str]:
    """Return a miss if waypoints are left out; each way to the charger may leave out a waypoint."""
    left_out = sum(
        (ROUND.index(later) - ROUND.index(earlier) - 1) % len(ROUND) for earlier, later in pairwise(visited)
    )
    # A waypoint that the low battery interrupts on the way is skipped: one for each way to the charger.
    return [f"{left_out} waypoints left out, with {recharges} recharges"] if left_out > recharges + 1 else []


def localisation_misses(robot: Result) -> list[str]:
    """Return what is wrong with the accuracy of the localisation."""
    error, turned = robot["localization_error_m"], robot["localization_yaw_error_rad"]["max"]
    misses = []
    if error["median"] > 0.15 or error["max"] > 0.40 or turned > 0.15:
        misses.append(f"localised within {error['median']} m (median), {error['max']} m, {turned} rad")
    if robot["odometry_error_m"] <= 1.0:
        misses.append(f"odometry alone is only {robot['odometry_error_m']} m off")
    return misses


def people_misses(result: Result) -> list[str]:
    """Return the misses of a patrol among people, which requires six waypoints and no collision."""
    robot = result["robot"]
    misses = [f"{robot['collisions']} collisions"] if robot["collisions"] else []
    visited = len(robot["waypoints_visited"])
    return misses + ([f"only {visited} waypoints"] if visited < 6 else [])


def box_misses(result: Result) -> list[str]:
    """Return the misses of a run in which a box drops and the robot reaches its waypoint."""
    robot, misses = result["robot"], safety_misses(result)
    if not result.get("events"):
        misses.append("no box dropped")
    if not robot["waypoints_visited"] or robot["goals_failed"]:
        misses.append("the robot reached no waypoint, or a goal failed")
    return misses


def relocalisation_misses(result: Result) -> list[str]:
    """Return the misses of a robot that is kidnapped, stops and finds its pose again within 120 s."""
    robot, misses = result["robot"], safety_misses(result)
    kidnappings = robot.get("kidnappings", [])
    if not kidnappings:
        return [*misses, "the robot was not kidnapped"]
    for removal in kidnappings:
        if removal["found_s"] is None or removal["found_s"] > 120.0:
            misses.append(f"not found within 120 s: {removal}")
        if removal["astray_m"] > 0.5:
            misses.append(f"drove {removal['astray_m']} m on a wrong pose")
    return misses


def all_groups(seeds: int) -> list[Group]:
    """Return all runs; *seeds* patrols of 600 s in each house, and half as many runs of each other kind."""
    few = range(1, math.ceil(seeds / 2) + 1)
    groups = []
    for house in HOUSES:
        world = ("--world", house)
        off = (*world, "--camera", "off")
        patrol = Case(
            f"patrol {house}", (*PATROL, "600", *off, "--battery", "50"), partial(patrol_misses, least=6)
        )
        camera = Case(f"camera {house}", (*PATROL, "120", *world), safety_misses)
        people = Case(f"people {house}", (*PATROL, "900", *off, "--people", "3"), people_misses)
        box = Case(f"box {house}", (*PATROL, "150", *off, "--event", "box:10-120"), box_misses)
        kidnap = Case(
            f"kidnap {house}", (*PATROL, "180", *off, "--event", "kidnap:30-60"), relocalisation_misses
        )
        groups += [
            Group(patrol, range(1, seeds + 1)),
            Group(camera, few[:3]),
            Group(people, few),
            Group(box, few),
            Group(kidnap, few, allowed=len(few) // 10),
        ]
    return groups


def sample() -> list[Group]:
    """Return the runs of the continuous integration."""
    return [
        Group(
            Case(
                f"sample {house}",
                (*PATROL, "300", "--world", house, "--camera", "off", "--battery", "25"),
                partial(patrol_misses, least=3),
            ),
            (1,),
        )
        for house in HOUSES
    ]


def row(group: Group, group_results: list[Result]) -> tuple[str, list[str]]:
    """Return a line of the table, and a message for each miss beyond the allowed number."""
    misses = failure_messages(group.case, group_results)
    completed = [result for result in group_results if "error" not in result]
    if not completed:
        return f"{group.case.name:18} {0:5}", misses
    failed_runs = {text.split(":")[0] for text in misses}
    good = sum(not group.case.misses(result) for result in completed)
    reported_misses = misses if len(failed_runs) > group.allowed else []
    robots = [result["robot"] for result in completed]
    factor = statistics.median(result["real_time_factor"] for result in completed)
    errors = [robot["localization_error_m"] for robot in robots]
    errors = [error for error in errors if error["max"] is not None]
    line = (
        f"{group.case.name:18} {good:3}/{len(group_results):<3}"
        f" {sum(robot['collisions'] for robot in robots):5} {sum(robot['grazes'] for robot in robots):6}"
        f" {min(len(robot['waypoints_visited']) for robot in robots):9}"
        f" {min(robot['battery_min'] for robot in robots):8.1f}"
        f" {max((error['median'] for error in errors), default=math.nan):8.3f}"
        f" {max((error['max'] for error in errors), default=math.nan):6.3f}"
        f" {min(robot['odometry_error_m'] for robot in robots):9.2f} {factor:11.1f}"
    )
    return line, reported_misses


def main() -> int:
    """Run the cases, print the table, and return 1 if there is a miss, otherwise 0."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=10, help="patrols a house (default: %(default)s)")
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, help="runs at a time (default: cores)"
    )
    parser.add_argument("--sample", action="store_true", help="one short patrol a house, and nothing else")
    parser.add_argument("--only", default="", metavar="TEXT", help="the runs with TEXT in their name")
    options = parser.parse_args()
    print(
        f"{'run':18} {'good':>7} {'coll.':>5} {'grazes':>6} {'waypoints':>9} {'battery':>8}"
        f" {'median m':>8} {'max m':>6} {'odom. m':>9} {'real time ×':>11}"
    )
    missed: list[str] = []
    for group in sample() if options.sample else all_groups(options.seeds):
        if options.only in group.case.name:
            line, more = row(group, run_seeds(group.case, group.seeds, options.jobs))
            print(line, flush=True)
            missed += more
    for miss in missed:
        print(f"miss: {miss}")
    return 1 if missed else 0


if __name__ == "__main__":
    raise SystemExit(main())
