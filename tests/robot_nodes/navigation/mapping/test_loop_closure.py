"""The detector of loop closures: how far from the estimate it searches for the true pose."""

from dataclasses import replace

import numpy as np
import pytest

from btcore_navigation.mapping.loop_closure import MIN_CHAIN, LoopClosureDetector
from btcore_navigation.mapping.pose_arrays import pose_to_row
from btcore_navigation.mapping.pose_graph import PoseGraph
from btcore_robot.robot import Pose2D
from tests.robot_nodes.navigation.mapping.conftest import ROOM, key_scan_at


def test_the_search_is_narrow_soon_after_a_loop_was_closed() -> None:
    old = [Pose2D(0.1 * index, 0.0, 0.7 * index) for index in range(MIN_CHAIN)]
    scans = [key_scan_at(ROOM, pose, seed) for seed, pose in enumerate(old)]
    scans.append(replace(key_scan_at(ROOM, Pose2D(0.2, 0.1, 0.3), 20), travelled=30.0))
    graph = PoseGraph(pose_to_row(old[0]))

    def estimate(error: float) -> None:
        graph.poses = np.array([pose_to_row(pose) for pose in (*old, Pose2D(0.2 + error, 0.1, 0.3))])

    # After 30 m without a correction, 0.4 m are searched.
    detector = LoopClosureDetector()
    estimate(0.4)
    closure = detector.find(scans, graph)
    assert closure is not None
    assert closure[1].pose == pytest.approx((0.2, 0.1, 0.3), abs=0.05)
    # After 2 m, 0.4 m are too far.
    scans[-1] = replace(scans[-1], travelled=32.0)
    assert detector.find(scans, graph) is None
    scans[-1] = replace(scans[-1], travelled=34.0)
    estimate(0.1)
    assert detector.find(scans, graph) is not None
