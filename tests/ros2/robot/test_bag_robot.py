"""A robot whose sensors come from a bag. No test needs ROS."""

import json
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

pytest.importorskip("rosbags")

from btcore.cli.main import main
from btcore.clock import NS_PER_S
from btcore.errors import EndOfTimeError
from btcore.logs import LogError
from btcore_bags.reader import BagReader
from btcore_robot.robot import Phase
from btcore_ros2.errors import RosError
from btcore_ros2.robot.bag_robot import BagRobot
from btcore_ros2.robot.command_comparison import CommandComparison
from btcore_ros2.robot.description import load_robot
from tests.ros2.robot.bag_file import BagFile, description_file, header, time
from tests.ros2.robot.conftest import DESCRIPTION, PARTS

JOINTS = "sensor_msgs/msg/JointState"
CLOCK = "rosgraph_msgs/msg/Clock"
NEVER = threading.Event()

Replay = Callable[..., BagRobot]


@pytest.fixture
def replay(tmp_path: Path) -> Iterator[Replay]:
    """A function that returns the robot of a bag; all are closed after the test."""
    readers: list[BagReader] = []

    def begin(bag: BagFile, text: str = DESCRIPTION, **settings: Any) -> BagRobot:
        readers.append(BagReader(bag.write(**settings)))
        return BagRobot(readers[-1], load_robot(description_file(tmp_path, text)))

    yield begin
    for reader in readers:
        reader.close()


def wait(robot: BagRobot, seconds: float) -> None:
    """Wait until *seconds* after the time 0 of the bag."""
    robot.clock.wait_until(round((1000.0 + seconds) * NS_PER_S), NEVER)


def test_time_jumps_from_stamp_to_stamp_until_the_end(replay: Replay, tmp_path: Path) -> None:
    robot = replay(BagFile(tmp_path, 1.0, {0.0: 5.0, 0.3: 2.0}))
    assert robot.clock.now() == 1000 * NS_PER_S
    assert robot.odometry().stamp == robot.clock.now()
    seen: list[tuple[int, float, float]] = []

    def look(now: int) -> None:
        scan = robot.scan()
        assert scan is not None
        seen.append((now - 1000 * NS_PER_S, float(scan.ranges[1]), robot.odometry().pose.x))

    robot.schedule.add_task(10.0, Phase.CONTROLLER, look)
    wait(robot, 0.45)
    assert seen == [(10**8, 5.0, 0.1), (2 * 10**8, 5.0, 0.2), (3 * 10**8, 2.0, 0.3), (4 * 10**8, 2.0, 0.4)]
    assert robot.clock.now() == 1000 * NS_PER_S + 450_000_000
    for _ in range(2):
        with pytest.raises(EndOfTimeError):
            wait(robot, 99.0)
    assert robot.clock.now() == 1001 * NS_PER_S
    assert robot.warning == ""
    assert robot.laser_info.frame == "laser"
    assert {frame.child: frame.position for frame in robot.frames()} == {"laser": (0.2, 0.0, 0.1)}


