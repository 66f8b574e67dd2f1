"""The laser: its geometry against the physics engine's own rays, its noise, REP 117."""

import math
from dataclasses import replace

import numpy as np
import pybullet
import pytest
from hypothesis import given
from hypothesis import strategies as st

from btcore_robot.robot import LaserInfo, Pose2D
from btcore_sim.laser import Laser, RayCaster
from btcore_sim.robot_description import LaserErrors, RobotDescription
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World
from btcore_sim.world_description import WorldDescription, WorldObject
from tests.sim.conftest import MakeObject, RobotAt, Steer

FACTS = LaserInfo(180, -math.pi, 2 * math.pi / 180, 0.05, 25.0, 10.0, 0.06, "laser")
HEIGHT = 0.1
GREY = (128, 128, 128, 255)

sides = st.floats(0.1, 3.0)
yaws = st.one_of(st.sampled_from([0.0, math.pi / 2, -math.pi / 2, math.pi]), st.floats(-4.0, 4.0))


@st.composite
def objects(draw: st.DrawFn) -> list[WorldObject]:
    found = []
    for index in range(draw(st.integers(1, 6))):
        kind = draw(st.sampled_from(["box", "cylinder"]))
        x, y = draw(sides), draw(sides)
        size = (x, y, 1.0) if kind == "box" else (x, x, 1.0)
        around = draw(st.floats(0.0, 2 * math.pi))
        away = 2.2 + draw(st.floats(0.0, 8.0))
        place = (away * math.cos(around), away * math.sin(around), 0.0)
        found.append(WorldObject(f"thing_{index}", kind, size, place, draw(yaws), 0.0, GREY))
    return found


@given(objects(), st.floats(-0.05, 0.05), st.floats(-0.05, 0.05), st.floats(-3.0, 3.0))
def test_geometry_agrees_with_rays(description: list[WorldObject], x: float, y: float, yaw: float) -> None:
    world = World(
        WorldDescription("test", "", tuple(description), (-1, -1, 1, 1), 0.0, Pose2D(0, 0, 0), GREY)
    )
    try:
        angles = FACTS.angle_min + FACTS.angle_increment * np.arange(FACTS.rays) + yaw
        starts = [(x, y, HEIGHT)] * len(angles)
        ends = [(x + 20 * math.cos(a), y + 20 * math.sin(a), HEIGHT) for a in angles]
        rays = pybullet.rayTestBatch(starts, ends, physicsClientId=world.client)
        theirs = np.array([hit[2] * 20 if hit[0] >= 0 else np.inf for hit in rays])
    finally:
        world.close()
    caster = RayCaster.of(description)
    fan = np.array([caster.distances(x, y, HEIGHT, angles + turn) for turn in (0.0, -0.002, 0.002)])
    fan[fan > 20.0] = np.inf
    differing = ~np.isclose(fan[0], theirs, atol=5e-3)
    # A ray that grazes an edge may hit for one and miss for the other: 0.002 rad to one side both agree.
    for ray in np.flatnonzero(differing):
        assert min(fan[:, ray]) - 0.05 <= theirs[ray] <= max(fan[:, ray]) + 0.05
    assert differing.sum() <= 0.05 * len(angles)


@pytest.mark.parametrize("tiny", [0.0, 5e-324, 1e-310, -1e-310, 1e-200])
def test_rays_parallel_to_side_have_right_distances(box: MakeObject, tiny: float) -> None:
    outlines = RayCaster.of([box(3.0, 0.0, (2.0, 1.0, 1.0)), box(0.0, 3.0, (1.0, 2.0, 1.0), yaw=1e-14)])
    found = outlines.distances(0.0, 0.25, HEIGHT, np.array([tiny, math.pi / 2, math.pi]))
    assert found == pytest.approx([2.0, 1.75, math.inf])


def sweep(outlines: RayCaster, seed: int = 0, **changes: float) -> np.ndarray:
    info = replace(FACTS, **changes)
    laser = Laser(info, outlines, np.random.default_rng(seed))
    return laser.sweep(0.0, 0.0, HEIGHT, 0.0, 7).ranges


