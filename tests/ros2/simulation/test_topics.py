"""The simulated robot in another process: what it publishes, and the commands that it takes."""

import json
import math
from collections.abc import Callable
from itertools import groupby, pairwise
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("pybullet")

from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState, CameraInfo, Image, JointState, LaserScan
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from btcore_sim.world_description import WORLD_FILES
from tests.ros2.simulation.process import Client, SimProcess

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
TYPES = {
    "/clock": "rosgraph_msgs/msg/Clock",
    "/scan_raw": "sensor_msgs/msg/LaserScan",
    "/mobile_base_controller/odom": "nav_msgs/msg/Odometry",
    "/joint_states": "sensor_msgs/msg/JointState",
    "/robot_description": "std_msgs/msg/String",
    "/power/battery": "sensor_msgs/msg/BatteryState",
    "/head_front_camera/rgb/image_raw": "sensor_msgs/msg/Image",
    "/head_front_camera/rgb/camera_info": "sensor_msgs/msg/CameraInfo",
    "/head_front_camera/depth_registered/image_raw": "sensor_msgs/msg/Image",
}


@pytest.fixture(scope="module", autouse=True)
def simulation(
    start: Callable[..., SimProcess], client: Client, tmp_path_factory: pytest.TempPathFactory
) -> SimProcess:
    """The arena with a door, in real time."""
    arena = json.loads((WORLD_FILES / "arena.json").read_text(encoding="utf-8"))
    arena["objects"].append(
        {"name": "back-door", "kind": "sliding_door", "position": [-2, 2], "width": 0.8, "yaw": 0}
    )
    world = tmp_path_factory.mktemp("world") / "arena_with_door.json"
    world.write_text(json.dumps(arena), encoding="utf-8")
    started = start("--world", str(world), "--start", "0,0,0", "--battery", "50", "--camera", "64x48@5")
    clock = client.messages(Clock, "/clock", qos_profile_sensor_data)
    client.wait(lambda: clock or started.process.poll() is not None)
    return started


def stamp(message: object) -> int:
    header = message.header.stamp  # type: ignore[attr-defined]
    return int(header.sec * 10**9 + header.nanosec)


def period(messages: list[Any]) -> float:
    """Return the shortest time (ns) between two messages: a slow client loses others."""
    stamps = [stamp(message) for message in messages]
    return min((later - earlier for earlier, later in pairwise(stamps)), default=math.inf)


def test_topics_have_the_types_and_the_quality_of_the_real_robot(client: Client) -> None:
    found = client.node.get_publishers_info_by_topic
    client.wait(lambda: all(found(topic) for topic in TYPES))
    assert {topic: found(topic)[0].topic_type for topic in TYPES} == TYPES
    (scan,), (description,) = found("/scan_raw"), found("/robot_description")
    assert scan.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT
    assert description.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL
    commands = ("/cmd_vel", "/key_vel", "/joy_vel")
    listeners = client.node.get_subscriptions_info_by_topic
    client.wait(lambda: all(listeners(topic) for topic in commands))
    assert {listeners(topic)[0].topic_type for topic in commands} == {"geometry_msgs/msg/Twist"}


def test_stamps_follow_the_rates_of_the_sensors(client: Client) -> None:
    scans = client.messages(LaserScan, "/scan_raw", qos_profile_sensor_data)
    motion = client.messages(Odometry, "/mobile_base_controller/odom")
    clock = client.messages(Clock, "/clock", qos_profile_sensor_data)
    client.wait(lambda: period(scans) <= 100_000_000 and period(motion) <= 20_000_000 and clock)
    assert (period(scans), period(motion)) == (100_000_000, 20_000_000)
    scan = scans[-1]
    assert len(scan.ranges) == 666
    assert scan.header.frame_id == "base_laser_link"
    assert scan.angle_max == pytest.approx(-scan.angle_min)
    assert scan.scan_time == pytest.approx(0.1)
    assert 0.2 < min(scan.ranges) < 10.0
    assert motion[-1].header.frame_id == "odom"
    assert motion[-1].child_frame_id == "base_footprint"
    assert abs(clock[-1].clock.sec - scans[-1].header.stamp.sec) <= 5


