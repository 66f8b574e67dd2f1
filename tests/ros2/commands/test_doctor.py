"""`btcore ros2 doctor` as a process."""

import importlib.util
import json
import os
import subprocess
import sys
from typing import Any

import pytest

from tests.ros2.conftest import LIMIT_S

HAS_ROS = importlib.util.find_spec("rclpy") is not None
needs_ros = pytest.mark.skipif(not HAS_ROS, reason="could not import 'rclpy'")
SECONDS = ("2", "4", "8", "16", "32")  # tried in turn: a busy machine may discover other processes late


def doctor(*arguments: str, **environment: str) -> tuple[int, str]:
    done = subprocess.run(
        [sys.executable, "-m", "btcore", "ros2", "doctor", *arguments],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
    )
    assert "Traceback" not in done.stderr
    return done.returncode, done.stdout + done.stderr


def findings(*arguments: str) -> list[dict[str, Any]]:
    code, output = doctor("--json", *arguments)
    assert code == 0, output
    # Fast DDS may print a warning before or after it.
    found: list[dict[str, Any]] = json.JSONDecoder().raw_decode(output, output.index("{"))[0]["findings"]
    return found


@pytest.mark.skipif(HAS_ROS, reason="ROS 2 is installed")
def test_without_ros_the_command_says_how_to_install_it() -> None:
    code, output = doctor()
    assert code == 1
    assert "✗ installation: ROS 2 is not installed for this Python" in output
    assert "pip install 'btcore[ros2]'" in output


@needs_ros
@pytest.mark.usefixtures("mismatched_peer")
def test_topics_types_and_mismatches_of_other_processes_are_reported() -> None:
    from std_msgs.msg import Bool, String

    from btcore_ros2.session import RosSession

    with RosSession("reader") as session:
        session.node.create_subscription(String, "/unreliable", lambda message: None, 10)
        session.node.create_subscription(Bool, "/number", lambda message: None, 10)
        for seconds in SECONDS:
            found = {finding["subject"]: finding for finding in findings("--seconds", seconds)}
            mismatches = [
                subject
                for subject, finding in found.items()
                # The names of ROS nodes may become known later than their topics.
                if finding["level"] == "warning"
                and all(name in finding["text"] for name in ("/reader ", "/robot1/peer "))
            ]
            if {"topic /unreliable", "topic /number"} <= set(mismatches) and "topic /wanted_latched" in found:
                break
    assert found["installation"]["level"] == "ok"
    assert found["domain"]["text"].startswith(os.environ["ROS_DOMAIN_ID"])
    assert found["discovery"]["text"] == "LOCALHOST: this machine only"
    assert found["middleware"]["text"].startswith("rmw_")
    assert found["topic /unreliable"] == {
        "level": "warning",
        "subject": "topic /unreliable",
        "text": "std_msgs/msg/String: /reader (RELIABLE, VOLATILE) receives nothing from /robot1/peer "
        "(BEST_EFFORT, VOLATILE)",
        "remedy": "the subscription must be BEST_EFFORT, or the publisher RELIABLE",
    }
    number = found["topic /number"]
    assert number["level"] == "warning"
    assert "/robot1/peer uses std_msgs/msg/Float64" in number["text"]
    assert "/reader uses std_msgs/msg/Bool" in number["text"]
    assert found["topic /wanted_latched"]["level"] == "ok"
    assert "no ROS node publishes /clock" in found["clock"]["text"]


@needs_ros
def test_a_clock_of_a_simulation_is_named() -> None:
    from rosgraph_msgs.msg import Clock

    from btcore_ros2.session import RosSession

    def clock(expected: str, *arguments: str) -> tuple[str, str]:
        for seconds in SECONDS:
            found = [
                each for each in findings("--seconds", seconds, *arguments) if each["subject"] == "clock"
            ]
            if found and expected in found[0]["text"]:
                break
        return found[0]["text"], found[0]["remedy"]

    with (
        RosSession("simulation") as session,
        RosSession("simulation", arguments=["-r", "__ns:=/robot1", "-r", "/clock:=clock"]) as own,
    ):
        session.node.create_publisher(Clock, "/clock", 10)
        own.node.create_publisher(Clock, "/clock", 10)
        assert clock("simulated") == ("simulated time: /simulation publishes /clock", "")
        with RosSession("simulation", arguments=["-r", "__ns:=/robot2"]) as other:
            other.node.create_publisher(Clock, "/clock", 10)
            text, remedy = clock("several")
        assert text.startswith("several ROS nodes publish /clock: ")
        assert "-r /clock:=clock" in remedy
        text, _ = clock("simulated", "--ros-args", "-r __ns:=/robot1 -r /clock:=clock")
        assert text == "simulated time: /robot1/simulation publishes /robot1/clock"


@needs_ros
def test_problems_of_the_settings_are_errors_with_a_remedy() -> None:
    code, output = doctor(RMW_IMPLEMENTATION="rmw_zenoh_cpp")
    assert code == 1
    assert "✗ installation: the middleware RMW_IMPLEMENTATION=rmw_zenoh_cpp is not installed" in output
    assert "→ unset RMW_IMPLEMENTATION" in output
    code, output = doctor(ROS_DOMAIN_ID="many")
    assert code == 1
    assert "✗ domain: ROS_DOMAIN_ID=many" in output
