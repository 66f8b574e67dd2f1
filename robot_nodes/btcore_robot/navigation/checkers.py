"""When a drive is at its goal, and when it is stuck: Nav2's SimpleGoalChecker and PoseProgressChecker."""

import math

from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import NS_PER_S, Pose2D


class GoalChecker:
    """Whether a pose is at the goal: within *xy* (m) and *yaw* (rad).

    *stateful*: once the place was reached, only the heading still counts, until `reset`.
    """

    def __init__(self, xy: float, yaw: float, stateful: bool = True) -> None:
        self._xy = xy
        self._yaw = yaw
        self._stateful = stateful
        self._arrived = False

    def reset(self) -> None:
        """Forget that the place was reached: there is another goal."""
        self._arrived = False

    def arrived(self, pose: Pose2D, goal: Pose2D) -> bool:
        """Whether the place is reached, whatever the heading."""
        there = math.hypot(goal.x - pose.x, goal.y - pose.y) <= self._xy
        self._arrived = there or (self._stateful and self._arrived)
        return self._arrived

    def reached(self, pose: Pose2D, goal: Pose2D) -> bool:
        """Whether place and heading are reached."""
        return self.arrived(pose, goal) and abs(wrap_angle(goal.yaw - pose.yaw)) <= self._yaw


class ProgressChecker:
    """Whether a robot has come *radius* (m) or turned *angle* (rad) within the last *allowance* (s).

    Time in which it stands because it has to doesn't count: tell of it by `pause`.
    """

    def __init__(self, radius: float, angle: float, allowance: float) -> None:
        self._radius = radius
        self._angle = angle
        self._allowance = round(allowance * NS_PER_S)
        self._mark: Pose2D | None = None
        self._since = 0

    def reset(self) -> None:
        """Begin anew at the next check."""
        self._mark = None

    def pause(self, nanoseconds: int) -> None:
        """Don't count the last *nanoseconds*."""
        self._since += nanoseconds

    def check(self, pose: Pose2D, now: int) -> bool:
        """Whether there is progress, the robot being at *pose* at *now* (ns)."""
        mark = self._mark
        if (
            mark is None
            or math.hypot(pose.x - mark.x, pose.y - mark.y) > self._radius
            or abs(wrap_angle(pose.yaw - mark.yaw)) > self._angle
        ):
            self._mark = pose
            self._since = now
            return True
        return now - self._since <= self._allowance
