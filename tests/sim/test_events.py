"""Events during a run: their notation, their places and their times."""

import math
import threading

import pytest

from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import Pose2D
from btcore_sim.clearance_map import ClearanceMap
from btcore_sim.errors import SimError
from btcore_sim.events import AHEAD, CLEAR, FAR, SIDE, Event, EventRunner, ahead_of, parse_event
from btcore_sim.obstacles import FROM_WAYPOINTS, PASSAGE
from btcore_sim.quiet_pybullet import pybullet
from btcore_sim.scenario import Scenario
from btcore_sim.scene import load_scene
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World

SECOND = 1_000_000_000


def test_events_are_parsed():
    assert parse_event("box:30") == Event("box", 30 * SECOND, AHEAD, 0.0)
    assert parse_event("box:30.5@2") == Event("box", 30.5 * SECOND, 2.0, 0.0)
    assert parse_event("box:30@2,-0.3") == Event("box", 30 * SECOND, 2.0, -0.3)
    assert parse_event(" kidnap:60 ") == Event("kidnap", 60 * SECOND)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("bx:3", r"did you mean 'box'\? kinds are box, kidnap"),
        ("rain:3", "kinds are box, kidnap"),
        ("box", "use KIND:TIME"),
        ("box:soon", "use KIND:TIME"),
        ("box:-3", "use KIND:TIME"),
        ("box:3@0.5", r"cannot avoid a box that drops 0\.5 m ahead: use 1\.5 m or more"),
        ("kidnap:3@2", "only a box has a distance; use kidnap:3"),
    ],
)
def test_an_invalid_event_raises_with_an_explanation(text: str, said: str):
    with pytest.raises(SimError, match=said):
        parse_event(text)


@pytest.fixture
def meet():
    """A robot in a world in which *events* happen."""
    worlds = []

    def make(
        name: str, *events: str, seed: int = 1, people: int = 0, spare_boxes: int = 0
    ) -> tuple[SimulatedRobot, EventRunner]:
        scenario = Scenario(people, 0, [parse_event(text) for text in events], spare_boxes)
        worlds.append(World(scenario.scene(load_scene(name), seed), seed=seed))
        body = SimulatedRobot(worlds[-1])
        begun = scenario.begin(worlds[-1], body, body.base.radius)
        assert begun is not None
        return body, begun

    yield make
    for world in worlds:
        world.close()


