"""`btcore ros2 serve` and `TreeServer`, with a plain rclpy client in another process."""

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar

import pytest
from click.testing import CliRunner

pytest.importorskip("rclpy")
pytest.importorskip("btcpp_ros2_interfaces")

from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal
from rclpy.parameter import Parameter

import btcore
from btcore import Status
from btcore.cli.main import main
from btcore.tree.hooks import Hook
from btcore_monitor.events import TreeEvent
from btcore_monitor.watch.feed import Feed
from btcore_recorder import Replay
from btcore_ros2.errors import RosError
from btcore_ros2.interfaces import load_interface
from btcore_ros2.leaves import RosSubscriber
from btcore_ros2.session import RosSession
from btcore_ros2.tree_server import COLLECT_GOALS, TreeServer
from tests.ros2.action_client import ClientProcess
from tests.ros2.conftest import LIMIT_S, wait_until
from tests.ros2.discovery import wait_until_known

EXECUTE_TREE = "btcpp_ros2_interfaces/action/ExecuteTree"
GET_TREES = "btcpp_ros2_interfaces/srv/GetTrees"

TREES = """
<root BTCPP_format="4">
  <BehaviorTree ID="Quick"><SubTree ID="Ready"/></BehaviorTree>
  <BehaviorTree ID="Fails"><Inverter><SubTree ID="Ready"/></Inverter></BehaviorTree>
  <BehaviorTree ID="Slow"><Sleep name="long rest" msec="600000"/></BehaviorTree>
  <BehaviorTree ID="Endless"><Repeat num_cycles="-1"><Sleep msec="1"/></Repeat></BehaviorTree>
  <BehaviorTree ID="Broken"><Sequence><Break name="the gripper"/></Sequence></BehaviorTree>
  <BehaviorTree ID="Payload">
    <ScriptCondition code="payload == 'forward' &amp;&amp; @runs == 2"/>
  </BehaviorTree>
  <BehaviorTree ID="Entries"><Measure speed="{speed}" place="{place}"/></BehaviorTree>
  <BehaviorTree ID="Count"><Script code="@runs := 2"/></BehaviorTree>
  <BehaviorTree ID="Increase"><Script code="@runs += 1"/></BehaviorTree>
  <BehaviorTree ID="IsThree"><ScriptCondition code="@runs == 3"/></BehaviorTree>
</root>
"""
OTHER_TREES = '<root BTCPP_format="4"><BehaviorTree ID="Ready"><AlwaysSuccess/></BehaviorTree></root>'
PLUGIN = """
import btcore

@btcore.action
def break_():
    raise OSError("it is stuck")

break_.ID = "Break"

@btcore.condition
def measure(speed: btcore.In[float], place: btcore.In[str]):
    return speed == 0.5 and place == "kitchen"
"""


def write_trees(folder: Path) -> None:
    folder.mkdir()
    (folder / "main.xml").write_text(TREES)
    (folder / "more.xml").write_text(OTHER_TREES)
    (folder / "notes.txt").write_text("not a tree")


class ServerProcess:
    """A process of `btcore ros2 serve`."""

    def __init__(self, *arguments: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "btcore", "ros2", "serve", *arguments],
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "NO_COLOR": "1"},
        )
        self.lines: list[str] = []
        self.reader = threading.Thread(target=self._read)
        self.reader.start()
        assert wait_until(lambda: "serving" in self.text or self.process.poll() is not None)
        assert self.process.poll() is None, self.text

    def _read(self) -> None:
        assert self.process.stderr is not None
        with self.process.stderr as lines:
            for line in lines:
                self.lines.append(line)

    @property
    def text(self) -> str:
        return "".join(list(self.lines))

    def end(self, number: int = signal.SIGINT) -> int:
        """Send a signal, and return the exit code."""
        self.process.send_signal(number)
        code = self.process.wait(LIMIT_S)
        self.reader.join()
        return code


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("server")
    write_trees(folder / "trees")
    (folder / "plugin.py").write_text(PLUGIN)
    return folder


@pytest.fixture(scope="module")
def server(folder: Path) -> Iterator[ServerProcess]:
    server = ServerProcess(
        str(folder / "trees"),
        *("--plugin", str(folder / "plugin.py"), "--port", "0"),
        *("--ros-args", "-r __ns:=/robot1 -p tick_frequency:=50"),
    )
    yield server
    server.end()


