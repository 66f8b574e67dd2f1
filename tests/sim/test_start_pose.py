"""The options for the start pose and for the noise of the sensors."""

import json
import math
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from btcore import Run, RunSettings
from btcore.program_runner import TreelessProgram
from btcore_navigation.action import GoalStatus
from btcore_navigation.providers import NavigationSettings
from btcore_navigation.stack import Navigation
from btcore_robot.robot import Pose2D
from btcore_sim.clearance_map import BESIDE_HULL, ClearanceMap
from btcore_sim.errors import SimError
from btcore_sim.providers import SimulatorSettings
from btcore_sim.robot_description import LaserErrors, load_robot_description
from btcore_sim.scenario import with_start
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World, random_generator
from btcore_sim.worlds import load_world_description

RADIUS = 0.27


@pytest.mark.parametrize("name", ["house", "aws_house", "office:3", "home:3"])
def test_random_starts_are_free_and_connected_to_all_waypoints(name: str) -> None:
    description = load_world_description(name)
    floor = ClearanceMap.of(description)
    poses = []
    for seed in range(8):
        pose = with_start(description, "random", random_generator(seed, "start"), RADIUS).pose
        assert pose is not None
        assert floor.connected([*description.waypoints.values(), (pose.x, pose.y)], RADIUS + BESIDE_HULL)
        assert description.clearance_at(pose.x, pose.y) >= RADIUS
        poses.append(pose)
    assert len(set(poses)) == 8
    assert max(math.dist((a.x, a.y), (b.x, b.y)) for a in poses for b in poses) > 4.0
    again = with_start(description, "random", random_generator(3, "start"), RADIUS).pose
    assert again == poses[3]


@pytest.mark.parametrize(("width", "is_wide_enough"), [(0.9, True), (0.8, True), (0.6, False)])
def test_random_start_may_be_in_passable_corridor(tmp_path: Path, width: float, is_wide_enough: bool) -> None:
    side = width / 2 + 0.05  # the points of a wall are on its middle line
    corners = [[-1, -side], [9, -side], [9, side], [-1, side]]
    corridor = {"kind": "wall", "closed": True, "points": corners, "height": 2}
    path = tmp_path / "corridor.json"
    world = {"start": {"pose": [0, 0, 0]}, "waypoints": {"wp1": [8, 0]}, "objects": [corridor]}
    path.write_text(json.dumps(world), encoding="utf-8")
    if is_wide_enough:
        pose = with_start(
            load_world_description(str(path)), "random", random_generator(1, "start"), RADIUS
        ).pose
        assert pose is not None
        assert abs(pose.y) + RADIUS < width / 2
    else:
        with pytest.raises(SimError, match="no free place with a way to all its waypoints"):
            with_start(load_world_description(str(path)), "random", random_generator(1, "start"), RADIUS)


def test_a_world_with_random_starts_of_its_own_keeps_them() -> None:
    arena = load_world_description("arena")
    assert with_start(arena, "random", random_generator(1, "start"), RADIUS) is arena


def test_a_start_is_given_in_metres_and_degrees() -> None:
    pose = with_start(
        load_world_description("house"), "0.5,-0.25,90", random_generator(0, "start"), RADIUS
    ).pose
    assert pose is not None
    assert (pose.x, pose.y, pose.yaw) == pytest.approx((0.5, -0.25, math.pi / 2))
    turned = with_start(load_world_description("house"), "0,0,270", random_generator(0, "start"), RADIUS).pose
    assert turned is not None
    assert turned.yaw == pytest.approx(-math.pi / 2)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("somewhere", "use random, unknown, X,Y or X,Y,YAW"),
        ("1", "use random"),
        ("1,2,3,4", "use random"),
        ("nan,0", "X, Y and YAW have to be finite numbers"),
    ],
)
def test_an_invalid_start_raises(text: str, message: str) -> None:
    with pytest.raises(SimError, match=re.escape(message)):
        with_start(load_world_description("house"), text, random_generator(0, "start"), RADIUS)


@pytest.fixture
def yard(tmp_path: Path) -> Path:
    """A world that starts far from the origin of its map, with a fence around it."""
    fence = [
        {"name": f"fence_{n}", "kind": "box", "position": [20 + x, 10 + y], "size": [w, d, 1]}
        for n, (x, y, w, d) in enumerate([(3, 0, 0.1, 6), (-3, 0, 0.1, 6), (0, 3, 6, 0.1), (0, -3, 6, 0.1)])
    ]
    crate = {"name": "crate", "kind": "box", "position": [21, 11], "size": [1, 1, 1]}
    path = tmp_path / "yard.json"
    start = {"pose": [19, 9, 0.5]}
    path.write_text(json.dumps({"start": start, "objects": [*fence, crate]}), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("start", "message"),
    [
        ("21,11", "cannot start at (21, 11), because it would touch 'crate' there"),
        ("20.23,11", "touch 'crate'"),
        ("22.7,9", "touch 'fence_0'"),
        ("20.2,11", None),
    ],
)
def test_a_robot_cannot_start_where_it_touches_an_object(yard: Path, start: str, message: str | None) -> None:
    world = World(with_start(load_world_description(str(yard)), start, random_generator(0, "start"), RADIUS))
    if message is None:
        assert SimulatedRobot(world).contacts.events == []
    else:
        with pytest.raises(SimError, match=re.escape(message)):
            SimulatedRobot(world)
    world.close()


