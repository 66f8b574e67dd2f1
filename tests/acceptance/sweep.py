"""A sweep of bump-and-go: no episode lost though a worker is killed, the cores busy, the same table twice.

``python tests/acceptance/sweep.py --episodes 1000`` prints what it found, and exits with 1 on any miss. The
share of the cores is judged from 500 episodes on. It includes the start of the workers, but not the time that
other processes took.
"""

import argparse
import csv
import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import psutil
from checkout import environment

DURATION = 20
LEAST_SHARE = 0.85
JUDGED_FROM = 500
TWICE = 100


class Swept(NamedTuple):
    """The output of ``--json``, the time it took (s), and the *share* of the cores that the sweep used.

    *left* is its share of the processor time that other processes left.
    """

    summary: dict[str, Any]
    wall: float
    share: float
    left: float


def sweep(seeds: str, folder: Path, jobs: int, *, kill: bool) -> Swept:
    """Sweep over *seeds*; with *kill* a worker is killed when a third is done."""
    command = [sys.executable, "-m", "btcore", "sweep", "bumpgo", "--seeds", seeds]
    command += ["--duration", str(DURATION), "--workers", str(jobs), "--output", str(folder), "--json"]
    system = psutil.cpu_times()
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    with subprocess.Popen(command, env=environment(), stdout=subprocess.PIPE, text=True) as process:
        if kill:
            kill_a_worker(process, folder, int(seeds) // 3)
        out, _ = process.communicate()
    wall, after = time.monotonic() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    busy = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    now = psutil.cpu_times()
    idle = now.idle + now.iowait - system.idle - system.iowait
    return Swept(json.loads(out.splitlines()[-1]), wall, busy / wall / jobs, busy / (busy + max(idle, 0.0)))


def kill_a_worker(process: "subprocess.Popen[str]", folder: Path, when: int) -> None:
    """Kill one of the workers of the sweep *process* when *when* episodes are done."""
    journal = folder / "journal.jsonl"
    while not journal.exists() or journal.read_bytes().count(b"\n") < when:
        if process.poll() is not None:
            return
        time.sleep(0.2)
    os.kill(workers(process)[-1].pid, signal.SIGKILL)


def workers(process: "subprocess.Popen[Any]") -> list[psutil.Process]:
    """Return the worker processes of the sweep *process*."""
    children = psutil.Process(process.pid).children(recursive=True)
    # The children include the process that tracks shared memory, which is not a worker.
    return [child for child in children if "spawn_main" in str(child.cmdline())]


def main() -> int:
    """Run the sweeps, print the results, and return 1 if there is a miss, otherwise 0."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--episodes", type=int, default=1000, help="how many (default: %(default)s)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="workers (default: one a core)")
    options = parser.parse_args()
    missed = []
    twice = min(TWICE, options.episodes)
    with TemporaryDirectory() as scratch:
        whole, part = Path(scratch, "whole"), Path(scratch, "part")
        done = sweep(str(options.episodes), whole, options.jobs, kill=True)
        again = sweep(str(twice), part, options.jobs, kill=False)
        with (whole / "results.csv").open(encoding="utf-8", newline="") as file:
            episodes = [int(row["episode"]) for row in csv.DictReader(file)]
        head = (whole / "results.csv").read_bytes().splitlines()[: twice + 1]
        same = head == (part / "results.csv").read_bytes().splitlines()
    summary = done.summary
    print(
        f"{summary['done']} episodes of {DURATION} s: {summary['succeeded']} succeeded, in {done.wall:.0f} s"
    )
    print(
        f"{done.share:.0%} of {options.jobs} cores, {done.left:.0%} of what others left of them; workers "
        f"played {summary['workers']['busy']:.0%} of the time; {summary['workers']['deaths']} worker died"
    )
    print(f"the table of the first {twice}, made again: {'the same' if same else 'another'}")
    if episodes != list(range(options.episodes)):
        missed.append(f"{len(episodes)} rows, and not each of {options.episodes} episodes once")
    missed += [f"seed {row['seed']}: {row['status']} {row['error'] or ''}" for row in summary["failed"]]
    if summary["workers"]["deaths"] == 0:
        missed.append("the worker that was killed wasn't noticed")
    if not same:
        missed.append("the same sweep gave another table")
    collisions = summary["figures"]["robot.collisions"]["max"]
    if collisions:
        missed.append(f"{collisions:g} collisions in one episode")
    if options.episodes >= JUDGED_FROM and done.left < LEAST_SHARE:
        missed.append(f"{done.left:.0%} of the free cores were used, and not {LEAST_SHARE:.0%}")
    for miss in [*missed, *([] if again.summary["done"] == twice else ["the second sweep isn't whole"])]:
        print(f"miss: {miss}")
    return 1 if missed else 0


if __name__ == "__main__":
    raise SystemExit(main())
