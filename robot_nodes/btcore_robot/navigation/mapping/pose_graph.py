"""A pose graph: where key scans were taken, from how each two of them lie to one another.

What is minimised is the sum over all edges of eᵀΩe, with e the difference between how two poses lie and how
they were measured to lie, by Gauss-Newton steps on sparse normal equations (Grisetti and others, *A tutorial
on graph-based SLAM*, 2010). At first all edges count in full; then those that close a loop weigh less the
more they still disagree. So a long drift is taken out, and one wrong loop among right ones does little.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve

from btcore_robot.navigation.mapping.pose_arrays import Floats, compose, relative_pose
from btcore_robot.rigid_transform import wrap_angles

Indices = NDArray[np.intp]

_BEARABLE = (math.inf, math.inf, math.inf, math.inf, 1000.0, 300.0, 100.0, 100.0, 100.0, 100.0)
"""The eᵀΩe (χ² of three numbers) at which a loop's edge counts a quarter, step by step."""
_ENOUGH = 1e-4  # a step shorter than this (m, rad) is the last
_FIXED = 1e9


@dataclass(frozen=True, slots=True)
class Edge:
    """Pose *last* was measured to be at *step* as seen from *first*; *information* is of x, y, yaw there."""

    first: int
    last: int
    step: Floats
    information: Floats
    loop: bool = False


class PoseGraph:
    """Poses, ``(n, 3)``, that `add` appends to, and edges between them. The first one stays where it is."""

    def __init__(self, start: Floats) -> None:
        self.poses: Floats = start[None, :].astype(np.float64)
        self.edges: list[Edge] = []

    def add(self, step: Floats, information: Floats) -> None:
        """Append a pose that lies at *step* as seen from the last one."""
        last = len(self.poses)
        self.edges.append(Edge(last - 1, last, step, information))
        self.poses = np.vstack((self.poses, compose(self.poses[-1], step)))

    def close(self, first: int, last: int, step: Floats, information: Floats) -> None:
        """Measure two poses, which need not follow each other, to lie so; `optimise` makes use of it."""
        self.edges.append(Edge(first, last, step, information, loop=True))

    def optimise(self) -> float:
        """Move the poses to where the edges agree best; how far (m) the one moved that moved most."""
        before = self.poses.copy()
        first = np.array([edge.first for edge in self.edges], dtype=np.intp)
        last = np.array([edge.last for edge in self.edges], dtype=np.intp)
        steps = np.array([edge.step for edge in self.edges])
        certain = np.array([edge.information for edge in self.edges])
        loops = np.array([edge.loop for edge in self.edges])
        for bearable in _BEARABLE:
            moved = self._step(first, last, steps, certain, np.where(loops, bearable, math.inf))
            if moved < _ENOUGH and bearable == _BEARABLE[-1]:
                break
        return float(np.hypot(*(self.poses - before)[:, :2].T).max())

    def _step(self, first: Indices, last: Indices, steps: Floats, certain: Floats, bearable: Floats) -> float:
        start, end = self.poses[first], self.poses[last]
        error = relative_pose(start, end) - steps
        error[:, 2] = wrap_angles(error[:, 2])
        tension = np.einsum("ei,eij,ej->e", error, certain, error)
        weight = (1.0 / (1.0 + tension / bearable)) ** 2
        by_start, by_end = _slopes(start, end)
        weighed = certain * weight[:, None, None]
        count = len(self.poses)
        blocks: list[Floats] = []
        rows: list[Indices] = []
        cols: list[Indices] = []
        right = np.zeros((count, 3))
        for one, slope in ((first, by_start), (last, by_end)):
            left = np.einsum("eji,ejk->eik", slope, weighed)
            np.add.at(right, one, -np.einsum("eij,ej->ei", left, error))
            for other, further in ((first, by_start), (last, by_end)):
                blocks.append(np.einsum("eij,ejk->eik", left, further))
                rows.append(np.repeat(3 * one[:, None] + np.arange(3), 3, axis=1).reshape(-1, 3, 3))
                cols.append(np.tile(3 * other[:, None] + np.arange(3), 3).reshape(-1, 3, 3))
        ties = np.arange(3)
        matrix = coo_matrix(
            (
                np.concatenate([np.concatenate(blocks).ravel(), np.full(3, _FIXED)]),
                (
                    np.concatenate([np.concatenate(rows).ravel(), ties]),
                    np.concatenate([np.concatenate(cols).ravel(), ties]),
                ),
            ),
            shape=(3 * count, 3 * count),
        ).tocsc()
        step = np.asarray(spsolve(matrix, right.ravel())).reshape(-1, 3)
        self.poses = self.poses + step
        self.poses[:, 2] = wrap_angles(self.poses[:, 2])
        return float(np.abs(step).max())


def _slopes(start: Floats, end: Floats) -> tuple[Floats, Floats]:
    """How `relative_pose` changes with the start and with the end, ``(e, 3, 3)`` each."""
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
