"""Bump-and-go over many seeds: no collision, over 10 m, every leaf ran.

``python tests/acceptance/bumpgo.py --seeds 200`` prints a table, and exits with 1 on any miss.
"""

import argparse
import os
import statistics

from cached_runs import Case, Result, failure_messages, run_seeds

DURATION = 120
LEAST_DISTANCE = 10.0


def bumpgo(tree: str, world: str, *, grazes: bool) -> Case:
    """Return the case of *tree* in *world*; with *grazes*, a graze is a miss, too."""

    def misses(result: Result) -> list[str]:
        robot, found = result["robot"], []
        if robot["collisions"]:
            found.append(f"{robot['collisions']} collisions")
        if grazes and robot["grazes"]:
            found.append(f"{robot['grazes']} grazes")
        if robot["distance_m"] <= LEAST_DISTANCE:
            found.append(f"only {robot['distance_m']} m")
        found += [f"{path} never ran" for path, node in result["nodes"].items() if node["ticks"] == 0]
        return found

    return Case(f"{tree} {world}", (tree, "--world", world, "--duration", str(DURATION)), misses)


CASES = (bumpgo("bumpgo", "arena", grazes=False), bumpgo("bumpgo_wide", "arena_boxes", grazes=True))


def row(case: Case, found: list[Result]) -> tuple[str, list[str]]:
    """Return a line of the table, and a message for each miss."""
    missed = failure_messages(case, found)
    whole = [run for run in found if "error" not in run]
    if not whole:
        return f"{case.name:24} {0:5}", missed
    robots = [run["robot"] for run in whole]
    factor = statistics.median(run["real_time_factor"] for run in whole)
    collisions, grazes = (sum(robot[kind] for robot in robots) for kind in ("collisions", "grazes"))
    least = min(robot["distance_m"] for robot in robots)
    line = f"{case.name:24} {len(whole):5} {collisions:5} {grazes:6} {least:8.2f} {factor:10.1f}"
    return line, missed


def main() -> int:
    """Run the cases, print the table, and return 1 if there is a miss, otherwise 0."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=200, help="how many (default: %(default)s)")
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, help="runs at a time (default: cores)"
    )
    options = parser.parse_args()
    print(f"{'tree and world':24} {'seeds':>5} {'coll.':>5} {'grazes':>6} {'least m':>8} {'real time ×':>10}")
    missed: list[str] = []
    for case in CASES:
        line, more = row(case, run_seeds(case, range(options.seeds), options.jobs))
        print(line, flush=True)
        missed += more
    for miss in missed:
        print(f"miss: {miss}")
    return 1 if missed else 0


if __name__ == "__main__":
    raise SystemExit(main())
