"""The world: its clock, the order of tasks, its pace, and reproducibility by seed."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path

import pytest

from btcore_robot.robot import Phase, Pose2D
from btcore_robot.schedule import SimulatedSchedule
from btcore_sim.robot_description import RobotDescription
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World
from btcore_sim.world_description import WorldDescription
from btcore_sim.worlds import load_world_description
from tests.sim.conftest import RobotAt, Steer

SECOND = 1_000_000_000
EMPTY = WorldDescription("empty", "", (), (-1, -1, 1, 1), 0.0, Pose2D(0, 0, 0), (0, 0, 0, 255))


@pytest.fixture
def world() -> Iterator[World]:
    world = World(EMPTY)
    yield world
    world.close()


def trace(seed: int, world: str = "arena_boxes", seconds: int = 8) -> str:
    """Return a digest of every scan, odometry and true pose of a run."""
    body = SimulatedRobot(World(load_world_description(world), seed=seed))
    seen = sha256()
    for tick in range(1, seconds * 10 + 1):
        body.drive(0.3, 0.2 if tick % 40 < 20 else -0.3)
        body.world.wait_until(tick * SECOND // 10, threading.Event())
        scan = body.scan()
        assert scan is not None
        seen.update(scan.ranges.tobytes())
        seen.update(repr((body.true_pose(), body.odometry(), body.contacts.events, body.distance)).encode())
    body.world.close()
    return seen.hexdigest()


def test_the_same_seed_gives_the_same_bytes_twice_in_one_process() -> None:
    assert trace(5) == trace(5)


def test_the_same_seed_gives_the_same_bytes_in_another_process() -> None:
    program = "import test_world; print(test_world.trace(5))"
    found = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, env=_environment()
    )
    assert found.stdout.strip() == trace(5)


def test_another_seed_gives_another_run() -> None:
    assert trace(5, seconds=1) != trace(6, seconds=1)


def test_two_worlds_in_one_process_do_not_affect_each_other() -> None:
    alone = trace(3, seconds=4)
    beside = SimulatedRobot(World(load_world_description("arena"), seed=9))
    assert trace(3, seconds=4) == alone
    beside.world.wait_until(SECOND, threading.Event())
    assert beside.contacts.events == []
    beside.world.close()


def test_waiting_ends_at_the_deadline_exactly(world: World) -> None:
    assert world.wait_until(SECOND // 3, threading.Event()) is False
    assert world.now() == SECOND // 3


def test_waiting_for_the_past_changes_nothing(world: World) -> None:
    world.wait_until(SECOND, threading.Event())
    world.wait_until(SECOND // 2, threading.Event())
    assert world.now() == SECOND


def test_the_number_of_waits_does_not_change_a_run() -> None:
    places = []
    for cuts in (10, 37):
        body = SimulatedRobot(World(EMPTY))
        body.drive(0.1, 0.1)
        for cut in range(1, cuts + 1):
            body.world.wait_until(cut * SECOND // cuts, threading.Event())
        places.append((body.true_pose(), body.scan().stamp))
        body.world.close()
    assert places[0] == places[1]


def test_a_wake_up_ends_the_waiting_early(world: World) -> None:
    wake = threading.Event()
    world.schedule.add_task(10, Phase.SENSORS, lambda now: wake.set(), first=SECOND // 5)
    assert world.wait_until(SECOND, wake) is True
    assert world.now() == SECOND // 5


def test_a_wake_up_that_is_due_already_stops_time(world: World) -> None:
    wake = threading.Event()
    wake.set()
    assert world.wait_until(SECOND, wake) is True
    assert world.now() == 0


def test_at_equal_times_the_order_is_fixed() -> None:
    schedule = SimulatedSchedule()
    done: list[tuple[str, int]] = []
    schedule.add_task(10, Phase.SENSORS, lambda now: done.append(("laser", now)), first=SECOND // 10)
    schedule.add_task(50, Phase.SENSORS, lambda now: done.append(("wheels", now)), first=SECOND // 10)
    schedule.add_task(240, Phase.PHYSICS, lambda now: done.append(("physics", now)), first=SECOND // 10)
    for _ in range(3):
        schedule.run_next()
    assert done == [("physics", SECOND // 10), ("laser", SECOND // 10), ("wheels", SECOND // 10)]


def test_periods_that_are_not_whole_nanoseconds_do_not_drift() -> None:
    schedule = SimulatedSchedule()
    times: list[int] = []
    schedule.add_task(240, Phase.PHYSICS, times.append, first=0)
    for _ in range(240 * 60 + 1):
        schedule.run_next()
    assert times[240 * 60] == 60 * SECOND


def test_the_first_scan_precedes_the_first_wait(robot_at: RobotAt) -> None:
    body = robot_at()
    assert body.world.now() == 0
    assert body.scan().stamp == 0
    assert body.odometry().stamp == 0


def test_scans_are_made_at_ten_hertz_and_available_at_their_time(
    robot_at: RobotAt, steer: Steer, noiseless_tiago: RobotDescription
) -> None:
    body = robot_at(description=noiseless_tiago)
    for tick in range(1, 11):
        steer(body, 0.1, None)
        assert body.scan().stamp == tick * SECOND // 10


def test_waiting_in_real_time_takes_real_time() -> None:
    world = World(EMPTY, fast=False)
    began = time.monotonic()
    world.wait_until(SECOND // 4, threading.Event())
    assert time.monotonic() - began >= 0.24
    world.close()


def test_world_slower_than_real_time_warns_once_and_skips_nothing(
    capsys: pytest.CaptureFixture[str],
) -> None:
    world = World(EMPTY, fast=False)
    steps: list[int] = []
    world.add_step_callbacks(lambda now: time.sleep(0.3 if now < SECOND // 50 else 0.0), steps.append)
    world.wait_until(SECOND // 10, threading.Event())
    assert len(steps) == 24
    assert capsys.readouterr().err.count("the simulation is slower than real time") == 1
    world.close()


def test_a_wake_up_from_another_thread_ends_a_wait_in_real_time() -> None:
    world = World(EMPTY, fast=False)
    wake = threading.Event()
    threading.Timer(0.05, wake.set).start()
    assert world.wait_until(3600 * SECOND, wake) is True
    assert world.now() < 3600 * SECOND
    world.close()


def _environment() -> dict[str, str]:
    path = [str(Path(__file__).parent), *filter(None, sys.path)]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(path), "PYTHONHASHSEED": "12"}
