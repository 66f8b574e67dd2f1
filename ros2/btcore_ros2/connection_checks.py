"""Checks of the connections of a ROS node: quality of service (QoS) and types that exclude each other.

ROS 2 connects such ROS nodes not at all, and most programs do not notice. These checks compare the topics,
services and actions of a ROS node with those of the other ROS nodes that were discovered.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import product
from typing import TYPE_CHECKING, Any

from rclpy.action import get_action_server_names_and_types_by_node
from rclpy.exceptions import InvalidHandle
from rclpy.node import NodeNameNonExistentError
from rclpy.qos import DurabilityPolicy, QoSCompatibility, QoSProfile, ReliabilityPolicy, qos_check_compatible

from btcore.clock import NS_PER_S
from btcore_ros2.direct_take import action_clients
from btcore_ros2.interfaces import interface_name

if TYPE_CHECKING:
    from rclpy.node import Node

CHECK_NS = NS_PER_S
"""The time (ns) between two checks of a connection."""

NAME_WAIT_NS = 10 * NS_PER_S
"""The time (ns) that a publisher or subscription without the name of its ROS node has to get one.

The name arrives after the topic. Programs that use DDS without ROS have no name at all.
"""

INCOMPATIBLE = (
    (ReliabilityPolicy.BEST_EFFORT, ReliabilityPolicy.RELIABLE),
    (DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL),
)
"""The policies of a publisher and a subscription that exclude each other."""

UNKNOWN_NAME = "_NODE_NAME_UNKNOWN_"  # of rmw_fastrtps

IGNORED_TOPICS = frozenset({"/rosout", "/parameter_events"})

Problem = tuple[str, str]
"""The subject of a report, such as "topic /scan", and its message; "" if there is no problem."""


def qos_text(profile: QoSProfile) -> str:
    """Return the reliability and durability of *profile*: "RELIABLE, VOLATILE"."""
    return f"{profile.reliability.name}, {profile.durability.name}"


def qos_problem(offered: QoSProfile, requested: QoSProfile) -> str:
    """Return why a subscription with *requested* receives nothing from a publisher with *offered*.

    Returns:
        What must change; "" if the subscription receives the messages.
    """
    compatibility, reason = qos_check_compatible(offered, requested)
    if compatibility != QoSCompatibility.ERROR:
        return ""
    pairs = (
        (offered.reliability, requested.reliability),
        (offered.durability, requested.durability),
    )
    remedies = [
        f"the subscription must be {weak.name}, or the publisher {strong.name}"
        for weak, strong in pairs
        if (weak, strong) in INCOMPATIBLE
    ]
    return "; ".join(remedies) or reason.removeprefix("ERROR: ").rstrip(";")


def full_name(name: str, namespace: str) -> str:
    """Return the name of a ROS node with its namespace: "/robot1/driver"."""
    return f"{namespace.rstrip('/')}/{name}"


def endpoint_name(info: Any) -> str:
    """Return the name of the ROS node of a publisher or subscription, from its `TopicEndpointInfo`."""
    if info.node_name == UNKNOWN_NAME:
        return "a ROS node whose name is not known yet"
    return full_name(info.node_name, info.node_namespace)


class ConnectionChecks:
    """Checks the connections of a ROS node, one in each call, and each about once a second.

    Args:
        node: The ROS node.
        report: A function that is called with the results: subject and message, see `RosSession.report`.
    """

    def __init__(self, node: "Node", report: Callable[[str, str], None]) -> None:
        self._node = node
        self._report = report
        self._next = 0
        self._checks: Iterator[Problem] = iter(())
        self._checked: set[str] = set()
        self._nameless: dict[tuple[int, ...], int] = {}
        """The time (ns) at which each endpoint without the name of its ROS node was found, by its GID."""

    def check(self) -> None:
        """Check a connection, if it is time to."""
        problem = next(self._checks, None)
        if problem is not None:
            self._report(*problem)
        elif (now := time.monotonic_ns()) >= self._next:
            self._next = now + CHECK_NS
            self._checks = self._problems()

    def _problems(self) -> Iterator[Problem]:
        """Yield the result of the check of each connection, then those of destroyed entities."""
        subjects = set()
        for subject, message in self._connection_problems():
            subjects.add(subject)
            yield subject, message
        for subject in self._checked - subjects:
            yield subject, ""
        self._checked = subjects

    def _connection_problems(self) -> Iterator[Problem]:
        node = self._node
        topics = set()
        for entity in (*node.subscriptions, *node.publishers):
            with suppress(InvalidHandle):  # destroyed by a thread of the program since the list was made
                topics.add(entity.topic_name)
        for topic in sorted(topics - IGNORED_TOPICS):
            yield f"topic {topic}", "\n".join(dict.fromkeys(self._topic_problems(topic)))
        for client in tuple(node.clients):
            try:
                name, ready = client.service_name, client.service_is_ready()
            except InvalidHandle:  # destroyed since the list was made
                continue
            own_type = interface_name(client.srv_type)
            message = "" if ready else self._server_problem("service", name, own_type)
            yield f"service {name}", message
        for action, name, action_type in action_clients(node):
            try:
                ready = action.server_is_ready()
            except InvalidHandle:
                continue
            name = node.resolve_topic_name(name)
            message = "" if ready else self._server_problem("action", name, interface_name(action_type))
            yield f"action {name}", message

    def _topic_problems(self, topic: str) -> Iterator[str]:
        """Yield the problems of the ROS node's publishers and subscriptions on *topic*."""
        # The QoS is that of the middleware: `subscription.qos_profile` contains unspecified values.
        own = full_name(self._node.get_name(), self._node.get_namespace())
        publishers = self._node.get_publishers_info_by_topic(topic)
        subscriptions = self._node.get_subscriptions_info_by_topic(topic)
        for publisher, subscription in product(publishers, subscriptions):
            if self._has_name(publisher) and self._has_name(subscription):
                yield from _problems_between(publisher, subscription, topic, own)

    def _has_name(self, info: Any) -> bool:
        """Return whether an endpoint has the name of its ROS node, or has waited for it in vain."""
        gid = tuple(info.endpoint_gid)
        if info.node_name != UNKNOWN_NAME:
            self._nameless.pop(gid, None)
            return True
        now = time.monotonic_ns()
        return now - self._nameless.setdefault(gid, now) > NAME_WAIT_NS

    def _server_problem(self, noun: str, name: str, own_type: str) -> str:
        """Return which ROS node offers *name* with a type other than *own_type*; "" if none does."""
        node = self._node
        for ros_node, namespace in node.get_node_names_and_namespaces():
            try:
                if noun == "service":
                    offered = node.get_service_names_and_types_by_node(ros_node, namespace)
                else:
                    offered = get_action_server_names_and_types_by_node(node, ros_node, namespace)
            except NodeNameNonExistentError:  # ended since the list was made
                continue
            for offered_name, types in offered:
                if offered_name == name and own_type not in types:
                    return (
                        f"{noun} {name}: the ROS node {full_name(ros_node, namespace)} offers it with the "
                        f"type {types[0]}, this program uses the type {own_type}; use the type or the name "
                        f"of the {noun} that you mean"
                    )
        return ""


def _problems_between(publisher: Any, subscription: Any, topic: str, own: str) -> Iterator[str]:
    """Yield the problem of the connection between two endpoints; *own* is the name of this ROS node."""
    names = [endpoint_name(info) for info in (publisher, subscription)]
    if own not in names:
        return
    sender, receiver = ("this program" if name == own else f"the ROS node {name}" for name in names)
    if publisher.topic_type != subscription.topic_type:
        yield (
            f"topic {topic}: {sender} publishes {publisher.topic_type}, {receiver} subscribes to "
            f"{subscription.topic_type}; use the type or the name of the topic that you mean"
        )
    elif remedy := qos_problem(publisher.qos_profile, subscription.qos_profile):
        yield (
            f"topic {topic}: no message arrives, because the QoS is incompatible: {sender} publishes "
            f"{qos_text(publisher.qos_profile)}, {receiver} subscribes with "
            f"{qos_text(subscription.qos_profile)}; {remedy}"
        )
