"""`btcore ros2 messages` as a process."""

import importlib.util
import os
import signal
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from tests.ros2.conftest import wait_until

HAS_ROS = importlib.util.find_spec("rosidl_adapter") is not None
needs_ros = pytest.mark.skipif(not HAS_ROS, reason="could not import 'rosidl_adapter'")


def start(*arguments: str, **environment: str) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-m", "btcore", "ros2", "messages", *arguments],
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )


def run(*arguments: str, **environment: str) -> tuple[int, str]:
    process = start(*arguments, **environment)
    output, errors = process.communicate(timeout=120)
    return process.returncode, output + errors


def test_a_sourced_ros_is_refused() -> None:
    code, output = run("tf2_msgs", AMENT_PREFIX_PATH="/opt/ros/jazzy")
    assert code == 2
    assert "ROS 2 is sourced (/opt/ros/jazzy): build the packages with colcon" in output


@pytest.mark.skipif(HAS_ROS, reason="ROS 2 is installed")
def test_without_ros_the_command_names_the_extra() -> None:
    code, output = run("tf2_msgs")
    assert code == 2
    assert "pip install 'btcore[ros2]'" in output


@needs_ros
def test_a_missing_compiler_is_reported_if_no_wheel_fits(tmp_path: Path) -> None:
    workspace, wheels = tmp_path / "made_msgs", tmp_path / "wheels"
    for folder, file in ((workspace, "msg/Made.msg"), (wheels, "ros_made_msgs-0-py3-none-any.whl")):
        (folder / file).parent.mkdir(parents=True)
        (folder / file).write_text("int8 x\n")
    code, output = run(str(workspace), "--wheels", str(wheels), CXX="no-such-compiler")
    assert code == 2
    assert f"made_msgs: no wheel in {wheels} fits, so one is built" in output
    assert "the compiler 'no-such-compiler' is not installed: sudo apt install g++" in output


@needs_ros
def test_packages_from_elsewhere_stay_and_missing_messages_are_named(tmp_path: Path) -> None:
    for file in ("geometry_msgs/msg/Point.msg", "made_msgs/msg/Made.msg"):
        (tmp_path / file).parent.mkdir(parents=True)
        (tmp_path / file).write_text("far_msgs/Far here\n")
    code, output = run(str(tmp_path))
    assert code == 2
    assert (
        f"geometry_msgs: {version('ros-geometry-msgs')} is installed from elsewhere, and stays as it is"
        in output
    )
    assert "made_msgs: Made is left out, because far_msgs/Far is not installed" in output
    assert "nothing is left to build" in output


@needs_ros
def test_an_interrupted_build_leaves_nothing(tmp_path: Path) -> None:
    workspace, temporary = tmp_path / "made_msgs", tmp_path / "temporary"
    temporary.mkdir()
    (workspace / "msg").mkdir(parents=True)
    (workspace / "msg/Made.msg").write_text("int8 x\n")
    process = start(str(workspace), TMPDIR=str(temporary))
    made = "btcore-messages-*/share/*/msg/*.idl"
    assert wait_until(lambda: list(temporary.glob(made)) or process.poll() is not None)
    assert process.poll() is None  # the generators are running
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode not in (0, None)
    assert "Traceback" not in errors
    assert list(temporary.glob("btcore-*")) == []
    assert importlib.util.find_spec("made_msgs") is None
