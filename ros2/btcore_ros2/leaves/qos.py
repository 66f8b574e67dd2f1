"""The quality of service of topics, and why the other side of a topic gets or sends no message."""

import enum
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Final

from btcore import NodeError
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


class Reliability(enum.Enum):
    """Whether lost messages are sent again."""

    as_qos = 0
    """The policy of the port `qos`."""
    reliable = 1
    """Lost messages are sent again."""
    best_effort = 2
    """Lost messages are not sent again."""


class Durability(enum.Enum):
    """Whether late subscribers get earlier messages."""

    as_qos = 0
    """The policy of the port `qos`."""
    volatile = 1
    """Late subscribers get no earlier messages."""
    transient_local = 2
    """Late subscribers get the last messages, as many as the depth of the publisher."""


DEPTHS: Final = {Qos.reliable: 10, Qos.sensor_data: 5, Qos.latched: 1}
"""The number of messages that are kept."""

MAX_DEPTH: Final = 1_000_000
"""The maximum of the port `depth`."""


def profile_of(qos: Qos, depth: int, reliability: Reliability, durability: Durability) -> "QoSProfile":
    """Return the profile of the ports of a leaf.

    Args:
        qos: The profile of which the other ports replace parts.
        depth: The number of messages that are kept; 0 = that of *qos*.

    Raises:
        NodeError: The depth is out of range.
    """
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    if not 0 <= depth <= MAX_DEPTH:
        raise NodeError(f"port [depth] = {depth}: write a number from 1 to {MAX_DEPTH}, or 0 for that of qos")
    if reliability is Reliability.as_qos:
        reliability = Reliability.best_effort if qos is Qos.sensor_data else Reliability.reliable
    if durability is Durability.as_qos:
        durability = Durability.transient_local if qos is Qos.latched else Durability.volatile
    return QoSProfile(
        depth=depth or DEPTHS[qos],
        reliability=ReliabilityPolicy[reliability.name.upper()],
        durability=DurabilityPolicy[durability.name.upper()],
    )


def why_silent(node: Any, name: str, message_type: str, profile: "QoSProfile") -> str:
    """Return the probable reason why no message of the topic *name* has arrived, and what to do.

    Args:
        node: The ROS node.
        name: The name of the topic.
        message_type: The ROS name of the message that is expected.
        profile: The quality of service of the subscription.
    """
    from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

    name = node.resolve_topic_name(name)
    publishers = node.get_publishers_info_by_topic(name)
    if not publishers:
        return f"nothing publishes it{_similar(node, name)}"
    if others := _other_types(publishers, message_type):
        return others
    offers = [info.qos_profile for info in publishers]
    best_effort = all(offer.reliability == ReliabilityPolicy.BEST_EFFORT for offer in offers)
    if best_effort and profile.reliability != ReliabilityPolicy.BEST_EFFORT:
        return 'its publishers are best effort: write reliability="best_effort"'
    volatile = all(offer.durability == DurabilityPolicy.VOLATILE for offer in offers)
    if volatile and profile.durability != DurabilityPolicy.VOLATILE:
        return 'its publishers are volatile: write durability="volatile"'
    return "its publishers have sent nothing"


def why_unheard(node: Any, name: str, message_type: str) -> str:
    """Return the probable reason why no subscriber gets the messages of this program on the topic *name*.

    Args:
        node: The ROS node.
        name: The name of the topic.
        message_type: The ROS name of the message that is published.
    """
    name = node.resolve_topic_name(name)
    subscriptions = node.get_subscriptions_info_by_topic(name)
    if not subscriptions:
        return f"nothing subscribes to it{_similar(node, name)}"
    return (
        _other_types(subscriptions, message_type)
        or "the quality of service of its subscribers is incompatible"
    )


def _similar(node: Any, name: str) -> str:
    return did_you_mean(name, [topic for topic, _ in node.get_topic_names_and_types() if topic != name])


def _other_types(endpoints: Iterable[Any], message_type: str) -> str:
    """Return which types *endpoints* of a topic have; "" if the type of one of them is *message_type*."""
    types = {info.topic_type for info in endpoints}
    return "" if message_type in types else f"its type is {join_names(sorted(types))}"
