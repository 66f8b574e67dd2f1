"""Fixtures: the simulated robot in a process of its own, and a ROS node that is connected with it."""

from collections.abc import Callable, Iterator

import pytest

from tests.ros2.simulation.process import Client, SimProcess


@pytest.fixture(scope="module")
def start(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., SimProcess]]:
    """A function that starts a simulation with options; all end with the module."""
    started: list[SimProcess] = []

    def begin(*arguments: str) -> SimProcess:
        started.append(SimProcess(tmp_path_factory.mktemp("simulation"), *arguments))
        return started[-1]

    yield begin
    for simulation in started:
        simulation.interrupt()


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    """A ROS node in the domain of this worker."""
    from btcore_ros2.session import RosSession

    with RosSession("client") as session:
        yield Client(session)
