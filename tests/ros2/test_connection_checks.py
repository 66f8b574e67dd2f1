"""Connections that cannot work are reported by name, with both sides and a remedy."""

import logging

import pytest

pytest.importorskip("rclpy")

from rclpy.action import ActionClient
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger
from test_msgs.action import Fibonacci

from btcore_ros2.connection_checks import CHECK_NS, qos_problem
from btcore_ros2.session import RosSession
from tests.ros2.conftest import LIMIT_S

BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
RELIABLE = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def check_all(session: RosSession) -> None:
    """Let all connections be checked again."""
    checks = session._checks
    while next(checks._checks, None) is not None:
        pass
    checks._next = 0
    checks.check()
    while (problem := next(checks._checks, None)) is not None:
        session.report(*problem)


def test_time_between_checks() -> None:
    """A problem is reported within 2 s: connections are discovered and named within a second."""
    assert CHECK_NS <= 1_000_000_000


@pytest.mark.usefixtures("mismatched_peer")
def test_each_mismatch_is_reported_once_with_both_sides(
    session: RosSession, caplog: pytest.LogCaptureFixture
) -> None:
    node = session.node
    node.create_subscription(String, "unreliable", lambda message: None, RELIABLE)
    node.create_subscription(String, "number", lambda message: None, 10)
    node.create_publisher(String, "wanted_number", 10)
    node.create_publisher(String, "wanted_latched", 10)
    switch = node.create_client(SetBool, "switch")
    count = ActionClient(node, Fibonacci, "count")
    assert session.wait_for(
        lambda: (
            node.count_publishers("unreliable")
            and node.count_publishers("number")
            and node.count_subscribers("wanted_number")
            and node.count_subscribers("wanted_latched")
            and dict(node.get_service_names_and_types()).get("/switch", [])[-1:] == ["std_srvs/srv/Trigger"]
        ),
        LIMIT_S,
    )
    assert session.wait_for(lambda: len(session.reports) == 6, LIMIT_S), session.reports
    assert dict(session.reports) == {
        "topic /unreliable": "topic /unreliable: no message arrives, because the QoS is incompatible: the "
        "ROS node /robot1/peer publishes BEST_EFFORT, VOLATILE, this program subscribes with RELIABLE, "
        "VOLATILE; the subscription must be BEST_EFFORT, or the publisher RELIABLE",
        "topic /number": "topic /number: the ROS node /robot1/peer publishes std_msgs/msg/Float64, this "
        "program subscribes to std_msgs/msg/String; use the type or the name of the topic that you mean",
        "topic /wanted_number": "topic /wanted_number: this program publishes std_msgs/msg/String, the ROS "
        "node /robot1/peer subscribes to std_msgs/msg/Float64; use the type or the name of the topic that "
        "you mean",
        "topic /wanted_latched": "topic /wanted_latched: no message arrives, because the QoS is "
        "incompatible: this program publishes RELIABLE, VOLATILE, the ROS node /robot1/peer subscribes with "
        "RELIABLE, TRANSIENT_LOCAL; the subscription must be VOLATILE, or the publisher TRANSIENT_LOCAL",
        "service /switch": "service /switch: the ROS node /robot1/peer offers it with the type "
        "std_srvs/srv/Trigger, this program uses the type std_srvs/srv/SetBool; use the type or the name of "
        "the service that you mean",
        "action /count": "action /count: the ROS node /robot1/peer offers it with the type "
        "test_msgs/action/NestedMessage, this program uses the type test_msgs/action/Fibonacci; use the type "
        "or the name of the action that you mean",
    }
    check_all(session)
    logged = [record for record in caplog.records if record.name == "btcore_ros2.session"]
    assert sorted(record.getMessage() for record in logged) == sorted(session.reports.values())
    assert {record.levelno for record in logged} == {logging.WARNING}
    assert not switch.service_is_ready()
    assert not count.server_is_ready()


@pytest.mark.usefixtures("mismatched_peer")
def test_report_ends_with_its_cause(session: RosSession) -> None:
    wrong = session.node.create_subscription(String, "unreliable", lambda message: None, RELIABLE)
    assert session.wait_for(lambda: session.reports, LIMIT_S)
    session.node.destroy_subscription(wrong)
    session.node.create_subscription(String, "unreliable", lambda message: None, BEST_EFFORT)
    assert session.wait_for(lambda: not session.reports, LIMIT_S)


@pytest.mark.usefixtures("mismatched_peer")
def test_report_ends_with_the_connection(session: RosSession) -> None:
    node = session.node
    wrong = node.create_subscription(String, "unreliable", lambda message: None, RELIABLE)
    client = node.create_client(SetBool, "switch")
    assert session.wait_for(lambda: len(session.reports) == 2, LIMIT_S)
    node.destroy_subscription(wrong)
    node.destroy_client(client)
    assert session.wait_for(lambda: not session.reports, LIMIT_S)


@pytest.mark.usefixtures("server", "mismatched_peer")
def test_connections_that_work_are_not_reported(session: RosSession) -> None:
    node = session.node
    node.create_subscription(String, "unreliable", lambda message: None, BEST_EFFORT)
    node.create_publisher(String, "wanted_latched", LATCHED)
    node.create_subscription(String, "echo", lambda message: None, 10)
    clients = (
        node.create_client(SetBool, "set_bool"),
        node.create_client(Trigger, "switch"),
        node.create_client(SetBool, "absent"),
    )
    assert session.wait_for(lambda: clients[0].service_is_ready() and clients[1].service_is_ready(), LIMIT_S)
    check_all(session)
    assert session.reports == {}


def test_changed_message_is_logged_again(session: RosSession, caplog: pytest.LogCaptureFixture) -> None:
    for message in ("late", "late", "lost", "", "", "lost"):
        session.report("topic /scan", message)
    assert [record.getMessage() for record in caplog.records] == ["late", "lost", "lost"]
    assert session.reports == {"topic /scan": "lost"}


def test_remedy_of_other_policies_is_the_reason_of_ros() -> None:
    slow = QoSProfile(depth=1, deadline=Duration(seconds=1))
    fast = QoSProfile(depth=1, deadline=Duration(seconds=0.1))
    assert "deadline" in qos_problem(slow, fast).lower()
    assert qos_problem(fast, slow) == ""
    assert qos_problem(RELIABLE, BEST_EFFORT) == ""
