"""Events during a run: their notation, their places and their times."""

import itertools
import json
import math
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import Pose2D
from btcore_sim.clearance_map import ClearanceMap
from btcore_sim.errors import SimError
from btcore_sim.events import (
    AHEAD,
    CARRYING_SPEED,
    CLEAR,
    FAR,
    PASSAGE,
    SIDE,
    Event,
    EventRunner,
    ahead_of,
    check_events,
    parse_event,
)
from btcore_sim.faults import parse_fault
from btcore_sim.obstacles import FROM_WAYPOINTS
from btcore_sim.quiet_pybullet import pybullet
from btcore_sim.scenario import Scenario
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World
from btcore_sim.world_description import WorldObject
from btcore_sim.worlds import load_world_description

SECOND = 1_000_000_000


@pytest.mark.parametrize(
    ("text", "event"),
    [
        ("box:30", Event("box", 30 * SECOND)),
        ("box:30.5@0.8", Event("box", 30_500_000_000, None, 0.8, 0.0)),
        ("box:30-60@2,-0.3", Event("box", 30 * SECOND, 60 * SECOND, 2.0, -0.3)),
        (" kidnap:60 ", Event("kidnap", 60 * SECOND)),
        ("carry:60-90", Event("carry", 60 * SECOND, 90 * SECOND)),
        ("door:the kitchen:open@20", Event("door", 20 * SECOND, door="the kitchen", opens=True)),
        ("door:a:b:close@0.5", Event("door", SECOND // 2, door="a:b", opens=False)),
    ],
)
def test_events_are_parsed_and_shown_in_the_same_form(text: str, event: Event) -> None:
    assert parse_event(text) == event
    assert parse_event(str(event)) == event


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("bx:3", r"kinds are box, kidnap, carry, door; did you mean 'box'\?"),
        ("rain:3", "unknown kind 'rain': kinds are box"),
        ("box", r"use box:TIME\[@AHEAD\[,LEFT\]\], with TIME in s, like box:30, or box:30@2,0.3"),
        ("box:soon", "use box:TIME"),
        ("box:-3", "use box:TIME"),
        ("box:3@-1", "use box:TIME"),
        ("box:30-20", "the window ends before it begins"),
        ("kidnap:3@2", "only a box has a place; use kidnap:3"),
        ("door:kitchen:open", "use door:NAME:open@TIME or door:NAME:close@TIME"),
        ("door:kitchen:opn@3", "unknown action 'opn': a door can open or close; did you mean 'open'"),
    ],
)
def test_an_invalid_event_raises_with_an_explanation(text: str, message: str) -> None:
    with pytest.raises(SimError, match=message):
        parse_event(text)


@pytest.mark.parametrize(
    ("text", "duration", "message"),
    [
        ("box:30", 20.0, r"event 'box:30' is after the end of the run \(--duration 20\)"),
        ("door:kitchen:open@3", None, "'door:kitchen:open@3': world 'house': there is no door 'kitchen'"),
    ],
)
def test_event_that_cannot_happen_in_run_raises(text: str, duration: float | None, message: str) -> None:
    with pytest.raises(SimError, match=message):
        check_events([parse_event(text)], load_world_description("house"), duration)


@pytest.fixture
def meet() -> Iterator[Callable[..., Any]]:
    """A robot in a world in which *events* happen."""
    worlds = []

    def make(
        name: str, *events: str, seed: int = 1, people: int = 0, spare_boxes: int = 0, faults: str = ""
    ) -> tuple[SimulatedRobot, EventRunner]:
        scenario = Scenario(people, 0, [parse_event(text) for text in events], spare_boxes)
        worlds.append(World(scenario.add_to(load_world_description(name), seed, 0.27), seed=seed))
        body = SimulatedRobot(worlds[-1], faults=[parse_fault(faults)] if faults else [])
        begun = scenario.begin(worlds[-1], body, body.base_info.radius)
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


def test_a_box_drops_ahead_and_is_in_the_scan_and_in_the_scene(meet: Callable[..., Any]) -> None:
    body, events = meet("house", "box:1@1.6,0.1")
    body.kidnap(Pose2D(-8.0, -0.5, 0.0))
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
    frames = {frame[0]: frame for frame in body.moving_scene().frames}
    name = body.world.bodies[number].name
    assert frames[name][2] == pytest.approx([happened["x"], happened["y"], SIDE / 2], abs=1e-3)
    assert name in {part.frame for part in body.static_scene().parts}


