"""Particles of the localiser: motion, number, resampling and the heaviest cluster."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from btcore_robot.rigid_transform import wrap_angle, wrap_angles
from btcore_robot.robot import Pose2D

_STANDS = 0.01
"""A move shorter than this (m) has no direction: it is a turn on the spot (nav2_amcl)."""

Floats = NDArray[np.float64]

BIN_LENGTH = 0.5
"""The side length (m) of a bin of the histogram for KLD sampling (nav2_amcl)."""
BIN_TURN = math.radians(10.0)
"""The extent of a bin in yaw (rad)."""

_TURNS = round(2.0 * math.pi / BIN_TURN)
_MAX_BINS = 1 << 14  # bins along x and y on either side of 0: ±8 km
_TOUCHING = np.ones((3, 3, 3), dtype=np.int8)


def decompose_motion(before: Pose2D, after: Pose2D) -> tuple[float, float, float]:
    """Return the motion between two poses as a turn, a straight line and another turn.

    Args:
        before: The pose at the start of the motion.
        after: The pose at the end, in the same frame.

    Returns:
        The first turn (rad), the distance (m) and the second turn (rad). The first turn is 0 for a distance
        below 1 cm, because its direction is uncertain.
    """
    dx, dy = after.x - before.x, after.y - before.y
    straight = math.hypot(dx, dy)
    first = 0.0 if straight < _STANDS else wrap_angle(math.atan2(dy, dx) - before.yaw)
    return first, straight, wrap_angle(after.yaw - before.yaw - first)


def sample_motion_model(
    particles: NDArray[np.float64],
    before: Pose2D,
    after: Pose2D,
    alphas: tuple[float, float, float, float],
    random: np.random.Generator,
) -> NDArray[np.float64]:
    """Move each particle by the motion of the odometry, with independent noise for each particle.

    Source: Thrun, Burgard, Fox: Probabilistic Robotics, table 5.6, in nav2_amcl's form: a turn counts as its
    distance from 0 or π, whichever is nearer, so that driving backward is as certain as driving forward.

    Args:
        particles: The poses (x, y, yaw), shape `(n, 3)`.
        before: The odometry's pose at the last update.
        after: The odometry's pose now.
        alphas: α1 (noise of turns by turns), α2 (of turns by distance), α3 (of distance by distance) and α4
            (of distance by turns).
        random: The source of the noise.

    Returns:
        The moved particles, shape `(n, 3)`.
    """
    turn, way, turn_after = decompose_motion(before, after)
    a1, a2, a3, a4 = alphas
    folded = min(abs(turn), abs(wrap_angle(turn - math.pi)))
    folded_after = min(abs(turn_after), abs(wrap_angle(turn_after - math.pi)))
    noise = random.standard_normal((3, len(particles)))
    first = turn - noise[0] * math.sqrt(a1 * folded**2 + a2 * way**2)
    straight = way - noise[1] * math.sqrt(a3 * way**2 + a4 * (folded**2 + folded_after**2))
    second = turn_after - noise[2] * math.sqrt(a1 * folded_after**2 + a2 * way**2)
    heading = particles[:, 2] + first
    result = np.empty_like(particles)
    result[:, 0] = particles[:, 0] + straight * np.cos(heading)
    result[:, 1] = particles[:, 1] + straight * np.sin(heading)
    result[:, 2] = wrap_angles(heading + second)
    return result


@dataclass(frozen=True, slots=True)
class Cluster:
    """A cluster of particles: mean *pose*, *covariance* (x, y, yaw) and share of the total *weight*."""

    pose: Pose2D
    covariance: Floats
    weight: float


def kld_sample_size(bins: int, err: float, z: float, least: int, most: int) -> int:
    """Return the number of particles that KLD sampling requires (Fox 2003).

    With this number, the divergence of the sample from the true distribution stays below *err*. A single bin
    gives no information; the result is *most*.

    Args:
        bins: The number of occupied bins of the histogram.
        err: The greatest divergence: nav2_amcl's `pf_err`.
        z: The quantile of the normal distribution, for which nav2_amcl inserts `pf_z`.
        least: The least number of particles.
        most: The greatest number of particles.
    """
    if bins <= 1:
        return most
    spread = 2.0 / (9.0 * (bins - 1))
    size = math.ceil((bins - 1) / (2.0 * err) * (1.0 - spread + math.sqrt(spread) * z) ** 3)
    return max(least, min(most, size))


def resample(
    particles: Floats,
    weights: Floats,
    random: np.random.Generator,
    *,
    err: float,
    z: float,
    least: int,
    most: int,
) -> Floats:
    """Draw particles by their weights (systematic resampling), in a number given by KLD sampling.

    A first sample, of *most* particles, gives the number. Its particles are counted one by one in random
    order, until their count reaches the number that KLD sampling requires for the bins that they occupy. Then
    a second sample with this number of particles is drawn and returned.

    Args:
        particles: The poses (x, y, yaw), shape `(n, 3)`.
        weights: The particles' weights, shape `(n,)`, with the sum 1.
        random: The source of random numbers.
        err: The greatest divergence, as for `kld_sample_size`.
        z: The quantile, as for `kld_sample_size`.
        least: The least number of particles.
        most: The greatest number of particles.
    """
    drawn = _systematic(weights, most, random)
    order = random.permutation(most)
    keys = _bins(particles)[drawn[order]]
    # The required size changes only where a bin is occupied for the first time.
    first = np.sort(np.unique(keys, return_index=True)[1]).tolist()
    size = most
    for occupied, (start, end) in enumerate(pairwise([*first, most]), 1):
        required = kld_sample_size(occupied, err, z, least, most)
        if required <= end:
            size = max(required, start + 1)
            break
    return particles[_systematic(weights, size, random)]


def _systematic(weights: Floats, count: int, random: np.random.Generator) -> NDArray[np.intp]:
    """Return *count* indices, each as often as its weight times *count*, rounded up or down."""
    sums = np.cumsum(weights)
    places = (random.random() + np.arange(count)) * (sums[-1] / count)
    indices: NDArray[np.intp] = np.searchsorted(sums, places, side="right")
    return np.minimum(indices, len(weights) - 1)


def _bins(particles: Floats) -> NDArray[np.int64]:
    """Return a number for each particle that identifies its bin."""
    across = np.floor(particles[:, 0] / BIN_LENGTH).astype(np.int64) + _MAX_BINS
    along = np.floor(particles[:, 1] / BIN_LENGTH).astype(np.int64) + _MAX_BINS
    turn = np.floor(particles[:, 2] / BIN_TURN).astype(np.int64) % _TURNS
    # A mixed-radix number: a single integer for the three indices of a bin.
    return (across * (2 * _MAX_BINS) + along) * _TURNS + turn


def best_cluster(particles: Floats, weights: Floats) -> Cluster:
    """Return the cluster of particles with the greatest total weight.

    Particles are in the same cluster if their bins of x, y and yaw touch at a side, an edge or a corner.

    Args:
        particles: The poses (x, y, yaw), shape `(n, 3)`.
        weights: The particles' weights, shape `(n,)`.
    """
    # Headings relative to their mean: the cut at ±π is then opposite to most particles.
    mean = math.atan2(weights @ np.sin(particles[:, 2]), weights @ np.cos(particles[:, 2]))
    turns = wrap_angles(particles[:, 2] - mean)
    cells = np.empty((3, len(particles)), dtype=np.int64)
    cells[0] = np.floor(particles[:, 0] / BIN_LENGTH)
    cells[1] = np.floor(particles[:, 1] / BIN_LENGTH)
    cells[2] = np.floor(turns / BIN_TURN)
    cells -= cells.min(axis=1, keepdims=True)
    box = np.zeros(cells.max(axis=1) + 1, dtype=np.int8)
    where = (cells[0], cells[1], cells[2])
    box[where] = 1
    labels, _ = ndimage.label(box, structure=_TOUCHING)
    clusters = labels[where]
    inside = clusters == int(np.argmax(np.bincount(clusters, weights=weights)))
    return _summary(particles[inside], turns[inside], weights[inside], mean)


def _summary(particles: Floats, turns: Floats, weights: Floats, heading: float) -> Cluster:
    total = float(weights.sum())
    share = weights / total
    rows = np.stack((particles[:, 0], particles[:, 1], turns))
    middle = rows @ share
    off = rows - middle[:, None]
    yaw = wrap_angle(heading + middle[2])
    return Cluster(Pose2D(float(middle[0]), float(middle[1]), yaw), (off * share) @ off.T, total)


def sample_particles(pose: Pose2D, covariance: Floats, count: int, random: np.random.Generator) -> Floats:
    """Draw particles from a normal distribution.

    Args:
        pose: The mean of the distribution.
        covariance: The covariance of x, y and yaw, shape `(3, 3)`.
        count: The number of particles.
        random: The source of random numbers.
    """
    # The diagonal makes a covariance of zeros positive definite.
    root = np.linalg.cholesky(covariance + 1e-12 * np.eye(3))
    spread: Floats = random.standard_normal((count, 3)) @ root.T
    spread += (pose.x, pose.y, pose.yaw)
    spread[:, 2] = wrap_angles(spread[:, 2])
    return spread
