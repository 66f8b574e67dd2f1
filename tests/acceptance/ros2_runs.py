"""Trees that drive the simulated robot of another process by ROS 2: no contact, repeatable, on time.

``python tests/acceptance/ros2_runs.py`` makes ten lockstep runs of 300 s of bump-and-go and of the patrol in
the house, some of them twice, and the same runs in one process for comparison. Then it makes a run of 60 s in
real time, and compares the lateness of ticks with that of a timer of rclpy in a third process. It prints the
figures, and exits with 1 on any miss. ``--sample`` makes one short run of each kind.

Contacts and distances are measured by the simulator.
"""

import argparse
import contextlib
import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from pathlib import Path
from queue import SimpleQueue
from subprocess import PIPE, Popen

from cached_runs import Case, Result, failure_messages, replay, run_seeds, safety_misses
from checkout import environment

from btcore_ros2.testing import isolate_ros

TREES = ("bumpgo_wide", "patrolling")
WORLD = ("--world", "house", "--camera", "off")
RATE = 10.0
LEAST_SPEED = 0.08
"""The least distance (m) that the robot drives per second of the run."""

WAYPOINT_TIME = 150.0
"""The longest time (s) for a waypoint of the patrol in the mean."""

START_LIMIT = 120.0
"""The longest time (s) for the start or the end of a process on a busy machine."""

Command = list[str]


@dataclass(frozen=True)
class Plan:
    """The runs to make.

    Attributes:
        seeds: The seeds of the lockstep runs.
        repeated: The seeds of those that are repeated.
        lockstep: The duration (s) of a lockstep run.
        real_time: The duration (s) of the run in real time.
        least_ticks: The least part of the ticks of the run in real time that are not skipped.
    """

    seeds: Sequence[int]
    repeated: Sequence[int]
    lockstep: int
    real_time: int
    least_ticks: float


FULL = Plan(seeds=range(1, 11), repeated=(1, 2, 3), lockstep=300, real_time=60, least_ticks=0.95)
# The machine of a sample may be busy, and skip ticks.
SAMPLE = Plan(seeds=(1,), repeated=(1,), lockstep=15, real_time=8, least_ticks=0.0)

domains: "SimpleQueue[int]" = SimpleQueue()
"""The ROS domains that no run uses at present."""


class RunError(Exception):
    """A process of a run has failed."""


def btcore(*arguments: object) -> Command:
    """Return the command line of `btcore` with *arguments*."""
    return [sys.executable, "-m", "btcore", *map(str, arguments)]


@contextlib.contextmanager
def reserve_ros_domain() -> "Iterator[Callable[[Command], Popen[str]]]":
    """Reserve a ROS domain, and yield a function that starts a process in it; they are killed at the end."""
    domain = domains.get()
    single_threaded = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    variables = environment(ROS_DOMAIN_ID=str(domain), **single_threaded)
    started: list[Popen[str]] = []

    def start(command: Command) -> "Popen[str]":
        started.append(Popen(command, stdout=PIPE, stderr=PIPE, text=True, env=variables))
        return started[-1]

    try:
        yield start
    finally:
        for process in started:
            process.kill()
            process.communicate()
        domains.put(domain)


def start_simulation(start: "Callable[[Command], Popen[str]]", *options: object) -> "Popen[str]":
    """Start the simulation with *options*, and wait until it is on ROS 2.

    Raises:
        RunError: The simulation has ended.
    """
    simulation = start(btcore("ros2", "sim", *WORLD, *options, "--json"))
    assert simulation.stderr is not None
    lines = []
    for line in simulation.stderr:
        if "is on ROS 2" in line:
            return simulation
        lines.append(line)
    raise RunError(f"the simulation has ended: {''.join(lines)[-500:]}")


def wait_for_object(process: "Popen[str]", code: int, limit: float) -> Result:
    """Wait for the end of *process*, and return the JSON object in its last line.

    Args:
        process: The process.
        code: The expected exit code.
        limit: The longest wait (s).

    Raises:
        RunError: The process hangs, or has ended with another exit code.
    """
    try:
        out, errors = process.communicate(timeout=limit)
    except subprocess.TimeoutExpired:
        raise RunError(f"no end after {limit:g} s: {process.args!r}") from None
    if process.returncode != code:
        raise RunError(f"exit code {process.returncode}: {process.args!r}: {errors.strip()[-500:]}")
    found: Result = json.loads(out.splitlines()[-1])
    return found


