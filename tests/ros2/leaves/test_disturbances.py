"""Leaves whose servers and topics are found late, are started again, or send messages twice.

The other ROS node is in a second session of the same thread.
"""

import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

pytest.importorskip("rclpy")

from std_msgs.msg import Int32, String
from std_srvs.srv import SetBool
from test_msgs.action import Fibonacci

import btcore
from btcore import Registry, Status, Tree
from btcore_ros2.action_server import RosActionServer
from btcore_ros2.leaves import RosSubscriber, register
from btcore_ros2.session import RosSession
from tests.ros2.conftest import LIMIT_S
from tests.ros2.discovery import wait_until_known, wait_until_service_knows

NUMBERS = itertools.count()
LONG_TIMEOUTS = 'server_timeout="60000" wait_for_server_timeout="60000"'
CALL = f"""<RosServiceCall service_name="{{name}}" type="std_srvs/srv/SetBool" {LONG_TIMEOUTS}
    request='json:{{{{"data": "{{{{on}}}}"}}}}' response="{{{{answer}}}}" response_field="message"/>"""
ACT = f"""<RosActionCall action_name="{{name}}" type="test_msgs/action/Fibonacci" {LONG_TIMEOUTS}
    goal='json:{{{{"order": 1}}}}' feedback="{{{{feedback}}}}" feedback_field="sequence[0]"/>"""
READ = """<RosTopicRead topic_name="{name}" type="std_msgs/msg/Int32" field="data" message="{{read}}"
    timeout="60000"/>"""
WRITE = """<RosTopicPublish topic_name="{name}" type="std_msgs/msg/Int32" message='json:{{"data": 7}}'
    wait_for_subscriber_timeout="60000" error="{{error}}"/>"""


class Hear(RosSubscriber):
    """Collects the messages of all ticks."""

    message_type = "std_msgs/msg/String"

    def on_message(self, message: Any) -> bool:
        if message is not None:
            self.heard = [*getattr(self, "heard", []), message.data]
        return True


def tree_of(body: str, name: str, session: RosSession) -> Tree:
    nodes = Registry.standard()
    register(nodes)
    nodes.add(Hear)
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body.format(name=name)}</BehaviorTree></root>'
    return btcore.loads(text, nodes=nodes, resources=[session], clock=session.clock)


def answer(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
    response.success, response.message = True, "on" if request.data else "off"
    return response


def offer_service(other: RosSession, name: str) -> Callable[[], None]:
    other.node.create_service(SetBool, name, answer)
    return lambda: None


def offer_action(other: RosSession, name: str) -> Callable[[], None]:
    server = RosActionServer[Any, Any, Any](other, Fibonacci, name)

    def work() -> None:
        if (goal := server.take()) is not None:
            for number in (1, 2, 2, 1):
                goal.publish_feedback(Fibonacci.Feedback(sequence=[number]))
            goal.succeed()

    other.after_drain(work)
    return server.close


def publish(other: RosSession, name: str) -> Callable[[], None]:
    publisher = other.node.create_publisher(Int32, name, 10)
    return other.after_drain(lambda: publisher.publish(Int32(data=5)))


def subscribe(other: RosSession, name: str) -> Callable[[], None]:
    other.node.create_subscription(Int32, name, lambda message: None, 10)
    return lambda: None


@pytest.fixture
def name() -> str:
    """A name that no other test uses: entities of earlier tests may still be visible."""
    return f"/disturbed{next(NUMBERS)}"


@contextmanager
def peer(session: RosSession) -> Iterator[RosSession]:
    """A second ROS node, which takes messages whenever *session* does."""
    with RosSession("peer") as other:
        end = session.after_drain(other.drain)
        yield other
        end()


@pytest.mark.parametrize(
    ("body", "offer", "count"),
    [
        (CALL, offer_service, lambda node, name: node.count_services(name)),
        (ACT, offer_action, lambda node, name: node.count_publishers(f"{name}/_action/status")),
        (READ, publish, lambda node, name: node.count_publishers(name)),
        (WRITE, subscribe, lambda node, name: node.count_subscribers(name)),
    ],
)
def test_leaf_waits_for_a_late_peer_and_works_with_its_successor(
    session: RosSession,
    name: str,
    body: str,
    offer: Callable[[RosSession, str], Callable[[], None]],
    count: Callable[[Any, str], int],
) -> None:
    tree = tree_of(body, name, session)
    tree.blackboard["on"] = True
    assert tree.tick_once() is Status.RUNNING  # nothing is there
    for _ in range(2):
        with peer(session) as other:
            end = offer(other, name)
            if body is CALL:
                wait_until_service_knows(session, name, SetBool, SetBool.Request())
            if body is ACT:
                wait_until_known(session, name)
            assert session.wait_for(lambda: tree.tick_once() is Status.SUCCESS, LIMIT_S)
            if body is WRITE:
                assert tree.blackboard["error"] == ""
            end()
        assert session.wait_for(lambda: count(session.node, name) == 0, LIMIT_S)


def test_missing_server_is_a_failure_after_the_time_of_the_port(session: RosSession, name: str) -> None:
    tree = tree_of(
        CALL.replace('wait_for_server_timeout="60000"', 'wait_for_server_timeout="50"'), name, session
    )
    tree.blackboard["on"] = True
    assert tree.tick_while_running(period=0.01) is Status.FAILURE
    with peer(session) as other:  # discovered after this time
        offer_service(other, name)
        wait_until_service_knows(session, name, SetBool, SetBool.Request())
        assert session.wait_for(lambda: tree.tick_once() is Status.SUCCESS, LIMIT_S)


def test_response_that_arrives_twice_belongs_to_its_request(session: RosSession, name: str) -> None:
    with peer(session) as other:
        service = other.node.create_service(SetBool, name, answer)
        send = service.send_response

        def send_twice(*arguments: Any) -> None:
            send(*arguments)
            send(*arguments)

        service.send_response = send_twice
        tree = tree_of(CALL, name, session)
        wait_until_service_knows(session, name, SetBool, SetBool.Request())
        for on in (True, False, True):
            tree.blackboard["on"] = on
            assert tree.tick_while_running(period=0.01) is Status.SUCCESS
            assert tree.blackboard["answer"] == ("on" if on else "off")


def test_feedback_is_processed_in_the_order_of_its_arrival(session: RosSession, name: str) -> None:
    with peer(session) as other:
        offer_action(other, name)
        tree = tree_of(ACT, name, session)
        wait_until_known(session, name)
        assert tree.tick_while_running(period=0.01) is Status.SUCCESS
        assert tree.blackboard["feedback"] == 1  # the last of 1, 2, 2, 1


def test_message_that_arrives_twice_counts_twice(session: RosSession, name: str) -> None:
    with peer(session) as other:
        publisher = other.node.create_publisher(String, name, 10)
        tree = tree_of('<Hear topic_name="{name}"/>', name, session)
        (leaf,) = tree
        assert session.wait_for(publisher.get_subscription_count, LIMIT_S)
        heard = ["new", "new", "old"]
        for number, word in enumerate(heard, 1):
            publisher.publish(String(data=word))
            session.wait_for(lambda n=number: tree.tick_once() and len(getattr(leaf, "heard", ())) == n, 60)
        assert leaf.heard == heard
        assert tree.tick_once() is Status.SUCCESS
        assert leaf.heard == heard