def test_urdf_has_the_frames_of_base_and_sensors(client: Client) -> None:
    texts = client.messages(String, "/robot_description", LATCHED)
    states = client.messages(JointState, "/joint_states")
    client.wait(lambda: texts and states)
    robot = ElementTree.fromstring(texts[0].data)
    links = {link.get("name") for link in robot.iterfind("link")}
    assert links >= {"base_footprint", "base_laser_link", "head_front_camera_rgb_optical_frame"}
    children = [str(child.get("link")) for child in robot.iterfind("joint/child")]
    assert links - set(children) == {"base_footprint"}
    assert len(children) == len(set(children))
    moving = {joint.get("name") for joint in robot.iterfind("joint") if joint.get("type") != "fixed"}
    assert set(states[0].name) == moving


def test_transforms_connect_odometry_and_sensors(client: Client) -> None:
    messages = pytest.importorskip("tf2_msgs.msg")
    moving = client.messages(messages.TFMessage, "/tf", 100)
    static = client.messages(messages.TFMessage, "/tf_static", LATCHED)
    client.wait(lambda: moving and static)
    parents = {
        frame.child_frame_id: frame.header.frame_id
        for frame in (*moving[-1].transforms, *static[0].transforms)
    }
    for frame in ("base_laser_link", "head_front_camera_rgb_optical_frame"):
        while frame != "odom":
            frame = parents[frame]
    assert parents["base_footprint"] == "odom"


def test_higher_priority_wins_until_its_commands_stop(client: Client) -> None:
    motion = client.messages(Odometry, "/mobile_base_controller/odom")
    tree = client.node.create_publisher(Twist, "/cmd_vel", 10)
    joystick = client.node.create_publisher(Twist, "/joy_vel", 10)
    turn, back = Twist(), Twist()
    turn.angular.z, back.angular.z = 0.5, -0.5

    def turns(sign: int) -> bool:
        return bool(motion) and motion[-1].twist.twist.angular.z * sign > 0.4

    client.publish_until([(tree, turn)], lambda: turns(1))
    both = [(joystick, back), (tree, turn)]
    client.publish_until(both, lambda: turns(-1))
    seen = len(motion)
    client.publish_until(both, lambda: len(motion) > seen + 15)
    # The commands of a slow client lapse, and the robot stands for a while.
    assert all(odometry.twist.twist.angular.z < 0.1 for odometry in motion[seen:])
    client.publish_until([(tree, turn)], lambda: turns(1))
    client.wait(lambda: abs(motion[-1].twist.twist.angular.z) < 0.01)  # the command has lapsed


def test_invalid_commands_are_ignored_with_a_warning(client: Client, simulation: SimProcess) -> None:
    publisher = client.node.create_publisher(Twist, "/cmd_vel", 10)
    command = Twist()
    command.linear.x = math.nan
    client.publish_until([(publisher, command)], lambda: "v=nan m/s" in simulation.errors)
    arms = client.node.create_publisher(JointTrajectory, "/torso_controller/joint_trajectory", 10)
    wrong = JointTrajectory(joint_names=["arm_1_joint"], points=[JointTrajectoryPoint(positions=[0.1])])
    client.publish_until([(arms, wrong)], lambda: "controller has torso_lift_joint" in simulation.errors)
    assert simulation.process.poll() is None
    assert "Traceback" not in simulation.errors


