"""`RosService`, `RosPublisher` and `RosSubscriber` with a server in another process."""

import time
from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("rclpy")

from planned_server import ServerProcess, start_planned_server
from std_msgs.msg import String
from test_msgs.srv import BasicTypes

import btcore
from btcore import In, Out, Registry, Status, Tree
from btcore_ros2.leaves import RosPublisher, RosService, RosSubscriber, ServiceErrorCode
from btcore_ros2.session import RosSession
from tests.ros2.conftest import LIMIT_S
from tests.ros2.discovery import wait_until_known

S, F, R = Status.SUCCESS, Status.FAILURE, Status.RUNNING


class Increment(RosService):
    service_name = "planned_service"
    service_type = BasicTypes
    server_timeout = 60_000
    wait_for_server_timeout = 60_000

    number: In[int]
    delay_ms: In[int] = 0
    sum: Out[int] = ""  # type: ignore[assignment]

    def on_start(self) -> Any:
        self.errors: list[ServiceErrorCode] = []
        return super().on_start()

    def make_request(self) -> Any:
        if self.number < 0:
            return None
        return BasicTypes.Request(int32_value=self.number, uint16_value=self.delay_ms)

    def on_response(self, response: Any) -> Any:
        self.sum = response.int32_value
        return True

    def on_failure(self, error: ServiceErrorCode) -> Any:
        self.errors.append(error)
        return F


class ShortTimeout(Increment):
    server_timeout = 50


class Unknown(Increment):
    service_name = "planned_servise"
    wait_for_server_timeout = 200


class Say(RosPublisher):
    topic_name = "speech"
    message_type = String
    text: In[str]

    def make_message(self) -> Any:
        return String(data=self.text) if self.text else None


class Hear(RosSubscriber):
    topic_name = "speech"
    message_type = String
    heard: Out[str]

    def on_message(self, message: Any) -> Any:
        if message is not None:
            self.heard = message.data
        return message is not None


class HearAgain(Hear):
    latch = True


@pytest.fixture(scope="module")
def session(server: ServerProcess) -> Iterator[RosSession]:
    with RosSession("leaves") as session:
        wait_until_known(session, "planned")
        yield session


def load(session: RosSession, body: str) -> Tree:
    nodes = Registry.standard()
    nodes.add(Increment, ShortTimeout, Unknown, Say, Hear, HearAgain)
    text = f'<root BTCPP_format="4"><BehaviorTree ID="T">{body}</BehaviorTree></root>'
    return btcore.loads(text, nodes=nodes, resources=[session], clock=session.clock)


def leaf_of(tree: Tree) -> Any:
    return next(node for node in tree if isinstance(node, RosService | RosSubscriber))


# --- services


def test_response(server: ServerProcess, session: RosSession) -> None:
    tree = load(session, '<Increment number="4" sum="{sum}"/>')
    assert tree.tick_while_running(period=0.01) is S
    assert tree.blackboard["sum"] == 5


def test_late_response_is_ignored(server: ServerProcess, session: RosSession) -> None:
    tree = load(session, '<ShortTimeout number="{n}" delay_ms="{delay}" sum="{sum}"/>')
    tree.blackboard["n"], tree.blackboard["delay"] = 70, 2000
    assert tree.tick_while_running(period=0.01) is F
    leaf = leaf_of(tree)
    assert leaf.errors == [ServiceErrorCode.SERVICE_TIMEOUT]
    assert "'planned_service' did not answer within 50 ms" in leaf.error_message
    tree.blackboard["n"], tree.blackboard["delay"] = 80, 0
    leaf.server_timeout = 60_000
    began = time.monotonic()
    assert tree.tick_while_running(period=0.01) is S
    assert tree.blackboard["sum"] == 81
    assert session.wait_for(lambda: time.monotonic() > began + 2.2, LIMIT_S)  # the first response arrives
    assert tree.blackboard["sum"] == 81