@pytest.fixture(scope="module")
def client() -> Iterator[ClientProcess]:
    client = ClientProcess(wait_until)
    yield client
    client.close()


@contextmanager
def running(server: TreeServer) -> Iterator[ClientProcess]:
    """A client of a server, which runs in a thread."""
    thread = threading.Thread(target=server.run)
    thread.start()
    client = ClientProcess(wait_until)
    yield client
    server.stop()
    thread.join(LIMIT_S)
    assert not thread.is_alive()
    client.close()


def run(client: ClientProcess, tree: str, payload: str = "") -> int:
    return client.send("/robot1/bt_execution", EXECUTE_TREE, {"target_tree": tree, "payload": payload})


def ended(client: ClientProcess, number: int) -> tuple[int, Status, str]:
    """Return the status of the goal, the status of its tree, and the message."""
    status, result = client.result(number)
    return status, Status(result["node_status"]["status"]), result["return_message"]


def test_success(server: ServerProcess, client: ClientProcess) -> None:
    expected = (GoalStatus.STATUS_SUCCEEDED, Status.SUCCESS, "the tree ended in SUCCESS")
    assert ended(client, run(client, "Quick")) == expected


def test_failure_aborts(server: ServerProcess, client: ClientProcess) -> None:
    expected = (GoalStatus.STATUS_ABORTED, Status.FAILURE, "the tree ended in FAILURE")
    assert ended(client, run(client, "Fails")) == expected


def test_the_end_of_a_tree_that_fails_is_recorded(
    server: ServerProcess, client: ClientProcess, recordings: Path
) -> None:
    def recorded(tree: str) -> list[Path]:
        return list(recordings.glob(f"*_{tree}_*.btrec.txt"))

    before = recorded("Fails")
    assert ended(client, run(client, "Quick"))[1] is Status.SUCCESS
    assert ended(client, run(client, "Fails"))[1] is Status.FAILURE
    assert ended(client, run(client, "Broken"))[1] is Status.IDLE
    assert wait_until(lambda: recorded("Fails") > before and recorded("Broken"))
    assert not recorded("Quick")
    for file in [*recorded("Fails"), *recorded("Broken")]:
        assert wait_until(lambda file=file: f"the end of the run is recorded in {file}" in server.text)
        replay = Replay(file)
        assert replay.verify() is None
        assert replay.tree.ticks == 1


def test_exception_aborts_with_the_path_of_the_node(server: ServerProcess, client: ClientProcess) -> None:
    status, tree_status, message = ended(client, run(client, "Broken"))
    assert (status, tree_status) == (GoalStatus.STATUS_ABORTED, Status.IDLE)
    assert "node 'the gripper' <Break> raised while ticking: OSError: it is stuck" in message
    assert ended(client, run(client, "Quick"))[1] is Status.SUCCESS  # the server goes on


def test_cancel_halts_the_tree(server: ServerProcess, client: ClientProcess) -> None:
    number = run(client, "Slow")
    client.wait_until_executing(number)
    assert client.cancel(number) == 1
    status, tree_status, message = ended(client, number)
    assert (status, tree_status) == (GoalStatus.STATUS_CANCELED, Status.RUNNING)
    assert message == "cancelled: the tree was halted"


def test_unknown_tree(server: ServerProcess, client: ClientProcess) -> None:
    status, _, message = ended(client, run(client, "Quik"))
    assert status == GoalStatus.STATUS_ABORTED
    assert message == "unknown tree 'Quik'; did you mean 'Quick'?"


def test_payload_and_global_blackboard(server: ServerProcess, client: ClientProcess) -> None:
    assert ended(client, run(client, "Count"))[1] is Status.SUCCESS
    assert ended(client, run(client, "Payload", "forward"))[1] is Status.SUCCESS
    assert ended(client, run(client, "Payload", "back"))[1] is Status.FAILURE


def test_payload_with_entries(server: ServerProcess, client: ClientProcess) -> None:
    payload = 'json:{"speed": 0.5, "place": "kitchen"}'
    assert ended(client, run(client, "Entries", payload))[1] is Status.SUCCESS


