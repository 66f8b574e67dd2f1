"""What an update of the localiser takes, beside a naive one that turns every beam by sine and cosine.

    python benchmarks/navigation_localising.py [--pairs 15] [--particles 500 1000 2000] [--beams 60]

An update is moving the particles, weighing them by the likelihood field, and KLD resampling; the naive peer
differs in the weighing only, which it does in numpy straight from the formula, and has to find the same
weights. Ratios are taken pair by pair; times are of the processor, so that other programs on the machine
disturb them little. The share is that of the 100 ms between two scans. Below stand the check that each scan
gets, a correction of the pose by matching, and one fifth of a search of the whole map.
"""

import math
import statistics
import time
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from btcore_robot.navigation.distance_field import SignedDistanceField
from btcore_robot.navigation.global_search import HEADINGS, GlobalSearch, SearchSpace
from btcore_robot.navigation.likelihood import LikelihoodField, obstacle_distances
from btcore_robot.navigation.occupancy_map import OccupancyMap
from btcore_robot.navigation.particles import best_cluster, resample, sample_motion_model, sample_particles
from btcore_robot.navigation.relocalisation import HEADINGS_A_STEP
from btcore_robot.robot import Pose2D
from btcore_sim.map_rasteriser import rasterise
from btcore_sim.scene import load_scene
from measure.paired_timing import Spread
from measure.report import Report, arguments

Floats = NDArray[np.float64]

MILLISECOND = 1e6
PERIOD = 100.0  # ms between two scans
ALPHAS = (0.2, 0.2, 0.2, 0.2)
POSE = Pose2D(0.0, 0.0, 0.3)
AHEAD = Pose2D(0.25, 0.05, 0.4)
EYE = (0.202, 0.0)


class NaiveField:
    """The likelihood field as its formula reads: a sine and a cosine for each beam of each particle."""

    def __init__(self, field_map: OccupancyMap) -> None:
        self._map = field_map
        self._z = obstacle_distances(field_map, 2.0)

    def weights(self, particles: Floats, points: Floats) -> Floats:
        """1 + Σ pz³, shape ``(n,)``."""
        bearings, lengths = np.arctan2(points[:, 1], points[:, 0]), np.hypot(points[:, 0], points[:, 1])
        angles = particles[:, 2, None] + bearings
        x = particles[:, 0, None] + lengths * np.cos(angles)
        y = particles[:, 1, None] + lengths * np.sin(angles)
        columns = np.floor((x - self._map.origin[0]) / self._map.resolution).astype(int)
        rows = np.floor((y - self._map.origin[1]) / self._map.resolution).astype(int)
        height, width = self._z.shape
        inside = (rows >= 0) & (columns >= 0) & (rows < height) & (columns < width)
        z = np.where(inside, self._z[rows.clip(0, height - 1), columns.clip(0, width - 1)], 2.0)
        pz = 0.5 * np.exp(-(z**2) / (2.0 * 0.2**2)) + 0.5 / 25.0
        weights: Floats = 1.0 + (pz**3).sum(axis=1)
        return weights


def ends(field_map: OccupancyMap, beams: int) -> Floats:
    """Where *beams* over 220° end for a robot at POSE, in its frame."""
    angles = np.linspace(-math.radians(110.0), math.radians(110.0), beams)
    steps = np.arange(0.0, 25.0, 0.01)
    x = POSE.x + np.cos(POSE.yaw + angles)[:, None] * steps
    y = POSE.y + np.sin(POSE.yaw + angles)[:, None] * steps
    cells = field_map.indices(np.stack((x.ravel(), y.ravel()), axis=1))
    height, width = field_map.cells.shape
    solid = field_map.occupied[cells[:, 0].clip(0, height - 1), cells[:, 1].clip(0, width - 1)]
    lengths = steps[solid.reshape(beams, -1).argmax(axis=1)]
    directions: Floats = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    directions *= lengths[:, None]
    return directions


def update(field: LikelihoodField | NaiveField, particles: Floats, points: Floats) -> Floats:
    """Move, weigh, find the pose, resample."""
    random = np.random.default_rng(1)
    ahead = sample_motion_model(particles, POSE, AHEAD, ALPHAS, random)
    weights = field.weights(ahead, points)
    weights /= weights.sum()
    best_cluster(ahead, weights)
    count = len(particles)
    return resample(ahead, weights, random, err=0.05, z=0.99, least=min(500, count), most=count)


def processor_time(work: Callable[[], object]) -> float:
    """How long *work* takes (ms of processor time)."""
    start = time.process_time_ns()
    work()
    return (time.process_time_ns() - start) / MILLISECOND


def median(work: Callable[[], object], times: int) -> float:
    """The median (ms) of so many *times*, the first left out."""
    return statistics.median([processor_time(work) for _ in range(times + 1)][1:])


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "", pairs=15)
    parser.add_argument("--particles", type=int, nargs="+", default=[500, 1000, 2000])
    parser.add_argument("--beams", type=int, default=60)
    given = parser.parse_args()
    field_map = rasterise(load_scene("house"))
    field, naive, points = LikelihoodField(field_map), NaiveField(field_map), ends(field_map, given.beams)
    height, width = field_map.cells.shape
    question = f"What localising takes in the house, {width} × {height} cells, with {given.beams} beams"
    report = Report("navigation_localising", question, given.pairs)
    for count in given.particles[: 1 if given.quick else None]:
        spread = np.diag([0.3, 0.3, 0.2]) ** 2
        particles = sample_particles(POSE, spread, count, np.random.default_rng(0))
        same = np.isclose(field.weights(particles, points), naive.weights(particles, points), rtol=1e-3)
        assert same.mean() > 0.95, "both weigh the particles alike, but for beams on a cell's edge"
        measured = []
        for index in range(given.pairs + 1):
            one = processor_time(partial(update, field, particles, points))
            other = processor_time(partial(update, naive, particles, points))
            if index:  # the first pair warms up
                measured.append((one, other))
        ours, theirs = (statistics.median(column) for column in zip(*measured, strict=True))
        figures = {
            "naive": f"{theirs:.2f} ms",
            "update": f"{ours:.2f} ms",
            "of 100 ms": f"{100 * ours / PERIOD:.1f} %",
        }
        ratio = Spread.of([one / other for one, other in measured])
        report.add(f"{count:,} particles: update / naive update", ratio, None, figures)
    faces, space = SignedDistanceField(field_map), SearchSpace(field_map)
    dense = ends(field_map, 2 * given.beams)
    for what, work in (
        ("how well a scan fits", lambda: faces.fit(POSE, points)),
        ("a pose by matching", lambda: faces.match(POSE, dense, EYE, deviation=(0.05, 0.05))),
        (
            f"{HEADINGS_A_STEP} of {HEADINGS} headings of a search",
            lambda: GlobalSearch(space, points).advance(HEADINGS_A_STEP),
        ),
    ):
        taken = median(work, given.pairs)
        report.remarks.append(f"{what}: {taken:.2f} ms, {100 * taken / PERIOD:.1f} % of 100 ms")
    report.output(given.json)


if __name__ == "__main__":
    main()