def test_all_sensors_are_read(replay: Replay, tmp_path: Path) -> None:
    bag = BagFile(tmp_path)
    names = ["head_1_joint", "head_2_joint", "torso_lift_joint"]
    for now in (0.0, 0.5):
        bag.add(now, "/joint_states", JOINTS, header=header(now), name=names, position=[now, -now, 0.1])
    pixels = np.arange(12, dtype=np.uint8)
    size = {"height": 2, "width": 2}
    for now in (0.0, 0.4):
        at = {"header": header(now, "lens")}
        bag.add(now, "/image", "sensor_msgs/msg/Image", **at, **size, encoding="rgb8", step=6, data=pixels)
        far = np.full(4, 2.0, dtype="<f4").view(np.uint8)
        bag.add(now, "/depth", "sensor_msgs/msg/Image", **at, **size, encoding="32FC1", step=8, data=far)
    lens = [1.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0]
    bag.add(0.4, "/camera_info", "sensor_msgs/msg/CameraInfo", header=header(0.4, "lens"), **size, k=lens)
    limits = {"min_range": 0.1, "max_range": 3.0, "range": 1.5}
    bag.add(0.2, "/sonar", "sensor_msgs/msg/Range", header=header(0.2, "sonar"), **limits)
    bag.add(0.2, "/battery", "sensor_msgs/msg/BatteryState", header=header(0.2), percentage=0.5)
    robot = replay(bag, f"{DESCRIPTION}{PARTS}battery: {{topic: battery}}\n")
    assert robot.camera_info is not None  # read ahead
    assert robot.camera_info.frame == "lens"
    assert (robot.camera(), robot.battery(), robot.sonars()) == (None, None, ())
    wait(robot, 0.6)
    image, head, battery = robot.camera(), robot.head(), robot.battery()
    assert image is not None
    assert image.depth is not None
    assert image.rgb.tolist() == pixels.reshape(2, 2, 3).tolist()
    assert image.depth.tolist() == [[2.0, 2.0], [2.0, 2.0]]
    assert image.stamp == 1000 * NS_PER_S + 400_000_000
    assert head is not None
    assert (head.pan, head.tilt, robot.torso_height()) == (0.5, -0.5, 0.1)
    assert battery is not None
    assert battery.level == 50.0
    assert [sonar.range for sonar in robot.sonars()] == [1.5]


@pytest.mark.parametrize("origin", [1000.0, 0.0], ids=["wall time", "simulated time"])
def test_time_of_a_simulation(replay: Replay, tmp_path: Path, origin: float) -> None:
    bag = BagFile(tmp_path)
    for count in range(11):
        bag.add(max(0.0, count / 10 - 0.001), "/clock", CLOCK, clock=time(count / 10))
    robot = replay(bag, origin=origin)
    assert robot.clock.now() == 0
    robot.clock.wait_until(500_000_000, NEVER)
    assert robot.odometry().stamp == 500_000_000
    with pytest.raises(EndOfTimeError):
        robot.clock.wait_until(9 * NS_PER_S, NEVER)
    assert robot.clock.now() == NS_PER_S


def test_commands_are_compared_with_the_recorded_commands(replay: Replay, tmp_path: Path) -> None:
    bag = BagFile(tmp_path).drive(0.0, 0.2).drive(0.11, 0.2).drive(0.2, 0.2).drive(0.2, 0.1).drive(0.8, 0.4)
    for count in range(3):
        bag.drive(count / 10, 0.0, 0.3, topic="/key_vel")
    bag.drive(0.3, float("nan"))
    joints = ["head_2_joint", "head_1_joint"]
    points = [{"positions": [9.0, 9.0]}, {"positions": [0.2, 0.3]}]
    topic, kind = "/head_controller/joint_trajectory", "trajectory_msgs/msg/JointTrajectory"
    bag.add(0.3, topic, kind, joint_names=joints, points=points)
    bag.add(0.0, "/joint_states", JOINTS, name=[*joints, "torso_lift_joint"], position=[0.0, 0.0, 0.0])
    robot = replay(bag, DESCRIPTION + PARTS)
    robot.drive(0.2, 0.0)
    wait(robot, 0.1)
    robot.drive(9.0, 0.0)
    robot.drive(0.2, 0.0)  # of two commands at a time the second counts
    wait(robot, 0.2)
    robot.drive(9.0, 0.0)  # limited to 0.5
    wait(robot, 0.3)
    robot.move_head(0.3, 0.2)
    wait(robot, 0.9)
    robot.stop()  # at the end: not compared
    report = robot.compare_commands()
    assert list(report) == ["/cmd_vel", topic, "/key_vel"]
    assert report["/cmd_vel"] == {
        "sent": 4,  # with the zero when the last command expires
        "recorded": 4,
        "agree": 2,
        "differ": 2,
        "only_sent": 0,
        "only_recorded": 0,
        "largest_difference": 0.4,
        "first_difference": {"time_s": 0.2, "sent": {"v": 0.5, "w": 0.0}, "recorded": {"v": 0.1, "w": 0.0}},
    }
    head = report[topic]
    assert isinstance(head, dict)
    assert (head["sent"], head["agree"], head["first_difference"]) == (1, 1, None)
    keys = report["/key_vel"]
    assert isinstance(keys, dict)
    assert (keys["sent"], keys["recorded"], keys["only_recorded"]) == (0, 3, 3)


