"""How long an update of the localiser takes, compared with a direct implementation of the formula.

    python benchmarks/navigation_localising.py [--pairs 15] [--particles 500 1000 2000] [--beams 60]
        [--quick] [--json]

An update moves the particles, computes their weights from the likelihood field, and resamples them by KLD
sampling. The naive reference differs only in the weights: it computes a sine and a cosine for each beam of
each particle with numpy, and must find the same weights. Ratios are computed within a pair; times are
processor times. Percentages are relative to the 100 ms between two scans. Below the table are the times of
the check of a scan, of a correction of the pose by scan matching, and of a fifth of the search for the robot
in the whole map.
"""

import math
from functools import partial

import numpy as np
from numpy.typing import NDArray

from btcore.clock import NS_PER_MS
from btcore_navigation.distance_field import SignedDistanceField
from btcore_navigation.global_search import HEADINGS, GlobalSearch, SearchSpace
from btcore_navigation.likelihood import LikelihoodField, obstacle_distances
from btcore_navigation.parameters import AmclParameters
from btcore_navigation.particles import best_cluster, resample, sample_motion_model, sample_particles
from btcore_navigation.relocalisation import HEADINGS_A_STEP
from btcore_robot.occupancy_map import OccupancyMap
from btcore_robot.robot import Pose2D
from btcore_sim.map_rasteriser import rasterise
from btcore_sim.worlds import load_world_description
from measure.paired_timing import measure_rounds
from measure.report import Report, create_parser

Floats = NDArray[np.float64]

PERIOD = 100.0  # ms between two scans
PARAMETERS = AmclParameters()
ALPHAS = (PARAMETERS.alpha1, PARAMETERS.alpha2, PARAMETERS.alpha3, PARAMETERS.alpha4)
RANGE_MAX = 25.0  # m
POSE = Pose2D(0.0, 0.0, 0.3)
NEXT_POSE = Pose2D(0.25, 0.05, 0.4)
LASER_POSITION = (0.202, 0.0)  # m, on the robot


class NaiveField:
    """The likelihood field, computed with a sine and a cosine for each beam of each particle."""

    def __init__(self, field_map: OccupancyMap) -> None:
        self._map = field_map
        self._z = obstacle_distances(field_map, PARAMETERS.laser_likelihood_max_dist)

    def weights(self, particles: Floats, points: Floats) -> Floats:
        """Return the weight 1 + Σ pz³ of each particle, shape ``(n,)``.

        Args:
            particles: The poses x (m), y (m), yaw (rad), shape ``(n, 3)``.
            points: The ends of the beams in the robot's frame (m), shape ``(k, 2)``.
        """
        bearings, lengths = np.arctan2(points[:, 1], points[:, 0]), np.hypot(points[:, 0], points[:, 1])
        angles = particles[:, 2, None] + bearings
        x = particles[:, 0, None] + lengths * np.cos(angles)
        y = particles[:, 1, None] + lengths * np.sin(angles)
        columns = np.floor((x - self._map.origin[0]) / self._map.resolution).astype(int)
        rows = np.floor((y - self._map.origin[1]) / self._map.resolution).astype(int)
        height, width = self._z.shape
        inside = (rows >= 0) & (columns >= 0) & (rows < height) & (columns < width)
        z = self._z[rows.clip(0, height - 1), columns.clip(0, width - 1)]
        z = np.where(inside, z, PARAMETERS.laser_likelihood_max_dist)
        hits = PARAMETERS.z_hit * np.exp(-(z**2) / (2.0 * PARAMETERS.sigma_hit**2))
        pz = hits + PARAMETERS.z_rand / RANGE_MAX
        weights: Floats = 1.0 + (pz**3).sum(axis=1)
        return weights


def beam_ends(field_map: OccupancyMap, beams: int) -> Floats:
    """Return the ends of beams over 220° from POSE, in the robot's frame (m), shape ``(beams, 2)``."""
    angles = np.linspace(-math.radians(110.0), math.radians(110.0), beams)
    steps = np.arange(0.0, RANGE_MAX, 0.01)
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
    """Move the particles, compute their weights and the pose; return the resampled particles."""
    random = np.random.default_rng(1)
    ahead = sample_motion_model(particles, POSE, NEXT_POSE, ALPHAS, random)
    weights = field.weights(ahead, points)
    weights /= weights.sum()
    best_cluster(ahead, weights)
    count = len(particles)
    return resample(
        ahead, weights, random, err=PARAMETERS.pf_err, z=PARAMETERS.pf_z, least=min(500, count), most=count
    )


def main() -> None:
    """Run the benchmark."""
    parser = create_parser(__doc__ or "", pairs=15)
    parser.add_argument("--particles", type=int, nargs="+", default=[500, 1000, 2000])
    parser.add_argument("--beams", type=int, default=60)
    options = parser.parse_args()
    field_map = rasterise(load_world_description("house"))
    field, naive = LikelihoodField(field_map, PARAMETERS, RANGE_MAX), NaiveField(field_map)
    points = beam_ends(field_map, options.beams)
    height, width = field_map.cells.shape
    question = f"The time for localising in the house, {width} × {height} cells, with {options.beams} beams"
    report = Report("navigation_localising", question, options.pairs)
    for count in options.particles[: 1 if options.quick else None]:
        spread = np.diag([0.3, 0.3, 0.2]) ** 2
        particles = sample_particles(POSE, spread, count, np.random.default_rng(0))
        is_close = np.isclose(field.weights(particles, points), naive.weights(particles, points), rtol=1e-3)
        assert is_close.mean() > 0.95, "the weights must be equal, except for beams on the edge of a cell"
        works = {
            "update": partial(update, field, particles, points),
            "naive": partial(update, naive, particles, points),
        }
        measured = measure_rounds([works] * (options.pairs + 1))
        duration = measured.time("update").median / NS_PER_MS
        figures = {
            "naive": f"{measured.time('naive').median / NS_PER_MS:.2f} ms",
            "update": f"{duration:.2f} ms",
            "of 100 ms": f"{100 * duration / PERIOD:.1f} %",
        }
        ratio = measured.ratio("update", "naive")
        report.add(f"{count:,} particles: update / naive update", ratio, None, figures)
    faces, space = SignedDistanceField(field_map), SearchSpace(field_map)
    dense = beam_ends(field_map, 2 * options.beams)
    search = f"{HEADINGS_A_STEP} of {HEADINGS} headings of a search"
    parts = {
        "check of a scan": lambda: faces.fit(POSE, points),
        "pose by matching": lambda: faces.match(POSE, dense, LASER_POSITION, deviation=(0.05, 0.05)),
        search: lambda: GlobalSearch(space, points).advance(HEADINGS_A_STEP),
    }
    for label, work in parts.items():
        duration = measure_rounds([{label: work}] * (options.pairs + 1)).time(label).median / NS_PER_MS
        report.remarks.append(f"{label}: {duration:.2f} ms, {100 * duration / PERIOD:.1f} % of 100 ms")
    report.output(options.json)


if __name__ == "__main__":
    main()