@pytest.mark.parametrize(
    ("payload", "message"),
    [
        ("json:{speed", "the payload is not valid JSON after 'json:': Expecting property name"),
        ("json:[1]", "the payload is not an object after 'json:'"),
        ('json:{"speed": "fast"}', "speed"),
        ('json:{"speed": ' + "[" * 2000, "nested more than 100 levels deep"),
    ],
)
def test_bad_payload(server: ServerProcess, client: ClientProcess, payload: str, message: str) -> None:
    status, tree_status, text = ended(client, run(client, "Entries", payload))
    assert (status, tree_status) == (GoalStatus.STATUS_ABORTED, Status.IDLE)
    assert message in text


def test_second_goal_waits_for_the_first(server: ServerProcess, client: ClientProcess) -> None:
    first = run(client, "Slow")
    second, third = run(client, "Quick"), run(client, "Quick")
    assert client.cancel(third) == 1  # a waiting goal
    assert ended(client, third) == (GoalStatus.STATUS_CANCELED, Status.IDLE, "the tree was not started")
    assert not any(event["event"] == "result" and event["goal"] in (first, second) for event in client.events)
    client.cancel(first)
    assert ended(client, second)[1] is Status.SUCCESS


def test_repeated_goal_runs_once(server: ServerProcess, client: ClientProcess, session: RosSession) -> None:
    """As over a bridge: the second request has the same ID."""
    from rclpy.action import ActionClient
    from unique_identifier_msgs.msg import UUID

    action = load_interface(EXECUTE_TREE, "action")
    run(client, "Count")
    sender = ActionClient(session.node, action, "/robot1/bt_execution")
    wait_until_known(session, "/robot1/bt_execution")
    goal = action.Goal(target_tree="Increase")
    answers = [sender.send_goal_async(goal, goal_uuid=UUID(uuid=[7] * 16)) for _ in range(2)]
    assert session.wait_for(lambda: all(answer.done() for answer in answers), LIMIT_S)
    assert [answer.result().accepted for answer in answers] == [True, False]
    result = answers[0].result().get_result_async()
    assert session.wait_for(result.done, LIMIT_S)
    assert ended(client, run(client, "IsThree"))[1] is Status.SUCCESS
    sender.destroy()


def test_goal_of_a_client_that_was_killed_goes_on(
    server: ServerProcess, client: ClientProcess, session: RosSession
) -> None:
    killed = ClientProcess(wait_until)
    run(killed, "Endless")
    with killed.process:
        killed.process.kill()
        killed.reader.join()  # the thread reads what the process has written
    waiting = run(client, "Quick")
    assert client.feedback(waiting) == []
    all_goals = session.node.create_client(CancelGoal, "/robot1/bt_execution/_action/cancel_goal")
    wait_until_known(session, "/robot1/bt_execution")
    cancelled = all_goals.call_async(CancelGoal.Request())
    assert session.wait_for(cancelled.done, LIMIT_S)
    assert len(cancelled.result().goals_canceling) == 2
    assert client.result(waiting)[0] == GoalStatus.STATUS_CANCELED
    session.node.destroy_client(all_goals)


def test_get_loaded_trees(server: ServerProcess, client: ClientProcess) -> None:
    trees = client.call("/robot1/get_loaded_trees", GET_TREES)["tree_ids"]
    assert trees == sorted(re.findall('BehaviorTree ID="(.*?)"', TREES + OTHER_TREES))


def test_parameters(server: ServerProcess, client: ClientProcess) -> None:
    response = client.call(
        "/robot1/bt_action_server/get_parameters",
        "rcl_interfaces/srv/GetParameters",
        names=["action_name", "tick_frequency", "groot2_port"],
    )
    name, frequency, port = response["values"]
    assert (name["string_value"], frequency["integer_value"]) == ("bt_execution", 50)
    assert port["integer_value"] == 1667


def test_changed_file_is_used_by_new_goal(server: ServerProcess, client: ClientProcess, folder: Path) -> None:
    file = folder / "trees" / "more.xml"
    file.write_text(OTHER_TREES.replace("AlwaysSuccess", "AlwaysFailure"))
    try:
        assert ended(client, run(client, "Quick"))[1] is Status.FAILURE
        file.write_text("<root")
        status, _, message = ended(client, run(client, "Quick"))
        assert status == GoalStatus.STATUS_ABORTED
        assert "more.xml:1" in message
    finally:
        file.write_text(OTHER_TREES)
    assert ended(client, run(client, "Quick"))[1] is Status.SUCCESS


