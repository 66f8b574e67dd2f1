"""A session with the ROS node of a program, whose executor serves the rest of the program meanwhile."""

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")

from rclpy.context import Context
from rclpy.executors import Executor, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import SetBool

import btcore
from btcore import Status
from btcore_ros2.errors import RosError
from btcore_ros2.leaves import RosAction, register
from btcore_ros2.session import RosSession
from btcore_ros2.tree_server import TreeServer
from tests.docs.test_docs import blocks
from tests.ros2.conftest import LIMIT_S

CALLS = """
<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>
  <RosActionCall action_name="fibonacci" type="test_msgs/action/Fibonacci" goal='json:{"order": 3}'
                 result="{sequence}" result_field="sequence"
                 wait_for_server_timeout="60000" server_timeout="60000"/>
  <RosServiceCall service_name="set_bool" type="std_srvs/srv/SetBool" request='json:{"data": true}'
                  response="{answer}" response_field="message"
                  wait_for_server_timeout="60000" server_timeout="60000"/>
  <RosTopicRead topic_name="echo" type="std_msgs/msg/String" message="{heard}" field="data" timeout="60000"/>
</Sequence></BehaviorTree></root>
"""
EXECUTE = """
<root BTCPP_format="4"><BehaviorTree ID="Main">
  <RosActionCall action_name="bt_execution" type="btcpp_ros2_interfaces/action/ExecuteTree"
                 goal='json:{"target_tree": "Quick"}' result="{message}" result_field="return_message"
                 wait_for_server_timeout="60000" server_timeout="60000"/>
</BehaviorTree></root>
"""
ENDLESS = '<root BTCPP_format="4"><BehaviorTree ID="Main"><Endless/></BehaviorTree></root>'


class Endless(RosAction):
    """A goal that lasts until it is cancelled."""

    action_name = "fibonacci"
    action_type: Any = "test_msgs/action/Fibonacci"
    wait_for_server_timeout = 60_000
    server_timeout = 60_000
    received = 0

    def make_goal(self) -> Any:
        """Return the goal."""
        return self.action_type.Goal(order=1000)

    def on_feedback(self, feedback: Any) -> None:
        """Count."""
        self.received += 1


