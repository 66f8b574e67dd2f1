"""Bump-and-go over many seeds: no collision, over 10 m, every leaf ran, 15 times faster than real time.

``python tests/acceptance/bumpgo.py --seeds 200`` uses all cores, and goes on where it was interrupted:
results are lines of JSON in .accept/, in files named after a digest of the sources, so that no result
outlives what it was got with. It prints a table, and exits with 1 on any miss.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / ".accept"
DURATION = 120
LEAST_DISTANCE = 10.0
LEAST_FACTOR = 15.0


@cache
def sources() -> str:
    """A digest of everything that a run depends on."""
    digest = sha256()
    for room in ("btcore", "robot_nodes", "sim", "trees"):
        for path in sorted((ROOT / room).rglob("*")):
            if path.suffix in {".py", ".json", ".urdf", ".xml"}:
                digest.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:12]


@dataclass(frozen=True)
class Case:
    """A tree in a world, and whether grazes are misses too."""

    tree: str
    world: str
    grazes: bool

    @property
    def file(self) -> Path:
        """Where its results are kept."""
        return RESULTS / f"{self.tree}-{self.world}-{sources()}.jsonl"


CASES = (Case("bumpgo", "arena", False), Case("bumpgo_wide", "arena_boxes", True))


def run(case: Case, seed: int) -> dict[str, Any]:
    """One run by the command line, in a process of its own, with its seed."""
    command = [sys.executable, "-m", "btcore", "run", case.tree, "--fast", "--json"]
    command += ["--duration", str(DURATION), "--world", case.world, "--seed", str(seed)]
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, env={**os.environ, "PYTHONPATH": path}
    )
    if done.returncode != 0:
        return {"seed": seed, "error": f"exit code {done.returncode}: {done.stderr.strip()[-500:]}"}
    return {"seed": seed, **json.loads(done.stdout.splitlines()[-1])}


def misses(case: Case, result: dict[str, Any]) -> list[str]:
    """What one run fell short of."""
    if "error" in result:
        return [result["error"]]
    robot, found = result["robot"], []
    if robot["collisions"]:
        found.append(f"{robot['collisions']} collisions")
    if case.grazes and robot["grazes"]:
        found.append(f"{robot['grazes']} grazes")
    if robot["distance_m"] <= LEAST_DISTANCE:
        found.append(f"only {robot['distance_m']} m")
    found += [f"{path} never ran" for path, node in result["nodes"].items() if node["ticks"] == 0]
    return found


def known(case: Case) -> dict[int, dict[str, Any]]:
    """The results there are, by seed; a line that an interruption cut is dropped."""
    found: dict[int, dict[str, Any]] = {}
    if case.file.exists():
        for line in case.file.read_text(encoding="utf-8").splitlines():
            try:
                result = json.loads(line)
            except json.JSONDecodeError:
                continue
            if "error" not in result:
                found[result["seed"]] = result
    return found


def results(case: Case, seeds: range, workers: int) -> Iterator[dict[str, Any]]:
    """The results of *seeds*: those that are known, then the others as they come."""
    before = known(case)
    yield from (before[seed] for seed in seeds if seed in before)
    case.file.parent.mkdir(exist_ok=True)
    with case.file.open("a", encoding="utf-8") as file, ThreadPoolExecutor(workers) as pool:
        pending = [pool.submit(run, case, seed) for seed in seeds if seed not in before]
        for one in as_completed(pending):
            result = one.result()
            file.write(json.dumps(result) + "\n")
            file.flush()
            yield result


def row(case: Case, found: list[dict[str, Any]]) -> tuple[str, list[str]]:
    """A line of the table, and a sentence for each miss."""
    name = f"{case.tree} in {case.world}"
    complaints = [f"{name}, seed {one['seed']}: {miss}" for one in found for miss in misses(case, one)]
    whole = [one for one in found if "error" not in one]
    if not whole:
        return f"{case.tree:12} {case.world:12} {0:5}", complaints
    robots = [one["robot"] for one in whole]
    factor = statistics.median(one["real_time_factor"] for one in whole)
    if factor < LEAST_FACTOR:
        complaints.append(f"{name}: {factor:.1f} times real time in the median, and not {LEAST_FACTOR:g}")
    collisions, grazes = (sum(one[kind] for one in robots) for kind in ("collisions", "grazes"))
    least = min(one["distance_m"] for one in robots)
    line = (
        f"{case.tree:12} {case.world:12} {len(whole):5} {collisions:5} {grazes:6} {least:8.2f} {factor:10.1f}"
    )
    return line, complaints


def main() -> int:
    """Run, print the table, and tell by the exit code whether all is well."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=200, help="how many (default: %(default)s)")
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, help="runs at a time (default: cores)"
    )
    options = parser.parse_args()
    print(
        f"{'tree':12} {'world':12} {'seeds':>5} {'coll.':>5} {'grazes':>6} {'least m':>8} {'real time ×':>10}"
    )
    complaints: list[str] = []
    for case in CASES:
        found = sorted(results(case, range(options.seeds), options.jobs), key=lambda one: one["seed"])
        line, missed = row(case, found)
        print(line, flush=True)
        complaints += missed
    for complaint in complaints:
        print(f"miss: {complaint}")
    return 1 if complaints else 0


if __name__ == "__main__":
    raise SystemExit(main())