def test_head_and_torso_follow_trajectories(client: Client) -> None:
    states = client.messages(JointState, "/joint_states", 1000)
    head = client.node.create_publisher(JointTrajectory, "/head_controller/joint_trajectory", 10)
    torso = client.node.create_publisher(JointTrajectory, "/torso_controller/joint_trajectory", 10)
    client.wait(lambda: states and head.get_subscription_count() and torso.get_subscription_count())
    first, last = JointTrajectoryPoint(positions=[-0.2, 0.8]), JointTrajectoryPoint(positions=[-0.4, -0.6])
    first.time_from_start.nanosec, last.time_from_start.sec = 500_000_000, 4
    # The joints are named in another order than that of the controller.
    head.publish(JointTrajectory(joint_names=["head_2_joint", "head_1_joint"], points=[first, last]))
    torso.publish(
        JointTrajectory(joint_names=["torso_lift_joint"], points=[JointTrajectoryPoint(positions=[0.05])])
    )

    def position(name: str, state: int = -1) -> float:
        return float(states[state].position[states[state].name.index(name)])

    # A slow client may receive the states of the first point together with later ones.
    client.wait(lambda: any(position("head_1_joint", state) > 0.7 for state in range(len(states))))
    client.wait(lambda: position("head_1_joint") == pytest.approx(-0.6, abs=0.01))
    client.wait(lambda: position("head_2_joint") == pytest.approx(-0.4, abs=0.01))
    client.wait(lambda: position("torso_lift_joint") == pytest.approx(0.05, abs=0.005))


def test_pictures_have_a_size_a_depth_and_a_camera_info(client: Client) -> None:
    pictures = client.messages(Image, "/head_front_camera/rgb/image_raw")
    depths = client.messages(Image, "/head_front_camera/depth_registered/image_raw")
    infos = client.messages(CameraInfo, "/head_front_camera/rgb/camera_info")
    client.wait(
        lambda: (
            period(pictures) <= 200_000_000
            and depths
            and {stamp(picture) for picture in pictures} & {stamp(info) for info in infos}
        )
    )
    picture, depth, info = pictures[-1], depths[-1], infos[-1]
    assert (picture.encoding, picture.width, picture.height, picture.step) == ("rgb8", 64, 48, 192)
    assert len(set(picture.data)) > 3
    assert (depth.encoding, depth.step) == ("32FC1", 256)
    assert 0.1 < np.frombuffer(depth.data, np.float32).min() < 10.0
    assert (info.width, info.height) == (64, 48)
    assert info.header.frame_id == picture.header.frame_id
    assert period(pictures) == 200_000_000


def test_services_recharge_trigger_events_and_report(client: Client) -> None:
    batteries = client.messages(BatteryState, "/power/battery")
    client.wait(lambda: batteries)
    assert batteries[-1].percentage == pytest.approx(0.5, abs=0.1)
    assert batteries[-1].present
    assert client.call(Trigger, "/sim/recharge").success
    client.wait(lambda: batteries[-1].percentage > 0.95)

    client.call(Trigger, "/sim/drop_box")  # its response is that of the second request if it is repeated
    again = client.call(Trigger, "/sim/drop_box")
    assert not again.success
    assert "'dropped_box_0' is where the box would drop" in again.message
    assert client.call(Trigger, "/sim/kidnap").success
    opened = client.call(SetBool, "/sim/doors/back_door", SetBool.Request(data=True))
    assert (opened.success, opened.message) == (True, "door 'back-door' opens")
    assert client.call(Trigger, "/sim/carry").success
    events = json.loads(client.call(Trigger, "/sim/summary").message)["events"]
    # A repeated request repeats its event.
    assert [kind for kind, _ in groupby(event["event"] for event in events)] == [
        "box",
        "kidnap",
        "door",
        "carry",
    ]
    assert client.call(Trigger, "/sim/reset_contacts").success
    summary = json.loads(client.call(Trigger, "/sim/summary").message)
    assert summary["robot"]["collisions"] == 0
    assert summary["time_s"] > 0


def test_interrupt_ends_the_simulation_with_its_report(simulation: SimProcess) -> None:
    assert simulation.interrupt() == 130
    assert simulation.result()["robot"]["battery_min"] < 50.0
    assert "Traceback" not in simulation.errors
