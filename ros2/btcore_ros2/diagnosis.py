"""What works and what does not in the ROS 2 of this machine and in its network, for `btcore ros2 doctor`."""

import os
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import product
from typing import TYPE_CHECKING, Any, Literal

from btcore_ros2.errors import RosError
from btcore_ros2.installation import Installation, find_installation
from btcore_ros2.interfaces import package_remedy

if TYPE_CHECKING:
    from rclpy.node import Node

BUNDLED_PACKAGES = {
    "tf2_msgs": "transforms",
    "nav2_msgs": "Nav2's actions and services",
    "map_msgs": "the updates of costmaps",
    "btcpp_ros2_interfaces": "the tree server",
}
"""The message packages that parts of btcore need and PyPI lacks, and what they are for."""

LAST_SAFE_DOMAIN = 101

Level = Literal["ok", "warning", "error"]


@dataclass(frozen=True, slots=True)
class Finding:
    """A result of the diagnosis.

    Attributes:
        level: "ok", "warning" or "error"; an error prevents the use of ROS 2.
        subject: What was examined, for example "domain".
        text: What was found.
        remedy: What to do about it; "" if nothing is to be done.
    """

    level: Level
    subject: str
    text: str
    remedy: str = ""


def examine_machine() -> Iterator[Finding]:
    """Yield the findings about the installation and the environment variables. ROS 2 is not imported."""
    environment = os.environ
    installation = find_installation(environment)
    yield _check_installation(installation)
    yield Finding("ok", "Python", platform.python_version())
    yield _domain(environment.get("ROS_DOMAIN_ID") or "0")
    yield _discovery(environment)
    if installation.middleware:
        used = environment.get("RMW_IMPLEMENTATION") or f"{installation.middleware[0]} (default)"
        yield Finding("ok", "middleware", f"{used}; installed: {', '.join(installation.middleware)}")
    for package, purpose in () if installation.problem else BUNDLED_PACKAGES.items():
        if find_spec(package) is None:
            yield Finding(
                "warning",
                "messages",
                f"{package} is not installed; needed for {purpose}",
                package_remedy(package, installation),
            )


def examine_network(seconds: float, ros_args: str | None) -> Iterator[Finding]:
    """Yield the findings about the topics, services and actions that are visible after *seconds* (s).

    Raises:
        RosError: ROS 2 cannot be used.
    """
    from btcore_ros2.session import RosSession, node_arguments

    with RosSession("btcore_doctor", arguments=node_arguments(ros_args)) as session:
        session.wait_for(lambda: False, seconds)
        yield from _visible(session.node)


def _check_installation(installation: Installation) -> Finding:
    if installation.problem:
        return Finding("error", "installation", installation.problem, installation.remedy)
    name = f" {installation.distribution}" if installation.distribution else ""
    if installation.kind == "wheels":
        return Finding("ok", "installation", f"wheels in {installation.folders[0]}")
    return Finding("ok", "installation", f"sourced ROS 2{name} in {installation.sourced[0]}")


def _domain(domain: str) -> Finding:
    if not domain.isdecimal() or int(domain) > 232:
        return Finding("error", "domain", f"ROS_DOMAIN_ID={domain}", "use a number from 0 to 101")
    if int(domain) > LAST_SAFE_DOMAIN:
        remedy = "domains above 101 may share ports with other programs: use 0 to 101"
        return Finding("warning", "domain", f"ROS_DOMAIN_ID={domain}", remedy)
    return Finding("ok", "domain", f"{domain}; the robot must use the same")


def _discovery(environment: Mapping[str, str]) -> Finding:
    allowed = ("SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT")
    range_setting = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE") or "SUBNET"
    peers = environment.get("ROS_STATIC_PEERS", "")
    text = range_setting + (f", peers {peers}" if peers else "")
    if range_setting not in allowed:
        remedy = f"ROS_AUTOMATIC_DISCOVERY_RANGE must be one of {', '.join(allowed)}"
        return Finding("warning", "discovery", text, remedy)
    if environment.get("ROS_LOCALHOST_ONLY") == "1":
        remedy = "ROS_LOCALHOST_ONLY is deprecated: set ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST instead"
        return Finding("warning", "discovery", "this machine only", remedy)
    if range_setting in ("LOCALHOST", "OFF"):
        reach = "this machine only" if range_setting == "LOCALHOST" else "no automatic discovery"
        return Finding("ok", "discovery", f"{text}: {reach}")
    return Finding("ok", "discovery", text)


def _visible(node: "Node") -> Iterator[Finding]:
    from btcore_ros2.connection_checks import IGNORED_TOPICS

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
    from btcore_ros2.robot.topic_report import CLOCK_REMEDY

    topic = node.resolve_topic_name("/clock")
    clocks = [_name(info) for info in node.get_publishers_info_by_topic(topic)]
    if not clocks:
        yield Finding("ok", "clock", f"the clocks of the machines; no ROS node publishes {topic}")
    elif len(clocks) == 1:
        yield Finding("ok", "clock", f"simulated time: {clocks[0]} publishes {topic}")
    else:
        text = f"several ROS nodes publish {topic}: {', '.join(clocks)}"
        yield Finding("warning", "clock", text, CLOCK_REMEDY)


def _endpoints(infos: Sequence[Any], node: "Node") -> list[Any]:
    return [info for info in infos if info.node_name != node.get_name()]


def _name(info: Any) -> str:
    from btcore_ros2.connection_checks import endpoint_name

    return endpoint_name(info)


def _topic(
    topic: str, types: Sequence[str], publishers: Sequence[Any], subscriptions: Sequence[Any]
) -> Finding:
    """Return the finding about *topic*: its type, and the first mismatch."""
    from btcore_ros2.connection_checks import qos_problem, qos_text

    subject = f"topic {topic}"
    if len(types) > 1:
        sides = [f"{_name(info)} uses {info.topic_type}" for info in (*publishers, *subscriptions)]
        return Finding("warning", subject, "; ".join(sides), "all ROS nodes must use the same type")
    for publisher, subscription in product(publishers, subscriptions):
        if remedy := qos_problem(publisher.qos_profile, subscription.qos_profile):
            text = (
                f"{types[0]}: {_name(subscription)} ({qos_text(subscription.qos_profile)}) receives nothing "
                f"from {_name(publisher)} ({qos_text(publisher.qos_profile)})"
            )
            return Finding("warning", subject, text, remedy)
    qos = f", {qos_text(publishers[0].qos_profile)}" if publishers else ""
    counts = f"{len(publishers)} publishing, {len(subscriptions)} subscribed"
    return Finding("ok", subject, f"{types[0]}, {counts}{qos}")


def diagnose(seconds: float, ros_args: str | None = None) -> Iterator[Finding]:
    """Yield the findings about this machine and, if ROS 2 can be used, about the network.

    Args:
        seconds: How long to search for other ROS nodes (s).
        ros_args: The arguments of the ROS node, as one text.
    """
    usable = True
    for finding in examine_machine():
        usable = usable and finding.level != "error"
        yield finding
    if usable:
        try:
            yield from examine_network(seconds, ros_args)
        except RosError as error:
            yield Finding("error", "ROS 2", str(error), "see the message")
