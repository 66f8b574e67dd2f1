"""A message package is generated and compiled into a wheel that rclpy can use."""

import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

pytest.importorskip("rosidl_adapter")
pytest.importorskip("rclpy")

from btcore_ros2.message_packages import wheels
from btcore_ros2.message_packages.definitions import MessagePackage, find_packages

# The same name in each kind, a name with a digit, and messages of another package.
FILES = {
    "msg/Go.msg": "uint8 FAST=2\ngeometry_msgs/Point[] points\nfloat32[3] sizes\nstring text 'none'\n",
    "msg/Arm2D.msg": "Go[<=2] steps\nfloat64[] angles\n",
    "srv/Go.srv": "Arm2D arm\n---\nbool done\n",
    "action/Go.action": "geometry_msgs/PoseStamped pose\n---\nint32 code\n---\nfloat32 progress\n",
}
USE = """
from btcore_ros2.testing import isolate_ros
isolate_ros()
import array
from btcore_ros2.session import RosSession
from geometry_msgs.msg import Point
from made_msgs.action import Go as GoAction
from made_msgs.msg import Arm2D, Go
from made_msgs.srv import Go as GoService
from rclpy.action import ActionClient, ActionServer

arm = Arm2D(steps=[Go(points=[Point(x=1.0)], sizes=[1.0, 2.0, 3.0])], angles=array.array("d", range(1000)))
seen = []
with RosSession("made") as session:
    session.node.create_subscription(Arm2D, "arm", seen.append, 1)
    publisher = session.node.create_publisher(Arm2D, "arm", 1)
    session.node.create_service(GoService, "go", lambda request, response: [
        setattr(response, "done", request.arm == arm), response][1])
    client = session.node.create_client(GoService, "go")
    ActionServer(session.node, GoAction, "drive", lambda goal: GoAction.Result())
    assert session.wait_for(lambda: client.service_is_ready() and publisher.get_subscription_count(), 60)
    future = client.call_async(GoService.Request(arm=arm))
    publisher.publish(arm)
    assert ActionClient(session.node, GoAction, "drive").wait_for_server(60)
    assert session.wait_for(lambda: seen and future.done(), 60)
print(seen == [arm], future.result().done, Go.FAST, Go().text)
"""


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> MessagePackage:
    folder = tmp_path_factory.mktemp("workspace") / "made_msgs"
    for name, text in FILES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    [found] = find_packages([str(folder)])
    return found


def test_a_wheel_of_messages_services_and_actions_works_with_rclpy(
    package: MessagePackage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(wheels, "_OPTIMIZATION", "-O0")  # compiles faster
    monkeypatch.setenv("PIP_PREFIX", str(tmp_path / "first"))  # not into the environment of the tests
    steps: list[None] = []
    kept = tmp_path / "wheels"
    version = wheels.wheel_version(package, {})
    wheels.build_and_install(package, version, lambda: steps.append(None), kept)
    assert len(steps) == wheels.count_jobs(package)
    [wheel] = kept.iterdir()
    assert wheel.name == wheels.wheel_name(package, version)

    prefix = tmp_path / "second"
    command = [sys.executable, "-m", "btcore", "ros2", "messages", str(package.folder), "--wheels", str(kept)]
    without_compiler = {**os.environ, "PIP_PREFIX": str(prefix), "CXX": "no-such-compiler"}
    done = subprocess.run(command, env=without_compiler, capture_output=True, text=True, check=False)
    assert f"made_msgs: 4 interfaces installed from {kept} in " in done.stdout, done.stderr
    site = sysconfig.get_path("purelib", vars={"base": str(prefix)})
    libraries = os.pathsep.join([str(prefix / "lib"), os.environ.get("LD_LIBRARY_PATH", "")])
    done = subprocess.run(
        [sys.executable, "-c", USE],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([site, *sys.path]), "LD_LIBRARY_PATH": libraries},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout == "True True 2 none\n", done.stderr
    assert "rcutils" not in done.stderr  # where a type support is missing, rcutils reports errors
    assert ("made_msgs", "Arm2D") in wheels.installed_messages(prefix)


def test_the_version_changes_with_a_definition_and_with_what_it_needs(package: MessagePackage) -> None:
    first = wheels.wheel_version(package, {})
    assert wheels.wheel_version(package, {}) == first
    [changed] = find_packages([str(package.folder)])
    assert wheels.wheel_version(changed, {}) == first
    (package.folder / "msg/New.msg").write_text("int8 x\n")
    [changed] = find_packages([str(package.folder)])
    (package.folder / "msg/New.msg").unlink()
    assert wheels.wheel_version(changed, {}) != first
    assert wheels.wheel_version(package, {"geometry_msgs": "0"}) != first
