"""Checks for reaching the goal and for being stuck: Nav2's SimpleGoalChecker and PoseProgressChecker."""

import math

from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import NS_PER_S, Pose2D


class GoalChecker:
    """A check whether a pose is at the goal, within *xy* (m) and *yaw* (rad).

    With *stateful*, a position that was reached once stays reached until `reset`; only the heading is checked
    from then on.
    """

    def __init__(self, xy: float, yaw: float, stateful: bool = True) -> None:
        self._xy = xy
        self._yaw = yaw
        self._stateful = stateful
        self._position_reached = False

    def reset(self) -> None:
        """Forget that the position was reached, for a new goal."""
        self._position_reached = False

    def is_position_reached(self, pose: Pose2D, goal: Pose2D) -> bool:
        """Return whether *pose* is at the position of *goal*, with any heading."""
        close = math.hypot(goal.x - pose.x, goal.y - pose.y) <= self._xy
        self._position_reached = close or (self._stateful and self._position_reached)
        return self._position_reached

    def is_goal_reached(self, pose: Pose2D, goal: Pose2D) -> bool:
        """Return whether *pose* has the position and the heading of *goal*."""
        return self.is_position_reached(pose, goal) and abs(wrap_angle(goal.yaw - pose.yaw)) <= self._yaw


class ProgressChecker:
    """A check whether a robot moved *radius* (m) or turned *angle* (rad) within the last *allowance* (s).

    Exclude the time in which the robot has to stand by calling `pause`.
    """

    def __init__(self, radius: float, angle: float, allowance: float) -> None:
        self._radius = radius
        self._angle = angle
        self._allowance = round(allowance * NS_PER_S)
        self._reference: Pose2D | None = None
        self._since = 0

    def reset(self) -> None:
        """Start again at the next check."""
        self._reference = None

    def pause(self, nanoseconds: int) -> None:
        """Exclude the last *nanoseconds* from the time without progress."""
        self._since += nanoseconds

    def check(self, pose: Pose2D, now: int) -> bool:
        """Return whether a robot that is at *pose* at *now* (ns) makes progress."""
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
