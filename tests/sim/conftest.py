"""Fixtures: objects of a world, and robots among them."""

import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import pytest

from btcore_robot.robot import Pose2D
from btcore_sim.camera import CameraSettings
from btcore_sim.faults import Fault
from btcore_sim.robot_description import PERFECT, TIAGO, LaserErrors, RobotDescription, load_robot_description
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World
from btcore_sim.world_description import WorldDescription, WorldObject

MakeObject = Callable[..., WorldObject]
RobotAt = Callable[..., SimulatedRobot]
Steer = Callable[..., None]

WHITE = (255, 255, 255, 255)


@pytest.fixture
def box() -> MakeObject:
    def make(
        x: float, y: float, size: Sequence[float], *, yaw: float = 0.0, mass: float = 0.0, name: str = "box"
    ) -> WorldObject:
        return WorldObject(name, "box", (size[0], size[1], size[2]), (x, y, 0.0), yaw, mass, WHITE)

    return make


@pytest.fixture
def drum() -> MakeObject:
    def make(x: float, y: float, radius: float, *, mass: float = 0.0, name: str = "drum") -> WorldObject:
        return WorldObject(name, "cylinder", (2 * radius, 2 * radius, 1.0), (x, y, 0.0), 0.0, mass, WHITE)

    return make


@pytest.fixture
def robot_at() -> Iterator[RobotAt]:
    """Return a function that places a robot among objects; the worlds are closed when the test ends."""
    worlds: list[World] = []

    def make(
        *objects: WorldObject,
        pose: tuple[float, float, float] = (0.0, 0.0, 0.0),
        seed: int = 0,
        faults: Sequence[Fault] = (),
        description: RobotDescription | None = None,
        physics_rate: int = 240,
        camera: CameraSettings | None = None,
        battery: float = 100.0,
    ) -> SimulatedRobot:
        world = WorldDescription(
            "test", "", objects, (-5, -5, 5, 5), 0.0, Pose2D(*pose), WHITE, physics_rate=physics_rate
        )
        worlds.append(World(world, seed=seed))
        robot = description or load_robot_description(TIAGO)
        return SimulatedRobot(worlds[-1], robot, camera=camera, faults=faults, battery=battery)

    yield make
    for world in worlds:
        world.close()


@pytest.fixture
def noiseless_tiago() -> RobotDescription:
    """Return the description of a Tiago without errors of laser and odometry."""
    tiago = load_robot_description(TIAGO)
    laser = replace(tiago.laser, sigma=0.0, range_noise=0.0, outliers=LaserErrors(), latency=0.0)
    return replace(tiago, odometry=PERFECT, laser=laser)


@pytest.fixture
def steer() -> Steer:
    """Return a function that sends a velocity at 10 Hz for some seconds, or only waits if it is None."""

    def drive(body: SimulatedRobot, seconds: float, command: tuple[float, float] | None) -> None:
        for _ in range(round(seconds * 10)):
            if command is not None:
                body.drive(*command)
            body.world.wait_until(body.world.now() + 100_000_000, threading.Event())

    return drive
