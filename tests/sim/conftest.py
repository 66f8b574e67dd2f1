import threading
from collections.abc import Callable, Iterator, Sequence

import pytest

from robot_nodes.robot import Pose2D
from sim.body import Body
from sim.description import TIAGO, Description, load_description
from sim.faults import Fault
from sim.scene import Scene, Thing
from sim.world import World

Stand = Callable[..., Body]
Pass = Callable[..., None]

WHITE = (255, 255, 255, 255)


@pytest.fixture
def box() -> Callable[..., Thing]:
    def make(
        x: float, y: float, size: Sequence[float], *, yaw: float = 0.0, mass: float = 0.0, name: str = "box"
    ) -> Thing:
        return Thing(name, "box", (size[0], size[1], size[2]), (x, y, 0.0), yaw, mass, WHITE)

    return make


@pytest.fixture
def drum() -> Callable[..., Thing]:
    def make(x: float, y: float, radius: float, *, mass: float = 0.0, name: str = "drum") -> Thing:
        return Thing(name, "cylinder", (2 * radius, 2 * radius, 1.0), (x, y, 0.0), 0.0, mass, WHITE)

    return make


@pytest.fixture
def stand() -> Iterator[Stand]:
    """Stand a robot among things at a pose; worlds are closed when the test ends."""
    worlds: list[World] = []

    def make(
        *things: Thing,
        pose: tuple[float, float, float] = (0.0, 0.0, 0.0),
        seed: int = 0,
        faults: Sequence[Fault] = (),
        description: Description | None = None,
    ) -> Body:
        scene = Scene("test", "", things, (-5, -5, 5, 5), 0.0, Pose2D(*pose), WHITE)
        worlds.append(World(scene, seed=seed))
        return Body(worlds[-1], description or load_description(TIAGO), faults=faults)

    yield make
    for world in worlds:
        world.close()


@pytest.fixture
def steer() -> Pass:
    """Command a velocity at 10 Hz for some seconds; None is silence."""

    def drive(body: Body, seconds: float, command: tuple[float, float] | None) -> None:
        for _ in range(round(seconds * 10)):
            if command is not None:
                body.drive(*command)
            body.world.wait_until(body.world.now() + 100_000_000, threading.Event())

    return drive
