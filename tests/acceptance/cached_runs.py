"""Runs of the command line over many seeds, on all cores; an interrupted series can be resumed.

Results are lines of JSON in .accept/. The files are named after a digest of the sources: a change of the
sources invalidates the results.
"""

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from checkout import ROOT, environment

from btcore_recorder.verification import verify

RESULTS = ROOT / ".accept"

Result = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """``btcore run`` with *arguments*; *misses* returns the requirements that a result does not meet."""

    name: str
    arguments: tuple[str, ...]
    misses: Callable[[Result], list[str]]

    @property
    def file(self) -> Path:
        """The file of its results."""
        return RESULTS / f"{self.name.replace(' ', '-')}-{sources()}.jsonl"


@cache
def sources() -> str:
    """Return a digest of all files that a run depends on."""
    digest = sha256()
    for folder in ("btcore", "robot_nodes", "ros2", "sim", "tools/btcore_recorder", "trees"):
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in {".py", ".json", ".urdf", ".xml", ".yaml"}:
                digest.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:12]


def run_process(case: Case, seed: int, *options: str) -> subprocess.CompletedProcess[str]:
    """Run *case* with *seed* and further *options* by the command line, in a separate process."""
    command = [sys.executable, "-m", "btcore", "run", *case.arguments, *options]
    command += ["--fast", "--json", "--seed", str(seed)]
    # Several runs share the cores already: more threads in a run would only wait for each other.
    single_threaded = environment(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
    return subprocess.run(command, capture_output=True, text=True, check=False, env=single_threaded)


def run(case: Case, seed: int) -> Result:
    """Run *case* with *seed*, and return its result. The run is recorded and run again; see `replay`."""
    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder) / "run.btrec.txt"
        done = run_process(case, seed, "--record", str(recording))
        if done.returncode != 0:
            return {"seed": seed, "error": f"exit code {done.returncode}: {done.stderr.strip()[-500:]}"}
        return {"seed": seed, **json.loads(done.stdout.splitlines()[-1]), "replay": replay(recording)}


def replay(recording: Path) -> Result:
    """Run a recording again, without simulator and ROS, and return whether it does the same."""
    return verify(recording).as_data()


Execution = Callable[[Case, int], Result]
"""A function that runs a case with a seed, such as `run`."""


def saved_results(case: Case) -> dict[int, Result]:
    """Return the saved results, by seed; a line that an interruption cut off is ignored."""
    found: dict[int, Result] = {}
    if case.file.exists():
        for line in case.file.read_text(encoding="utf-8").splitlines():
            try:
                result = json.loads(line)
            except json.JSONDecodeError:
                continue
            if "error" not in result:
                found[result["seed"]] = result
    return found


def run_seeds(case: Case, seeds: Sequence[int], workers: int, execute: Execution = run) -> list[Result]:
    """Return the results of *seeds*, in their order; missing results are computed, *workers* at a time.

    Args:
        case: The case.
        seeds: The seeds.
        workers: The number of runs at a time.
        execute: Runs the case with a seed.
    """
    return sorted(_run_seeds(case, seeds, workers, execute), key=lambda result: int(result["seed"]))


def _run_seeds(case: Case, seeds: Sequence[int], workers: int, execute: Execution) -> Iterator[Result]:
    before = saved_results(case)
    yield from (before[seed] for seed in seeds if seed in before)
    case.file.parent.mkdir(exist_ok=True)
    with case.file.open("a", encoding="utf-8") as file, ThreadPoolExecutor(workers) as pool:
        pending = [pool.submit(execute, case, seed) for seed in seeds if seed not in before]
        for run in as_completed(pending):
            result = run.result()
            file.write(json.dumps(result) + "\n")
            file.flush()
            yield result


def safety_misses(result: Result) -> list[str]:
    """Return the numbers of collisions and grazes that are not 0."""
    robot = result["robot"]
    return [f"{robot[kind]} {kind}" for kind in ("collisions", "grazes") if robot[kind]]


def replay_misses(result: Result) -> list[str]:
    """Return a message if the recording of a run was not run again in the same way."""
    replayed = result["replay"]
    is_same = replayed["equal"] and replayed["ticks"] == result["ticks"]
    return [] if is_same else [f"the recording was not run again: {replayed}"]


def failure_messages(case: Case, found: Sequence[Result]) -> list[str]:
    """Return a message for each miss."""
    return [
        f"{case.name}, seed {run['seed']}: {miss}"
        for run in found
        for miss in ([run["error"]] if "error" in run else [*case.misses(run), *replay_misses(run)])
    ]