def test_halted_call_is_forgotten(server: ServerProcess, session: RosSession) -> None:
    tree = load(session, '<Increment number="{n}" delay_ms="{delay}" sum="{sum}"/>')
    tree.blackboard["n"], tree.blackboard["delay"] = 90, 1000
    assert tree.tick_once() is R
    assert session.wait_for(lambda: tree.tick_once() is R and server.of(90), LIMIT_S)
    tree.halt()
    tree.blackboard["n"], tree.blackboard["delay"] = 95, 1200
    assert tree.tick_while_running(period=0.01) is S
    assert tree.blackboard["sum"] == 96


def test_invalid_request(server: ServerProcess, session: RosSession) -> None:
    tree = load(session, '<Increment number="-1" sum="{sum}"/>')
    assert tree.tick_once() is F
    assert leaf_of(tree).errors == [ServiceErrorCode.INVALID_REQUEST]


def test_absent_service(server: ServerProcess, session: RosSession) -> None:
    tree = load(session, '<Unknown number="1" sum="{sum}"/>')
    assert tree.tick_while_running(period=0.01) is F
    leaf = leaf_of(tree)
    assert leaf.errors == [ServiceErrorCode.SERVICE_UNREACHABLE]
    assert "no service 'planned_servise' (test_msgs/srv/BasicTypes): start it" in leaf.error_message
    assert "did you mean '/planned_service'?" in leaf.error_message


def test_service_that_dies(session: RosSession) -> None:
    with start_planned_server("/own") as own:
        tree = load(session, '<Increment service_name="/own/planned_service" number="60" delay_ms="30000"/>')
        wait_until_known(session, "/own/planned")
        leaf = leaf_of(tree)
        leaf.server_timeout = 1000
        assert session.wait_for(lambda: tree.tick_once() is not R or own.of(60), LIMIT_S)
        own.kill()
        assert tree.tick_while_running(period=0.01) is F
        assert leaf.errors == [ServiceErrorCode.SERVICE_TIMEOUT]


# --- topics


@pytest.fixture(scope="module")
def other() -> Iterator[Any]:
    """A ROS node with a publisher and a subscription for the topic `speech`."""
    with RosSession("other") as session:
        yield session


def test_message_is_published(session: RosSession, other: RosSession) -> None:
    received: list[str] = []
    subscription = other.node.create_subscription(
        String, "speech", lambda message: received.append(message.data), 10
    )
    tree = load(session, '<Say text="hello"/>')
    publisher = next(node for node in tree if isinstance(node, Say))._endpoint.get()
    assert session.wait_for(publisher.get_subscription_count, LIMIT_S)
    assert tree.tick_once() is S
    assert other.wait_for(lambda: received, LIMIT_S)
    assert received == ["hello"]
    assert load(session, '<Say text=""/>').tick_once() is F
    other.node.destroy_subscription(subscription)


@pytest.mark.parametrize(("tag", "again"), [("Hear", F), ("HearAgain", S)])
def test_newest_message_per_tick(session: RosSession, other: RosSession, tag: str, again: Status) -> None:
    tree = load(session, f'<{tag} heard="{{heard}}"/>')
    publisher = other.node.create_publisher(String, "speech", 10)
    assert other.wait_for(publisher.get_subscription_count, LIMIT_S)
    assert tree.tick_once() is F
    for word in ("one", "two", "three"):
        publisher.publish(String(data=word))
    leaf = leaf_of(tree)
    assert session.wait_for(lambda: leaf._listening.message == String(data="three"), LIMIT_S)
    assert tree.tick_once() is S
    assert tree.blackboard["heard"] == "three"
    assert tree.tick_once() is again
    other.node.destroy_publisher(publisher)


def test_two_leaves_share_a_subscription_but_not_the_message(session: RosSession, other: RosSession) -> None:
    tree = load(session, '<ParallelAll><Hear heard="{a}"/><Hear heard="{b}"/></ParallelAll>')
    publisher = other.node.create_publisher(String, "speech", 10)
    assert other.wait_for(publisher.get_subscription_count, LIMIT_S)
    publisher.publish(String(data="both"))
    assert session.wait_for(
        lambda: all(node._listening.count for node in tree if isinstance(node, Hear)), LIMIT_S
    )
    assert tree.tick_once() is S
    assert (tree.blackboard["a"], tree.blackboard["b"]) == ("both", "both")
    other.node.destroy_publisher(publisher)
