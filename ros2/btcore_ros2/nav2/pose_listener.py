"""The robot's pose from tf, or from AMCL where the messages of tf are missing."""

import logging
from typing import Any

from btcore_robot.robot import NS_PER_S, Pose2D, TransformStamped
from btcore_robot.transforms import TransformError, TransformTree
from btcore_ros2.errors import RosError
from btcore_ros2.nav2.conversions import MAP, pose_from_message, time_to_ns
from btcore_ros2.session import RosSession

BASE_FRAMES = ("base_footprint", "base_link")
"""The names of the robot's frame; the first that exists is used."""

POSE_IS_UNKNOWN = (
    "the robot's pose is unknown: no transform from map to base_footprint or base_link was received"
)

JUMP = NS_PER_S
"""How much older (ns) than the newest pose of a frame a transform must be for a jump of its clock."""

log = logging.getLogger(__name__)


class PoseListener:
    """A subscriber of `/tf` and `/tf_static`; without tf2_msgs, of `amcl_pose`.

    If the stamps of a frame jump back, because a simulation was reset, the moving frames are unknown until
    their next transforms arrive. A transform that is late, as over a bridge, is stored with its own stamp.

    Args:
        session: The session.

    Attributes:
        transforms: The frames.
    """

    def __init__(self, session: RosSession) -> None:
        from rclpy.qos import DurabilityPolicy, QoSProfile

        self.transforms = TransformTree()
        self._pose: Pose2D | None = None
        self._warned = False
        latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node = session.node
        try:
            from tf2_msgs.msg import TFMessage
        except ModuleNotFoundError:
            from geometry_msgs.msg import PoseWithCovarianceStamped

            log.warning(
                "the package tf2_msgs is missing (generate it: btcore ros2 messages FOLDER): "
                "the robot's pose is read from the topic amcl_pose, which changes rarely"
            )
            node.create_subscription(PoseWithCovarianceStamped, "amcl_pose", self._take_pose, latched)
            return
        node.create_subscription(TFMessage, "/tf", lambda message: self._take(message, False), 100)
        node.create_subscription(TFMessage, "/tf_static", lambda message: self._take(message, True), latched)

    def pose(self) -> Pose2D | None:
        """Return the robot's newest pose in the frame map, or None if it is unknown."""
        for frame in BASE_FRAMES:
            try:
                return self.transforms.lookup(MAP, frame).to_pose()
            except TransformError:
                continue
        return self._pose

    def _take_pose(self, message: Any) -> None:
        try:
            self._pose = pose_from_message(message.pose.pose)
        except RosError as error:
            log.warning("amcl_pose: %s", error)

    def _take(self, message: Any, static: bool) -> None:
        for stamped in message.transforms:
            position, turn = stamped.transform.translation, stamped.transform.rotation
            frame = TransformStamped(
                stamped.child_frame_id.lstrip("/"),
                stamped.header.frame_id.lstrip("/"),
                (position.x, position.y, position.z),
                (turn.x, turn.y, turn.z, turn.w),
                time_to_ns(stamped.header.stamp),
            )
            try:
                if static:
                    self.transforms.set_static(frame)
                    continue
                newest = self.transforms.newest(frame.child)
                if newest is not None and frame.stamp < newest - JUMP:
                    if not self._warned:
                        log.warning("the time of tf jumped back: its moving transforms are forgotten")
                    self._warned = True
                    self.transforms.forget_moving()
                self.transforms.set(frame)
            except TransformError as error:
                if not self._warned:
                    log.warning("a transform of tf is ignored: %s", error)
                self._warned = True