def test_no_echo_is_infinite_and_never_the_maximum(box: MakeObject) -> None:
    outlines = RayCaster.of([box(30.0, 0.0, (1.0, 100.0, 1.0)), box(-2.0, 0.0, (1.0, 1.0, 1.0))])
    ranges = sweep(outlines, sigma=0.0)
    assert ranges[len(ranges) // 2] == np.inf
    assert np.isfinite(ranges).any()


def test_an_echo_below_the_minimum_is_minus_infinite(box: MakeObject) -> None:
    assert (sweep(RayCaster.of([box(0.0, 0.0, (1.0, 1.0, 1.0))]), sigma=0.0) == -np.inf).all()


def test_an_object_below_the_laser_is_not_seen(box: MakeObject) -> None:
    assert (sweep(RayCaster.of([box(2.0, 0.0, (1.0, 1.0, 0.09))])) == np.inf).all()


def test_noise_has_the_sigma_of_the_description() -> None:
    ring = WorldObject("wall", "box", (0.1, 20.0, 1.0), (2.05, 0.0, 0.0), 0.0, 0.0, GREY)
    errors = []
    for seed in range(50):
        ranges = sweep(RayCaster.of([ring]), seed)
        middle = slice(85, 96)
        angles = FACTS.angle_min + FACTS.angle_increment * np.arange(FACTS.rays)
        errors.append(ranges[middle] - 2.0 / np.cos(angles[middle]))
    assert np.std(errors) == pytest.approx(0.06, rel=0.1)
    assert np.mean(errors) == pytest.approx(0.0, abs=0.01)


def repeated(outlines: RayCaster, errors: LaserErrors, **noise: float) -> np.ndarray:
    """Return 1000 scans of the same place, shape `(1000, rays)`."""
    laser = Laser(
        replace(FACTS, **{"sigma": 0.0, **noise}), outlines, np.random.default_rng(1), errors=errors
    )
    return np.array([laser.sweep(0.0, 0.0, HEIGHT, 0.0, 7).ranges for _ in range(1000)])


@pytest.mark.parametrize("distance", [2.0, 20.0])
def test_noise_grows_with_the_range(box: MakeObject, distance: float) -> None:
    wall = RayCaster.of([box(distance + 0.05, 0.0, (0.1, 100.0, 1.0))])
    ahead = repeated(wall, LaserErrors(), sigma=0.06, range_noise=0.01)[:, FACTS.rays // 2]
    assert np.std(ahead) == pytest.approx(math.hypot(0.06, 0.01 * distance), rel=0.07)
    assert np.mean(ahead) == pytest.approx(distance, abs=0.02)


def test_shares_of_rays_return_no_echo_or_a_short_range(box: MakeObject) -> None:
    wall = RayCaster.of([box(4.05, 0.0, (0.1, 100.0, 1.0))])
    front = slice(FACTS.rays // 2 - 2, FACTS.rays // 2 + 3)
    ranges = repeated(wall, LaserErrors(missed=0.1, short=0.05))[:, front]
    assert np.mean(ranges == np.inf) == pytest.approx(0.1, rel=0.2)
    short = ranges[ranges < 3.9]
    assert len(short) / ranges.size == pytest.approx(0.05, rel=0.2)
    assert np.mean(short[np.isfinite(short)]) == pytest.approx(2.0, rel=0.1)


def test_only_rays_beside_an_edge_return_ranges_between_both_objects(box: MakeObject) -> None:
    outlines = RayCaster.of([box(2.5, -5.0, (1.0, 10.05, 1.0)), box(6.0, 0.0, (0.1, 100.0, 1.0))])
    ranges = repeated(outlines, LaserErrors(edge=0.3))
    mixed = (ranges > 2.15) & (ranges < 5.94)
    ahead = FACTS.rays // 2
    assert np.mean(mixed[:, ahead]) == pytest.approx(0.3, rel=0.2)
    assert not mixed[:, ahead - 10 : ahead].any()
    assert not mixed[:, ahead + 1 : ahead + 5].any()


def test_a_movable_box_is_seen_at_its_current_place(
    robot_at: RobotAt, steer: Steer, box: MakeObject, noiseless_tiago: RobotDescription
) -> None:
    body = robot_at(
        box(2.0, 0.0, (0.5, 0.5, 0.5), mass=5.0),
        box(4.0, 0.0, (0.2, 9.0, 1.0), name="wall"),
        description=noiseless_tiago,
    )
    ahead = noiseless_tiago.laser.info.rays // 2
    assert body.scan().ranges[ahead] == pytest.approx(1.75 - 0.202, abs=0.01)
    number = body.world.movable[0]
    pybullet.resetBasePositionAndOrientation(
        number, [2.5, 0.0, 0.25], [0.0, 0.0, 0.0, 1.0], physicsClientId=body.world.client
    )
    steer(body, 0.2, None)
    assert body.scan().ranges[ahead] == pytest.approx(2.25 - 0.202, abs=0.01)
    pybullet.resetBasePositionAndOrientation(
        number, [2.5, 3.0, 0.25], [0.0, 0.0, 0.0, 1.0], physicsClientId=body.world.client
    )
    steer(body, 0.2, None)
    assert body.scan().ranges[ahead] == pytest.approx(3.9 - 0.202, abs=0.01)


@pytest.mark.parametrize("turned", [(0.0, 0.0, 0.9), (0.6, 0.0, 0.3), (0.0, math.pi / 2, 0.0)])
def test_a_movable_object_in_any_orientation_agrees_with_the_engine(
    robot_at: RobotAt,
    box: MakeObject,
    drum: MakeObject,
    noiseless_tiago: RobotDescription,
    turned: tuple[float, float, float],
) -> None:
    body = robot_at(
        box(2.0, 0.0, (0.5, 0.4, 0.5), mass=5.0), drum(2.0, 1.5, 0.25, mass=5.0), description=noiseless_tiago
    )
    client = body.world.client
    for number, y in zip(body.world.movable, (0.0, 1.5), strict=True):
        pybullet.resetBasePositionAndOrientation(
            number, [2.0, y, 0.3], pybullet.getQuaternionFromEuler(turned), physicsClientId=client
        )
    pybullet.performCollisionDetection(physicsClientId=client)
    laser = body.sensors.laser
    ours = laser.distances(0.202, 0.0, 0.0945, 0.0)
    angles = laser.info.angle_min + laser.info.angle_increment * np.arange(laser.info.rays)
    starts = [(0.202, 0.0, 0.0945)] * len(angles)
    ends = [(0.202 + 9 * math.cos(a), 9 * math.sin(a), 0.0945) for a in angles]
    rays = pybullet.rayTestBatch(starts, ends, physicsClientId=client)
    theirs = np.array([hit[2] * 9 if hit[0] >= 0 else np.inf for hit in rays])
    assert np.isfinite(theirs).sum() > 20
    assert (~np.isclose(ours, theirs, atol=5e-3)).sum() <= 4


def test_the_robot_does_not_see_itself(robot_at: RobotAt) -> None:
    body: SimulatedRobot = robot_at()
    assert (body.scan().ranges == np.inf).all()


def test_the_middle_of_666_rays_points_a_little_to_the_left(robot_at: RobotAt) -> None:
    scan = robot_at().scan()
    assert len(scan.ranges) == 666
    assert math.degrees(scan.angles()[666 // 2]) == pytest.approx(0.165, abs=0.001)
