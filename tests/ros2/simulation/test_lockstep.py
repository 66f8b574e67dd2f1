"""Lockstep: the world advances as far as a client requests, and runs are repeatable."""

import json
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("pybullet")

from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Trigger

from btcore.clock import NS_PER_S
from btcore_robot.robot import Phase
from btcore_robot.testing import check_robot, is_standing, wait
from btcore_ros2.errors import RosError
from btcore_ros2.robot.description import load_robot
from btcore_ros2.robot.ros_robot import RosRobot
from btcore_ros2.session import RosSession
from btcore_ros2.simulation import lockstep
from btcore_ros2.simulation.lockstep import LockstepClock
from tests.ros2.conftest import LIMIT_S
from tests.ros2.simulation.process import Client, SimProcess

TENTH = 100_000_000
ODOMETRY = "/mobile_base_controller/odom"
DYING_CLIENT = """
import os, threading
from btcore_ros2.session import RosSession
from btcore_ros2.simulation.lockstep import LockstepClock

clock = LockstepClock(RosSession("lockstep"), 60.0)
death = clock.now() + 300_000_000
clock.add_task(10.0, 0, lambda now: os.kill(os.getpid(), 9) if now >= death else None)
clock.wait_until(clock.now() + 10**9, threading.Event())
"""


def step(client: Client, *parameters: tuple[str, ParameterValue]) -> Any:
    """Request a step like a program that knows the protocol only."""
    request = SetParametersAtomically.Request(
        parameters=[Parameter(name=name, value=value) for name, value in parameters]
    )
    return client.call(SetParametersAtomically, "/sim/step", request).result


def integer(value: int) -> ParameterValue:
    return ParameterValue(type=2, integer_value=value)


def stamp(message: Any) -> int:
    return int(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)


def next_tenth(clock: LockstepClock) -> int:
    """Let the world run to the next multiple of 0.1 s, at which it measures, and return this time."""
    time = clock.now() // TENTH * TENTH + TENTH
    clock.wait_until(time, threading.Event())
    return time


@pytest.fixture(scope="module")
def worlds() -> list[SimProcess]:
    """The worlds that tests have shared; only the last one may still run."""
    return []


@pytest.fixture
def world(start: Callable[..., SimProcess], worlds: list[SimProcess]) -> SimProcess:
    """The arena in lockstep, at any time. The next test continues with it, unless a test has ended it."""
    if not worlds or worlds[-1].process.poll() is not None:
        worlds.append(start("--world", "arena", "--lockstep", "--wait-limit", "300", "--camera", "64x48@10"))
    return worlds[-1]


@pytest.fixture
def no_world(worlds: list[SimProcess]) -> None:
    """Ends the shared world: the test starts a world of its own."""
    if worlds:
        worlds[-1].interrupt()


def test_time_stands_without_a_request_and_a_sync_publishes_again(world: SimProcess, client: Client) -> None:
    time = json.loads(client.call(Trigger, "/sim/sync").message)["time"]
    scans = client.messages(LaserScan, "/scan_raw", qos_profile_sensor_data)

    def synced() -> bool:
        state = json.loads(client.call(Trigger, "/sim/sync").message)
        assert state["time"] == time
        return bool(scans)

    client.wait(synced)
    assert json.loads(client.call(Trigger, "/sim/summary").message)["time_s"] == time / NS_PER_S