def test_a_triggered_box_drops_at_once(meet: Callable[..., Any]) -> None:
    body, events = meet("house", spare_boxes=1)
    body.kidnap(Pose2D(-8.0, -0.5, 0.0))
    go(body, 0.5, 0.0)
    events.trigger("box")
    assert [(event["event"], event["t"]) for event in events.event_log] == [("box", 0.5)]
    with pytest.raises(SimError, match="no further box"):
        events.trigger("box")
    with pytest.raises(SimError, match="kinds are box, kidnap, carry"):
        events.trigger("rain")


@pytest.mark.parametrize(
    ("pose", "event", "message"),
    [
        (Pose2D(0.0, 0.0, 0.0), "box:1", r"'box:1' is not possible: 'wall_.*; a window, like box:30-60"),
        (Pose2D(-8.0, -0.5, 0.0), "box:1@0,0", "the robot is where the box would drop"),
        (Pose2D(-8.0, -0.5, 0.0), "box:1@0.3,0.2", None),
    ],
)
def test_box_drops_at_time_and_place_or_raises(
    meet: Callable[..., Any], pose: Pose2D, event: str, message: str | None
) -> None:
    body, events = meet("house", event)
    body.kidnap(pose)
    if message is not None:
        with pytest.raises(SimError, match=message):
            go(body, 1.5, 0.0)
        return
    go(body, 1.5, 0.0, 0.0)
    (happened,) = events.event_log
    parsed = parse_event(event)
    assert happened["x"] == pytest.approx(pose.x + 0.27 + parsed.distance + SIDE / 2, abs=0.02)
    assert happened["y"] == pytest.approx(pose.y + parsed.offset, abs=0.02)


def test_a_second_box_does_not_drop_into_the_first(meet: Callable[..., Any]) -> None:
    body, _ = meet("house", "box:1", "box:1.5")
    body.kidnap(Pose2D(-8.0, -0.5, 0.0))
    with pytest.raises(SimError, match="'dropped_box_0' is where the box would drop"):
        go(body, 2.0, 0.0)


def test_driving_into_a_dropped_box_is_a_collision(meet: Callable[..., Any]) -> None:
    body, events = meet("house", "box:1")
    body.kidnap(Pose2D(-8.0, -0.5, 0.0))
    go(body, 12.0)
    assert len(events.event_log) == 1
    assert body.contacts.collisions == 1


def test_a_box_with_a_window_waits_for_a_robot_that_drives_straight(meet: Callable[..., Any]) -> None:
    body, events = meet("house", "box:0-20")
    body.kidnap(Pose2D(-8.0, -0.5, 0.0))
    go(body, 1.0, 0.0, 0.0)
    go(body, 1.0, 0.1, 0.5)
    assert events.event_log == []
    assert [str(event) for event in events.pending] == ["box:0-20"]
    body.kidnap(Pose2D(-8.0, -0.5, 0.0))
    go(body, 1.0)
    assert len(events.event_log) == 1
    assert events.pending == []


@pytest.mark.parametrize("kind", ["box", "kidnap"])
def test_a_window_without_a_suitable_moment_ends_with_an_error(meet: Callable[..., Any], kind: str) -> None:
    body, _ = meet("house", f"{kind}:0.5-1.5")
    go(body, 1.4, 0.0, 0.0)
    with pytest.raises(SimError, match=rf"'{kind}:0\.5-1\.5' is not possible: in this time the robot was"):
        go(body, 0.2, 0.0, 0.0)


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
def test_a_box_fits_only_where_there_is_room(
    meet: Callable[..., Any], pose: tuple[float, float, float], fits: bool
) -> None:
    body, events = meet("house", "box:100")
    here = Pose2D(*pose)
    box = ahead_of(here, 0.27, Event("box", 0), body.world.bodies[body.world.kinematic_bodies("dropped")[0]])
    assert events.fits(box, here) == fits


def test_a_box_that_fits_leaves_a_passage_and_is_far_from_waypoints(meet: Callable[..., Any]) -> None:
    body, events = meet("aws_house", "box:100")
    description, floor, random = (
        body.world.description,
        ClearanceMap.of(body.world.description),
        body.world.random("test"),
    )
    parked = body.world.bodies[body.world.kinematic_bodies("dropped")[0]]
    found = 0
    for _ in range(300):
        place = floor.random_point(random, 0.4)
        pose = Pose2D(*place, random.uniform(-math.pi, math.pi))
        box = ahead_of(pose, 0.27, Event("box", 0), parked)
        if events.fits(box, pose):
            found += 1
            assert box.distance(pose.x, pose.y) - 0.27 == pytest.approx(AHEAD)
            assert all(box.distance(*point) >= FROM_WAYPOINTS for point in description.waypoints.values())
            after = floor.with_obstacle(box)
            assert after.connected(list(description.waypoints.values()), 0.32)
            sides = [box_side(pose, box, side) for side in (1.0, -1.0)]
            assert max(description.clearance_at(*side) for side in sides) >= PASSAGE / 2
    assert found >= 30