def test_commands_without_a_partner_are_counted() -> None:
    comparison = CommandComparison(window=5)
    for stamp in (10, 20, 40):
        comparison.add_sent("/a", stamp, {"v": 1.0})
    for stamp in (0, 6, 24, 60, 70):
        comparison.add_recorded("/a", stamp, {"v": 1.0005})
    report = comparison.report(start=5, end=70)["/a"]
    assert isinstance(report, dict)
    assert (report["sent"], report["recorded"]) == (3, 3)
    assert (report["agree"], report["differ"], report["only_sent"], report["only_recorded"]) == (2, 0, 1, 1)
    assert report["first_difference"] == {"time_s": 0.0, "sent": {"v": 1.0}, "recorded": None}
    assert comparison.report(start=100, end=200) == {}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda bag: bag.without("/scan"), "scan: the bag has no topic /scan"),
        (
            lambda bag: bag.renamed("/scan", "/lidar"),
            "scan: the bag has no topic /scan; topics of sensor_msgs/msg/LaserScan: /lidar",
        ),
        (
            lambda bag: bag.renamed("/scan", "/lidar").renamed("/odom", "/scan"),
            "scan: /scan is nav_msgs/msg/Odometry, but sensor_msgs/msg/LaserScan is expected\n"
            "  odometry: the bag has no topic /odom",
        ),
        (
            lambda bag: (
                bag.add(0.5, "/tf", "tf2_msgs/msg/TFMessage").without("/tf", -1.0).renamed("/odom", "/tf")
            ),
            "frames.tf: /tf is nav_msgs/msg/Odometry",
        ),
        (
            lambda bag: bag.without("/tf").add(0.0, "/tf", "tf2_msgs/msg/TFMessage"),
            "frames: the laser's frame 'laser' is not connected with 'base_footprint'",
        ),
    ],
)
def test_bag_of_another_robot_is_explained(
    replay: Replay, tmp_path: Path, change: Callable[[BagFile], BagFile], message: str
) -> None:
    with pytest.raises(RosError) as caught:
        replay(change(BagFile(tmp_path)))
    assert message in str(caught.value)
    assert f"in a copy of {tmp_path / 'point.yaml'}" in str(caught.value)


def test_sensor_that_stops_ends_the_run_with_a_warning(replay: Replay, tmp_path: Path) -> None:
    # The next message is a century later: the time does not run until then.
    bag = BagFile(tmp_path, 3.0).without("/scan", 1.0).drive(3e9, 0.0)
    robot = replay(bag, DESCRIPTION.replace("timeout: 20.0", "timeout: 1.0"))
    with pytest.raises(EndOfTimeError):
        wait(robot, 4e9)
    assert robot.clock.now() == 1000 * NS_PER_S + 1_950_000_000
    assert "/scan has no message for 1.1 s (limit 1 s)" in robot.warning


def test_reading_that_makes_no_sense_is_an_error(replay: Replay, tmp_path: Path) -> None:
    bag = BagFile(tmp_path).without("/odom", 0.5)
    pose = {"pose": {"position": {"x": float("nan"), "y": 0.0, "z": 0.0}, "orientation": {"w": 1.0}}}
    bag.add(0.5, "/odom", "nav_msgs/msg/Odometry", header=header(0.5), pose=pose)
    robot = replay(bag)
    with pytest.raises(RosError, match=r"run.mcap: /odom: the odometry is not finite"):
        wait(robot, 0.6)


def test_damaged_bag_is_an_error(tmp_path: Path) -> None:
    path = BagFile(tmp_path).write()
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(LogError, match="not a complete bag of ROS 2"):
        BagReader(path)


# --- btcore run --bag

