"""The patrol of both houses: alone, with the camera, among people, past dropped boxes, and carried away.

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

from cached_runs import Case, Result, failure_messages, results, safety_misses

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
    robot, found = result["robot"], safety_misses(result)
    visited = robot["waypoints_visited"]
    if len(visited) < least:
        found.append(f"only {len(visited)} waypoints")
    found += order_misses(visited, robot["recharges"])
    if not robot["recharges"]:
        found.append("no recharge")
    if robot["battery_min"] <= 3.0:
        found.append(f"the battery went down to {robot['battery_min']}")
    if robot["goals_failed"]:
        found.append(f"{robot['goals_failed']} goals failed")
    return found + localisation_misses(robot)


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
    found = []
    if error["median"] > 0.15 or error["max"] > 0.40 or turned > 0.15:
        found.append(f"localised within {error['median']} m (median), {error['max']} m, {turned} rad at most")
    if robot["odometry_error_m"] <= 1.0:
        found.append(f"odometry alone is only {robot['odometry_error_m']} m off")
    return found


def people_misses(result: Result) -> list[str]:
    """Return the misses of a patrol among people, which requires six waypoints and no collision."""
    robot = result["robot"]
    found = [f"{robot['collisions']} collisions"] if robot["collisions"] else []
    visited = len(robot["waypoints_visited"])
    return found + ([f"only {visited} waypoints"] if visited < 6 else [])


def box_misses(result: Result) -> list[str]:
    """Return the misses of a run in which a box drops and the robot reaches its waypoint."""
    robot, found = result["robot"], safety_misses(result)
    if not result.get("events"):
        found.append("no box dropped")
    if not robot["waypoints_visited"] or robot["goals_failed"]:
        found.append("it didn't come past")
    return found


def relocalisation_misses(result: Result) -> list[str]:
    """Return the misses of a robot that is carried away, stops and finds its pose again within 120 s."""
    robot, found = result["robot"], safety_misses(result)
    carried = robot.get("carried", [])
    if not carried:
        return [*found, "the robot was not carried away"]
    for one in carried:
        if one["found_s"] is None or one["found_s"] > 120.0:
            found.append(f"not found within 120 s: {one}")
        if one["astray_m"] > 0.5:
            found.append(f"drove {one['astray_m']} m on a wrong pose")
    return found


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


def row(group: Group, found: list[Result]) -> tuple[str, list[str]]:
    """Return a line of the table, and a message for each miss beyond the allowed number."""
    missed = failure_messages(group.case, found)
    whole = [one for one in found if "error" not in one]
    if not whole:
        return f"{group.case.name:18} {0:5}", missed
    failed = {text.split(":")[0] for text in missed}
    counted = missed if len(failed) > group.allowed else []
    robots = [one["robot"] for one in whole]
    factor = statistics.median(one["real_time_factor"] for one in whole)
    errors = [one["localization_error_m"] for one in robots if one["localization_error_m"]["max"] is not None]
    line = (
        f"{group.case.name:18} {len(whole) - len(failed):3}/{len(whole):<3}"
        f" {sum(one['collisions'] for one in robots):5} {sum(one['grazes'] for one in robots):6}"
        f" {min(len(one['waypoints_visited']) for one in robots):9}"
        f" {min(one['battery_min'] for one in robots):8.1f}"
        f" {max((one['median'] for one in errors), default=math.nan):8.3f}"
        f" {max((one['max'] for one in errors), default=math.nan):6.3f}"
        f" {min(one['odometry_error_m'] for one in robots):9.2f} {factor:11.1f}"
    )
    return line, counted


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
            line, more = row(group, results(group.case, group.seeds, options.jobs))
            print(line, flush=True)
            missed += more
    for one in missed:
        print(f"miss: {one}")
    return 1 if missed else 0


if __name__ == "__main__":
    raise SystemExit(main())
