"""A robot whose clock is the topic /clock."""

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("tf2_msgs")

from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Time
from rosgraph_msgs.msg import Clock

from btcore.clock import NS_PER_S
from btcore_robot import time_limits
from btcore_robot.testing import check_frames, check_info, check_scan, wait
from btcore_ros2.errors import RosError
from btcore_ros2.robot import ros_robot
from btcore_ros2.robot.ros_robot import RosRobot
from btcore_ros2.robot.sim_time import SimTime
from btcore_ros2.session import RosSession
from btcore_ros2.tree_server import TreeServer
from tests.ros2.action_client import ClientProcess
from tests.ros2.conftest import LIMIT_S, wait_until
from tests.ros2.robot.conftest import AGREEMENT_S, PointRobotProcess, describe, drive_until_error, stopped

TREES = """<root BTCPP_format="4">
    <BehaviorTree ID="Endless"><Repeat num_cycles="-1"><Sleep msec="10"/></Repeat></BehaviorTree>
    <BehaviorTree ID="Rest"><Sleep msec="100"/></BehaviorTree></root>"""


@pytest.fixture(scope="module")
def shared_process() -> Iterator[PointRobotProcess]:
    """A robot whose time is twice as fast as that of the machine."""
    robot = PointRobotProcess(sim_time=True, factor=2.0)
    robot.send(shift=1000 * NS_PER_S)
    yield robot
    robot.close()


@pytest.fixture
def process(shared_process: PointRobotProcess) -> Iterator[PointRobotProcess]:
    """The robot of the module, whose messages are sent again after the test."""
    yield shared_process
    shared_process.send(silent=[], paused=False, disorder=False)


@pytest.fixture(autouse=True)
def long_clock_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """Search for the topic of the clock until it is found, on a slow machine."""
    monkeypatch.setattr(ros_robot, "MAX_CLOCK_SEARCH_S", LIMIT_S)


def test_simulated_time(session: RosSession, process: PointRobotProcess, tmp_path: Path) -> None:
    robot = RosRobot(session, describe(tmp_path))
    assert isinstance(robot.clock, SimTime)
    check_info(robot)
    check_scan(robot)
    check_frames(robot)
    before, wall = robot.clock.now(), time.monotonic_ns()
    wait(robot, 1.0)
    # The time is that of the last message, which may be old on a slow machine.
    while robot.clock.now() - before < 1.5 * (time.monotonic_ns() - wall):
        assert time.monotonic_ns() - wall < LIMIT_S * NS_PER_S
        wait(robot, 0.1)


def test_jump_of_simulated_time(session: RosSession, process: PointRobotProcess, tmp_path: Path) -> None:
    robot = RosRobot(session, describe(tmp_path))
    before = robot.clock.now()
    process.send(shift=500 * NS_PER_S)  # more than the time that passes meanwhile
    assert "/clock jumped back by " in drive_until_error(robot)
    assert robot.clock.now() >= before
    robot.close()
    assert stopped(process, session)


