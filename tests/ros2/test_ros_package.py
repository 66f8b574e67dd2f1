"""packaging/ros, installed as by colcon for a Python without btcore: `ros2 run`, and the launch files."""

import os
import re
import shlex
import signal
import site
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pytest
from lxml import etree

pytest.importorskip("rclpy")
pytest.importorskip("btcpp_ros2_interfaces")
pytest.importorskip("nav2_msgs")

from action_msgs.msg import GoalStatus
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Trigger

from btcore_ros2.session import RosSession
from tests.colcon_installation import PACKAGE, install_as_by_colcon
from tests.ros2.action_client import ClientProcess
from tests.ros2.conftest import LIMIT_S, wait_until
from tests.ros2.nav2.conftest import start

EXECUTE_TREE = "btcpp_ros2_interfaces/action/ExecuteTree"
CALL = """
<RetryUntilSuccessful num_attempts="-1">
  <RosServiceCall service_name="go" type="std_srvs/srv/Trigger" server_timeout="60000"/>
</RetryUntilSuccessful>
"""
NAV2_LEAF = '<Wait wait_duration="1" server_timeout="60000"/>'

pytestmark = pytest.mark.skipif(
    not (PACKAGE / "btcore").is_symlink(), reason="needs symbolic links, which an sdist lacks"
)