def box_side(pose: Pose2D, box: WorldObject, side: float) -> tuple[float, float]:
    """The middle of the passage beside a box on one side of the course."""
    aside = side * (SIDE / 2 + PASSAGE / 2)
    return box.position[0] - math.sin(pose.yaw) * aside, box.position[1] + math.cos(pose.yaw) * aside


@pytest.mark.parametrize("name", ["house", "aws_house"])
@pytest.mark.parametrize("seed", range(2))
def test_a_kidnapped_robot_is_clear_and_far_away_with_unchanged_odometry(
    meet: Callable[..., Any], name: str, seed: int
) -> None:
    body, events = meet(name, "kidnap:2", seed=seed)
    go(body, 1.9, 0.1, 0.0)
    before, odometry, way = body.true_pose(), body.odometry().pose, body.distance
    go(body, 0.2, 0.1, 0.0)
    (happened,) = events.event_log
    assert (happened["event"], happened["t"]) == ("kidnap", 2.0)
    after = body.true_pose()
    assert math.dist((before.x, before.y), (after.x, after.y)) > FAR
    assert body.world.description.clearance_at(after.x, after.y) >= body.base_info.radius + CLEAR - 0.05
    assert math.dist((odometry.x, odometry.y), (body.odometry().pose.x, body.odometry().pose.y)) < 0.06
    assert body.distance - way < 0.06
    assert (body.contacts.collisions, body.contacts.grazes) == (0, 0)
    go(body, 1.0, 0.1, 0.0)
    moved = body.true_pose()
    assert math.dist((after.x, after.y), (moved.x, moved.y)) == pytest.approx(0.1, abs=0.04)
    assert math.atan2(moved.y - after.y, moved.x - after.x) == pytest.approx(moved.yaw, abs=0.1)


def test_a_standing_and_blind_robot_is_kidnapped_at_its_time(meet: Callable[..., Any]) -> None:
    body, events = meet("house", "kidnap:1.23", faults="laser:0-10")
    before = body.true_pose()
    go(body, 1.5, 0.0, 0.0)
    assert [(event["event"], event["t"]) for event in events.event_log] == [("kidnap", 1.23)]
    assert math.dist((before.x, before.y), (body.true_pose().x, body.true_pose().y)) > FAR


def test_a_carried_robot_sees_the_way_but_its_wheels_do_not_turn(meet: Callable[..., Any]) -> None:
    body, events = meet("house", "carry:1")
    go(body, 1.0, 0.0, 0.0)
    wheels, distance = body.joint_positions(), body.distance
    places, scans = [body.true_pose()], []
    (happened,) = events.event_log
    while math.dist((places[-1].x, places[-1].y), (happened["x"], happened["y"])) > 0.02:
        go(body, 0.1)  # commands have no effect on a carried robot
        places.append(body.true_pose())
        scans.append(body.scan().ranges.tobytes())
    steps = [math.dist((a.x, a.y), (b.x, b.y)) for a, b in itertools.pairwise(places)]
    assert len(steps) > 20
    assert max(steps) < 1.1 * CARRYING_SPEED / 10
    assert len(set(scans)) > 0.9 * len(scans)
    assert (
        min(body.world.description.clearance_at(place.x, place.y) for place in places)
        > body.base_info.radius - 0.05
    )
    left = [name for name in wheels if "wheel" in name and "left" in name]
    assert [body.joint_positions()[name] for name in left] == pytest.approx(
        [wheels[name] for name in left], abs=0.05
    )
    assert body.odometry().pose.x == pytest.approx(0.0, abs=0.02)
    assert body.distance - distance < 0.02
    assert body.kidnap_times == [SECOND]
    assert (body.contacts.collisions, body.contacts.grazes) == (0, 0)
    go(body, 1.0)
    assert body.odometry().pose.x > 0.1


