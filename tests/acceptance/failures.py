"""Runs in which something fails: the robot stops or gives up, says why, and touches nothing.

``python tests/acceptance/failures.py`` runs each scenario with several seeds, prints a table, and exits with
1 on any miss; ``--sample`` runs each scenario that takes less than a minute of the robot's time with one
seed. The worlds are the house and the lobby, with crates that the map does not have.
"""

import argparse
import json
import os
import re
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib.resources import files
from pathlib import Path

from cached_runs import Case, Execution, Result, failure_messages, run, run_seeds, safety_misses
from patrolling import relocalisation_misses

PATROL = ("patrolling", "--camera", "off", "--until", "success")
SKIPPING = ("patrolling_skipping", "--camera", "off", "--until", "success")
OUTAGE = 25
"""The time (s) at which a sensor fails."""

STOPPED = {"odometry": 0.12, "laser": 0.2}
"""The greatest distance (m) driven during an outage: 0.3 s (laser: 0.5 s) at 0.3 m/s, and braking."""

CRATES = {
    "crate_on_recharge": [(3.67, -0.24, 0.8, 0.8)],
    "two_closed_doors": [(-2.7, -10.35, 0.3, 2.1), (1.83, -7.4, 1.5, 0.3)],
}
"""The crates of a world by its name: x, y (m) and the lengths (m) along x and y."""


@dataclass(frozen=True)
class Scenario:
    """A *case*, its *seeds*, the *figure* for the table, and how it is run."""

    case: Case
    figure: Callable[[Result], str]
    seeds: Sequence[int]
    execute: Execution = run
    short: bool = True


def run_outage(case: Case, seed: int) -> Result:
    """Run *case* until its end, and until the outage; `driven_m` is the distance (m) between both."""
    late = run(case, seed)
    arguments = list(case.arguments)
    arguments[arguments.index("--duration") + 1] = str(OUTAGE)
    del arguments[arguments.index("--fault") :]
    before = run(replace(case, arguments=tuple(arguments)), seed)
    if "error" in late or "error" in before:
        return late if "error" in late else before
    driven = late["robot"]["distance_m"] - before["robot"]["distance_m"]
    return {**late, "driven_m": round(driven, 4)}


def outage_misses(result: Result, sensor: str) -> list[str]:
    """Return the misses of a robot that has to stand during the outage of *sensor*."""
    driven = result["driven_m"]
    return safety_misses(result) + (
        [f"drove {driven} m during the outage"] if driven > STOPPED[sensor] else []
    )


def failed_goal_misses(result: Result, goal: str, cause: str, within: float) -> list[str]:
    """Return the misses of a run in which a goal has to fail.

    Args:
        result: The result of the run.
        goal: The name of the goal.
        cause: A pattern of the cause of the failure.
        within: The time of the run (s) by which the goal has to fail.
    """
    found = safety_misses(result)
    failed = [failure for failure in result["robot"]["failed_goals"] if failure["goal"] == goal]
    if not failed:
        return [*found, f"the goal {goal} did not fail"]
    if failed[0]["time_s"] > within:
        found.append(f"{goal} failed as late as {failed[0]['time_s']} s")
    if not re.search(cause, failed[0]["cause"]):
        found.append(f"the cause is: {failed[0]['cause']}")
    return found


def closed_door_misses(result: Result, within: float) -> list[str]:
    """Return the misses of a robot that gives up wp1 *within* a time (s), and visits wp2 and wp3."""
    blocked = failed_goal_misses(result, "wp1", "blocked at", within)
    return blocked + waypoint_misses(result, "wp2", "wp3")


def first_cause(result: Result) -> str:
    """Return the time and the cause of the first failed goal."""
    failed = result["robot"]["failed_goals"]
    if not failed:
        return "no goal failed"
    return f"{failed[0]['time_s']:.0f} s: {failed[0]['cause']}"


def waypoint_misses(result: Result, *names: str) -> list[str]:
    """Return a miss if the robot has not visited all waypoints *names*."""
    found = set(names) - set(result["robot"]["waypoints_visited"])
    return [f"did not visit {', '.join(sorted(found))}"] if found else []


def moved_robot_misses(result: Result) -> list[str]:
    """Return the misses of a robot that is moved at 30 s, and has to find its pose again."""
    moved = [kidnapping["t"] for kidnapping in result["robot"].get("kidnappings", [])]
    return relocalisation_misses(result) + (
        [f"moved at {moved} s, and not at 30 s"] if moved != [30.0] else []
    )


def time_to_find(result: Result) -> str:
    """Return the time until the robot found its pose again."""
    kidnappings = result["robot"].get("kidnappings", [])
    return f"found after {kidnappings[0]['found_s']} s" if kidnappings else "not moved"


def unknown_start_misses(result: Result) -> list[str]:
    """Return the misses of a robot that has to find its pose, and must not drive on a wrong pose."""
    error = result["robot"]["localization_error_m"]["max"]
    found = [*safety_misses(result), *waypoint_misses(result, "wp1")]
    return found if error is not None and error <= 0.4 else [*found, f"localised within {error} m"]


