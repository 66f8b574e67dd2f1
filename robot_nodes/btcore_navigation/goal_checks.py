"""Checks of the robot's way to its goal: Nav2's SimpleGoalChecker and PoseProgressChecker."""

import math

from btcore.clock import NS_PER_S
from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import Pose2D


class GoalChecker:
    """A check whether a pose is within *xy* (m) and *yaw* (rad) of the goal.

    With *stateful*, a position that was reached once stays reached until `reset`; only the heading is checked
    from then on.

    Attributes:
        is_position_reached: Whether the last check found the robot at the goal's position, with any heading.
    """

    def __init__(self, xy: float, yaw: float, stateful: bool = True) -> None:
        self._xy = xy
        self._yaw = yaw
        self._stateful = stateful
        self.is_position_reached = False

    def reset(self) -> None:
        """Forget that the position was reached, for a new goal."""
        self.is_position_reached = False

    def check(self, pose: Pose2D, goal: Pose2D) -> bool:
        """Return whether the robot has the position and the heading of the goal.

        Args:
            pose: The robot's pose.
            goal: The goal, in the same frame as *pose*.
        """
        is_close = math.hypot(goal.x - pose.x, goal.y - pose.y) <= self._xy
        self.is_position_reached = is_close or (self._stateful and self.is_position_reached)
        return self.is_position_reached and abs(wrap_angle(goal.yaw - pose.yaw)) <= self._yaw


class ProgressChecker:
    """A check whether a robot moved *radius* (m) or turned *angle* (rad) within the last *allowance* (s).

    Call `pause` to exclude time in which the robot is not allowed to move.
    """

    def __init__(self, radius: float, angle: float, allowance: float) -> None:
        self._radius = radius
        self._angle = angle
        self._allowance = round(allowance * NS_PER_S)
        self._reference: Pose2D | None = None
        self._since = 0

    def reset(self) -> None:
        """Measure the progress from the pose and the time of the next check."""
        self._reference = None

    def pause(self, nanoseconds: int) -> None:
        """Exclude the last *nanoseconds* from the time without progress."""
        self._since += nanoseconds

    def check(self, pose: Pose2D, now: int) -> bool:
        """Return whether the robot makes progress. The first check after `reset` returns True.

        Args:
            pose: The robot's pose, in the same frame in all calls.
            now: The time (ns).
        """
        reference = self._reference
        if (
            reference is None
            or math.hypot(pose.x - reference.x, pose.y - reference.y) > self._radius
            or abs(wrap_angle(pose.yaw - reference.yaw)) > self._angle
        ):
            self._reference = pose
            self._since = now
            return True
        return now - self._since <= self._allowance
