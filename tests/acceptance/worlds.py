"""Random offices and homes that the robot maps itself, and then patrols on its own map.

``python tests/acceptance/worlds.py`` prints a line for each world, and exits with 1 if the robot touches
anything, if more than one of 30 worlds is not completed, or if a failure has no message that explains it.
"""

import argparse
import json
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from cached_runs import RESULTS, Case, Result, run_process, run_seeds, sources

from btcore_sim.random_world_kinds import KINDS

EXPLORATION, PATROL = 900, 300
"""The longest exploration and the duration of the patrol (s)."""
LEAST_WAYPOINTS = 4
ALLOWED = 1 / 30
"""The share of worlds that may be incomplete."""


def names(count: int) -> list[str]:
    """Return the names of *count* worlds: offices and homes in turn, with the seeds from 1."""
    return [f"{KINDS[number % 2]}:{number // 2 + 1}" for number in range(count)]


def exploration_case(world: str, file: Path) -> Case:
    """Return the case of exploring *world*, and saving the map as *file*."""
    arguments = ("mapping", "--world", world, "--camera", "off", "--duration", str(EXPLORATION))
    return Case(f"mapping {safe_name(world)}", (*arguments, "--save-map", str(file)), no_misses)


def patrol_case(world: str, file: Path, duration: float) -> Case:
    """Return the case of patrolling *world* for *duration* (s) on the map in *file*."""
    arguments = ("patrolling", "--world", world, "--camera", "off", "--duration", f"{duration:g}")
    name = f"patrol {safe_name(world)} {duration:g}"
    return Case(name, (*arguments, "--until", "success", "--map", str(file)), no_misses)


def no_misses(result: Result) -> list[str]:
    """Return an empty list: `world_misses` judges all worlds together."""
    return []


def safe_name(world: str) -> str:
    """Return the name of *world* as a part of a file name."""
    return world.replace(":", "-")


def run(case: Case, seed: int) -> Result:
    """Run *case* with *seed*; the result also has the `warnings`, and exists if the tree fails."""
    done = run_process(case, seed)
    warnings = [line for line in done.stderr.splitlines() if line.startswith(("warning: ", "error: "))]
    try:
        result = json.loads(done.stdout.splitlines()[-1])
    except (IndexError, json.JSONDecodeError):
        return {"seed": seed, "error": f"exit code {done.returncode}: {done.stderr.strip()[-500:]}"}
    return {"seed": seed, "warnings": warnings, **result}


def attempt(world: str, duration: float) -> dict[str, Any]:
    """Map and patrol *world*, and return what happened.

    Returns:
        The `world`, the `collisions` and `grazes` of both runs, the duration of the mapping `mapping_s`, and
        the number of `waypoints`. `misses` says what is not complete; `causes` are the messages that explain
        it.
    """
    folder = RESULTS / f"worlds-{sources()}"
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{safe_name(world)}.yaml"
    found: dict[str, Any] = {"world": world, "collisions": 0, "grazes": 0, "waypoints": 0, "mapping_s": 0.0}
    misses: list[str] = []
    causes: list[str] = []
    found |= {"misses": misses, "causes": causes}
    (made,) = run_seeds(exploration_case(world, file), (1,), 1, run)
    count(found, made)
    if "error" in made:
        return found
    found["mapping_s"] = made["time_s"]
    if made["status"] != "SUCCESS":
        misses.append(f"mapping ended with {made['status']} after {made['time_s']:.0f} s")
        causes += explanations(made)
    if not file.exists():
        return found
    (patrol,) = run_seeds(patrol_case(world, file, duration), (1,), 1, run)
    count(found, patrol)
    if "error" in patrol:
        return found
    found["waypoints"] = len(patrol["robot"]["waypoints_visited"])
    least = LEAST_WAYPOINTS * duration / PATROL
    failed = patrol["robot"]["goals_failed"]
    if failed or patrol["status"] == "FAILURE" or found["waypoints"] < least:
        misses.append(f"the patrol was {patrol['status']} with {failed} failed goals")
        causes += explanations(patrol)
    return found


def count(found: dict[str, Any], result: Result) -> None:
    """Add the contacts of a run to *found*, and its error if it has one."""
    if "error" in result:
        found["misses"].append("a run ended with an error")
        found["causes"].append(result["error"])
        return
    found["collisions"] += result["robot"]["collisions"]
    found["grazes"] += result["robot"]["grazes"]


def explanations(result: Result) -> list[str]:
    """Return the causes of the failed goals of a run, or else its warnings."""
    goals = result["robot"].get("failed_goals", [])
    causes = [f"{goal['goal'] or (goal['x'], goal['y'])}: {goal['cause']}" for goal in goals if goal["cause"]]
    return causes or list(result["warnings"])


def row(found: dict[str, Any]) -> str:
    """Return the line of a world."""
    why = " | ".join([*found["misses"], *found["causes"]]) if found["misses"] else "complete"
    return (
        f"{found['world']:12} {found['collisions']:5} {found['grazes']:6} {found['mapping_s']:9.0f}"
        f" {found['waypoints']:9}  {why}"
    )


def world_misses(worlds: Sequence[dict[str, Any]]) -> list[str]:
    """Return a message for each requirement that is not met."""
    messages = [
        f"{found['world']}: {found['collisions']} collisions, {found['grazes']} grazes"
        for found in worlds
        if found["collisions"] or found["grazes"]
    ]
    incomplete = [found for found in worlds if found["misses"]]
    if len(incomplete) > ALLOWED * len(worlds):
        messages.append(f"{len(incomplete)} of {len(worlds)} worlds are not complete")
    messages += [f"{found['world']}: no message explains it" for found in incomplete if not found["causes"]]
    return messages


def main() -> int:
    """Run the worlds, print the table, and return 1 if there is a miss, otherwise 0."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--worlds", type=int, default=30, metavar="N", help="number of worlds (default: 30)")
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, help="worlds at a time (default: cores)"
    )
    parser.add_argument(
        "--duration", type=float, default=PATROL, help="seconds of each patrol (default: 300)"
    )
    parser.add_argument("--only", default="", metavar="TEXT", help="those with TEXT in their name")
    options = parser.parse_args()
    print(f"{'world':12} {'coll.':>5} {'grazes':>6} {'mapping s':>9} {'waypoints':>9}")
    worlds: list[dict[str, Any]] = []
    with ThreadPoolExecutor(options.jobs) as pool:
        pending = [
            pool.submit(attempt, world, options.duration)
            for world in names(options.worlds)
            if options.only in world
        ]
        for run in as_completed(pending):
            worlds.append(run.result())
            print(row(worlds[-1]), flush=True)
    messages = world_misses(worlds)
    for message in messages:
        print(f"miss: {message}")
    return 1 if messages else 0


if __name__ == "__main__":
    raise SystemExit(main())