def test_monitor_follows_the_trees(server: ServerProcess, client: ClientProcess) -> None:
    """A connected monitor, with the protocol of Groot 2, gets the tree of each goal."""
    address = re.search(r"publishing at tcp://127.0.0.1:(\d+)", server.text)
    assert address is not None
    seen: list[str] = []
    with Feed(f":{address[1]}") as feed:

        def sees(name: str) -> bool:
            for event in feed.poll(0.05):
                if isinstance(event, TreeEvent):
                    seen.extend(node.name for node in event.tree.nodes)
            return name in seen

        number = run(client, "Slow")
        assert wait_until(lambda: sees("long rest"))
        client.cancel(number)
        assert ended(client, run(client, "Broken"))[0] == GoalStatus.STATUS_ABORTED
        assert wait_until(lambda: sees("the gripper"))


@pytest.mark.parametrize(
    ("tree", "number", "code"), [("Slow", signal.SIGINT, 130), ("Endless", signal.SIGTERM, 143)]
)
def test_signal_aborts_goals(folder: Path, client: ClientProcess, tree: str, number: int, code: int) -> None:
    name = f"act_{tree.lower()}_{int(number)}"
    plugin = ("--plugin", str(folder / "plugin.py"))
    server = ServerProcess(str(folder / "trees"), *plugin, "--port", "0", "--action-name", name)
    goals = [client.send(name, EXECUTE_TREE, {"target_tree": tree}) for _ in range(2)]
    client.wait_until_executing(goals[0])
    assert server.end(number) == code
    assert ended(client, goals[0]) == (GoalStatus.STATUS_ABORTED, Status.RUNNING, "the server was stopped")
    assert ended(client, goals[1]) == (GoalStatus.STATUS_ABORTED, Status.IDLE, "the tree was not started")