class Program(Node):  # type: ignore[misc]
    """A ROS node with a timer, a subscription and a service; a second timer may tick a tree."""

    def __init__(self, context: Context, executor: Executor) -> None:
        super().__init__("program", context=context)
        self.turns = 0
        self.received: list[str] = []
        self.words = self.create_publisher(String, "words", 10)
        self.create_subscription(String, "echo", lambda message: self.received.append(message.data), 10)
        self.create_service(SetBool, "program_set", self.answer)
        self.create_timer(0.01, self.work)
        executor.add_node(self)
        self.spinning = executor

    def work(self) -> None:
        """Publish a word."""
        self.turns += 1
        self.words.publish(String(data="word"))

    def answer(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """Return the data of the request."""
        response.success = request.data
        return response

    def spin_until(self, condition: Callable[[], Any]) -> bool:
        """Let the executor work until *condition* is met."""
        end = time.monotonic() + LIMIT_S
        while not condition():
            if time.monotonic() > end:
                return False
            self.spinning.spin_once(0.05)
        return True

    def entities(self) -> list[int]:
        """Return how many entities of each type there are."""
        kinds = (self.publishers, self.subscriptions, self.clients, self.services, self.timers)
        return [len(list(kind)) for kind in (*kinds, self.waitables)]


@pytest.fixture
def program(request: pytest.FixtureRequest) -> Iterator[Program]:
    """A ROS node in a program's executor."""
    context = Context()
    context.init()
    executor = getattr(request, "param", SingleThreadedExecutor)(context=context)
    program = Program(context, executor)
    yield program
    executor.shutdown()
    program.destroy_node()
    context.try_shutdown()


def create_tree(text: str, session: RosSession) -> btcore.Tree:
    nodes = btcore.Registry.standard()
    register(nodes)
    nodes.add(Endless)
    return btcore.loads(text, nodes=nodes, resources=[session], clock=session.clock)


@pytest.mark.usefixtures("server")
@pytest.mark.parametrize(
    ("program", "use_executor"),
    [(SingleThreadedExecutor, False), (MultiThreadedExecutor, True)],
    indirect=["program"],
)
def test_tree_is_ticked_by_a_timer_of_the_same_node(program: Program, use_executor: bool) -> None:
    before = program.entities()
    session = RosSession(node=program, use_executor=use_executor)
    tree = create_tree(CALLS, session)
    statuses: list[Status] = []

    def tick() -> None:
        if not statuses or statuses[-1] is Status.RUNNING:
            statuses.append(tree.tick_once())

    timer = program.create_timer(0.01, tick)
    assert program.spin_until(lambda: statuses and statuses[-1] is not Status.RUNNING)
    assert statuses[-1] is Status.SUCCESS
    sequence: Any = tree.blackboard["sequence"]
    assert list(sequence) == [0, 1, 1, 2, 3]
    assert (tree.blackboard["answer"], tree.blackboard["heard"]) == ("set", "word")
    assert "word" in program.received, "the program receives, too"
    assert program.turns > 1
    program.destroy_timer(timer)
    session.close()
    assert program.executor is program.spinning
    assert program.entities() == before
    turns, received = program.turns, len(program.received)
    assert program.spin_until(lambda: program.turns > turns and len(program.received) > received)


@pytest.mark.usefixtures("server")
def test_halt_and_close_in_a_timer(program: Program) -> None:
    """Closing waits for the answer of the server, while the executor is in the callback of the timer."""
    before = program.entities()
    session = RosSession(node=program)
    tree = create_tree(ENDLESS, session)
    leaf = tree.root
    assert isinstance(leaf, Endless)
    client = program.create_client(SetBool, "set_bool", callback_group=session.callback_group)
    answered: list[bool] = []

    def tick() -> None:
        if answered:
            return
        tree.tick_once()
        if leaf.received:
            call = client.call_async(SetBool.Request(data=True))
            done = session.wait_for(call.done, LIMIT_S, client)
            tree.halt()
            session.close()
            answered.append(done)

    timer = program.create_timer(0.01, tick)
    assert program.spin_until(lambda: answered)
    assert answered == [True]
    assert not session.unfinished, "the server has acknowledged the cancellation"
    program.destroy_timer(timer)
    assert program.entities() == before
    assert program.context.ok()
    with pytest.raises(RosError, match="session was closed"):
        session.refresh()


def test_tree_server_in_thread_beside_executor(program: Program, session: RosSession, tmp_path: Path) -> None:
    pytest.importorskip("btcpp_ros2_interfaces")
    file = tmp_path / "quick.xml"
    file.write_text('<root BTCPP_format="4"><BehaviorTree ID="Quick"><AlwaysSuccess/></BehaviorTree></root>')
    before = program.entities()
    own = RosSession(node=program)
    with own, TreeServer(own, [file]) as server:
        thread = threading.Thread(target=server.run)
        thread.start()
        tree = create_tree(EXECUTE, session)
        assert program.spin_until(lambda: tree.tick_once() is not Status.RUNNING)
        assert tree.blackboard["message"] == "the tree ended in SUCCESS"
        server.stop()
        thread.join(LIMIT_S)
    assert program.entities() == before


def test_node_has_its_own_arguments(program: Program) -> None:
    with pytest.raises(RosError, match="only without a ROS node"):
        RosSession(node=program, arguments=["-r", "a:=b"])


PATROL = '<root BTCPP_format="4"><BehaviorTree ID="Patrol"><Sleep msec="{}"/></BehaviorTree></root>'


@pytest.mark.parametrize("duration_ms", [100, 600_000])
def test_program_of_the_guide_ends_with_its_tree_or_by_ctrl_c(tmp_path: Path, duration_ms: int) -> None:
    page = Path(__file__).parents[2] / "docs/guides/from_behaviortree_ros2.md"
    program = next(block.text for block in blocks(page.read_text("utf-8")) if "class Patrol" in block.text)
    (tmp_path / "patrol.xml").write_text(PATROL.format(duration_ms), encoding="utf-8")
    program = program.replace("self.result = Future()", "self.result = Future(); print('loaded', flush=True)")
    command = [sys.executable, "-c", program]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "loaded\n"
        if duration_ms > 1000:
            time.sleep(0.5)  # Ctrl-C reaches a callback, or the executor between two callbacks
            process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=LIMIT_S)
    expected = "the tree ended in SUCCESS\n" if duration_ms < 1000 else ""
    assert (process.returncode, output) == (0, expected)