def drive(case: Case, seed: int) -> Result:
    """Run *case* with *seed*: the simulation in one process, the tree in another."""
    tree, *options = case.arguments
    lockstep = ("--lockstep", "--seed", seed)
    duration = float(options[options.index("--duration") + 1])
    try:
        with reserve_ros_domain() as start, tempfile.TemporaryDirectory() as folder:
            simulation = start_simulation(start, *lockstep)
            recording = Path(folder) / "run.btrec.txt"
            record = ("--record", str(recording), "--json")
            client = start(btcore("run", tree, "--ros2", "tiago", *options, *lockstep, *record))
            driven = wait_for_object(client, 0, START_LIMIT + 10.0 * duration)
            simulation.send_signal(signal.SIGINT)
            measured = wait_for_object(simulation, 130, START_LIMIT)
            again = {"replay": replay(recording)}
    except RunError as error:
        return {"seed": seed, "error": str(error)}
    return {"seed": seed, **driven, **measured, **again}


def waypoints(result: Result) -> int:
    """Return how many waypoints the robot has reached."""
    return sum(node["success"] for node in result["nodes"].values() if node["id"] == "Move")


def run_misses(result: Result, tree: str, duration: int) -> list[str]:
    """Return the requirements of *tree* in a run of *duration* (s) that the result does not meet."""
    robot, found = result["robot"], safety_misses(result)
    if robot["distance_m"] < LEAST_SPEED * duration:
        found.append(f"only {robot['distance_m']} m")
    if result["time_s"] != duration:
        found.append(f"{result['time_s']} s instead of {duration} s")
    if tree == "patrolling" and waypoints(result) < duration // WAYPOINT_TIME:
        found.append(f"only {waypoints(result)} waypoints")
    return found


def run_in_lockstep(plan: Plan, tree: str, map_file: Path, jobs: int) -> list[str]:
    """Make the runs of *tree* and print their figures. Return a message for each miss."""
    duration = ("--duration", str(plan.lockstep))
    options = (*duration, "--map", str(map_file)) if tree == "patrolling" else duration
    misses = partial(run_misses, tree=tree, duration=plan.lockstep)
    inside = Case(f"{tree} one process {plan.lockstep}", (tree, *WORLD, *duration), misses)
    outside = Case(f"{tree} ros2 {plan.lockstep}", (tree, *options), misses)
    again = Case(f"{tree} ros2 again {plan.lockstep}", (tree, *options), misses)
    alone = run_seeds(inside, plan.seeds, jobs)
    missed = print_row(inside, alone)
    driven = run_seeds(outside, plan.seeds, jobs, drive)
    missed += print_row(outside, driven)
    equal = sum(way(first) == way(second) for first, second in zip(alone, driven, strict=True))
    print(f"  {equal} of {len(driven)} runs have the same ticks and the same way as in one process")
    repeated = run_seeds(again, plan.repeated, jobs, drive)
    missed += failure_messages(again, repeated)
    summaries = {run["seed"]: summary(run) for run in driven}
    different = [run["seed"] for run in repeated if summary(run) != summaries[run["seed"]]]
    print(f"  {len(repeated) - len(different)} of {len(repeated)} repeated runs have the same summary")
    return missed + [f"{outside.name}, seed {seed}: another summary in the second run" for seed in different]


def way(result: Result) -> list[object]:
    """Return the results of the nodes, and where the robot has driven."""
    return [result.get("nodes"), *(result.get("robot", {}).get(key) for key in ("distance_m", "pose"))]


def summary(result: Result) -> Result:
    """Return *result* without the time that the run took."""
    return {key: value for key, value in result.items() if key != "real_time_factor"}


def print_row(case: Case, found: Sequence[Result]) -> list[str]:
    """Print a line of the table. Return a message for each miss."""
    whole = [run for run in found if "error" not in run]
    robots = [run["robot"] for run in whole]
    collisions, grazes = (sum(robot[kind] for robot in robots) for kind in ("collisions", "grazes"))
    least = min((robot["distance_m"] for robot in robots), default=0.0)
    reached = min(map(waypoints, whole), default=0)
    factor = statistics.median([run["real_time_factor"] for run in whole] or [0.0])
    print(
        f"{case.name:28} {len(whole):5} {collisions:5} {grazes:6} {least:8.1f} {reached:9} {factor:11.1f}",
        flush=True,
    )
    return failure_messages(case, found)


