"""The quality of service of topics, and why the other side of a topic gets or sends no message."""

import enum
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from btcore.suggestions import did_you_mean, join_names

if TYPE_CHECKING:
    from rclpy.qos import QoSProfile


class Qos(enum.Enum):
    """The quality of service of a topic, by its usual names."""

    reliable = 1
    """Reliable, with a depth of 10."""
    sensor_data = 2
    """Best effort, with a depth of 5: for sensors, whose publishers often are best effort."""
    latched = 3
    """Reliable and transient local, with a depth of 1: late subscribers get the last message, as of a map."""

    def profile(self) -> "QoSProfile":
        """Return the profile."""
        from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data

        if self is Qos.sensor_data:
            return qos_profile_sensor_data
        if self is Qos.latched:
            return QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        return QoSProfile(depth=10)


def why_silent(node: Any, name: str, kind: str, qos: Qos) -> str:
    """Return the probable reason why no message of the topic *name* has arrived, and what to do.

    Args:
        node: The ROS node.
        name: The name of the topic.
        kind: The ROS name of the message that is expected.
        qos: The quality of service of the subscription.
    """
    from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

    name = node.resolve_topic_name(name)
    publishers = node.get_publishers_info_by_topic(name)
    if not publishers:
        return f"nothing publishes it{_similar(node, name)}"
    if others := _other_types(publishers, kind):
        return others
    profiles = [info.qos_profile for info in publishers]
    best_effort = all(profile.reliability == ReliabilityPolicy.BEST_EFFORT for profile in profiles)
    if best_effort and qos is not Qos.sensor_data:
        return 'its publishers are best effort: write qos="sensor_data"'
    volatile = all(profile.durability == DurabilityPolicy.VOLATILE for profile in profiles)
    if volatile and qos is Qos.latched:
        return 'its publishers are volatile: write qos="reliable"'
    return "its publishers have sent nothing"


def why_unheard(node: Any, name: str, kind: str) -> str:
    """Return the probable reason why no subscriber gets the messages of this program on the topic *name*.

    Args:
        node: The ROS node.
        name: The name of the topic.
        kind: The ROS name of the message that is published.
    """
    name = node.resolve_topic_name(name)
    subscriptions = node.get_subscriptions_info_by_topic(name)
    if not subscriptions:
        return f"nothing subscribes to it{_similar(node, name)}"
    return _other_types(subscriptions, kind) or "the quality of service of its subscribers is incompatible"


def _similar(node: Any, name: str) -> str:
    return did_you_mean(name, [topic for topic, _ in node.get_topic_names_and_types() if topic != name])


def _other_types(endpoints: Iterable[Any], kind: str) -> str:
    """Return which types *endpoints* of a topic have; "" if the type of one of them is *kind*."""
    types = {info.topic_type for info in endpoints}
    return "" if kind in types else f"its type is {join_names(sorted(types))}"
