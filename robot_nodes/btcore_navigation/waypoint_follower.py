"""The waypoint follower: Nav2's action server `follow_waypoints`, which drives to several goals in turn."""

from dataclasses import dataclass

from btcore.clock import NS_PER_MS
from btcore_navigation.action import ActionServer, GoalHandle, GoalStatus
from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_navigation.navigate_goal import NavigateGoal
from btcore_navigation.navigation_servers import AnyGoalHandle, NavigationServers
from btcore_navigation.parameters import WaypointFollowerParameters
from btcore_robot.robot import Pose2D


@dataclass(frozen=True, slots=True)
class FollowWaypointsGoal:
    """A request to stop at the poses *goals* (in the frame map) in turn.

    Attributes:
        goals: The poses.
        loops: How often the robot repeats the poses after the first time.
        first: The index of the pose with which the robot begins.
    """

    goals: tuple[Pose2D, ...]
    loops: int = 0
    first: int = 0


@dataclass(frozen=True, slots=True)
class MissedWaypoint:
    """A pose that was not reached: its index, the pose, error code and message of the navigator."""

    index: int
    goal: Pose2D
    code: int
    message: str


FollowWaypointsHandle = GoalHandle[FollowWaypointsGoal, int, tuple[MissedWaypoint, ...]]
"""The handle of a `FollowWaypointsGoal`; its feedback is the index of the present pose."""


class WaypointFollower(ActionServer[FollowWaypointsGoal, int, tuple[MissedWaypoint, ...]]):
    """The server of `FollowWaypointsGoal`. It sends each pose to `navigate_to_pose` of *servers*.

    Call `step` from the robot's schedule at 20 Hz in `Phase.CONTROLLER`.

    Args:
        servers: The servers with the navigator.
        parameters: The parameters; the defaults if omitted.
    """

    name = "follow_waypoints"
    node = "waypoint_follower"
    RATE = 20.0

    def __init__(
        self, servers: NavigationServers, parameters: WaypointFollowerParameters | None = None
    ) -> None:
        super().__init__()
        self._servers = servers
        self._parameters = parameters or WaypointFollowerParameters()
        self._index = self._loop = 0
        self._missed: list[MissedWaypoint] = []
        self._drive: AnyGoalHandle | None = None
        self._arrived: int | None = None
        """The time (ns) at which the robot arrived at the present pose."""

    def start(self, handle: FollowWaypointsHandle, now: int, previous: FollowWaypointsHandle | None) -> None:
        """Begin with the first pose; the drive of a previous goal is replaced."""
        goal = handle.goal
        self._index, self._loop, self._missed = goal.first, 0, []
        if goal.first < len(goal.goals):
            self._send_goal(goal)
            return
        if self._drive is not None:
            self._drive.cancel()
        reason = f"there is no waypoint {goal.first}" if goal.goals else "the list of waypoints is empty"
        handle.abort(Nav2ErrorCode.NO_VALID_WAYPOINTS, reason)

    def work(self, handle: FollowWaypointsHandle, now: int) -> None:
        """Send the next pose when the drive to the present pose has ended."""
        handle.feedback = self._index
        drive, goal = self._drive, handle.goal
        if drive is None or not drive.done:
            return
        if drive.status is GoalStatus.SUCCEEDED:
            if self._arrived is None:
                self._arrived = now
            if now - self._arrived < self._parameters.waypoint_pause_duration * NS_PER_MS:
                return
        else:
            code, message = (drive.result.code, drive.result.message) if drive.result is not None else (0, "")
            self._missed.append(MissedWaypoint(self._index, goal.goals[self._index], code, message))
            if self._parameters.stop_on_failure:
                handle.abort(
                    Nav2ErrorCode.STOP_ON_MISSED_WAYPOINT,
                    f"waypoint {self._index} was not reached: {message}",
                    tuple(self._missed),
                )
                return
        self._index += 1
        if self._index == len(goal.goals):
            if self._loop == goal.loops:
                handle.succeed(tuple(self._missed))
                return
            self._index, self._loop = 0, self._loop + 1
        self._send_goal(goal)

    def stop(self, handle: FollowWaypointsHandle, now: int) -> None:
        """Cancel the drive to the present pose."""
        if self._drive is not None:
            self._drive.cancel()

    def _send_goal(self, goal: FollowWaypointsGoal) -> None:
        self._arrived = None
        self._drive = self._servers.send_goal(NavigateGoal((goal.goals[self._index],)), "navigate_to_pose")