def run_in_real_time(seconds: int, least_ticks: float) -> list[str]:
    """Make a run in real time beside a timer of rclpy, and print the lateness of both.

    The robot has no simulated time, like a real robot.

    Args:
        seconds: The duration (s) of the run.
        least_ticks: The least part of the ticks that are not skipped.

    Returns:
        A message for each miss.
    """
    with tempfile.TemporaryDirectory() as folder:
        log, robot = Path(folder, "ticks.json"), Path(folder, "robot.yaml")
        tiago = files("btcore_ros2.robot").joinpath("tiago.yaml").read_text(encoding="utf-8")
        robot.write_text(f"{tiago}\nuse_sim_time: false\n", encoding="utf-8", newline="\n")
        run_options = ("--ros2", robot, "--duration", seconds, "--log", log, "--json")
        try:
            with reserve_ros_domain() as start:
                simulation = start_simulation(start)
                client = start(btcore("run", "bumpgo_wide", *run_options))
                timer = start([sys.executable, __file__, "--timer", str(seconds)])
                driven = wait_for_object(client, 0, START_LIMIT + 2.0 * seconds)
                timed = wait_for_object(timer, 0, START_LIMIT)
                simulation.send_signal(signal.SIGINT)
                measured = wait_for_object(simulation, 130, START_LIMIT)
        except RunError as error:
            return [f"real time: {error}"]
        events = json.loads(log.read_text(encoding="utf-8"))["traceEvents"]
    # The first leaf of the tree is ticked in each tick.
    ticks = lateness([event["ts"] / 1e6 for event in events if event["name"] == "WaitForScan"])
    calls = lateness(timed["times_s"])
    print(f"\n{'lateness in real time, ms':28} {'median':>8} {'95 %':>8} {'99 %':>8}")
    for name, values in (("ticks of bumpgo_wide", ticks), ("timer of rclpy", calls)):
        print(f"{name:28} " + " ".join(f"{value * 1e3:8.2f}" for value in values))
    print(f"{'ratio':28} " + " ".join(f"{a / b:8.2f}" for a, b in zip(ticks, calls, strict=True)))
    found = {**driven, **measured}
    missed = [f"real time: {kind}" for kind in safety_misses(found)]
    if driven["ticks"] < least_ticks * RATE * seconds:
        missed.append(f"real time: only {driven['ticks']} ticks")
    return missed


def lateness(times: Sequence[float]) -> list[float]:
    """Return the median and the percentiles 95 and 99 of the lateness of periodic *times* (all in s).

    The percentile 2 of the delays counts as punctual. Only the first time of each period counts, because a
    leaf that waits causes further ticks.
    """
    period, tolerance = 1.0 / RATE, 0.001
    begin = times[0] - 0.2 * period
    phase = statistics.quantiles(((moment - begin) % period for moment in times), n=50)[0]
    begin += phase - tolerance
    first: dict[int, float] = {}
    for moment in times:
        number, delay = divmod(moment - begin, period)
        first.setdefault(int(number), max(0.0, delay - tolerance))
    cuts = statistics.quantiles(first.values(), n=100)
    return [cuts[49], cuts[94], cuts[98]]


def print_timer_calls(seconds: int) -> None:
    """Print the times (s) at which a timer of rclpy calls its callback within *seconds*."""
    import rclpy

    times: list[float] = []
    rclpy.init()
    node = rclpy.create_node("timer")
    node.create_timer(1.0 / RATE, lambda: times.append(time.monotonic()))
    rclpy.spin_until_future_complete(node, rclpy.task.Future(), timeout_sec=seconds)
    rclpy.shutdown()
    print(json.dumps({"times_s": times}))


def main() -> int:
    """Make the runs, print the figures, and return 1 on any miss, otherwise 0."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--sample", action="store_true", help="one short run of each kind, and nothing else")
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, help="runs at a time (default: cores)"
    )
    parser.add_argument("--timer", type=int, metavar="S", help=argparse.SUPPRESS)
    parser.add_argument("--only", default="", metavar="TEXT", help="the trees with TEXT in their name")
    options = parser.parse_args()
    if options.timer:
        print_timer_calls(options.timer)
        return 0
    plan = SAMPLE if options.sample else FULL
    for _ in range(options.jobs):
        domains.put(isolate_ros())
    began = time.monotonic()
    missed: list[str] = []
    print(
        f"{'lockstep':28} {'runs':>5} {'coll.':>5} {'grazes':>6} {'least m':>8} {'waypoints':>9}"
        f" {'real time ×':>11}"
    )
    with tempfile.TemporaryDirectory() as folder:
        map_command = btcore("map", "house", "--output", folder)
        subprocess.run(map_command, check=True, capture_output=True, env=environment())
        for tree in TREES:
            if options.only in tree:
                missed += run_in_lockstep(plan, tree, Path(folder, "house.yaml"), options.jobs)
    missed += run_in_real_time(plan.real_time, plan.least_ticks)
    for miss in missed:
        print(f"miss: {miss}")
    print(f"{time.monotonic() - began:.0f} s")
    return 1 if missed else 0


if __name__ == "__main__":
    raise SystemExit(main())
