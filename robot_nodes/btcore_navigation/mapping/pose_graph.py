"""A pose graph: the poses of key scans, determined from measured relative poses.

The sum over all edges of eᵀΩe is minimised, where e is the difference between the relative pose of two poses
and its measurement, by Gauss-Newton steps on sparse normal equations (Grisetti and others, *A tutorial on
graph-based SLAM*, 2010). All edges have their full weight at first, which removes a long drift. Afterwards,
an edge that closes a loop has less weight the more it disagrees with the other edges, which limits the effect
of a wrong loop among correct loops.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve

from btcore_navigation.mapping.pose_arrays import Floats, compose, relative_pose
from btcore_robot.rigid_transform import wrap_angles

Indices = NDArray[np.intp]

_LOOP_SCALES = (math.inf, math.inf, math.inf, math.inf, 1000.0, 300.0, 100.0, 100.0, 100.0, 100.0)
"""For each iteration, the eᵀΩe (χ² of three numbers) at which a loop's edge has a quarter of its weight."""
_MIN_STEP = 1e-4  # m, rad: the iteration ends with a shorter step
_FIXED_WEIGHT = 1e9  # information of the first pose, which must not move


@dataclass(frozen=True, slots=True)
class Edge:
    """A measured *step* (x, y in m, yaw in rad) from the pose *first* to the pose *last* (indices).

    *information* is the inverse covariance of the step, shape `(3, 3)`. *loop* marks an edge that closes a
    loop.
    """

    first: int
    last: int
    step: Floats
    information: Floats
    loop: bool = False


class PoseGraph:
    """Poses (x, y in m, yaw in rad; shape `(n, 3)`) and edges between them. The first pose is fixed."""

    def __init__(self, start: Floats) -> None:
        self.poses: Floats = start[None, :].astype(np.float64)
        self.edges: list[Edge] = []

    def add(self, step: Floats, information: Floats) -> None:
        """Append a pose at *step* relative to the last pose.

        Args:
            step: The relative pose: x, y (m) and yaw (rad).
            information: The inverse covariance of *step*, shape `(3, 3)`.
        """
        last = len(self.poses)
        self.edges.append(Edge(last - 1, last, step, information))
        self.poses = np.vstack((self.poses, compose(self.poses[-1], step)))

    def add_loop_edge(self, first: int, last: int, step: Floats, information: Floats) -> None:
        """Add a measurement that closes a loop. The poses change only at the next call of `optimise`.

        Args:
            first: The index of the reference pose.
            last: The index of the measured pose.
            step: Pose *last* relative to pose *first*: x, y (m) and yaw (rad).
            information: The inverse covariance of *step*, shape `(3, 3)`.
        """
        self.edges.append(Edge(first, last, step, information, loop=True))

    def optimise(self) -> float:
        """Move the poses to fit the edges best, and return the greatest distance (m) that a pose moved."""
        before = self.poses.copy()
        first = np.array([edge.first for edge in self.edges], dtype=np.intp)
        last = np.array([edge.last for edge in self.edges], dtype=np.intp)
        steps = np.array([edge.step for edge in self.edges])
        information = np.array([edge.information for edge in self.edges])
        loops = np.array([edge.loop for edge in self.edges])
        # Loops have their full weight in the first rounds and are weakened afterwards if they disagree.
        for scale in _LOOP_SCALES:
            step = self._step(first, last, steps, information, np.where(loops, scale, math.inf))
            # A short step means convergence only at the last scale: a narrower scale moves the poses again.
            if step < _MIN_STEP and scale == _LOOP_SCALES[-1]:
                break
        return float(np.hypot(*(self.poses - before)[:, :2].T).max())

    def _step(
        self, first: Indices, last: Indices, steps: Floats, information: Floats, scales: Floats
    ) -> float:
        start, end = self.poses[first], self.poses[last]
        error = relative_pose(start, end) - steps
        error[:, 2] = wrap_angles(error[:, 2])
        chi_squared = np.einsum("ei,eij,ej->e", error, information, error)
        # The Geman-McClure kernel; an infinite scale leaves the full weight.
        weight = (1.0 / (1.0 + chi_squared / scales)) ** 2
        by_start, by_end = _jacobians(start, end)
        weighted = information * weight[:, None, None]
        count = len(self.poses)
        blocks: list[Floats] = []
        rows: list[Indices] = []
        cols: list[Indices] = []
        right = np.zeros((count, 3))
        # The normal equations JᵀΩJ·step = -JᵀΩe, assembled from 3 x 3 blocks for each pair of poses.
        for indices, jacobian in ((first, by_start), (last, by_end)):
            left = np.einsum("eji,ejk->eik", jacobian, weighted)
            np.add.at(right, indices, -np.einsum("eij,ej->ei", left, error))
            for other_indices, other_jacobian in ((first, by_start), (last, by_end)):
                blocks.append(np.einsum("eij,ejk->eik", left, other_jacobian))
                rows.append(np.repeat(3 * indices[:, None] + np.arange(3), 3, axis=1).reshape(-1, 3, 3))
                cols.append(np.tile(3 * other_indices[:, None] + np.arange(3), 3).reshape(-1, 3, 3))
        # Unless a pose is fixed, the whole graph could be shifted and turned at no cost.
        first_pose = np.arange(3)
        matrix = coo_matrix(
            (
                np.concatenate([np.concatenate(blocks).ravel(), np.full(3, _FIXED_WEIGHT)]),
                (
                    np.concatenate([np.concatenate(rows).ravel(), first_pose]),
                    np.concatenate([np.concatenate(cols).ravel(), first_pose]),
                ),
            ),
            shape=(3 * count, 3 * count),
        ).tocsc()
        step = np.asarray(spsolve(matrix, right.ravel())).reshape(-1, 3)
        self.poses = self.poses + step
        self.poses[:, 2] = wrap_angles(self.poses[:, 2])
        return float(np.abs(step).max())


def _jacobians(start: Floats, end: Floats) -> tuple[Floats, Floats]:
    """Return the derivatives of `relative_pose` by the start and by the end, shape `(e, 3, 3)` each."""
    cos, sin = np.cos(start[:, 2]), np.sin(start[:, 2])
    x, y = end[:, 0] - start[:, 0], end[:, 1] - start[:, 1]
    by_end = np.zeros((len(start), 3, 3))
    by_end[:, 0, 0], by_end[:, 0, 1] = cos, sin
    by_end[:, 1, 0], by_end[:, 1, 1] = -sin, cos
    by_end[:, 2, 2] = 1.0
    by_start = -by_end
    by_start[:, 0, 2] = cos * y - sin * x
    by_start[:, 1, 2] = -cos * x - sin * y
    return by_start, by_end
