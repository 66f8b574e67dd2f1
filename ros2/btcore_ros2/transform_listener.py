"""A listener of tf: the transforms of all frames that other ROS nodes publish."""

import logging
from collections.abc import Iterator
from typing import Any, Final

from btcore.clock import NS_PER_S
from btcore_robot.robot import TransformStamped
from btcore_robot.transforms import TransformError, TransformTree
from btcore_ros2.interfaces import load_interface
from btcore_ros2.session import RosSession

TF_MESSAGE: Final = "tf2_msgs/msg/TFMessage"
"""The type of the topics `/tf` and `/tf_static`."""

JUMP: Final = NS_PER_S
"""How much older (ns) than the newest transform of its frame a transform must be for a jump of its clock."""

log = logging.getLogger(__name__)


class TransformListener:
    """A subscriber of `/tf` and `/tf_static`.

    If the stamps of a frame jump back, because a simulation was reset, the moving frames are unknown until
    their next transforms arrive. A transform that is late, as over a bridge, is stored with its own stamp.

    Attributes:
        transforms: The frames.
        parts: The subscriptions.

    Raises:
        RosError: The package tf2_msgs is not installed.
    """

    def __init__(self, session: RosSession) -> None:
        from rclpy.qos import DurabilityPolicy, QoSProfile

        message_class = load_interface(TF_MESSAGE, "msg")
        self.transforms = TransformTree()
        self._session = session
        self._arrivals: dict[str, int] = {}
        self._warnings: set[str] = set()
        latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node, group = session.node, session.callback_group
        self.parts = (
            node.create_subscription(
                message_class, "/tf", lambda message: self._take(message, False), 100, callback_group=group
            ),
            node.create_subscription(
                message_class,
                "/tf_static",
                lambda message: self._take(message, True),
                latched,
                callback_group=group,
            ),
        )

    def stamp(self, target: str, source: str) -> int:
        """Return the time (ns) of the newest pose of *source* in *target*; 0 if all frames are static."""
        return min((stamp for _, stamp in self._moving(target, source)), default=0)

    def age(self, target: str, source: str) -> float:
        """Return the time (s) since the transforms arrived of which a pose consists; 0 if all are static."""
        now = self._session.clock.now()
        arrivals = (self._arrivals[child] for child, _ in self._moving(target, source))
        return max(((now - arrival) / NS_PER_S for arrival in arrivals), default=0.0)

    def _moving(self, target: str, source: str) -> Iterator[tuple[str, int]]:
        """Yield each moving frame between *target* and *source*, with its newest stamp (ns)."""
        for child in self._to_root(target) ^ self._to_root(source):
            stamp = self.transforms.newest(child)
            if stamp is not None:
                yield child, stamp

    def _to_root(self, frame: str) -> set[str]:
        frames: set[str] = set()
        parent: str | None = frame
        while parent is not None:
            frames.add(parent)
            parent = self.transforms.parent(parent)
        return frames

    def _take(self, message: Any, static: bool) -> None:
        for stamped in message.transforms:
            position, turn = stamped.transform.translation, stamped.transform.rotation
            stamp = stamped.header.stamp
            frame = TransformStamped(
                stamped.child_frame_id.lstrip("/"),
                stamped.header.frame_id.lstrip("/"),
                (position.x, position.y, position.z),
                (turn.x, turn.y, turn.z, turn.w),
                stamp.sec * NS_PER_S + stamp.nanosec,
            )
            try:
                if static:
                    self.transforms.set_static(frame)
                else:
                    self._set_moving(frame)
            except TransformError as error:
                self._warn(f"a transform of tf is ignored: {error}")

    def _set_moving(self, frame: TransformStamped) -> None:
        newest = self.transforms.newest(frame.child)
        if newest is not None and frame.stamp < newest - JUMP:
            self._warn("the time of tf jumped back: its moving transforms are forgotten")
            self.transforms.forget_moving()
            newest = None
        self.transforms.set(frame)
        if newest is None or frame.stamp > newest or not frame.stamp:  # a repetition is not new
            self._arrivals[frame.child] = self._session.clock.now()

    def _warn(self, text: str) -> None:
        """Log *text* once."""
        if text not in self._warnings:
            self._warnings.add(text)
            log.warning("%s", text)