def test_busy_port(folder: Path) -> None:
    """A usage error, as it is for `btcore run --publish groot2`."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        arguments = [str(folder / "trees" / "more.xml"), "--ros-args", f"-p groot2_port:={port}"]
        code, text = refused(*arguments)
    assert code != 0
    assert f"port {port} is in use" in text
    assert "the ROS parameter groot2_port" in text


def refused(*arguments: str) -> tuple[int, str]:
    done = CliRunner().invoke(main, ["ros2", "serve", *arguments])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, " ".join(done.output.split())


def test_invalid_parameter(folder: Path) -> None:
    code, text = refused(
        str(folder / "trees" / "more.xml"), "--port", "0", "--ros-args", "-p tick_frequency:=often"
    )
    assert code == 2
    assert 'the ROS parameter tick_frequency is "often", and a number is expected' in text


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        ("-p tick_frequency:=50 extra", "unknown arguments of the ROS node: ['extra']"),
        ("-p tick_frequency=50", "ROS 2 cannot start: failed to initialize rcl: Couldn't parse parameter"),
        ("-p 'tick_frequency:=50", "--ros-args: No closing quotation in -p 'tick_frequency:=50"),
    ],
)
def test_invalid_arguments_of_the_ros_node_are_usage_errors(folder: Path, given: str, problem: str) -> None:
    code, text = refused(str(folder / "trees" / "more.xml"), "--ros-args", given)
    assert code == 2
    assert problem in text


def test_no_trees() -> None:
    code, text = refused("--ros-args", "-p behavior_trees:=[btcpp_ros2_interfaces/trees]")
    assert code == 2
    assert "there is no file, folder or ROS package for 'btcpp_ros2_interfaces/trees'" in text


def test_trees_and_plugins_of_a_parameter_file(folder: Path, client: ClientProcess) -> None:
    """A file for the C++ server can be used, apart from the C++ libraries."""
    parameters = folder / "parameters.yaml"
    parameters.write_text(
        "bt_action_server:\n"
        "  ros__parameters:\n"
        "    action_name: from_file\n"
        "    groot2_port: 0\n"
        "    tick_frequenzy: 50\n"
        "    ros_plugins_timeout: 1000\n"
        "    speed: 1.0\n"
        f"    plugins: [btcpp_ros2_samples/bt_plugins, {folder / 'plugin.py'}]\n"
        f"    behavior_trees: [{folder / 'trees'}]\n"
    )
    server = ServerProcess("--ros-args", f"--params-file {parameters}")
    number = client.send("from_file", EXECUTE_TREE, {"target_tree": "Quick"})
    assert ended(client, number)[1] is Status.SUCCESS
    check_changes_of_parameters(folder, client)
    assert server.end() == 130
    warning = "the ROS parameter tick_frequenzy has no effect; did you mean 'tick_frequency'?"
    assert re.findall("the ROS parameter .* has no effect.*", server.text) == [warning]
    assert "'btcpp_ros2_samples/bt_plugins' of the ROS parameter is ignored" in " ".join(server.text.split())


def check_changes_of_parameters(folder: Path, client: ClientProcess) -> None:
    """Change the parameters of the server, of which the next goal uses the new values."""

    def change(name: str, kind: int, field: str, value: Any) -> str:
        parameter = {"name": name, "value": {"type": kind, field: value}}
        response = client.call(
            "/bt_action_server/set_parameters", "rcl_interfaces/srv/SetParameters", parameters=[parameter]
        )
        (result,) = response["results"]
        return str(result["reason"]) if not result["successful"] else ""

    def set_texts(name: str, *texts: str) -> str:
        return change(name, 9, "string_array_value", texts)

    def goal(tree: str) -> str:
        return ended(client, client.send("from_file", EXECUTE_TREE, {"target_tree": tree}))[2]

    other = folder / "other_plugin.py"
    other.write_text(PLUGIN.replace("break_", "shake").replace("Break", "Shake"))
    shaking = folder / "shaking.xml"
    shaking.write_text('<root BTCPP_format="4"><BehaviorTree ID="Shaking"><Shake/></BehaviorTree></root>')
    assert set_texts("behavior_trees", str(shaking)) == ""
    assert "E101 unknown node <Shake>" in goal("Shaking")
    assert set_texts("plugins", str(other)) == ""
    assert "<Shake> raised while ticking: OSError" in goal("Shaking")
    assert "unknown tree 'Quick'" in goal("Quick")
    assert "there is no file, folder or ROS package for 'nothing'" in set_texts("behavior_trees", "nothing")
    assert "there are no trees to serve" in set_texts("behavior_trees")
    assert "tick_frequency has to be between 0 and 10000" in change("tick_frequency", 2, "integer_value", 0)
    assert 'tick_frequency is "often"' in change("tick_frequency", 4, "string_value", "often")
    assert change("tick_frequency", 3, "double_value", 20.0) == ""
    assert "read-only parameter: action_name" in change("action_name", 4, "string_value", "other")
    described = client.call(
        "/bt_action_server/describe_parameters",
        "rcl_interfaces/srv/DescribeParameters",
        names=["action_name", "groot2_port", "plugins"],
    )
    assert [
        (item["read_only"], item["additional_constraints"].partition(",")[0])
        for item in described["descriptors"]
    ] == [(True, "read-only"), (True, "read-only"), (False, "")]


class CountingServer(TreeServer):
    """Overrides all methods for subclasses."""

    may_end = threading.Event()

    def reject_reason(self, tree_id: str, payload: str) -> str:
        return "" if payload.isdigit() else "the payload is not a number"

    def on_tree_created(self, tree: btcore.Tree, payload: str) -> None:
        tree.blackboard["limit"] = self.limit = int(payload)
        self.begun = self.ticks = 0

    def on_before_tick(self) -> Status | None:
        self.begun += 1
        return Status.FAILURE if self.limit == 0 else None

    def on_tick(self, status: Status) -> Status | None:
        self.ticks += 1
        return Status.SKIPPED if self.may_end.is_set() else None

    def feedback(self) -> str | None:
        return f"tick {self.ticks}" if self.ticks <= 2 else None

    def on_completed(self, status: Status, was_cancelled: bool) -> str | None:
        return f"{status} after {self.ticks} ticks{', cancelled' if was_cancelled else ''}"


def test_python_server(session: RosSession, folder: Path) -> None:
    """The methods of a subclass; the server runs on the thread of its caller."""
    nodes = btcore.Registry.standard()
    nodes.add_plugin(folder / "plugin.py")
    file = folder / "counting.xml"
    file.write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="Count">'
        '<KeepRunningUntilFailure><ScriptCondition code="limit == 1000000"/></KeepRunningUntilFailure>'
        "</BehaviorTree></root>"
    )
    with (
        CountingServer(session, [file], nodes=nodes, action_name="count", tick_frequency=1000.0) as server,
        running(server) as client,
    ):

        def send(payload: str, *, accepted: bool = True) -> int:
            goal = {"target_tree": "Count", "payload": payload}
            return client.send("count", EXECUTE_TREE, goal, accepted=accepted)

        send("many", accepted=False)
        number = send("1000000")
        client.wait(lambda: len(client.feedback(number)) == 2)
        server.may_end.set()
        status, result = client.result(number)
        assert status == GoalStatus.STATUS_ABORTED
        assert result["node_status"]["status"] == Status.SKIPPED
        assert result["return_message"] == f"SKIPPED after {server.ticks} ticks, cancelled"
        assert server.begun == server.ticks
        assert [message["message"] for message in client.feedback(number)] == ["tick 1", "tick 2"]
        assert session.node.set_parameters([Parameter("tick_frequency", value=500)])[0].successful
        status, result = client.result(send("0"))
        assert server._period == 2_000_000
        assert (status, result["node_status"]["status"]) == (GoalStatus.STATUS_ABORTED, Status.FAILURE)
        assert result["return_message"] == "FAILURE after 0 ticks, cancelled"


class Hear(RosSubscriber):
    topic_name = "/heard"
    message_type = "std_msgs/msg/String"
    alive: ClassVar[weakref.WeakSet["Hear"]] = weakref.WeakSet()

    def __init__(self, session: RosSession) -> None:
        super().__init__(session)
        self.alive.add(self)

    def on_message(self, message: Any) -> bool:
        return True


def test_trees_of_the_past_are_collected(session: RosSession, tmp_path: Path) -> None:
    """That nothing else is left is tested by test_many_goals.py."""
    file = tmp_path / "past.xml"
    file.write_text('<root BTCPP_format="4"><BehaviorTree ID="Listen"><Hear/></BehaviorTree></root>')
    nodes = btcore.Registry.standard()
    nodes.add(Hear)
    with (
        TreeServer(session, [file], nodes=nodes, action_name="past", tick_frequency=1000.0) as server,
        running(server) as client,
    ):
        goals = [client.send("past", EXECUTE_TREE, {"target_tree": "Listen"}) for _ in range(50)]
        for number in goals:
            status, result = client.result(number)
            assert status == GoalStatus.STATUS_SUCCEEDED, result["return_message"]
        assert len(Hear.alive) <= COLLECT_GOALS + 1
    assert session.wait_for(lambda: not list(session.node.subscriptions), LIMIT_S)


def test_the_end_of_a_server_releases_a_tick_at_a_breakpoint(session: RosSession, tmp_path: Path) -> None:
    stopped = threading.Event()

    class StoppingServer(TreeServer):
        def on_tree_created(self, tree: btcore.Tree, payload: str) -> None:
            tree.hooks.subscribe(lambda hook: stopped.set())
            tree.hooks.insert(Hook(1))

    file = tmp_path / "quick.xml"
    file.write_text('<root BTCPP_format="4"><BehaviorTree ID="Quick"><AlwaysSuccess/></BehaviorTree></root>')
    with StoppingServer(session, [file], action_name="stop") as server, running(server) as client:
        client.send("stop", EXECUTE_TREE, {"target_tree": "Quick"})
        assert stopped.wait(LIMIT_S)


def test_missing_folder_contents(session: RosSession, tmp_path: Path) -> None:
    with pytest.raises(RosError, match="no XML file in the folder"):
        TreeServer(session, [tmp_path])


def test_missing_resource(session: RosSession, folder: Path) -> None:
    class Gripper:
        pass

    @btcore.action
    def grasp(gripper: Gripper) -> None: ...

    nodes = btcore.Registry.standard()
    nodes.add(grasp)
    file = folder / "grasp.xml"
    file.write_text('<root BTCPP_format="4"><BehaviorTree ID="Main"><Grasp/></BehaviorTree></root>')
    with pytest.raises(RosError, match="the trees need a resource of the type Gripper, and none is given"):
        TreeServer(session, [file], nodes=nodes)
