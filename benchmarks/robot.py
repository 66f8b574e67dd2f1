"""How many seconds a robot runs per second of processor time, and how that compares with its physics alone.

    python benchmarks/robot.py [--pairs 3] [--seconds 60] [--quick] [--json]

The program is ``btcore run --fast`` without a camera: *patrolling* in the house, which localises, plans and
drives by the navigation stack, and *bumpgo_wide* in the arena, which reads only the laser. The reference is
the same world with the same robot, of which only the physics is stepped, for the same simulated time. Each
program runs in a new process, in turn. Times are processor times, user and system, without imports and
set-up: the time of a run of one second is subtracted; the column "start" shows it.

The row "robot s / CPU s" is not a ratio to a reference, and depends on the machine.
"""

import os
import resource
import subprocess
import sys

from measure.paired_timing import Spread
from measure.report import Report, create_parser

RUNS = {"house": "patrolling", "arena": "bumpgo_wide"}
"""The tree that runs in each world."""
PHYSICS = (
    "import sys, time\n"
    "from btcore_sim.simulated_robot import SimulatedRobot\n"
    "from btcore_sim.world import World\n"
    "from btcore_sim.worlds import load_world_description\n"
    "world = World(load_world_description(sys.argv[1]))\n"
    "robot = SimulatedRobot(world)\n"
    "began = time.process_time()\n"
    "world.settle(float(sys.argv[2]))\n"
    "print(time.process_time() - began)\n"
)
START = 1.0
"""The simulated time (s) of the run whose processor time is subtracted."""
ENVIRONMENT = {name: text for name, text in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}


def measure_process(command: list[str]) -> float:
    """Return the processor time (s) of a new Python with the arguments *command*."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *command], env=ENVIRONMENT, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def measure_run(world: str, seconds: float) -> float:
    """Return the processor time (s) of a run of *seconds* (s) in *world*."""
    options = ["--world", world, "--camera", "off", "--fast", "--seed", "1", "--duration", str(seconds)]
    return measure_process(["-m", "btcore", "run", RUNS[world], *options])


def measure_physics(world: str, seconds: float) -> float:
    """Return the processor time (s) of *seconds* (s) of physics in *world*."""
    command = [sys.executable, "-c", PHYSICS, world, str(seconds)]
    done = subprocess.run(command, env=ENVIRONMENT, check=True, capture_output=True, text=True)
    return float(done.stdout.splitlines()[-1])


def main() -> None:
    """Run the benchmark."""
    parser = create_parser(__doc__ or "", pairs=3)
    parser.add_argument("--seconds", type=float, default=60.0, help="simulated time of a run (s)")
    given = parser.parse_args()
    seconds = 8.0 if given.quick else given.seconds
    report = Report("robot", "The speed of a simulated robot without a camera", given.pairs)
    for world in list(RUNS)[: 1 if given.quick else None]:
        starts, speeds, ratios = [], [], []
        for _ in range(given.pairs):
            starts.append(measure_run(world, START))
            run = measure_run(world, START + seconds) - starts[-1]
            physics = measure_physics(world, seconds)
            speeds.append(seconds / run)
            ratios.append(run / physics)
        start = {"start": f"{Spread.of(starts).median:.1f} s"}
        report.add(f"{world}, {RUNS[world]}: robot s / CPU s", Spread.of(speeds), None, start)
        report.add(f"{world}, {RUNS[world]}: run / physics alone", Spread.of(ratios))
    report.output(given.json)


if __name__ == "__main__":
    main()