def test_step_runs_to_the_time_and_counts_messages(world: SimProcess, client: Client) -> None:
    scans = client.messages(LaserScan, "/scan_raw", qos_profile_sensor_data)
    client.wait(lambda: client.call(Trigger, "/sim/sync").success and scans)
    # Scans are measured every 0.1 s, and published 0.067 s later.
    start = json.loads(client.call(Trigger, "/sim/sync").message)["time"] // TENTH * TENTH + TENTH
    before = json.loads(step(client, ("until", integer(start))).reason)["published"]["/scan_raw"]
    state = json.loads(step(client, ("until", integer(start + TENTH // 2))).reason)
    assert state["time"] == start + TENTH // 2
    assert state["published"]["/scan_raw"] == before
    end = ParameterValue(type=3, double_value=(start + 2 * TENTH) / NS_PER_S)
    state = json.loads(step(client, ("until", end)).reason)
    assert state["time"] == start + 2 * TENTH
    assert state["published"]["/scan_raw"] == before + 2
    assert set(state["received"]) >= {"/cmd_vel", "/key_vel", "/joy_vel", "/head_controller/joint_trajectory"}
    # A request that was sent twice.
    assert json.loads(step(client, ("until", integer(start))).reason)["time"] == start + 2 * TENTH


@pytest.mark.parametrize(
    ("parameters", "reason"),
    [
        ([], "'until' is missing"),
        ([("til", integer(1))], "unknown parameter 'til': use until, from"),
        ([("until", ParameterValue(type=4, string_value="1"))], "'until' has to be an integer"),
        ([("until", integer(10**14)), ("from", integer(10**13))], "before the client's 10000.000 s"),
    ],
)
def test_invalid_request_is_refused(
    world: SimProcess, client: Client, parameters: list[tuple[str, ParameterValue]], reason: str
) -> None:
    result = step(client, *parameters)
    assert not result.successful
    assert reason in result.reason


def test_no_message_is_lost(world: SimProcess) -> None:
    with RosSession("driver") as session:
        client = Client(session)
        clock = LockstepClock(session, LIMIT_S)
        start = next_tenth(clock)
        scans = client.messages(LaserScan, "/scan_raw", qos_profile_sensor_data)
        motion = client.messages(Odometry, "/mobile_base_controller/odom")
        publisher = client.node.create_publisher(Twist, "/cmd_vel", 10)
        client.wait(publisher.get_subscription_count)
        command = Twist()
        command.linear.x = 0.2
        for tick in range(1, 21):
            publisher.publish(command)
            clock.wait_until(start + tick * TENTH, threading.Event())
        # The last scan has not arrived yet, because of its latency. A new subscriber gets the scan before.
        stamps = {stamp(scan) for scan in scans} - {start - TENTH}
        assert stamps == {start + tick * TENTH for tick in range(20)}
        measured = sorted({stamp(odometry) for odometry in motion})
        assert measured == list(range(measured[0], start + 20 * TENTH + 1, TENTH // 5))
        moved = motion[-1].pose.pose.position.x - motion[0].pose.pose.position.x
        assert moved > 0.3


def test_check_robot(world: SimProcess) -> None:
    pytest.importorskip("tf2_msgs")
    with RosSession("checked") as session:
        session.clock = LockstepClock(session, LIMIT_S)
        # A program cannot charge the battery of a real robot, so it is left out.
        robot = RosRobot(session, replace(load_robot("tiago"), battery=None))

        def at_rest() -> RosRobot:
            robot.stop()
            while not is_standing(robot.odometry().twist):
                wait(robot, 0.1)
            return robot

        check_robot(at_rest)


def test_tasks_of_the_clock_run_at_their_times(world: SimProcess) -> None:
    with RosSession("scheduled") as session:
        clock = LockstepClock(session, LIMIT_S)
        start = clock.now()
        times: list[int] = []
        clock.schedule.add_task(20.0, Phase.CONTROLLER, times.append)
        assert not clock.wait_until(start + 4 * TENTH, threading.Event())
        assert times == [start + number * TENTH // 2 for number in range(1, 9)]
        assert clock.now() == start + 4 * TENTH
        wake = threading.Event()
        clock.add_task(10.0, Phase.EVALUATION, lambda now: wake.set())
        assert clock.wait_until(start + 9 * TENTH, wake)
        assert clock.now() == start + 5 * TENTH


def test_world_outlives_a_client_that_dies(world: SimProcess) -> None:
    died = subprocess.run([sys.executable, "-c", DYING_CLIENT], timeout=LIMIT_S, check=False)
    assert died.returncode == -9
    with RosSession("next") as session:
        clock = LockstepClock(session, LIMIT_S)
        now = clock.now()
        assert now >= 3 * TENTH
        clock.wait_until(now + TENTH, threading.Event())
        assert clock.now() == now + TENTH


def test_stopped_world_goes_on_where_it_was(world: SimProcess, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lockstep, "RETRY_AFTER_S", 0.05)  # requests are repeated meanwhile
    with RosSession("patient") as session:
        clock = LockstepClock(session, LIMIT_S)
        start = next_tenth(clock)
        times: list[int] = []
        session.node.create_subscription(Odometry, ODOMETRY, lambda message: times.append(stamp(message)), 10)
        clock.wait_until(start + TENTH, threading.Event())
        world.process.send_signal(signal.SIGSTOP)
        goes_on = threading.Timer(0.5, world.process.send_signal, [signal.SIGCONT])
        goes_on.start()
        try:
            clock.wait_until(start + 3 * TENTH, threading.Event())
        finally:
            goes_on.join()
        assert clock.now() == start + 3 * TENTH
        assert times == sorted(times)
        assert times[-1] == clock.now()


def test_client_that_did_not_wait_for_response_may_request_next(world: SimProcess, client: Client) -> None:
    state = json.loads(client.call(Trigger, "/sim/sync").message)
    times = [state["time"] + number * TENTH for number in range(3)]
    steps = client.node.create_client(SetParametersAtomically, "/sim/step")
    client.wait(steps.service_is_ready)
    # A response is lost if the server does not know the new client yet.
    refused = SetParametersAtomically.Request()
    client.wait(lambda: client.session.wait_for(steps.call_async(refused).done, LIMIT_S / 10))
    requests = [
        SetParametersAtomically.Request(
            parameters=[
                Parameter(name="from", value=integer(begin)),
                Parameter(name="until", value=integer(end)),
            ]
        )
        for begin, end in pairwise(times)
    ]
    responses = [steps.call_async(request) for request in requests]
    client.wait(lambda: all(response.done() for response in responses))
    assert [response.result().result.successful for response in responses] == [True, True]
    client.node.destroy_client(steps)


def test_steps_may_be_shorter_than_those_of_the_physics(world: SimProcess, client: Client) -> None:
    start = json.loads(client.call(Trigger, "/sim/sync").message)["time"]
    for number in range(1, 8):
        result = step(client, ("until", integer(start + number * 1_000_000)))
        assert result.successful
        assert json.loads(result.reason)["time"] == start + number * 1_000_000


def test_client_of_a_world_that_ends_raises(world: SimProcess, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lockstep, "RETRY_AFTER_S", 0.2)
    with RosSession("client") as session:
        clock = LockstepClock(session, LIMIT_S)
        assert world.interrupt() == 130
        with pytest.raises(RosError, match="the simulation has ended"):
            clock.wait_until(clock.now() + TENTH, threading.Event())
        with pytest.raises(RosError, match="btcore ros2 sim --lockstep"):
            LockstepClock(session, 0.3)


@pytest.mark.usefixtures("no_world")
def test_end_of_the_duration_refuses_further_steps(
    start: Callable[..., SimProcess], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lockstep, "RETRY_AFTER_S", 0.2)
    simulation = start("--lockstep", "--duration", "0.5")
    with RosSession("client") as session:
        clock = LockstepClock(session, LIMIT_S)
        with pytest.raises(RosError, match=r"the simulation (ended at 0\.500 s|has ended)"):
            clock.wait_until(10 * TENTH, threading.Event())
    assert simulation.process.wait(LIMIT_S) == 0
    assert simulation.result()["time_s"] == 0.5


@pytest.mark.usefixtures("no_world")
def test_world_without_a_client_ends_after_the_limit(start: Callable[..., SimProcess]) -> None:
    simulation = start("--lockstep", "--wait-limit", "0.5")
    assert simulation.process.wait(LIMIT_S) == 1
    assert "no client requested a step for 0.5 s" in simulation.errors
    assert "Traceback" not in simulation.errors
