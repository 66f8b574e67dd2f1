"""Descriptions of robots: the bundled files are valid, and each mistake is reported with its line."""

import re
from pathlib import Path

import pytest
import yaml

from btcore_robot.robot import BaseInfo
from btcore_ros2.errors import RosError
from btcore_ros2.robot import description
from btcore_ros2.robot.description import bundled_robots, load_robot
from btcore_sim.robot_description import load_robot_description
from tests.ros2.robot.conftest import DESCRIPTION, PARTS

BUNDLED = {
    # The topic for velocities and whether it is stamped, the topics of laser and odometry, the frame of the
    # base, and the limits (m/s, rad/s).
    "tiago": ("cmd_vel", False, "scan_raw", "mobile_base_controller/odom", "base_footprint", (1.0, 2.09)),
    "turtlebot3": ("cmd_vel", True, "scan", "odom", "base_footprint", (0.22, 2.84)),
    "turtlebot4": ("cmd_vel", False, "scan", "odom", "base_link", (0.306, 1.9)),
}


def test_bundled_robots_have_the_topics_of_their_repositories() -> None:
    assert set(bundled_robots()) == BUNDLED.keys()
    for name, facts in BUNDLED.items():
        robot = load_robot(name)
        topic = next(iter(robot.velocity.topics))
        limits = (robot.base.v_max, robot.base.w_max)
        scan, odometry = robot.scan, robot.odometry
        assert facts == (
            topic,
            robot.velocity.type == "TwistStamped",
            scan.topic,
            odometry.topic,
            robot.base_frame,
            limits,
        )
        # A best effort subscription receives from publishers of both kinds, and many scans are best effort.
        assert scan.reliability == "best_effort"
        # A scan or an odometry that stops has to end the run.
        assert scan.timeout
        assert odometry.timeout
        assert scan.timeout > 3.0 / robot.scan.rate
        assert robot.battery is None or robot.battery.reliability == "best_effort"


@pytest.mark.parametrize("name", BUNDLED)
def test_names_of_bundled_robots_are_relative(name: str) -> None:
    """Robots in two namespaces share nothing; RosSession moves the transforms into the namespace."""
    content = yaml.safe_load((Path(description.__file__).parent / f"{name}.yaml").read_text("utf-8"))
    assert set(re.findall(r"'(/[\w/]+)'", str(content))) == {"/tf", "/tf_static"}


def test_tiago_has_the_facts_of_the_simulated_tiago() -> None:
    tiago, simulated = load_robot("tiago"), load_robot_description()
    assert tiago.base == simulated.base
    assert simulated.head is not None
    assert tiago.head is not None
    assert tiago.head.joints == (simulated.head.pan, simulated.head.tilt)
    assert tiago.head.info == simulated.head.info
    assert simulated.torso is not None
    assert tiago.torso is not None
    assert tiago.torso.info == simulated.torso.info
    info = simulated.laser.info
    assert (tiago.scan.rate, tiago.scan.sigma) == (info.rate, info.sigma)
    assert tiago.velocity.topics == {"cmd_vel": 10, "key_vel": 90, "joy_vel": 100}


def test_defaults(tmp_path: Path) -> None:
    path = tmp_path / "point.yaml"
    path.write_text(DESCRIPTION + PARTS)
    robot = load_robot(path)
    assert robot.base == BaseInfo(-0.3, 0.5, 1.0, 1.0, 2.0, 0.5, 0.2)
    assert (robot.use_sim_time, robot.odom_frame, robot.base_frame) == (None, "odom", "base_footprint")
    assert robot.scan.reliability == "best_effort"
    assert robot.scan.timeout == 20.0
    assert robot.joint_states is not None
    assert robot.joint_states.timeout is None


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("v_max: 0.5", "vmax: 0.5", ":3: 'base.vmax' is unknown: known are v_min, v_max"),
        ("v_min: -0.3", "v_min: 0.3", ":3: 'base.v_min' is 0.3, and a number of at most 0 is expected"),
        ("command_timeout: 0.5", "command_timeout: 2", ":3: 'base.command_timeout' is 2"),
        ("{/cmd_vel: 10, /key_vel: 90}", "{}", ":6: 'velocity.topics' is {}"),
        ("{tf: /tf}", "{}", ":7: 'frames.tf' is missing"),
        ("joint_states:", "#", ":9: 'head' needs the positions of its joints: add 'joint_states'"),
        ("pan_limits: [-1.3, 1.3]", "pan_limits: [1.3, -1.3]", ":12: 'head.pan_limits' is [1.3, -1.3]"),
        ("joints: [head_1_joint, head_2_joint]", "joints: [head_1_joint]", "a list of 2 texts is expected"),
        ("near: 0.1", "near: 9", ":16: 'camera.far' is 8, and it has to be greater than 'near'"),
        ("sonars: [/sonar]", "name: twice", ":17:1: not valid YAML: 'name' occurs twice"),
    ],
)
def test_mistake_is_reported_with_its_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    text = DESCRIPTION + PARTS
    assert old in text
    path = tmp_path / "point.yaml"
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(RosError) as caught:
        load_robot(path)
    assert str(path) in str(caught.value)
    assert message in str(caught.value)


def test_unknown_robot_is_reported(tmp_path: Path) -> None:
    with pytest.raises(RosError, match=r"there is no robot 'tiga': .*; did you mean 'tiago'"):
        load_robot("tiga")
    with pytest.raises(RosError, match=r"missing\.yaml"):
        load_robot(tmp_path / "missing.yaml")
