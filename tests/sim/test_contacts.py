"""Contacts: when they count as events, and when as collisions."""

import math
from dataclasses import replace

import pybullet
import pytest

from tests.sim.conftest import MakeObject, RobotAt, Steer

WALL = (0.2, 8.0, 2.2)


def test_a_contact_is_one_event_until_it_has_ended_for_half_a_second(
    robot_at: RobotAt, steer: Steer, box: MakeObject
) -> None:
    body = robot_at(box(1.1, 0.0, WALL))
    steer(body, 4.0, (0.3, 0.0))
    assert (body.contacts.collisions, body.contacts.grazes) == (1, 0)
    assert body.contacts.events[0].speed == pytest.approx(0.3, abs=0.02)
    steer(body, 6.0, (0.3, 0.0))
    assert len(body.contacts.events) == 1
    steer(body, 2.0, (-0.2, 0.0))
    steer(body, 4.0, (0.3, 0.0))
    assert (body.contacts.collisions, body.contacts.grazes) == (2, 0)
    # A lasting contact is not counted again.
    body.contacts.reset()
    assert (body.contacts.collisions, body.contacts.grazes) == (0, 0)
    steer(body, 1.0, (0.3, 0.0))
    assert body.contacts.events == []


def test_scraping_along_a_wall_at_nine_degrees_is_a_graze(
    robot_at: RobotAt, steer: Steer, box: MakeObject
) -> None:
    body = robot_at(box(0.45, 0.0, WALL), pose=(0.0, -3.0, math.radians(90 - 9)))
    steer(body, 6.0, (0.3, 0.0))
    assert (body.contacts.collisions, body.contacts.grazes) == (0, 1)
    assert body.contacts.events[0].speed == pytest.approx(0.3 * math.sin(math.radians(9)), abs=0.01)


def test_contact_with_the_floor_does_not_count(robot_at: RobotAt, steer: Steer) -> None:
    body = robot_at()
    steer(body, 2.0, (1.0, 1.0))
    assert body.contacts.events == []


def test_contacts_with_two_objects_are_two_events(robot_at: RobotAt, steer: Steer, box: MakeObject) -> None:
    body = robot_at(
        box(1.1, 0.3, (0.2, 0.4, 1.0), name="left"), box(1.1, -0.3, (0.2, 0.4, 1.0), name="right")
    )
    steer(body, 4.0, (0.3, 0.0))
    assert len({event.body for event in body.contacts.events}) == 2


def test_a_table_top_above_the_base_is_hit_by_the_torso(
    robot_at: RobotAt, steer: Steer, box: MakeObject
) -> None:
    top = box(1.2, 0.0, (0.8, 2.0, 0.1))
    body = robot_at(replace(top, position=(1.2, 0.0, 0.6)))
    steer(body, 5.0, (0.3, 0.0))
    assert body.contacts.collisions == 1
    assert body.true_pose().x > 0.8 - 0.27 + 0.05


def test_pushed_sideways_hull_touches_at_radius(robot_at: RobotAt, box: MakeObject) -> None:
    """The wheels reach farther out than the hull, and don't count. There is no friction to hold the robot."""
    face = 0.32
    body = robot_at(box(0.0, face + 0.1, (8.0, 0.2, 2.2)))
    pybullet.changeDynamics(body.world.floor, -1, lateralFriction=0.0, physicsClientId=body.world.client)
    while not body.contacts.events:
        pybullet.resetBaseVelocity(
            body.physics_body.body_id, [0.0, 0.05, 0.0], [0.0, 0.0, 0.0], physicsClientId=body.world.client
        )
        body.world.schedule.run_next()
        assert body.true_pose().y < face, "the robot went through the wall"
    assert body.true_pose().y > 0.03, "the robot touched before it moved"
    assert face - body.true_pose().y == pytest.approx(0.27, abs=0.005)


def test_a_light_box_that_is_pushed_away_counts_once(
    robot_at: RobotAt, steer: Steer, box: MakeObject
) -> None:
    body = robot_at(box(0.8, 0.0, (0.3, 0.3, 0.3), mass=2.0))
    steer(body, 3.0, (0.3, 0.0))
    assert body.contacts.collisions == 1
    assert body.true_pose().x > 0.5