@contextmanager
def navigation(
    yard: Path, start: str | None = None, nav_params: Path | None = None
) -> Iterator[tuple[SimulatedRobot, Navigation]]:
    settings = [
        SimulatorSettings(world=str(yard), camera="off", start=start),
        NavigationSettings(nav_params),
        RunSettings(fast=True, seed=1),
    ]
    with Run(TreelessProgram("Navigate"), settings=settings).want(Navigation) as run:
        body, found = run.find(SimulatedRobot), run.find(Navigation)
        assert body is not None
        assert found is not None
        yield body, found


@pytest.mark.parametrize("start", [None, "21,9,90", "random"])
def test_the_localiser_is_given_the_start_pose(yard: Path, start: str | None) -> None:
    with navigation(yard, start=start) as (body, found):
        true, pose = body.true_pose(), found.localiser.pose()
        assert (pose.x, pose.y, pose.yaw) == pytest.approx((true.x, true.y, true.yaw), abs=0.01)
        body.world.wait_until(2_000_000_000, threading.Event())
        assert found.estimate() is not None
        assert not found.localiser.is_searching


def test_a_robot_can_navigate_in_a_closed_room_outside_the_start_area(yard: Path) -> None:
    world = json.loads(yard.read_text(encoding="utf-8"))
    world["objects"].append({"kind": "wall", "points": [[17, 12], [20, 12], [20, 13]], "height": 1})
    yard.write_text(json.dumps(world), encoding="utf-8")
    with navigation(yard, start="18,12.5") as (body, found):
        for place in ((18.0, 12.5), (19.0, 9.0)):
            assert found.map.free[found.map.cell(*place)]
        handle = found.go_to(Pose2D(19.0, 12.5, 0.0))
        while not handle.done and body.world.now() < 30_000_000_000:
            body.world.wait_until(body.world.now() + 500_000_000, threading.Event())
        assert handle.status is GoalStatus.SUCCEEDED


def test_the_users_initial_pose_replaces_the_start_pose(yard: Path, tmp_path: Path) -> None:
    file = tmp_path / "nav2.yaml"
    file.write_text("amcl: {ros__parameters: {initial_pose: {x: 18.5, y: 9.0, yaw: 0.4}}}", encoding="utf-8")
    with navigation(yard, nav_params=file) as (_, found):
        assert found.localiser.pose() == Pose2D(18.5, 9.0, pytest.approx(0.4))


def test_a_robot_with_an_unknown_start_stands_until_it_has_found_its_pose(yard: Path) -> None:
    with navigation(yard, start="unknown") as (body, found):
        handle = found.go_to(Pose2D(19.0, 9.0, 0.0))
        begin = body.true_pose()
        while found.estimate() is None and body.world.now() < 60_000_000_000:
            true = body.true_pose()
            assert math.dist((begin.x, begin.y), (true.x, true.y)) < 0.05
            body.world.wait_until(body.world.now() + 500_000_000, threading.Event())
        pose, true = found.estimate(), body.true_pose()
        assert pose is not None
        assert math.dist((pose.x, pose.y), (true.x, true.y)) < 0.05
        while not handle.done and body.world.now() < 120_000_000_000:
            body.world.wait_until(body.world.now() + 500_000_000, threading.Event())
        assert handle.status is GoalStatus.SUCCEEDED
        assert (body.contacts.collisions, body.contacts.grazes) == (0, 0)


def test_noise_is_a_factor_on_the_errors_of_all_sensors() -> None:
    tiago = load_robot_description()
    assert tiago.with_noise(1.0) == tiago
    perfect, twice = tiago.with_noise(0.0), tiago.with_noise(2.0)
    assert (perfect.laser.info.sigma, perfect.odometry.slip, perfect.odometry.scale_sigma) == (0.0, 0.0, 0.0)
    assert twice.laser.info.sigma == 2 * tiago.laser.info.sigma
    assert twice.odometry.slip_sigma == 2 * tiago.odometry.slip_sigma
    assert (perfect.laser.outliers, perfect.laser.latency) == (LaserErrors(), 0.0)
    assert twice.laser.info.range_noise == 2 * tiago.laser.info.range_noise
    assert twice.laser.latency == 2 * tiago.laser.latency
    assert tiago.with_noise(1000.0).laser.outliers.edge == 1.0
