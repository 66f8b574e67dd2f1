"""`btcore ros2 sim`: options, errors, and what it leaves out."""

import json
import threading
from pathlib import Path

import pytest
from click.testing import CliRunner

pytest.importorskip("rclpy")
pytest.importorskip("pybullet")

from collections.abc import Callable

from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image
from std_srvs.srv import SetBool

from btcore.cli.main import main
from btcore_robot.robot import Pose2D
from btcore_ros2.session import RosSession
from btcore_ros2.simulation.services import offer_services
from btcore_ros2.simulation.topics import RobotTopics
from btcore_sim.camera import CameraSettings
from btcore_sim.scenario import Scenario
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.simulation import Simulation
from btcore_sim.world import World
from btcore_sim.worlds import load_world_description
from tests.ros2.conftest import LIMIT_S
from tests.ros2.simulation.process import SimProcess

SECOND = 1_000_000_000


def test_duration_and_options_of_the_simulator_apply(start: Callable[..., SimProcess]) -> None:
    arguments = (
        "--world",
        "aws_house",
        "--battery",
        "42",
        "--duration",
        "0.5",
        "--ros-args",
        "-r __ns:=/tiago",
    )
    simulation = start(*arguments)
    assert simulation.process.wait(LIMIT_S) == 0
    result = simulation.result()
    assert result["time_s"] == 0.5
    assert 41.0 < result["robot"]["battery_min"] < 42.0
    assert "has no effect" not in simulation.errors


@pytest.mark.parametrize(
    ("arguments", "environment", "message"),
    [
        (["--world", "hous"], {}, "house"),
        (["--ros-args", "-r scan"], {}, "remap rule: '-r scan'"),
        ([], {"ROS_DOMAIN_ID": "999"}, "no domain 999"),
        (["--ros2", "tiago"], {}, "--ros2 does not belong here"),
    ],
)
def test_a_mistake_of_the_user_is_a_message(
    monkeypatch: pytest.MonkeyPatch, arguments: list[str], environment: dict[str, str], message: str
) -> None:
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    done = CliRunner().invoke(main, ["ros2", "sim", "--duration", "1", *arguments])
    assert done.exit_code == 2
    assert isinstance(done.exception, SystemExit)
    assert message in done.output


def test_a_door_past_which_the_robot_is_carried_refuses_to_move(session: RosSession, tmp_path: Path) -> None:
    hatch = {"name": "hatch", "kind": "sliding_door", "position": [0, 0], "width": 0.8}
    path = tmp_path / "door.json"
    path.write_text(json.dumps({"start": {"pose": [-1, 0, 0]}, "objects": [hatch]}), encoding="utf-8")
    scenario = Scenario(0, 0, [], spare_boxes=1)
    world = World(scenario.add_to(load_world_description(str(path)), 1, 0.27))
    robot = SimulatedRobot(world)
    events = scenario.begin(world, robot, robot.base_info.radius)
    assert events is not None
    offer_services(session, Simulation(robot, world.description, events, (), None))
    robot.carry([Pose2D(x, 0.0, 0.0) for x in (-1.0, 0.0, 1.0)], 0.1)
    client = session.node.create_client(SetBool, "sim/doors/hatch")
    assert session.wait_for(client.service_is_ready, LIMIT_S)
    request = client.call_async(SetBool.Request(data=False))
    assert session.wait_for(request.done, LIMIT_S)
    assert not request.result().success
    assert "the robot is being carried past this door" in request.result().message
    world.close()


def test_no_picture_is_rendered_without_a_subscriber(session: RosSession) -> None:
    world = World(load_world_description("arena"))
    robot = SimulatedRobot(world, camera=CameraSettings(32, 24, 10.0))
    topics = RobotTopics(session, robot)
    image = "/head_front_camera/rgb/image_raw"
    world.wait_until(SECOND, threading.Event())
    assert robot.moving_scene().pictures == ()
    assert topics.published()[image] == 0

    pictures: list[Image] = []
    session.node.create_subscription(Image, image, pictures.append, qos_profile_sensor_data)
    assert session.wait_for(lambda: session.node.count_subscribers(image), LIMIT_S)
    world.wait_until(2 * SECOND, threading.Event())
    assert session.wait_for(lambda: pictures, LIMIT_S)
    assert len(robot.moving_scene().pictures) == 1
    assert topics.published()[image] == 10
    world.close()


def test_no_camera_topics_without_a_camera(session: RosSession) -> None:
    world = World(load_world_description("arena"))
    topics = RobotTopics(session, SimulatedRobot(world))
    assert not [topic for topic in topics.published() if "camera" in topic]
    world.wait_until(SECOND, threading.Event())
    world.close()
