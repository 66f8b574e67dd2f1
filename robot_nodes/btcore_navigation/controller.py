"""The controller of FollowPath: drive along a path, and around obstacles on the path or stop before them.

The control law is a regulated pure pursuit: the speed depends on the curvature of the arc, on the free length
of the arc in the newest scan, on the clearance beside the arc, and on the remaining distance. The robot
passes an obstacle on the path by a detour; the controller updates the detour while the obstacle stays.
Collision checks treat the robot as a circle: they compare the distance to the nearest obstacle with a radius.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from btcore.clock import NS_PER_S
from btcore_navigation.action import GoalHandle
from btcore_navigation.clearance import ClearanceGrid
from btcore_navigation.detour import find_detour
from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_navigation.goal_checks import GoalChecker, ProgressChecker
from btcore_navigation.motion_server import MotionServer
from btcore_navigation.parameters import ControllerParameters
from btcore_navigation.path import NavPath, path_through
from btcore_navigation.pure_pursuit import Carrot, PurePursuit
from btcore_navigation.sensor_watch import SensorWatch
from btcore_navigation.velocity_smoother import VelocityLimits
from btcore_robot.rigid_transform import Transform, wrap_angle
from btcore_robot.robot import Pose2D, Robot
from btcore_robot.transforms import TransformError, TransformTree

__all__ = ["ControllerServer", "FollowPathFeedback", "FollowPathGoal", "FollowPathHandle"]

_EXTRA_FULL_SPEED_CLEARANCE = 0.15  # m more than the least clearance: then the speed is not reduced
_MIN_SPEED_SHARE = 0.4  # share of the full speed right beside an obstacle
_POINT_DISTANCE = 0.05  # m between the checked points of an arc or a path
_ARC_POINTS = 12  # the number of checked points of an arc: 0.6 m
_SPEED_POINTS = 6  # the number of points of an arc whose clearance limits the speed: 0.3 m
_CHECKED_DISTANCE = 1.3  # m of the path that must be free; otherwise a detour is searched
_MAX_RETURN_DISTANCE = 3.0  # m of the path on which a detour may end: the range of the clearance grid
_MAP_ERROR = 0.04  # m less than the least clearance: a path with less clearance is blocked
_RETURN_STRIDE = 2  # every second point of the path is a possible end of a detour
_DISTANCE_PAST_OBSTACLE = 0.3  # m behind the obstacle at which a detour returns to the path
_MAX_CROSS_TRACK_DISTANCE = 0.3  # m beside the path; farther away, a way back is searched too
_EXTRA_DETOUR_CLEARANCE = 0.02  # m of clearance that a detour keeps in addition
_STOP_DISTANCE = 0.08  # m that the robot stops before the last free point of an arc
# With less motion a detour is searched, even if the path looks free.
_STUCK_RADIUS, _STUCK_ANGLE, _STUCK_S = 0.05, 0.15, 1.5  # m, rad, s
_MIN_UNSTICK_DISTANCE = 0.6  # m along the path: the nearest end of a detour for a stuck robot
_SEARCH_INTERVAL_NS = NS_PER_S // 3  # between two searches for a detour
_ALIGNED_ANGLE = 0.15  # rad: a turn on the spot ends at this error
_NEARLY_HALF_TURN = 2.5  # rad: from this angle noise may flip the sign
_MIN_SPEED = 0.02  # m/s: a lower speed counts as standing
_MIN_TURN_RATE = 0.05  # rad/s of a turn on the spot
_TURN_ACCELERATION_SHARE = 0.7  # of the turning acceleration, with which turns on the spot are planned
_MAX_DETOUR_CARROT_DISTANCE = 0.4  # m: a detour bends more than a path


@dataclass(frozen=True, slots=True)
class FollowPathGoal:
    """A *path* to follow to its end.

    The ids name Nav2's plug-ins; "" = the default. There is a single plug-in of each kind, whatever its name,
    but a name that the parameters lack is an error.

    Attributes:
        path: The path.
        controller_id: One of the parameter `controller_plugins`.
        goal_checker_id: One of `goal_checker_plugins`.
        progress_checker_id: One of `progress_checker_plugins`.
        path_handler_id: Ignored.
    """

    path: NavPath
    controller_id: str = ""
    goal_checker_id: str = ""
    progress_checker_id: str = ""
    path_handler_id: str = ""


@dataclass(frozen=True, slots=True)
class FollowPathFeedback:
    """The progress along a path.

    Attributes:
        distance_to_goal: The remaining distance (m).
        speed: The commanded speed (m/s).
        position_error: The distance from the path (m); positive if the robot is to the left of the path.
        heading_error: The error of the heading (rad); positive if the robot is turned to the left of the
            path's direction.
    """

    distance_to_goal: float = 0.0
    speed: float = 0.0
    position_error: float = 0.0
    heading_error: float = 0.0


FollowPathHandle = GoalHandle[FollowPathGoal, FollowPathFeedback, None]
"""The handle of a `FollowPathGoal`."""


class ControllerServer(MotionServer[FollowPathGoal, FollowPathFeedback]):
    """The action server of `FollowPathGoal`.

    Call `step` from the robot's schedule at `controller_frequency` in `Phase.CONTROLLER`. While *hold*
    returns True, or a sensor has an outage, the robot stands and the goal waits. The goal fails when an
    outage lasts longer than `btcore_robot.time_limits.MAX_OUTAGE_S`.

    Args:
        robot: The robot.
        tree: The transform tree.
        clearance: The distances to obstacles, for collision checks.
        sensors: The watch over the sensors.
        parameters: The parameters.
        hold: A function that returns whether the robot has to stand.

    Attributes:
        name: The name of the action.
    """

    name = "follow_path"
    node = "controller_server"

    def __init__(
        self,
        robot: Robot,
        tree: TransformTree,
        clearance: ClearanceGrid,
        sensors: SensorWatch,
        parameters: ControllerParameters,
        hold: Callable[[], bool],
    ) -> None:
        limits = VelocityLimits(
            v=parameters.max_vel_x,
            w=parameters.max_vel_theta,
            v_up=parameters.acc_lim_x,
            v_down=abs(parameters.decel_lim_x),
            w_up=parameters.acc_lim_theta,
            w_down=abs(parameters.decel_lim_theta),
        )
        super().__init__(robot, tree, clearance, sensors, limits, parameters.controller_frequency)
        self.parameters = parameters
        self._hold = hold
        self._blocked_clearance = round(clearance.required - _MAP_ERROR, 6)
        self._full_speed_clearance = round(clearance.required + _EXTRA_FULL_SPEED_CLEARANCE, 6)
        self._goals = GoalChecker(
            parameters.xy_goal_tolerance, parameters.yaw_goal_tolerance, parameters.stateful
        )
        self._progress = ProgressChecker(
            parameters.required_movement_radius,
            parameters.required_movement_angle,
            parameters.movement_time_allowance,
        )
        self._motion_check = ProgressChecker(_STUCK_RADIUS, _STUCK_ANGLE, _STUCK_S)
        self._pursuit: PurePursuit | None = None
        self._detour: PurePursuit | None = None
        self._detour_kept_distance = 0.0  # m of the detour that the robot drives in any case
        self._searched_at = 0
        self._checked_stamp: int | None = None
        self._turn_direction = 0.0
        self._could_move_at = 0

    def start(self, handle: FollowPathHandle, now: int, previous: FollowPathHandle | None) -> None:
        """Begin to follow the path.

        After a *previous* goal the robot drives on, and the checkers keep their state.
        """
        path = handle.goal.path
        problem = self._problem(handle.goal)
        if problem is not None:
            handle.abort(*problem)
            if previous is not None:
                self._smoother.halt(now)
            return
        old = previous.goal.path if previous is not None else None
        self._pursuit = PurePursuit(path.points)
        if old is None:
            self._smoother.resume(now)
            self._progress.reset()
            self._motion_check.reset()
            self._could_move_at = self._last = now
            self._turn_direction = 0.0
        if old is None or old.frame != path.frame or old.goal != path.goal:
            self._goals.reset()
        self._detour = None
        self._checked_stamp = None

    def work(self, handle: FollowPathHandle, now: int) -> None:
        """Follow the path for one period."""
        elapsed, self._last = now - self._last, now
        outage = self._sensors.outage(now)
        if outage is not None:
            self._pause(elapsed)
            self._smoother.halt(now)
            if outage.exceeds_patience(now):
                handle.abort(outage.error_code(Nav2ErrorCode.FOLLOW_PATH_TF_ERROR), outage.message(now))
            return
        path, pursuit = handle.goal.path, self._pursuit
        goal = path.goal
        assert pursuit is not None
        assert goal is not None
        try:
            frame = self.clearance.frame
            to_path = Transform() if path.frame == frame else self._tree.lookup(path.frame, frame)
            self._update_clearance()
        except TransformError as error:
            self._fail(handle, now, Nav2ErrorCode.FOLLOW_PATH_TF_ERROR, str(error))
            return
        odometry = self._robot.odometry().pose
        pose = _transform_pose(to_path, odometry)
        pursuit.locate(pose)
        turned = 0.0 if pursuit.heading is None else wrap_angle(pose.yaw - pursuit.heading)
        handle.feedback = FollowPathFeedback(
            pursuit.remaining, self._smoother.v, pursuit.cross_track_error, turned
        )
        if self._hold():
            self._pause(elapsed)
            self._smoother.send_command(0.0, 0.0, now)
            return
        if self._goals.check(pose, goal):
            handle.succeed()
            self._smoother.send_command(0.0, 0.0, now)
            return
        if not self._progress.check(pose, now):
            seconds = self.parameters.movement_time_allowance
            handle.abort(
                Nav2ErrorCode.FAILED_TO_MAKE_PROGRESS, f"the robot has made no progress for {seconds:g} s"
            )
            self._smoother.send_command(0.0, 0.0, now)
            return
        if self._goals.is_position_reached:
            self._could_move_at = now
            self._turn(wrap_angle(goal.yaw - pose.yaw), now)
            return
        self._update_detour(pursuit, to_path, odometry, now)
        if self._drive(pursuit, pose, odometry, now):
            self._could_move_at = now
        else:
            self._fail(
                handle,
                now,
                Nav2ErrorCode.NO_VALID_CONTROL,
                "no way along the path keeps clear of obstacles",
            )

    def local_plan(self) -> NavPath | None:
        """Return the way that the robot is about to drive, in the frame of the local costmap.

        It leads from the robot along the detour or the path, as far as obstacles are considered.

        Returns:
            The way, or None while no path is followed or a transform is missing.
        """
        handle, way, frame = self.current, self._detour, self.clearance.frame
        if handle is None or handle.done or self._pursuit is None:
            return None
        to_frame = Transform()
        if way is None:
            way = self._pursuit
            try:
                to_frame = self._tree.lookup(frame, handle.goal.path.frame)
            except TransformError:
                return None
        here = self._robot.odometry().pose
        points = _transform_points(to_frame, way.ahead(_CHECKED_DISTANCE, _POINT_DISTANCE))
        points[0] = here.x, here.y
        (x, y), (east, north) = points[-1].tolist(), (points[-1] - points[-2:][0]).tolist()
        goal = Pose2D(x, y, math.atan2(north, east) if len(points) > 1 else here.yaw)
        return path_through(points, goal, self._last, frame)

    def _problem(self, goal: FollowPathGoal) -> tuple[Nav2ErrorCode, str] | None:
        """Return error code and message of a goal that can't be followed, or None."""
        parameters, unknown = self.parameters, Nav2ErrorCode.FOLLOW_PATH_UNKNOWN
        for noun, name, names, code in (
            (
                "controller",
                goal.controller_id,
                parameters.controller_plugins,
                Nav2ErrorCode.INVALID_CONTROLLER,
            ),
            ("goal checker", goal.goal_checker_id, parameters.goal_checker_plugins, unknown),
            ("progress checker", goal.progress_checker_id, parameters.progress_checker_plugins, unknown),
        ):
            if name and name not in names:
                return code, f"unknown {noun} '{name}': use {' or '.join(names)}"
        if not len(goal.path):
            return Nav2ErrorCode.INVALID_PATH, "the path has no poses"
        if not np.isfinite(goal.path.poses).all():
            return Nav2ErrorCode.INVALID_PATH, "a pose of the path is not finite"
        return None

    def _pause(self, elapsed: int) -> None:
        """Exclude the *elapsed* time (ns) since the last step from all checks of progress."""
        self._progress.pause(elapsed)
        self._motion_check.pause(elapsed)
        self._could_move_at += elapsed

    def _fail(self, handle: FollowPathHandle, now: int, code: Nav2ErrorCode, message: str) -> None:
        """Stop the robot; abort the goal once the robot couldn't move for longer than the tolerance."""
        self._smoother.send_command(0.0, 0.0, now)
        tolerance = self.parameters.failure_tolerance
        if tolerance == 0.0:
            handle.abort(code, message)
        elif tolerance > 0.0 and now - self._could_move_at > tolerance * NS_PER_S:
            if code is Nav2ErrorCode.NO_VALID_CONTROL:
                code = Nav2ErrorCode.PATIENCE_EXCEEDED
            handle.abort(code, f"{message}, for {tolerance:g} s")

    def _update_detour(self, pursuit: PurePursuit, to_path: Transform, odometry: Pose2D, now: int) -> None:
        """Check once per scan whether the path is blocked; begin, keep, renew or end a detour."""
        if self._checked_stamp == self.clearance.stamp:
            return
        self._checked_stamp = self.clearance.stamp
        ahead = _transform_points(to_path.inverse(), pursuit.ahead(_MAX_RETURN_DISTANCE, _POINT_DISTANCE))
        clearances = self.clearance.distances_at(ahead[:, 0], ahead[:, 1])
        blocked = np.flatnonzero(
            clearances[: int(_CHECKED_DISTANCE / _POINT_DISTANCE)] < self._blocked_clearance
        )
        last_blocked = int(blocked[-1]) if len(blocked) else None
        is_stuck = not self._motion_check.check(odometry, now)
        if self._detour is not None:
            self._detour.locate(odometry)
        is_near_path = pursuit.cross_track_distance < _MAX_CROSS_TRACK_DISTANCE
        if last_blocked is None and is_near_path and not is_stuck and not self._must_finish_detour():
            self._detour = None
        elif (is_stuck or not self._is_detour_free()) and now - self._searched_at >= _SEARCH_INTERVAL_NS:
            self._searched_at = now
            self._search_detour(ahead, clearances, last_blocked, is_stuck, odometry)

    def _must_finish_detour(self) -> bool:
        return self._detour is not None and (self._detour.travelled or 0.0) < self._detour_kept_distance

    def _is_detour_free(self) -> bool:
        """Return whether there is a detour, with the robot on it, that keeps clear of obstacles."""
        if self._detour is None or self._detour.cross_track_distance >= _MAX_CROSS_TRACK_DISTANCE:
            return False
        way = self._detour.ahead(_CHECKED_DISTANCE, _POINT_DISTANCE)
        clearances = self.clearance.distances_at(way[:, 0], way[:, 1])
        return bool(
            (clearances >= min(self._blocked_clearance, float(clearances[0]) - _EXTRA_DETOUR_CLEARANCE)).all()
        )

    def _search_detour(
        self,
        ahead: NDArray[np.float64],
        clearances: NDArray[np.float32],
        last_blocked: int | None,
        is_stuck: bool,
        odometry: Pose2D,
    ) -> None:
        """Replace the detour by a new detour, or by None if there is no short way.

        The detour ends at a point of *ahead*, the path with these *clearances* (m), behind the last blocked
        point.
        """
        unstick = min(int(_MIN_UNSTICK_DISTANCE / _POINT_DISTANCE), len(ahead) - 1) if is_stuck else 0
        required = self.clearance.required + _EXTRA_DETOUR_CLEARANCE
        ends = _find_return_points(clearances >= required, unstick if last_blocked is None else last_blocked)
        previous = None if self._detour is None else self._detour.ahead(math.inf, _POINT_DISTANCE)
        self._detour = None
        result = find_detour(self.clearance, odometry, ahead[ends], required, previous) if ends else None
        if result is not None:
            chosen, way = result
            self._detour = PurePursuit(np.concatenate((way, ahead[ends[chosen] :])))
            length = float(np.hypot(*np.diff(way, axis=0).T).sum())
            # A way out of a stuck position is driven to its end, though the path may look free at once.
            self._detour_kept_distance = length if last_blocked is None else 0.0

    def _drive(self, pursuit: PurePursuit, pose: Pose2D, odometry: Pose2D, now: int) -> bool:
        """Command the velocity towards the carrot; return False if the robot can't move."""
        parameters = self.parameters
        current_clearance = self.clearance.distance_at(odometry.x, odometry.y)
        reach = min(max(current_clearance, parameters.min_lookahead_dist), parameters.lookahead_dist)
        if self._detour is not None:
            self._detour.locate(odometry)
            carrot = self._detour.carrot(odometry, min(reach, _MAX_DETOUR_CARROT_DISTANCE))
        else:
            carrot = pursuit.carrot(pose, reach)
        free_length, share = self._measure_arc(carrot, odometry, current_clearance)
        speed = min(
            parameters.max_vel_x * share, (free_length - _STOP_DISTANCE) / parameters.time_to_collision
        )
        # A turn continues until the robot is aligned, so that turns and drives do not alternate.
        is_driving = self._turn_direction == 0.0 and speed >= _MIN_SPEED
        if abs(carrot.angle) > (parameters.rotate_to_heading_min_angle if is_driving else _ALIGNED_ANGLE):
            self._turn(carrot.angle, now)
            return True
        self._turn_direction = 0.0
        if speed < _MIN_SPEED:
            return False
        remaining = pursuit.remaining if self._detour is None else math.inf
        if remaining < parameters.approach_velocity_scaling_dist:
            share = remaining / parameters.approach_velocity_scaling_dist
            speed = min(speed, max(parameters.max_vel_x * share, parameters.min_approach_linear_velocity))
        curvature = carrot.curvature
        if abs(curvature) * speed > parameters.max_vel_theta:
            speed = parameters.max_vel_theta / abs(curvature)
        # The base reaches this speed within the period; turning in proportion keeps it on the arc.
        turn = curvature * self._smoother.reachable_speed(speed)
        self._smoother.send_command(speed, turn, now)
        return True

    def _measure_arc(self, carrot: Carrot, odometry: Pose2D, current_clearance: float) -> tuple[float, float]:
        """Return the free length (m) of the arc to the carrot, and the share of the speed (0 … 1)."""
        curvature = carrot.curvature
        along = np.arange(1, _ARC_POINTS + 1) * _POINT_DISTANCE
        turned = odometry.yaw + curvature * along / 2
        chord = along * np.sinc(curvature * along / (2 * math.pi))
        x, y = odometry.x + chord * np.cos(turned), odometry.y + chord * np.sin(turned)
        clearances = self.clearance.distances_at(x, y)
        is_tight = clearances < self.clearance.required_from(current_clearance)
        free_length = float(along[int(is_tight.argmax())]) - _POINT_DISTANCE if is_tight.any() else math.inf
        narrowest = float(clearances[:_SPEED_POINTS].min())
        least = self.clearance.required
        width = (narrowest - least) / (self._full_speed_clearance - least)
        share = _MIN_SPEED_SHARE + (1 - _MIN_SPEED_SHARE) * width
        return free_length, min(max(share, _MIN_SPEED_SHARE), 1.0)

    def _turn(self, angle: float, now: int) -> None:
        """Turn on the spot by *angle* (rad), slowing down in time."""
        # Near half a turn the sign of the angle flips with noise: keep the direction.
        if self._turn_direction and abs(angle) > _NEARLY_HALF_TURN:
            angle = math.copysign(angle, self._turn_direction)
        self._turn_direction = math.copysign(1.0, angle)
        limits = self._smoother.limits
        rate = math.sqrt(2 * _TURN_ACCELERATION_SHARE * limits.w_down * abs(angle))
        self._smoother.send_command(0.0, math.copysign(max(rate, _MIN_TURN_RATE), angle), now)


