"""Leaves that use ROS 2: base classes and decorators, and leaves that need no code."""

from btcore import Registry
from btcore_ros2.leaves.action import ActionErrorCode, RosAction
from btcore_ros2.leaves.by_name import RosActionCall, RosServiceCall, RosTopicPublish, RosTopicRead
from btcore_ros2.leaves.decorators import (
    RosCallError,
    ros_action,
    ros_publisher,
    ros_service,
    ros_subscriber,
)
from btcore_ros2.leaves.service import RosService, ServiceErrorCode
from btcore_ros2.leaves.topics import RosPublisher, RosSubscriber
from btcore_ros2.leaves.transforms import RosPoseTransform, RosTransformPublish, RosTransformRead

__all__ = [
    "ActionErrorCode",
    "RosAction",
    "RosActionCall",
    "RosCallError",
    "RosPoseTransform",
    "RosPublisher",
    "RosService",
    "RosServiceCall",
    "RosSubscriber",
    "RosTopicPublish",
    "RosTopicRead",
    "RosTransformPublish",
    "RosTransformRead",
    "ServiceErrorCode",
    "register",
    "ros_action",
    "ros_publisher",
    "ros_service",
    "ros_subscriber",
]


def register(nodes: Registry) -> None:
    """Register the leaves that need no code."""
    nodes.add(RosActionCall, RosServiceCall, RosTopicPublish, RosTopicRead)
    nodes.add(RosTransformRead, RosPoseTransform, RosTransformPublish)
