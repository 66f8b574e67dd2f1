"""The navigation keeps the clearance of the robot that it drives: robots of three sizes at a gap."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from btcore.bundled_trees import folder
from btcore.clock import NS_PER_S
from btcore_navigation.action import GoalStatus
from btcore_navigation.controller import FollowPathGoal
from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_navigation.navigator import NavigateGoal
from btcore_navigation.parameters import NavigationParameters
from btcore_navigation.stack import Navigation
from btcore_robot.occupancy_map import OccupancyMap
from btcore_robot.robot import Pose2D
from tests.robot_nodes.navigation.conftest import polyline_path, rig_on_floor

TURTLEBOT, TIAGO, WIDE = 0.18, 0.27, 0.45
"""The radii (m) of a robot like TurtleBot 4, of Tiago, and of a wide robot."""


def boxes_around_gap(width: float) -> tuple[tuple[float, ...], ...]:
    """Return a corridor, closed at both ends, with a wall in its middle that has a gap of *width* (m).

    The edges of the gap are in the middle of cells of the costmaps: noise does not change their cells.
    """
    left, right = width / 2 + 0.025, 0.025 - width / 2
    return (
        (1.5, left, 1.6, 1.0),
        (1.5, -1.0, 1.6, right),
        (-1.0, 1.0, 4.0, 1.1),
        (-1.0, -1.1, 4.0, -1.0),
        (-1.1, -1.1, -1.0, 1.1),
        (4.0, -1.1, 4.1, 1.1),
    )


def map_of(boxes: tuple[tuple[float, ...], ...]) -> OccupancyMap:
    cells = np.zeros((60, 120), dtype=np.int8)
    for x0, y0, x1, y1 in boxes:
        rows = slice(round((y0 + 1.5) / 0.05), round((y1 + 1.5) / 0.05))
        cells[rows, round((x0 + 1.5) / 0.05) : round((x1 + 1.5) / 0.05)] = 100
    return OccupancyMap(cells, 0.05, (-1.5, -1.5))


@pytest.mark.parametrize(
    ("radius", "gap", "passes"),
    [(TURTLEBOT, 0.5, True), (TIAGO, 0.5, False), (TIAGO, 0.8, True), (WIDE, 0.8, False)],
)
def test_a_robot_passes_only_a_gap_that_is_wide_enough_for_it(
    radius: float, gap: float, passes: bool
) -> None:
    boxes = boxes_around_gap(gap)
    robot = rig_on_floor(*boxes).robot
    robot.info = replace(robot.info, radius=radius)
    robot._sigma = 0.01
    navigation = Navigation(robot, map_of(boxes), np.random.default_rng(1), folder())
    # A tree without recoveries: it fails as soon as there is no path.
    tree = "navigate_w_replanning_time.xml"
    handle = navigation.navigate_to_pose.send_goal(NavigateGoal((Pose2D(2.5, 0.0, 0.0),), tree))

    def run(seconds: float) -> None:
        end = robot.clock.now() + round(seconds * NS_PER_S)
        while robot.clock.now() < end and not handle.done:
            robot.clock.wait_until(robot.clock.now() + NS_PER_S // 10, threading.Event())

    run(60.0)
    assert robot.nearest > 0.0
    assert handle.status is (GoalStatus.SUCCEEDED if passes else GoalStatus.ABORTED)
    if not passes:
        assert handle.result.code == Nav2ErrorCode.NO_VALID_PATH
        # The controller refuses the gap, too, even if it is commanded to drive through.
        handle = navigation.servers.follow_path.send_goal(
            FollowPathGoal(polyline_path((0.0, 0.0), (2.5, 0.0)))
        )
        run(60.0)
        assert handle.status is GoalStatus.ABORTED
        assert robot.pose.x < 1.5
        assert robot.nearest > 0.0


def test_a_radius_that_is_too_small_for_the_robot_is_replaced_with_a_warning(
    caplog: pytest.LogCaptureFixture,
) -> None:
    boxes = boxes_around_gap(0.8)
    figures = NavigationParameters()
    small = replace(figures, global_costmap=replace(figures.global_costmap, robot_radius=0.22))
    navigation = Navigation(
        rig_on_floor(*boxes).robot, map_of(boxes), np.random.default_rng(1), folder(), small
    )
    assert navigation.parameters.global_costmap.robot_radius == 0.3
    assert caplog.messages == ["global_costmap: the radius 0.22 m is too small for the robot: 0.3 m is used"]