def _find_return_points(is_free: NDArray[np.bool_], start: int) -> list[int]:
    """Return the indices of the points of a path, the nearest first, at which a detour may end.

    *is_free* is whether a point has enough clearance; the indices are at least *start*.
    """
    last, offset = len(is_free) - 1, int(_DISTANCE_PAST_OBSTACLE / _POINT_DISTANCE)
    ends = []
    for index in (np.flatnonzero(is_free[start:])[::_RETURN_STRIDE] + start).tolist():
        # A little farther along the path is better where the path is free all the way.
        farther = min(index + offset, last)
        ends.append(farther if is_free[index : farther + 1].all() else index)
    return ends


def _transform_pose(transform: Transform, pose: Pose2D) -> Pose2D:
    """Return *pose* in the target frame of *transform* (only x, y and yaw)."""
    turn = transform.yaw
    cos, sin = math.cos(turn), math.sin(turn)
    x, y, _ = transform.position
    yaw = wrap_angle(turn + pose.yaw)
    return Pose2D(x + cos * pose.x - sin * pose.y, y + sin * pose.x + cos * pose.y, yaw)


def _transform_points(transform: Transform, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return *points* (m, shape `(n, 2)`) in the target frame of *transform* (only x, y and yaw)."""
    yaw = transform.yaw
    cos, sin = math.cos(yaw), math.sin(yaw)
    x, y, _ = transform.position
    east = x + cos * points[:, 0] - sin * points[:, 1]
    north = y + sin * points[:, 0] + cos * points[:, 1]
    return np.stack((east, north), axis=1)