def error_of_pose(result: Result) -> str:
    """Return the greatest error of the pose."""
    return f"pose within {result['robot']['localization_error_m']['max']} m"


def create_scenarios(folder: Path, seeds: Sequence[int]) -> list[Scenario]:
    """Return all scenarios; their worlds are written to *folder*."""
    house = ("--world", "house")

    def crates(name: str) -> tuple[str, str]:
        return "--world", str(write_world(folder, name))

    def sensor(name: str, seeds: Sequence[int]) -> Scenario:
        fault = (*PATROL, *house, "--duration", "55", "--fault", f"{name}:{OUTAGE}-55")
        return Scenario(
            Case(f"{name} fails", fault, partial(outage_misses, sensor=name)),
            lambda result: f"{result['driven_m']:.3f} m driven in 30 s",
            seeds,
            run_outage,
        )

    def moved(name: str, *options: str) -> Scenario:
        arguments = (*PATROL, *house, "--duration", "180", *options)
        return Scenario(Case(name, arguments, moved_robot_misses), time_to_find, seeds, short=False)

    recharge = Case(
        "crate on recharge",
        (*PATROL, *crates("crate_on_recharge"), "--duration", "240", "--battery", "18"),
        # Rays along a side of the crate clear it: then the robot circles it until the battery is empty.
        partial(
            failed_goal_misses,
            goal="recharge",
            cause="recharge.*(blocked at|is not on the map)|the battery is empty",
            within=240.0,
        ),
    )
    doors = Case(
        "two closed doors",
        (*SKIPPING, *crates("two_closed_doors"), "--duration", "420"),
        partial(closed_door_misses, within=300.0),
    )
    lobby = ("--world", "lobby", "--duration", "240")
    door = Case(
        "a door closes",
        (*SKIPPING, *lobby, "--event", "door:office_door:close@5"),
        partial(closed_door_misses, within=240.0),
    )
    unknown = (*PATROL, *house, "--duration", "240", "--start", "unknown")
    return [
        sensor("odometry", (*seeds, 320)),
        sensor("laser", seeds),
        Scenario(recharge, first_cause, seeds, short=False),
        Scenario(doors, first_cause, seeds, short=False),
        Scenario(door, first_cause, seeds, short=False),
        moved("kidnap", "--event", "kidnap:30"),
        moved("kidnap while blind", "--event", "kidnap:30", "--fault", "laser:25-40"),
        moved("carried", "--event", "carry:30"),
        Scenario(Case("start unknown", unknown, unknown_start_misses), error_of_pose, seeds, short=False),
    ]


def write_world(folder: Path, name: str) -> Path:
    """Write the house with crates that are too heavy to be pushed, and that are not on the map."""
    world_files = files("btcore_sim") / "world_files"
    world = json.loads((world_files / "house.json").read_text(encoding="utf-8"))
    world.pop("$schema", None)
    for number, (x, y, length, width) in enumerate(CRATES[name]):
        crate = {"name": f"crate_{number}", "kind": "box", "position": [x, y], "size": [length, width, 0.9]}
        world["objects"].append({**crate, "mass": 500.0})
    path = folder / f"{name}.json"
    path.write_text(json.dumps(world), encoding="utf-8")
    return path


def main() -> int:
    """Run the scenarios, print the table, and return 1 if there is a miss, otherwise 0."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=5, help="seeds of a scenario (default: %(default)s)")
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, help="runs at a time (default: cores)"
    )
    parser.add_argument("--sample", action="store_true", help="the short scenarios with one seed")
    parser.add_argument("--only", default="", metavar="TEXT", help="the scenarios with TEXT in their name")
    options = parser.parse_args()
    seeds = (1,) if options.sample else range(1, options.seeds + 1)
    missed: list[str] = []
    print(f"{'scenario':20} {'good':>5} {'coll.':>5} {'grazes':>6}  figure with the first seed")
    with tempfile.TemporaryDirectory() as folder:
        for scenario in create_scenarios(Path(folder), seeds):
            case = scenario.case
            if options.only not in case.name or (options.sample and not scenario.short):
                continue
            found = run_seeds(case, scenario.seeds, options.jobs, scenario.execute)
            misses = failure_messages(case, found)
            whole = [run for run in found if "error" not in run]
            bad = {text.split(":")[0] for text in misses}
            contacts = [sum(run["robot"][kind] for run in whole) for kind in ("collisions", "grazes")]
            figure = scenario.figure(whole[0]) if whole else "no run ended"
            good = f"{len(found) - len(bad)}/{len(found)}"
            print(f"{case.name:20} {good:>5} {contacts[0]:5} {contacts[1]:6}  {figure}", flush=True)
            missed += misses
    for miss in missed:
        print(f"miss: {miss}")
    return 1 if missed else 0


if __name__ == "__main__":
    raise SystemExit(main())