@pytest.fixture
def flat(tmp_path: Path) -> Callable[..., Any]:
    """A world file with two rooms, a closed door between them, and the start pose *start*."""

    def make(*start: float) -> str:
        walls = {
            "outside": [[-5, 3], [-5, -3], [5, -3], [5, 3]],
            "far": [[-5, 3], [5, 3]],
            "south": [[0, -3], [0, -0.6]],
            "north": [[0, 0.6], [0, 3]],
            "closet": [[-5, 1], [-3, 1], [-3, 3]],
        }
        objects = [
            {"name": name, "kind": "wall", "points": line, "height": 2} for name, line in walls.items()
        ]
        door = {"name": "inner", "kind": "hinged_door", "position": [0, 0], "width": 1.2, "yaw": math.pi / 2}
        path = tmp_path / "flat.json"
        world = {"start": {"pose": start}, "objects": [*objects, door]}
        path.write_text(json.dumps(world), encoding="utf-8")
        return str(path)

    return make


@pytest.mark.parametrize(
    ("start", "events", "passes"),
    [
        ((-3.0, -1.0, 0.0), ["carry:1"], False),
        ((-4.67, -1.0, 0.0), ["carry:1"], False),  # beside a wall
        ((-3.0, -1.0, 0.0), ["door:inner:open@0.5", "carry:1"], False),  # the door is still moving
        ((-3.0, -1.0, 0.0), ["door:inner:open@0.5", "carry:4"], True),
    ],
)
def test_robot_is_carried_only_through_open_doors(
    meet: Callable[..., Any],
    flat: Callable[..., Any],
    start: tuple[float, float, float],
    events: list[str],
    passes: bool,
) -> None:
    rooms = set()
    for seed in range(2):
        body, _ = meet(flat(*start), *events, seed=seed)
        go(body, parse_event(events[-1]).time / SECOND, 0.0)
        way = body.carried_along()
        rooms.add(way[-1].x > 0.0)
        free = [place for place in way if math.dist((place.x, place.y), start[:2]) > 0.6]
        obstacles = [item for item in body.world.bodies.values() if item.is_static] + body.world.door_leaves()
        assert min(item.distance(place.x, place.y) for item in obstacles for place in free) > 0.27
    assert (True in rooms) == passes


@pytest.mark.parametrize(
    ("start", "events", "message"),
    [
        (
            (-4.2, 2.0, 0.0),
            ["carry:0.5"],
            r"no free place with a way to it \(doors that are not open: inner\) that is more than 2 m away",
        ),
        (
            (-1.5, -1.0, 0.0),
            ["door:inner:open@0.2", "carry:3.5", "door:inner:close@3.6"],
            "'door:inner:close@3.6' is not possible: the robot is being carried past this door",
        ),
    ],
)
def test_a_way_that_a_door_prevents_is_an_error(
    meet: Callable[..., Any],
    flat: Callable[..., Any],
    start: tuple[float, float, float],
    events: list[str],
    message: str,
) -> None:
    body, _ = meet(flat(*start), *events)
    with pytest.raises(SimError, match=message):
        go(body, 4.0, 0.0)


def test_a_door_opens_and_closes_at_its_times(tmp_path: Path) -> None:
    door = {"name": "kitchen", "kind": "sliding_door", "position": [2, 0], "width": 1.0}
    path = tmp_path / "flat.json"
    path.write_text(json.dumps({"start": {"pose": [0, 0, 0]}, "objects": [door]}), encoding="utf-8")
    scenario = Scenario(0, 0, [parse_event(f"door:kitchen:{action}") for action in ("close@5", "open@0.5")])
    world = World(scenario.add_to(load_world_description(str(path)), 1, 0.27), seed=1)
    body = SimulatedRobot(world)
    events = scenario.begin(world, body, body.base_info.radius)
    go(body, 4.8, 0.0)
    assert world.door_opening("kitchen") == 1.0
    go(body, 4.8, 0.0)
    assert world.door_opening("kitchen") == 0.0
    assert events.event_log == [
        {"event": "door", "t": 0.5, "door": "kitchen", "open": True},
        {"event": "door", "t": 5.0, "door": "kitchen", "open": False},
    ]
    world.close()


def test_a_person_is_in_the_scan_and_keeps_away_from_a_standing_robot(meet: Callable[..., Any]) -> None:
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
            seen = np.median(scan.ranges[max(0, ray - 2) : ray + 3])
            assert seen == pytest.approx(math.dist(laser, (x, y)) - 0.25, abs=0.3)
            hits += 1
    assert hits > 20
    assert (body.contacts.collisions, body.contacts.grazes) == (0, 0)


@pytest.mark.parametrize("side", range(8))
def test_person_walking_into_robot_is_collision_from_every_side(meet: Callable[..., Any], side: int) -> None:
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
