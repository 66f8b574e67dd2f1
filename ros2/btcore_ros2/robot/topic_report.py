"""Reports why nothing arrives on a topic: what is visible of it, and what to do."""

from typing import Any

DOMAIN_HINT = (
    "no other ROS node is visible: compare ROS_DOMAIN_ID and ROS_AUTOMATIC_DISCOVERY_RANGE with those of "
    "the robot"
)
CLOCK_REMEDY = (
    "end all simulations except one, or start each simulation and the programs of its robot with a namespace "
    "and a clock of its own: -r __ns:=/robot1 -r /clock:=clock"
)


def type_name(message_class: type) -> str:
    """Return the name of a message class, for example `sensor_msgs/msg/LaserScan`."""
    return f"{message_class.__module__.partition('.')[0]}/msg/{message_class.__name__}"


def has_other_type(node: Any, topic: str, message_class: type, *, published: bool = True) -> bool:
    """Return whether a topic is visible, but with another type only.

    Args:
        node: The ROS node.
        message_class: The expected message class.
        published: Whether to look at publishers; otherwise at subscriptions.
    """
    types = {info.topic_type for info in _endpoints(node, topic, published)}
    return bool(types) and type_name(message_class) not in types


def takes(node: Any, topic: str, message_class: type) -> bool:
    """Return whether another ROS node subscribes to *topic* with the message class *message_class*."""
    name = type_name(message_class)
    return any(info.topic_type == name for info in _endpoints(node, topic, published=False))


def topic_problem(node: Any, topic: str, message_class: type, *, published: bool = True) -> str:
    """Return a sentence about a topic on which nothing arrives, or to which nothing listens.

    Args:
        node: The ROS node.
        message_class: The expected message class.
        published: Whether a publisher is missing; otherwise a subscription.
    """
    name = type_name(message_class)
    endpoints = _endpoints(node, topic, published)
    word = "publisher" if published else "subscription"
    if not endpoints:
        others = _topics_of(node, name, published)
        alternatives = f"; topics with a {word} of {name}: {', '.join(others)}" if others else ""
        return f"no {word} is visible{alternatives}"
    types = sorted({info.topic_type for info in endpoints})
    if name not in types:
        return f"the robot uses {', '.join(types)}, but {name} is expected"
    policies = sorted({_policies(info) for info in endpoints if info.topic_type == name})
    return f"{len(endpoints)} {word}{'s' * (len(endpoints) > 1)} ({'; '.join(policies)}), but no message"


def sees_others(node: Any) -> bool:
    """Return whether a ROS node of another process or session is visible."""
    return any(other != _own_name(node) for other in node.get_node_names_and_namespaces())


def _endpoints(node: Any, topic: str, published: bool) -> list[Any]:
    name = node.resolve_topic_name(topic)
    if published:
        return list(node.get_publishers_info_by_topic(name))
    return [
        info
        for info in node.get_subscriptions_info_by_topic(name)
        if (info.node_name, info.node_namespace) != _own_name(node)
    ]


def _own_name(node: Any) -> tuple[str, str]:
    return node.get_name(), node.get_namespace()


def _topics_of(node: Any, name: str, published: bool) -> list[str]:
    count = node.count_publishers if published else node.count_subscribers
    return sorted(
        topic for topic, types in node.get_topic_names_and_types() if name in types and count(topic)
    )


def _policies(info: Any) -> str:
    profile = info.qos_profile
    return f"{profile.reliability.name.lower()}, {profile.durability.name.lower()}"
