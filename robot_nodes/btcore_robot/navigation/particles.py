"""A cloud of particles: how many it needs, which survive, and what the largest cluster of them says."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from btcore_robot.rigid_transform import wrap_angle, wrap_angles
from btcore_robot.robot import Pose2D

Floats = NDArray[np.float64]

BIN_LENGTH = 0.5
"""The side (m) of a bin of the histogram that KLD sampling counts (nav2_amcl)."""
BIN_TURN = math.radians(10.0)
"""Its extent in yaw (rad)."""

_TURNS = round(2.0 * math.pi / BIN_TURN)
_ROOM = 1 << 14  # bins along x and y on either side of 0: ±8 km
_TOUCHING = np.ones((3, 3, 3), dtype=np.int8)


@dataclass(frozen=True, slots=True)
class Cluster:
    """Particles that touch one another: weighted mean, *covariance* (x, y, yaw), share of the weight."""

    pose: Pose2D
    covariance: Floats
    weight: float


def sample_size(bins: int, err: float, z: float, least: int, most: int) -> int:
    """How many particles KLD sampling asks for when *bins* of the histogram are occupied (Fox 2003).

    With the quantile *z* as it is in nav2_amcl, the divergence of the sample from the true distribution stays
    below *err*. One bin tells nothing: then it is *most*.
    """
    if bins <= 1:
        return most
    spread = 2.0 / (9.0 * (bins - 1))
    wanted = math.ceil((bins - 1) / (2.0 * err) * (1.0 - spread + math.sqrt(spread) * z) ** 3)
    return max(least, min(most, wanted))


def resampled(
    particles: Floats,
    weights: Floats,
    random: np.random.Generator,
    *,
    err: float,
    z: float,
    least: int,
    most: int,
) -> Floats:
    """As many particles as KLD sampling asks for, each drawn by its weight (systematic resampling).

    *weights* sum to 1. A sample of *most* is drawn first, in random order, and read until it is as long as
    its occupied bins ask for; then one of that length is drawn.
    """
    drawn = _systematic(weights, most, random)
    order = random.permutation(most)
    keys = _bins(particles)[drawn[order]]
    # The size asked for changes only where a bin is seen for the first time.
    first = np.sort(np.unique(keys, return_index=True)[1]).tolist()
    size = most
    for occupied, (start, end) in enumerate(pairwise([*first, most]), 1):
        wanted = sample_size(occupied, err, z, least, most)
        if wanted <= end:
            size = max(wanted, start + 1)
            break
    return particles[_systematic(weights, size, random)]


def _systematic(weights: Floats, count: int, random: np.random.Generator) -> NDArray[np.intp]:
    """*count* indices, each as often as its weight says, rounded up or down."""
    sums = np.cumsum(weights)
    places = (random.random() + np.arange(count)) * (sums[-1] / count)
    found: NDArray[np.intp] = np.searchsorted(sums, places, side="right")
    return np.minimum(found, len(weights) - 1)


def _bins(particles: Floats) -> NDArray[np.int64]:
    """The number of each particle's bin."""
    across = np.floor(particles[:, 0] / BIN_LENGTH).astype(np.int64) + _ROOM
    along = np.floor(particles[:, 1] / BIN_LENGTH).astype(np.int64) + _ROOM
    turn = np.floor(particles[:, 2] / BIN_TURN).astype(np.int64) % _TURNS
    return (across * (2 * _ROOM) + along) * _TURNS + turn


def best_cluster(particles: Floats, weights: Floats) -> Cluster:
    """The heaviest cluster: particles whose bins touch, corners included.

    Turns are counted from the cloud's mean heading, so that a cluster is cut, if at all, at its back.
    """
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
    mine = labels[where]
    sums = np.bincount(mine, weights=weights)
    chosen = int(np.argmax(sums))
    inside = mine == chosen
    return _summary(particles[inside], turns[inside], weights[inside], mean)


def _summary(particles: Floats, turns: Floats, weights: Floats, heading: float) -> Cluster:
    total = float(weights.sum())
    share = weights / total
    rows = np.stack((particles[:, 0], particles[:, 1], turns))
    middle = rows @ share
    off = rows - middle[:, None]
    yaw = wrap_angle(heading + middle[2])
    return Cluster(Pose2D(float(middle[0]), float(middle[1]), yaw), (off * share) @ off.T, total)


def cloud(pose: Pose2D, covariance: Floats, count: int, random: np.random.Generator) -> Floats:
    """*count* particles about *pose* with *covariance* (x, y, yaw)."""
    root = np.linalg.cholesky(covariance + 1e-12 * np.eye(3))
    spread: Floats = random.standard_normal((count, 3)) @ root.T
    spread += (pose.x, pose.y, pose.yaw)
    spread[:, 2] = wrap_angles(spread[:, 2])
    return spread
