"""Physics at 120 Hz in the houses: the base drives as accurately as in Tiago's data sheet."""

import math
import threading

import pytest

from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import Pose2D
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World
from btcore_sim.world_description import WorldDescription
from btcore_sim.worlds import load_world_description

SECOND = 1_000_000_000
RATE = 120


@pytest.mark.parametrize("name", ["house", "aws_house"])
def test_a_house_makes_120_steps_a_second(name: str) -> None:
    world = World(load_world_description(name))
    steps: list[int] = []
    world.add_step_callbacks(steps.append, lambda now: None)
    world.wait_until(SECOND, threading.Event())
    world.close()
    assert len(steps) == RATE
    assert steps[-1] == SECOND


@pytest.mark.parametrize(
    ("v", "w", "way", "turn"), [(0.3, 0.0, 0.015, 0.002), (0.0, 0.5, 0.003, 0.006), (0.3, 0.5, 0.008, 0.006)]
)
def test_ten_seconds_of_driving_end_where_commands_lead(v: float, w: float, way: float, turn: float) -> None:
    """*way* (m) and *turn* (rad) are the largest errors; 2.956 m straight, 4.941 rad on the spot."""
    floor = WorldDescription(
        "floor", "", (), (-1, -1, 1, 1), 0.0, Pose2D(0, 0, 0), (0, 0, 0, 255), physics_rate=RATE
    )
    body = SimulatedRobot(World(floor))
    x = y = yaw = 0.0
    step = 1.0 / RATE
    for tick in range(1, 10 * RATE + 1):
        body.drive(v, w)
        body.world.wait_until(tick * SECOND // RATE, threading.Event())
        speed, rate = body.ramped_twist()
        x += speed * step * math.cos(yaw + rate * step / 2)
        y += speed * step * math.sin(yaw + rate * step / 2)
        yaw += rate * step
    pose = body.true_pose()
    body.world.close()
    assert math.dist((pose.x, pose.y), (x, y)) <= way
    assert abs(wrap_angle(pose.yaw - yaw)) <= turn
    if not w:
        assert x == pytest.approx(2.956, abs=0.005)
    if not v:
        assert yaw == pytest.approx(4.941, abs=0.005)
