"""The robot's pose from tf, or from AMCL where the messages of tf are missing."""

import logging
from typing import Any

from btcore_robot.robot import MAP_FRAME, Pose2D
from btcore_robot.transforms import TransformError, TransformTree
from btcore_ros2.errors import RosError
from btcore_ros2.interfaces import MissingPackageError
from btcore_ros2.nav2.conversions import pose_from_message
from btcore_ros2.session import RosSession
from btcore_ros2.transform_listener import TransformListener

BASE_FRAMES = ("base_footprint", "base_link")
"""The names of the robot's frame; the first that exists is used."""

POSE_IS_UNKNOWN = (
    "the robot's pose is unknown: no transform from map to base_footprint or base_link was received"
)

log = logging.getLogger(__name__)


class PoseListener:
    """A subscriber of `/tf` and `/tf_static`; without tf2_msgs, of `amcl_pose`.

    Attributes:
        transforms: The frames.
    """

    def __init__(self, session: RosSession) -> None:
        self.transforms = TransformTree()
        self._pose: Pose2D | None = None
        try:
            self.transforms = TransformListener(session).transforms
        except MissingPackageError:
            from geometry_msgs.msg import PoseWithCovarianceStamped
            from rclpy.qos import DurabilityPolicy, QoSProfile

            log.warning(
                "the package tf2_msgs is missing (generate it: btcore ros2 messages FOLDER): "
                "the robot's pose is read from the topic amcl_pose, which changes rarely"
            )
            session.node.create_subscription(
                PoseWithCovarianceStamped,
                "amcl_pose",
                self._take_pose,
                QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL),
                callback_group=session.callback_group,
            )

    def pose(self) -> Pose2D | None:
        """Return the robot's newest pose in the frame map, or None if it is unknown."""
        for frame in BASE_FRAMES:
            try:
                return self.transforms.lookup(MAP_FRAME, frame).to_pose()
            except TransformError:
                continue
        return self._pose

    def _take_pose(self, message: Any) -> None:
        try:
            self._pose = pose_from_message(message.pose.pose)
        except RosError as error:
            log.warning("amcl_pose: %s", error)