TREE = """<root BTCPP_format="4"><BehaviorTree ID="Main">
  <ReactiveFallback>
    <Sequence><IsObstacle distance="1.0"/><Turn/></Sequence>
    <Forward/>
  </ReactiveFallback>
</BehaviorTree></root>"""


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Result]:
    """A function that calls `btcore run --bag run.mcap --ros2 point.yaml` on the tree."""
    monkeypatch.chdir(tmp_path)
    for name in [name for name in sys.modules if name.partition(".")[0] == "rclpy"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "rclpy", None)
    (tmp_path / "tree.xml").write_text(TREE)
    description_file(tmp_path)

    def call(*arguments: str, tree: str = "tree.xml") -> Result:
        command = ["run", tree, "--bag", "run.mcap", "--ros2", "point.yaml", *arguments]
        result = CliRunner().invoke(main, command, prog_name="btcore")
        assert "Traceback" not in result.output
        return result

    return call


def test_a_run_on_a_bag_reports_how_many_commands_agree(run: Callable[..., Result], tmp_path: Path) -> None:
    bag = BagFile(tmp_path, 3.0, {1.0: 0.5, 2.0: 5.0})
    for count in range(30):
        v, w = (0.3, 0.0) if count < 10 else (0.0, 0.5)
        bag.drive(count / 10, v, w if count < 25 else 0.55)
    bag.write()
    result = run("--json")
    assert result.exit_code == 0, result.output
    assert "until the end of the recording" in result.stderr
    assert "commands  /cmd_vel sent 30  recorded 30  agree 25  differ 5" in result.stderr
    report = json.loads(result.stdout.splitlines()[-1])
    assert report["time_s"] == 3.0
    assert report["commands"]["/cmd_vel"]["first_difference"]["time_s"] == 2.5
    assert report["commands"]["/cmd_vel"]["largest_difference"] == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--nav2",), "--bag and --nav2 exclude each other"),
        (("--lockstep",), "--bag and --lockstep exclude each other"),
        (("--ros-args", "-r scan:=/front"), "--bag and --ros-args exclude each other"),
        (("--ros2", "tiago"), "this is not a bag of the robot 'TIAGo':"),
        (("--bag", "gone.mcap"), "gone.mcap: cannot read this log: no such file"),
        (("--rate", "1"), "--rate 1 is too slow"),
    ],
)
def test_options_that_do_not_fit_a_bag(
    run: Callable[..., Result], tmp_path: Path, arguments: tuple[str, ...], message: str
) -> None:
    BagFile(tmp_path).write()
    result = run(*arguments)
    assert result.exit_code == 2
    assert message in result.stderr


def test_missing_package_is_named(
    run: Callable[..., Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    BagFile(tmp_path).write()
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    result = run()
    assert result.exit_code == 2
    assert "pip install 'btcore[bags]'" in result.stderr


def test_wait_for_a_save_ends_with_the_bag(run: Callable[..., Result], tmp_path: Path) -> None:
    BagFile(tmp_path, 2.0).write()
    tree = TREE.replace("<Forward/>", "<AlwaysSuccess/>")
    (tmp_path / "short.xml").write_text(tree)
    result = run("--watch", tree="short.xml")
    assert result.exit_code == 0
    assert "2.0 s, 1 tick" in result.stderr
    assert "until the end of the recording" in result.stderr


def test_options_of_simulated_robot_have_no_effect_on_bag(run: Callable[..., Result], tmp_path: Path) -> None:
    BagFile(tmp_path).write()
    message = "warning: --world has no effect: bag_robot provides the Robot"
    assert message in run("--world", "house").stderr


def test_trees_without_a_robot_and_with_ros_leaves(run: Callable[..., Result], tmp_path: Path) -> None:
    tree = '<root BTCPP_format="4"><BehaviorTree ID="Main">{}</BehaviorTree></root>'
    (tmp_path / "plain.xml").write_text(tree.format("<AlwaysSuccess/>"))
    result = run(tree="plain.xml")
    assert result.exit_code == 0
    assert "warning: --bag has no effect: no leaf needs a Robot\n" in result.stderr
    leaf = '<RosTopicPublish name="/a" type="std_msgs/msg/Empty"/>'
    (tmp_path / "ros.xml").write_text(tree.format(leaf))
    result = run(tree="ros.xml")
    assert result.exit_code == 2
    assert "the tree has leaves that use ROS 2" in result.stderr
