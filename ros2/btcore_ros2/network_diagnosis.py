"""The part of `btcore ros2 doctor` that uses ROS 2: what works and what does not in the network."""

from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from itertools import product
from typing import Any

from rclpy.node import Node

from btcore_ros2.connection_checks import IGNORED_TOPICS, endpoint_name, qos_problem, qos_text
from btcore_ros2.diagnosis import Finding
from btcore_ros2.installation import find_installation
from btcore_ros2.interfaces import package_remedy
from btcore_ros2.robot.topic_report import CLOCK_REMEDY
from btcore_ros2.session import RosSession, node_arguments


def examine_network(seconds: float, ros_args: str | None) -> Iterator[Finding]:
    """Yield the findings about the topics, services and actions that are visible after *seconds* (s).

    Raises:
        RosError: ROS 2 cannot be used.
    """
    with RosSession("btcore_doctor", arguments=node_arguments(ros_args)) as session:
        session.wait_for(lambda: False, seconds)
        yield from _visible(session.node)


def _visible(node: Node) -> Iterator[Finding]:
    others = {item for item in node.get_node_names_and_namespaces() if item[0] != node.get_name()}
    if not others:
        yield Finding(
            "warning",
            "ROS nodes",
            "no other ROS node is visible",
            "start the robot; its domain, discovery range and network must be the same",
        )
        return
    yield Finding("ok", "ROS nodes", f"{len(others)} visible")
    missing: set[str] = set()
    for topic, types in sorted(node.get_topic_names_and_types()):
        publishers = _endpoints(node.get_publishers_info_by_topic(topic), node)
        subscriptions = _endpoints(node.get_subscriptions_info_by_topic(topic), node)
        if publishers or subscriptions:
            missing.update(name.partition("/")[0] for name in types)
            finding = _topic(topic, types, publishers, subscriptions)
            if finding.level != "ok" or (topic not in IGNORED_TOPICS and "/_action/" not in topic):
                yield finding
    for _, types in node.get_service_names_and_types():
        missing.update(name.partition("/")[0] for name in types)
    for package in sorted(missing):
        if find_spec(package) is None:
            remedy = package_remedy(package, find_installation())
            yield Finding("warning", "messages", f"{package} is used in this network, not installed", remedy)
    topic = node.resolve_topic_name("/clock")
    clocks = [endpoint_name(info) for info in node.get_publishers_info_by_topic(topic)]
    if not clocks:
        yield Finding("ok", "clock", f"the clocks of the machines; no ROS node publishes {topic}")
    elif len(clocks) == 1:
        yield Finding("ok", "clock", f"simulated time: {clocks[0]} publishes {topic}")
    else:
        text = f"several ROS nodes publish {topic}: {', '.join(clocks)}"
        yield Finding("warning", "clock", text, CLOCK_REMEDY)


def _endpoints(infos: Sequence[Any], node: Node) -> list[Any]:
    return [info for info in infos if info.node_name != node.get_name()]


def _topic(
    topic: str, types: Sequence[str], publishers: Sequence[Any], subscriptions: Sequence[Any]
) -> Finding:
    """Return the finding about *topic*: its type, and the first mismatch."""
    subject = f"topic {topic}"
    if len(types) > 1:
        sides = [f"{endpoint_name(info)} uses {info.topic_type}" for info in (*publishers, *subscriptions)]
        return Finding("warning", subject, "; ".join(sides), "all ROS nodes must use the same type")
    for publisher, subscription in product(publishers, subscriptions):
        if remedy := qos_problem(publisher.qos_profile, subscription.qos_profile):
            text = (
                f"{types[0]}: {endpoint_name(subscription)} ({qos_text(subscription.qos_profile)}) receives "
                f"nothing from {endpoint_name(publisher)} ({qos_text(publisher.qos_profile)})"
            )
            return Finding("warning", subject, text, remedy)
    qos = f", {qos_text(publishers[0].qos_profile)}" if publishers else ""
    counts = f"{len(publishers)} publishing, {len(subscriptions)} subscribed"
    return Finding("ok", subject, f"{types[0]}, {counts}{qos}")