def test_simulated_time_that_stops(
    session: RosSession,
    process: PointRobotProcess,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(time_limits, "MAX_CLOCK_SILENCE_S", 1.0)
    robot = RosRobot(session, describe(tmp_path))
    process.send(silent=["/clock"])
    # The robot is stopped before the run ends, and without a call of `close`.
    assert "/clock: no message for 1." in drive_until_error(robot)
    assert stopped(process, session)
    assert "the robot stands until it advances again" in caplog.text


def test_simulation_that_is_paused_goes_on(
    session: RosSession,
    process: PointRobotProcess,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(time_limits, "MAX_CLOCK_SILENCE_S", 2.0)
    robot = RosRobot(session, describe(tmp_path))
    robot.drive(0.1, 0.2)
    process.send(paused=True)
    end = threading.Timer(2.5, process.send, [], {"paused": False})
    end.start()
    before = robot.clock.now()
    try:
        wait(robot, 1.0)
        while "the time on /clock advances again" not in caplog.text:
            wait(robot, 0.1)
    finally:
        end.join()
    assert "the robot stands until it advances again" in caplog.text
    assert before < robot.clock.now() < before + AGREEMENT_S * NS_PER_S
    assert stopped(process, session)


def test_clock_in_wrong_order_is_no_jump(
    session: RosSession, process: PointRobotProcess, tmp_path: Path
) -> None:
    process.send(disorder=True)
    robot = RosRobot(session, describe(tmp_path))
    start, times = robot.clock.now(), []
    while robot.clock.now() < start + NS_PER_S:
        wait(robot, 0.02)
        times.append(robot.clock.now())
    assert times == sorted(times)


def test_clock_that_is_found_late_is_reported(
    session: RosSession,
    process: PointRobotProcess,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(ros_robot, "MAX_CLOCK_SEARCH_S", 0.0)
    monkeypatch.setattr(session.node, "count_publishers", lambda topic: topic != "/clock")
    robot = RosRobot(session, describe(tmp_path))
    monkeypatch.undo()
    wait(robot, 0.2)
    assert "/clock was found only after the start, and is not used" in caplog.text


def test_tree_server_survives_resets_and_pauses_of_the_simulation(
    session: RosSession,
    process: PointRobotProcess,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Only the goal in progress is aborted; a goal that arrives without a simulation waits for it."""
    pytest.importorskip("btcpp_ros2_interfaces")
    monkeypatch.setattr(time_limits, "MAX_CLOCK_SILENCE_S", 1.0)
    waiting = "waiting until the robot 'point' is available"
    file = tmp_path / "trees.xml"
    file.write_text(TREES)
    robot = RosRobot(session, describe(tmp_path))
    with TreeServer(session, [file], resources=[robot], action_name="reset", clock=robot.clock) as server:
        thread = threading.Thread(target=server.run)
        thread.start()
        client = ClientProcess(wait_until)

        def send(tree: str) -> int:
            return client.send("reset", "btcpp_ros2_interfaces/action/ExecuteTree", {"target_tree": tree})

        try:
            goal = send("Endless")
            before = robot.clock.now()
            process.send(shift=100 * NS_PER_S)
            status, result = client.result(goal)
            assert status == GoalStatus.STATUS_ABORTED
            assert "/clock jumped back by " in result["return_message"]
            assert client.result(send("Rest"))[0] == GoalStatus.STATUS_SUCCEEDED
            assert before <= robot.clock.now() < before + AGREEMENT_S * NS_PER_S
            assert abs(robot.odometry().stamp - robot.clock.now()) < AGREEMENT_S * NS_PER_S
            process.send(silent=["/clock"], shift=0)
            # By the silent clock, or before by stamps that jump back to the earlier shift.
            assert wait_until(lambda: caplog.text.count(waiting) == 2 or not thread.is_alive())
            goal = send("Rest")
            process.send(silent=[])
            assert client.result(goal)[0] == GoalStatus.STATUS_SUCCEEDED
            process.send(paused=True)
            server.stop()
            thread.join(LIMIT_S)
            assert not thread.is_alive()
        finally:
            process.send(silent=[], paused=False)
            server.stop()
            thread.join(LIMIT_S)
            client.close()
    assert caplog.text.count(waiting) == 2


def test_second_publisher_of_the_clock_is_named_with_a_remedy(
    session: RosSession, process: PointRobotProcess, tmp_path: Path
) -> None:
    robot = RosRobot(session, describe(tmp_path))
    with RosSession("other", arguments=["-r", "__ns:=/robot2"]) as other:
        publisher = other.node.create_publisher(Clock, "/clock", 10)

        def publishers() -> list[str]:  # DDS announces a publisher before the name of its ROS node
            return [publisher.node_name for publisher in session.node.get_publishers_info_by_topic("/clock")]

        assert session.wait_for(lambda: "other" in publishers() and len(publishers()) == 2, LIMIT_S)

        def has_jumped() -> bool:
            publisher.publish(Clock(clock=Time(sec=1)))
            assert isinstance(robot.clock, SimTime)
            return robot.clock.has_jumped

        assert session.wait_for(has_jumped, LIMIT_S)
        with pytest.raises(RosError, match=r"several ROS nodes publish it \(.*/robot2/other") as caught:
            wait(robot, 1.0)
    assert "-r /clock:=clock" in str(caught.value)
