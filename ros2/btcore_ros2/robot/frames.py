"""The poses of a robot's links and sensors, below `base_footprint`."""

import math
from collections.abc import Sequence
from typing import Any

from btcore_robot.rigid_transform import Transform
from btcore_robot.robot import BASE_FRAME, TransformStamped


class FrameStore:
    """The newest pose of every frame, and the frames of the robot among them.

    The robot's frames are those that are connected with its base without passing the odometry frame. They
    form a tree below the base: if the base has a parent that is part of the robot, that pose is inverted.

    Args:
        base: The robot's name of the frame `base_footprint`.
        odom: The robot's name of the odometry frame.
    """

    def __init__(self, base: str, odom: str) -> None:
        self._base = base
        self._odom = odom
        # The parent, the pose, and the stamp (ns) of moving frames, by child.
        self._poses: dict[str, tuple[str, Transform, int | None]] = {}
        self._above: list[str] = []
        self._below: list[str] = []
        self._arranged = True

    def set(self, child: str, parent: str, pose: Transform, stamp: int | None) -> None:
        """Store the pose of *child* in *parent*.

        Args:
            child: The frame.
            parent: The frame in which the pose is given.
            pose: The pose; its quaternion may have any length above 0.
            stamp: The time of the pose (ns); None = it does not change.
        """
        length = math.hypot(*pose.quaternion)
        if not (length > 0.0 and math.isfinite(length) and math.isfinite(sum(pose.position))):
            return
        if abs(length - 1.0) > 1e-6:
            x, y, z, w = pose.quaternion
            pose = Transform(pose.position, (x / length, y / length, z / length, w / length))
        child, parent = child.lstrip("/"), parent.lstrip("/")
        known = self._poses.get(child)
        self._arranged = self._arranged and known is not None and known[0] == parent
        self._poses[child] = parent, pose, stamp

    def frames(self, now: int) -> list[TransformStamped]:
        """Return the robot's frames below `base_footprint`; fixed frames have the stamp *now* (ns)."""
        if not self._arranged:
            self._arrange()
        frames = []
        for child in self._below:
            parent, pose, stamp = self._poses[child]
            frames.append(self._frame(child, parent, pose, now if stamp is None else stamp))
        for child in self._above:
            parent, pose, stamp = self._poses[child]
            frames.append(self._frame(parent, child, pose.inverse(), now if stamp is None else stamp))
        return frames

    def known(self) -> Sequence[str]:
        """Return the names of all frames that have a pose, sorted."""
        return sorted(self._poses)

    def _arrange(self) -> None:
        """Find the robot's frames: those above the base, and those below them or below the base."""
        self._above = []
        roots = [self._base]
        while (pose := self._poses.get(roots[-1])) and pose[0] != self._odom and pose[0] not in roots:
            self._above.append(roots[-1])
            roots.append(pose[0])
        self._below = [
            child for child in self._poses if child not in self._above and self._is_below(child, roots)
        ]
        # The frames below odom: the base itself, or the root of a tree with the base further down.
        self._below = [child for child in self._below if child not in roots]
        self._arranged = True

    def _is_below(self, child: str, roots: Sequence[str]) -> bool:
        passed = {child}
        while child not in roots:
            pose = self._poses.get(child)
            if pose is None or pose[0] in passed:
                return False
            child = pose[0]
            passed.add(child)
        return True

    def _frame(self, child: str, parent: str, pose: Transform, stamp: int) -> TransformStamped:
        child, parent = (BASE_FRAME if name == self._base else name for name in (child, parent))
        return TransformStamped(child, parent, pose.position, pose.quaternion, stamp)


def pose_of(message: Any) -> Transform:
    """Return the pose in a `geometry_msgs/Transform`."""
    position, rotation = message.translation, message.rotation
    return Transform((position.x, position.y, position.z), (rotation.x, rotation.y, rotation.z, rotation.w))
