"""Leaves that are made from functions, with a server in another process."""

import time
from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("rclpy")

from planned_server import Answer, End, Plan, ServerProcess
from std_msgs.msg import String
from test_msgs.action import Fibonacci
from test_msgs.srv import BasicTypes

import btcore
from btcore import In, NodeExecutionError, Put, RegistrationError, Registry, Status, Tree
from btcore_ros2.leaves import RosCallError, ros_action, ros_publisher, ros_service, ros_subscriber
from btcore_ros2.session import RosSession
from tests.ros2.conftest import LIMIT_S
from tests.ros2.discovery import wait_until_known

S, F, R = Status.SUCCESS, Status.FAILURE, Status.RUNNING
CLOSED: list[str] = []


class Notebook:
    """A resource."""

    def __init__(self) -> None:
        self.lines: list[str] = []


@ros_action(Fibonacci, "planned", server_timeout=60_000, wait_for_server_timeout=60_000)
def send(order: In[int]) -> Any:
    """Send a goal."""
    return Fibonacci.Goal(order=order) if order >= 0 else None


@ros_action("test_msgs/action/Fibonacci", "planned", server_timeout=60_000, wait_for_server_timeout=60_000)
def send_and_read(book: Notebook, order: In[int], tag: Put[int], fallback: In[int] = 7) -> Any:
    try:
        result = yield Fibonacci.Goal(order=order)
    except RosCallError as error:
        book.lines += [error.code.name, str(error)]
        tag(fallback)
        return True
    finally:
        CLOSED.append("send_and_read")
    tag(result.sequence[0])
    return True


@ros_action(Fibonacci, "planned", server_timeout=60_000, wait_for_server_timeout=60_000)
def send_twice(order: In[int]) -> Any:
    yield Fibonacci.Goal(order=order)
    yield Fibonacci.Goal(order=order)


@ros_service(BasicTypes, "planned_service", server_timeout=60_000, wait_for_server_timeout=60_000)
def increment(number: In[int], sum: Put[int]) -> Any:
    response = yield BasicTypes.Request(int32_value=number)
    sum(response.int32_value)
    return response.int32_value > 0


@ros_publisher(String, "words")
def say(text: In[str] = "hello") -> Any:
    return String(data=text) if text else None


@ros_subscriber(String, "words", latch=True)
def heard(message: Any, expected: In[str] = "hello") -> bool:
    return message is not None and message.data == expected


@pytest.fixture(scope="module")
def session(server: ServerProcess) -> Iterator[RosSession]:
    with RosSession("leaves") as session:
        wait_until_known(session, "planned")
        yield session


def load(session: RosSession, body: str, book: Notebook | None = None) -> Tree:
    nodes = Registry.standard()
    nodes.add(send, send_and_read, send_twice, increment, say, heard)
    text = f'<root BTCPP_format="4"><BehaviorTree ID="T">{body}</BehaviorTree></root>'
    return btcore.loads(text, nodes=nodes, resources=[session, book or Notebook()], clock=session.clock)


def run(session: RosSession, body: str, book: Notebook | None = None) -> tuple[Status, Any]:
    tree = load(session, body, book)
    return tree.tick_while_running(period=0.01), tree.blackboard


@pytest.mark.parametrize(
    ("order", "status"), [(Plan().order, S), (Plan(answer=Answer.REJECT).order, F), (-1, F)]
)
def test_function_returns_the_goal(
    server: ServerProcess, session: RosSession, order: int, status: Status
) -> None:
    assert run(session, f'<Send order="{order}"/>')[0] is status


def test_generator_gets_the_result(server: ServerProcess, session: RosSession) -> None:
    status, board = run(session, f'<SendAndRead order="{Plan(tag=9).order}" tag="{{tag}}"/>')
    assert (status, board["tag"]) == (S, 9)


def test_generator_handles_a_failure(server: ServerProcess, session: RosSession) -> None:
    book = Notebook()
    status, board = run(session, f'<SendAndRead order="{Plan(end=End.ABORT).order}" tag="{{tag}}"/>', book)
    assert (status, board["tag"]) == (S, 7)
    assert book.lines == [
        "ACTION_ABORTED",
        "the action server 'planned' aborted the goal: its log may contain the reason",
    ]


def test_halt_closes_the_generator_and_cancels_the_goal(server: ServerProcess, session: RosSession) -> None:
    CLOSED.clear()
    tree = load(session, f'<SendAndRead order="{Plan(end=End.NEVER, tag=30).order}" tag="{{tag}}"/>')
    end = time.monotonic() + LIMIT_S
    while "executing" not in server.of(30):
        assert tree.tick_once() is R
        assert time.monotonic() < end
    tree.halt()
    assert CLOSED == ["send_and_read"]
    assert session.wait_for(lambda: "canceled" in server.of(30), LIMIT_S)


def test_generator_that_yields_again(server: ServerProcess, session: RosSession) -> None:
    with pytest.raises(NodeExecutionError, match="send_twice must yield once"):
        run(session, f'<SendTwice order="{Plan().order}"/>')


def test_service(server: ServerProcess, session: RosSession) -> None:
    status, board = run(session, '<Increment number="3" sum="{sum}"/>')
    assert (status, board["sum"]) == (S, 4)


def test_topic(session: RosSession) -> None:
    with RosSession("other") as other:
        publish, read = load(other, "<Say/>"), load(session, "<Heard/>")
        publisher = next(iter(publish))._endpoint.get()  # type: ignore[attr-defined]
        assert other.wait_for(publisher.get_subscription_count, LIMIT_S)
        assert read.tick_once() is F
        assert publish.tick_once() is S
        assert session.wait_for(lambda: read.tick_once() is S, LIMIT_S)
        assert load(other, '<Say text=""/>').tick_once() is F


def test_manifest() -> None:
    nodes = Registry.standard()
    nodes.add(send, send_and_read)
    manifest = nodes.get("SendAndRead")
    assert manifest is not None
    assert sorted(manifest.ports) == ["action_name", "fallback", "order", "tag"]
    assert send.__doc__ == "Send a goal."


def test_parameter_without_annotation() -> None:
    with pytest.raises(RegistrationError, match=r"parameter 'x' of .* has no annotation"):
        ros_publisher(String, "words")(lambda x: None)


def test_subscriber_without_a_parameter_for_the_message() -> None:
    def near(limit: In[float] = 1.0) -> bool:
        return limit > 0

    subscriber = ros_subscriber(String, "words")
    with pytest.raises(RegistrationError, match=r"first parameter of .*near is 'limit': .*def near\(message"):
        subscriber(near)
    with pytest.raises(RegistrationError, match="is missing: write a parameter for the message"):
        subscriber(lambda: True)
