"""The pose graph on a loop: exact measurements give exact poses, and errors are distributed."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from btcore_navigation.mapping.pose_arrays import Floats, compose, relative_pose
from btcore_navigation.mapping.pose_graph import PoseGraph

SURE = np.diag((1e4, 1e4, 1e5))


def circle(count: int = 40, radius: float = 5.0) -> Floats:
    """Return poses along a circle, back to the first."""
    angles = np.linspace(0.0, math.tau, count + 1)
    poses = np.stack((radius * np.sin(angles), radius * (1 - np.cos(angles)), angles), axis=1)
    return np.asarray(compose(np.zeros(3), poses))


def driven(true: Floats, noise: Floats) -> PoseGraph:
    """Return a graph of the steps between *true* poses, each with *noise*."""
    graph = PoseGraph(true[0])
    for start, end, error in zip(true[:-1], true[1:], noise, strict=True):
        graph.add(relative_pose(start, end) + error, SURE)
    return graph


def largest_error(graph: PoseGraph, true: Floats) -> float:
    return float(np.hypot(*(graph.poses - true)[:, :2].T).max())


def test_a_closed_loop_distributes_the_error() -> None:
    true = circle()
    noise = np.tile((0.01, 0.004, 0.01), (len(true) - 1, 1))
    graph = driven(true, noise)
    before = largest_error(graph, true)
    graph.add_loop_edge(0, len(true) - 1, np.zeros(3), SURE)
    moved = graph.optimise()
    assert before > 1.0
    assert moved > 0.5 * before
    assert largest_error(graph, true) < 0.35 * before
    assert np.hypot(*graph.poses[-1, :2]) < 0.05
    assert graph.poses[0] == pytest.approx(true[0], abs=1e-6)


@given(seed=st.integers(0, 10_000), count=st.integers(4, 30))
def test_exact_measurements_are_reproduced(seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    steps = random.uniform((-0.5, -0.3, -0.8), (1.0, 0.3, 0.8), (count, 3))
    true = [random.uniform(-3.0, 3.0, 3)]
    for step in steps:
        true.append(compose(true[-1], step))
    poses = np.array(true)
    graph = driven(poses, np.zeros((count, 3)))
    graph.add_loop_edge(0, count, relative_pose(poses[0], poses[count]), SURE)
    graph.poses[1:] += random.normal(0.0, 0.05, (count, 3))
    graph.optimise()
    assert largest_error(graph, poses) < 1e-3


def test_consistent_measurements_move_no_pose() -> None:
    true = circle()
    graph = driven(true, np.zeros((len(true) - 1, 3)))
    graph.add_loop_edge(0, len(true) - 1, np.zeros(3), SURE)
    assert graph.optimise() < 1e-6


def test_a_single_wrong_loop_edge_has_little_effect() -> None:
    true = circle()
    last = len(true) - 1
    graph = driven(true, np.zeros((last, 3)))
    for back in range(3):
        graph.add_loop_edge(back, last - back, relative_pose(true[back], true[last - back]), SURE)
    graph.add_loop_edge(5, 25, relative_pose(true[5], true[25]) + np.array((1.5, 0.0, 0.0)), SURE)
    graph.optimise()
    assert largest_error(graph, true) < 0.1