def go(body: SimulatedRobot, seconds: float, v: float = 0.3, w: float = 0.0) -> None:
    end = body.world.now() + round(seconds * SECOND)
    while body.world.now() < end:
        body.drive(v, w)
        body.world.wait_until(body.world.now() + SECOND // 10, threading.Event())


def test_a_box_drops_ahead_and_is_in_the_scan_and_in_the_scene(meet):
    body, events = meet("house", "box:1@1.6,0.1")
    body.teleport(Pose2D(-8.0, -0.5, 0.0))
    number = body.world.kinematic_bodies("dropped_box_")[0]
    go(body, 0.9)
    assert events.event_log == []
    go(body, 0.3)
    (happened,) = events.event_log
    assert (happened["event"], happened["t"]) == ("box", 1.0)
    pose = body.true_pose()
    assert happened["x"] - SIDE / 2 - 0.27 - pose.x == pytest.approx(1.6, abs=0.08)
    assert happened["y"] - pose.y == pytest.approx(0.1, abs=0.02)
    scan = body.scan()
    assert scan.ranges[len(scan.ranges) // 2] == pytest.approx(1.6 + 0.07, abs=0.3)
    frames = {frame[0]: frame for frame in body.scene_moving().frames}
    name = body.world.bodies[number].name
    assert frames[name][2] == pytest.approx([happened["x"], happened["y"], SIDE / 2], abs=1e-3)
    assert name in {part.frame for part in body.scene_static().parts}


def test_a_triggered_box_drops_as_soon_as_the_robot_drives(meet):
    body, events = meet("house", spare_boxes=1)
    body.teleport(Pose2D(-8.0, -0.5, 0.0))
    go(body, 0.5)
    events.trigger("box")
    with pytest.raises(SimError, match="no further box"):
        events.trigger("box")
    go(body, 0.2)
    assert [(event["event"], event["t"]) for event in events.event_log] == [("box", 0.6)]
    with pytest.raises(SimError, match="kinds are box, kidnap"):
        events.trigger("rain")


def test_driving_into_a_dropped_box_is_a_collision(meet):
    body, events = meet("house", "box:1")
    body.teleport(Pose2D(-8.0, -0.5, 0.0))
    go(body, 12.0)
    assert len(events.event_log) == 1
    assert body.contacts.collisions == 1


def test_no_box_drops_in_front_of_a_standing_or_turning_robot(meet):
    body, events = meet("house", "box:0")
    go(body, 2.0, 0.0, 0.0)
    go(body, 2.0, 0.1, 0.5)
    assert events.event_log == []


@pytest.mark.parametrize(
    ("pose", "fits"),
    [
        ((-8.0, -0.5, 0.0), True),
        ((0.0, 0.0, 0.0), False),  # the alcove's wall is 2 m ahead
        ((0.0, -3.0, -math.pi / 2), True),
        ((2.6, 2.55, 0.0), False),  # at the end of the way
        ((-1.0, -12.5, math.pi), False),  # a wall is in between
        ((-5.5, -12.4, 0.0), False),  # into a corner between wall and bookcase
        ((1.0, -10.0, -math.pi / 2), False),  # onto the waypoint
    ],
)
def test_a_box_fits_only_where_there_is_room(meet, pose: tuple[float, float, float], fits: bool):
    body, events = meet("house", "box:100")
    here = Pose2D(*pose)
    box = ahead_of(
        here, 0.27, Event("box", 0.0), body.world.bodies[body.world.kinematic_bodies("dropped")[0]]
    )
    assert events.fits(box, here) == fits


def test_a_box_that_fits_leaves_a_passage_and_is_far_from_waypoints(meet):
    body, events = meet("aws_house", "box:100")
    scene, floor, random = body.world.scene, ClearanceMap.of(body.world.scene), body.world.random("test")
    parked = body.world.bodies[body.world.kinematic_bodies("dropped")[0]]
    found = 0
    for _ in range(300):
        place = floor.random_point(random, 0.4)
        pose = Pose2D(*place, random.uniform(-math.pi, math.pi))
        box = ahead_of(pose, 0.27, Event("box", 0.0), parked)
        if events.fits(box, pose):
            found += 1
            assert box.distance(pose.x, pose.y) - 0.27 == pytest.approx(AHEAD)
            assert all(box.distance(*point) >= FROM_WAYPOINTS for point in scene.waypoints.values())
            after = floor.with_obstacle(box)
            assert after.connected(list(scene.waypoints.values()), 0.32)
            sides = [box_side(pose, box, side) for side in (1.0, -1.0)]
            assert max(scene.clearance_at(*side) for side in sides) >= PASSAGE / 2
    assert found >= 30


def box_side(pose: Pose2D, box, side: float) -> tuple[float, float]:
    """The middle of the passage beside a box on one side of the course."""
    aside = side * (SIDE / 2 + PASSAGE / 2)
    return box.position[0] - math.sin(pose.yaw) * aside, box.position[1] + math.cos(pose.yaw) * aside


@pytest.mark.parametrize("name", ["house", "aws_house"])
@pytest.mark.parametrize("seed", range(5))
def test_a_kidnapped_robot_is_clear_and_far_away_with_unchanged_odometry(meet, name: str, seed: int):
    body, events = meet(name, "kidnap:2", seed=seed)
    go(body, 1.9, 0.1, 0.0)
    before, odometry, way = body.true_pose(), body.odometry().pose, body.distance
    go(body, 0.2, 0.1, 0.0)
    (happened,) = events.event_log
    assert (happened["event"], happened["t"]) == ("kidnap", 2.0)
    after = body.true_pose()
    assert math.dist((before.x, before.y), (after.x, after.y)) > FAR
    assert body.world.scene.clearance_at(after.x, after.y) >= body.base.radius + CLEAR - 0.05
    assert math.dist((odometry.x, odometry.y), (body.odometry().pose.x, body.odometry().pose.y)) < 0.06
    assert body.distance - way < 0.06
    assert (body.contacts.collisions, body.contacts.grazes) == (0, 0)
    go(body, 1.0, 0.1, 0.0)
    moved = body.true_pose()
    assert math.dist((after.x, after.y), (moved.x, moved.y)) == pytest.approx(0.1, abs=0.04)
    assert math.atan2(moved.y - after.y, moved.x - after.x) == pytest.approx(moved.yaw, abs=0.1)


def test_a_standing_robot_is_not_kidnapped(meet):
    body, events = meet("house", "kidnap:1")
    go(body, 3.0, 0.0, 0.0)
    assert events.event_log == []


def test_a_person_is_in_the_scan_and_keeps_away_from_a_standing_robot(meet):
    body, _ = meet("arena", "kidnap:1000", people=1)
    (number,) = body.world.kinematic_bodies("person_")
    hits = 0
    for _ in range(300):
        body.world.wait_until(body.world.now() + SECOND // 10, threading.Event())
        scan, pose = body.scan(), body.true_pose()
        (x, y, _), _ = pybullet.getBasePositionAndOrientation(number, physicsClientId=body.world.client)
        laser = (pose.x + 0.202 * math.cos(pose.yaw), pose.y + 0.202 * math.sin(pose.yaw))
        bearing = wrap_angle(math.atan2(y - laser[1], x - laser[0]) - pose.yaw)
        ray = round((bearing - scan.angle_min) / scan.angle_increment)
        if 0 <= ray < len(scan.ranges):
            assert scan.ranges[ray] == pytest.approx(math.dist(laser, (x, y)) - 0.25, abs=0.3)
            hits += 1
    assert hits > 20
    assert (body.contacts.collisions, body.contacts.grazes) == (0, 0)


@pytest.mark.parametrize("side", range(8))
def test_a_person_who_walks_into_the_robot_is_a_collision_from_every_side(meet, side: int):
    body, _ = meet("aws_house", "kidnap:1000", people=1)
    (number,) = body.world.kinematic_bodies("person_")
    begun = body.world.now()
    around = side * math.pi / 4
    for step in range(24):
        away = 1.0 - 0.025 * step
        x, y = away * math.cos(around), away * math.sin(around)
        body.world.move_kinematic_body(number, x, y, wrap_angle(around + math.pi), v=0.5)
        body.world.wait_until(begun + (step + 1) * SECOND // 20, threading.Event())
    assert (body.contacts.collisions, body.contacts.grazes) == (1, 0)
