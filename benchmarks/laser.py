"""How long a scan of the simulated laser takes, compared with the rays of the physics engine.

    python benchmarks/laser.py [--pairs 15] [--worlds house aws_house] [--quick] [--json]

A scan of Tiago's laser casts 666 rays against all static and movable objects of the world, and adds noise.
The reference is pybullet's `rayTestBatch` with the same rays in the same world; it has neither noise nor the
special values of REP 117, and its arguments are created before the measurement. Both must find the same
distances. The scans are made at the world's waypoints, in turn. A pair consists of a scan and a call of the
reference, directly after each other; ratios are computed within a pair. Times are processor times of a single
thread. A column shows the time of a scan as a percentage of the time between two scans.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from functools import partial

import numpy as np

from btcore.clock import NS_PER_MS
from btcore_sim.laser import Floats, Laser, MovableObstacles, RayCaster
from btcore_sim.quiet_pybullet import pybullet
from btcore_sim.robot_description import load_robot_description
from btcore_sim.world import World
from btcore_sim.worlds import load_world_description
from measure.paired_timing import Work, measure_rounds
from measure.report import Report, create_parser

HEIGHT = 0.095  # m, of Tiago's laser above the floor
TOLERANCE = 0.005  # m

Point = tuple[float, float, float]
Hit = tuple[int, int, float, Point, Point]
"""A result of pybullet: body (-1: no hit), link, fraction of the ray (0 to 1), point (m) and normal."""


def peer_rays(world: World, place: Point, angles: Floats, reach: float) -> Callable[[], list[Hit]]:
    """Return a function that casts rays with pybullet.

    Args:
        world: The world.
        place: The start of all rays (m).
        angles: The directions of the rays in the world (rad), shape ``(rays,)``.
        reach: The length of the rays (m).
    """
    x, y, z = place
    ends = [(x + reach * math.cos(angle), y + reach * math.sin(angle), z) for angle in angles.tolist()]
    starts = [place] * len(ends)
    return partial(pybullet.rayTestBatch, starts, ends, numThreads=1, physicsClientId=world.client)


def scans(world: World, count: int) -> Iterator[Mapping[str, Work]]:
    """Yield *count* pairs of the reference and a scan, after a pair for the warm-up."""
    info = load_robot_description().laser.info
    still = RayCaster.of([item for item in world.description.objects if item.is_static])
    moved = MovableObstacles(world.client, {body: world.bodies[body] for body in world.movable})
    laser = Laser(info, still, np.random.default_rng(0), moved)
    angles = info.angle_min + info.angle_increment * np.arange(info.rays, dtype=np.float64)
    places = list(world.description.waypoints.values())
    reach = info.range_max
    for index in range(count + 1):
        x, y = places[index % len(places)]
        cast = peer_rays(world, (x, y, HEIGHT), angles, reach)
        own = laser.distances(x, y, HEIGHT, 0.0)
        own[own > reach] = math.inf
        theirs = np.array([hit[2] * reach if hit[0] >= 0 else math.inf for hit in cast()])
        is_close = np.isclose(own, theirs, atol=TOLERANCE)
        assert is_close.mean() > 0.95, "the distances must be equal, except for rays that graze an edge"
        yield {"peer": cast, "scan": partial(laser.sweep, x, y, HEIGHT, 0.0, 0)}


def main() -> None:
    """Run the benchmark."""
    parser = create_parser(__doc__ or "", pairs=15)
    parser.add_argument("--worlds", nargs="+", default=["house", "aws_house"])
    options = parser.parse_args()
    info = load_robot_description().laser.info
    period = 1000 / info.rate
    question = f"The time for a scan of {info.rays} rays, compared with pybullet's rays"
    report = Report("laser", question, options.pairs)
    for name in options.worlds[: 1 if options.quick else None]:
        world = World(load_world_description(name))
        measured = measure_rounds(scans(world, options.pairs))
        peer, scan = measured.time("peer").median / NS_PER_MS, measured.time("scan").median / NS_PER_MS
        figures = {
            "things": f"{len(world.bodies)}",
            "rayTestBatch": f"{peer:.2f} ms",
            "scan": f"{scan:.2f} ms",
            f"of {period:g} ms": f"{100 * scan / period:.1f} %",
        }
        report.add(f"{name}: scan / rayTestBatch", measured.ratio("scan", "peer"), None, figures)
        world.close()
    report.output(options.json)


if __name__ == "__main__":
    main()