@pytest.fixture(scope="module")
def prefix(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The installed package, sourced: this environment is that of the processes that a test starts."""
    folder = tmp_path_factory.mktemp("colcon")
    # The environment of the tests contains btcore. Of the new environment, PYTHONPATH is searched first; its
    # .pth files, such as that of an editable install, are ignored.
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder / "robot"], check=True)
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("PYTHONPATH", site.getsitepackages()[0])
        prefix = install_as_by_colcon(folder, str(folder / "robot/bin/python"))
        (modules,) = prefix.glob("lib/python*/site-packages")
        environment.setenv("PYTHONPATH", os.pathsep.join([str(modules), site.getsitepackages()[0]]))
        environment.setenv("AMENT_PREFIX_PATH", str(prefix))
        yield prefix


def commands(prefix: Path, name: str, given: Mapping[str, str]) -> Iterator[list[str]]:
    """The commands that `ros2 launch btcore NAME.launch.xml` starts.

    `launch` is not on PyPI. This reads the part of its language that our files use, and rejects the rest.
    """
    values = dict(given)
    share = str(prefix / "share/btcore")

    def expand(text: str) -> list[str]:
        """As launch: the value of a variable is a single argument, or a part of one."""
        parts = shlex.split(re.sub(r"\$\((var|find-pkg-share) (\w+)\)", r"<\1:\2>", text))
        return [re.sub(r"<(\S+?):(\w+)>", lambda match: value(match[1], match[2]), part) for part in parts]

    def value(kind: str, name: str) -> str:
        if kind == "var":
            return values[name]
        assert name == "btcore"
        return share

    def expand_text(text: str) -> str:
        return re.sub(r"\$\((\S+) (\w+)\)", lambda match: value(match[1], match[2]), text)

    file = prefix / f"share/btcore/launch/{name}.launch.xml"
    for element in etree.parse(file).getroot().iterchildren("*"):
        attributes = dict(element.attrib)
        if element.tag == "arg":
            assert attributes.pop("description")
            values.setdefault(attributes["name"], expand_text(attributes["default"]))
        elif element.tag == "include":
            included = Path(expand_text(attributes["file"])).name.removesuffix(".launch.xml")
            arguments = {
                arg.get("name"): expand_text(arg.get("value")) for arg in element.iterchildren("arg")
            }
            yield from commands(prefix, included, arguments)
        else:
            assert element.tag == "node"
            assert attributes.pop("pkg") == "btcore"
            assert attributes.pop("output") == "screen"
            command = [str(prefix / "lib/btcore" / attributes.pop("exec")), *expand(attributes.pop("args"))]
            command.append("--ros-args")
            namespace = expand_text(attributes.pop("namespace"))
            command += ["-r", f"__ns:=/{namespace}"] if namespace else []
            for parameter in element.iterchildren("param"):
                command += ["--params-file", expand_text(parameter.get("from"))]
            assert attributes == {}
            yield command


@contextmanager
def launched(prefix: Path, name: str, **arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run the launch file, and end its process as launch does."""
    (command,) = commands(prefix, name, arguments)
    with subprocess.Popen(command) as process:
        try:
            yield process
            process.send_signal(signal.SIGINT)
            assert process.wait(LIMIT_S) == 0
        finally:
            process.kill()


def write_trees(folder: Path, **leaves: str) -> Path:
    folder.mkdir()
    trees = [f'<BehaviorTree ID="{name}">{leaf}</BehaviorTree>' for name, leaf in leaves.items()]
    (folder / "trees.xml").write_text(f'<root BTCPP_format="4">{"".join(trees)}</root>')
    return folder


def test_btcore_comes_from_the_workspace(prefix: Path) -> None:
    python = prefix.parent / "robot/bin/python"
    show = "import btcore, btcore_ros2; print(btcore.__file__, btcore_ros2.__file__)"
    command = [python, "-c", show]
    printed = subprocess.run(command, cwd=prefix, check=True, capture_output=True, text=True).stdout
    assert all(Path(file).is_relative_to(prefix) for file in printed.split())


def test_ros2_run_runs_a_leaf_without_code(prefix: Path, session: RosSession, tmp_path: Path) -> None:
    def answer(request: object, response: Trigger.Response) -> Trigger.Response:
        response.success = True
        return response

    session.node.create_service(Trigger, "/robot1/go", answer)
    file = write_trees(tmp_path / "trees", Go=CALL) / "trees.xml"
    command = [prefix / "lib/btcore/btcore", "run", file, "--ros-args", "-r", "__ns:=/robot1"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        session.wait_for(lambda: process.poll() is not None, LIMIT_S)
        process.kill()
        _, errors = process.communicate()
        assert process.returncode == 0, errors


@pytest.fixture(scope="module")
def client() -> Iterator[ClientProcess]:
    client = ClientProcess(wait_until)
    yield client
    client.close()


@pytest.fixture(scope="module")
def plain_nav2() -> Iterator[None]:
    process = start(str(Path(__file__).parent / "nav2/plain_nav2.py"))
    yield
    process.communicate(timeout=LIMIT_S)


@pytest.mark.parametrize(
    ("name", "arguments", "leaf", "action"),
    [
        ("tree_server", {"namespace": "robot1"}, "<AlwaysSuccess/>", "/robot1/by_file"),
        ("nav2_robot", {"options": "--ros-args -p action_name:=by_option"}, NAV2_LEAF, "/by_option"),
    ],
)
@pytest.mark.usefixtures("plain_nav2")
def test_launch_file_serves_trees(
    prefix: Path,
    client: ClientProcess,
    tmp_path: Path,
    name: str,
    arguments: dict[str, str],
    leaf: str,
    action: str,
) -> None:
    trees = write_trees(tmp_path / "my trees", Go=leaf)
    file = tmp_path / "parameters.yaml"
    file.write_text("/**: {ros__parameters: {action_name: by_file, groot2_port: 0}}\n")
    with launched(prefix, name, trees=shlex.quote(str(trees)), params_file=str(file), **arguments):
        goal = client.send(action, EXECUTE_TREE, {"target_tree": "Go"})
        status, result = client.result(goal)
        assert status == GoalStatus.STATUS_SUCCEEDED, result


def test_launch_file_simulates_a_robot(prefix: Path, session: RosSession) -> None:
    pytest.importorskip("pybullet")
    scans: list[LaserScan] = []
    session.node.create_subscription(LaserScan, "/robot1/scan_raw", scans.append, qos_profile_sensor_data)
    arguments = {"world": "arena_boxes", "namespace": "robot1", "options": "--camera off"}
    with launched(prefix, "simulated_robot", **arguments) as process:
        session.wait_for(lambda: scans or process.poll() is not None, LIMIT_S)
        assert scans
