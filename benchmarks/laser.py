"""What a scan of the simulated laser takes, beside the physics engine's own rays.

    python benchmarks/laser.py [--pairs 15] [--worlds house aws_house] [--json]

A scan is Tiago's laser (666 rays): geometry against all that stands and moves in the scene, and noise. The
peer is pybullet's `rayTestBatch` of the same rays in the same world, which has neither noise nor REP 117, its
arguments made beforehand; both have to find the same lengths. Scans are taken from the scene's waypoints in
turn. Each pair is one of both, one right after another, and ratios are taken pair by pair; times are of the
processor, on one thread. The share is that of the time between two scans.
"""

import math
import statistics
import time
from collections.abc import Callable
from functools import partial

import numpy as np

from btcore_sim.laser import Floats, Laser, MovableObstacles, RayCaster
from btcore_sim.quiet_pybullet import pybullet
from btcore_sim.robot_description import load_description
from btcore_sim.scene import load_scene
from btcore_sim.world import World
from measure.paired_timing import Spread
from measure.report import Report, arguments

MILLISECOND = 1e6
HEIGHT = 0.095  # m, of Tiago's laser above the floor
ALIKE = 0.005  # m

Point = tuple[float, float, float]


def processor_time(work: Callable[[], object]) -> int:
    """How long *work* takes (ns of processor time)."""
    start = time.process_time_ns()
    work()
    return time.process_time_ns() - start


class Rays:
    """The peer: the rays at *angles* (rad) from *place* (m), *reach* (m) long, by the engine of *world*."""

    def __init__(self, world: World, place: Point, angles: Floats, reach: float) -> None:
        self._client = world.client
        self._reach = reach
        x, y, z = place
        self._starts = [place] * len(angles)
        self._ends = [(x + reach * math.cos(one), y + reach * math.sin(one), z) for one in angles.tolist()]

    def cast(self) -> list[tuple[int, int, float, Point, Point]]:
        """What the rays hit, as pybullet has it."""
        hits: list[tuple[int, int, float, Point, Point]] = pybullet.rayTestBatch(
            self._starts, self._ends, numThreads=1, physicsClientId=self._client
        )
        return hits

    def distances(self) -> Floats:
        """How far (m) the rays go, shape ``(n,)``; inf where nothing is hit."""
        return np.array([hit[2] * self._reach if hit[0] >= 0 else math.inf for hit in self.cast()])


def scans(world: World, count: int) -> list[tuple[int, int]]:
    """*count* times the time (ns) of the engine's rays, and that of a scan."""
    facts = load_description().laser.facts
    still = RayCaster.of([thing for thing in world.scene.things if thing.still])
    moved = MovableObstacles(world.client, {body: world.bodies[body] for body in world.movable})
    laser = Laser(facts, still, np.random.default_rng(0), moved)
    angles = facts.angle_min + facts.angle_increment * np.arange(facts.rays, dtype=np.float64)
    places = list(world.scene.waypoints.values())
    measured = []
    for index in range(count + 1):
        x, y = places[index % len(places)]
        rays = Rays(world, (x, y, HEIGHT), angles, facts.range_max)
        own, theirs = laser.distances(x, y, HEIGHT, 0.0), rays.distances()
        own[own > facts.range_max] = math.inf
        same = np.isclose(own, theirs, atol=ALIKE)
        assert same.mean() > 0.95, "both see the same, but for rays that graze an edge"
        peer = processor_time(rays.cast)
        scan = processor_time(partial(laser.sweep, x, y, HEIGHT, 0.0, 0))
        if index:  # the first pair warms up
            measured.append((peer, scan))
    return measured


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "", pairs=15)
    parser.add_argument("--worlds", nargs="+", default=["house", "aws_house"])
    given = parser.parse_args()
    facts = load_description().laser.facts
    period = 1000 / facts.rate
    question = f"What a scan of {facts.rays} rays takes beside pybullet's own rays"
    report = Report("laser", question, given.pairs)
    for name in given.worlds[: 1 if given.quick else None]:
        world = World(load_scene(name))
        measured = scans(world, given.pairs)
        peer, scan = (statistics.median(column) / MILLISECOND for column in zip(*measured, strict=True))
        figures = {
            "things": f"{len(world.bodies)}",
            "rayTestBatch": f"{peer:.2f} ms",
            "scan": f"{scan:.2f} ms",
            f"of {period:g} ms": f"{100 * scan / period:.1f} %",
        }
        ratio = Spread.of([one / other for other, one in measured])
        report.add(f"{name}: scan / rayTestBatch", ratio, None, figures)
        world.close()
    report.output(given.json)


if __name__ == "__main__":
    main()
