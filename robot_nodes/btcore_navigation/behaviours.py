"""The behaviours of Nav2's `behavior_server`: Spin, BackUp, DriveOnHeading, Wait and AssistedTeleop.

A behaviour simulates the motion for `simulate_ahead_time` and ends before the robot touches something. It
checks the newest scan, the obstacles that the local costmap remembers (no laser covers the area behind the
robot) and the sonars. Parameters and defaults are Nav2's.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from btcore.clock import NS_PER_S
from btcore_navigation.action import ActionServer, GoalHandle
from btcore_navigation.clearance import ClearanceGrid
from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_navigation.motion_server import MotionServer
from btcore_navigation.parameters import BehaviourParameters
from btcore_navigation.sensor_watch import SensorWatch
from btcore_navigation.velocity_smoother import VelocityLimits
from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import BASE_FRAME, Odometry, Robot, Twist2D
from btcore_robot.transforms import TransformError, TransformTree

__all__ = [
    "AssistedTeleopGoal",
    "BackUpGoal",
    "BehaviourFeedback",
    "DriveOnHeadingGoal",
    "SpinGoal",
    "WaitGoal",
]

_STEP_S = 0.1  # s between the simulated poses
_MAX_ACCELERATION = 2.5  # m/s²: Nav2's limit for driving straight; the base's own limit is mostly lower
_GRID_ERROR = 0.03  # m by which a distance of the grid may be under the hull's radius without contact
_CLOSE_ENOUGH = 1e-6  # rad or m: Nav2's value


@dataclass(frozen=True, slots=True)
class SpinGoal:
    """Turn on the spot.

    Attributes:
        dist: The angle (rad, + to the left).
        time_allowance: The time limit (s); 0 = no limit.
        disable_collision_checks: Whether to turn even if the robot would touch an obstacle.
    """

    dist: float = 1.57
    time_allowance: float = 10.0
    disable_collision_checks: bool = False


@dataclass(frozen=True)
class _StraightGoal:
    dist: float = 0.15
    speed: float = 0.025
    time_allowance: float = 10.0
    disable_collision_checks: bool = False


class BackUpGoal(_StraightGoal):
    """Back up *dist* (m) at *speed* (m/s); signs are ignored. *time_allowance* is in s; 0 means no limit."""


class DriveOnHeadingGoal(_StraightGoal):
    """Drive *dist* (m) straight at *speed* (m/s), both with the same sign.

    *time_allowance* is in s; 0 means no limit.
    """


@dataclass(frozen=True, slots=True)
class WaitGoal:
    """Do nothing for *duration* (s)."""

    duration: float = 1.0


@dataclass(frozen=True, slots=True)
class AssistedTeleopGoal:
    """Let a user drive the robot for at most *time_allowance* (s; 0 = no limit); stop it before obstacles.

    As in goals of other motions, *dist* (m) is the greatest distance, and *disable_collision_checks* whether
    the robot drives into obstacles. Both are constants here.
    """

    time_allowance: float = 10.0
    dist: ClassVar[float] = math.inf
    disable_collision_checks: ClassVar[bool] = False


@dataclass(frozen=True, slots=True)
class BehaviourFeedback:
    """The *progress* of a behaviour: the distance (m) or, for Spin, the angle (rad) so far.

    For Wait it is the time left (s), for AssistedTeleop the time that has passed (s).
    """

    progress: float


MotionGoal = TypeVar("MotionGoal", SpinGoal, BackUpGoal, DriveOnHeadingGoal, AssistedTeleopGoal)
Handle = GoalHandle[MotionGoal, BehaviourFeedback, None]
WaitHandle = GoalHandle[WaitGoal, BehaviourFeedback, None]


@dataclass(frozen=True, slots=True)
class _Codes:
    """The error codes of a motion behaviour."""

    timeout: Nav2ErrorCode
    transform: Nav2ErrorCode
    collision: Nav2ErrorCode
    invalid_goal: Nav2ErrorCode


class MotionBehaviour(MotionServer[MotionGoal, BehaviourFeedback], Generic[MotionGoal]):
    """A behaviour that moves the robot.

    Call `step` from the robot's schedule at `cycle_frequency` (10 Hz by default) in `Phase.CONTROLLER`. While
    a sensor has an outage, the robot stands and the goal waits. The goal fails when an outage lasts longer
    than `btcore_robot.time_limits.MAX_OUTAGE_S`. Motion during an outage of the odometry doesn't count.

    Args:
        robot: The robot.
        tree: The transform tree.
        clearance: The distances to obstacles, for collision checks.
        sensors: The watch over the sensors.
        parameters: The parameters.
    """

    node = "behavior_server"
    _codes: _Codes

    def __init__(
        self,
        robot: Robot,
        tree: TransformTree,
        clearance: ClearanceGrid,
        sensors: SensorWatch,
        parameters: BehaviourParameters,
    ) -> None:
        base, turning = robot.base_info, parameters.rotational_acc_lim
        v, w = max(base.v_max, -base.v_min), parameters.max_rotational_vel
        limits = VelocityLimits(v, w, _MAX_ACCELERATION, _MAX_ACCELERATION, turning, turning)
        super().__init__(robot, tree, clearance, sensors, limits, parameters.cycle_frequency)
        self.parameters = parameters
        self._started = 0
        self._interrupted = False
        self._from: Odometry = robot.odometry()
        self._travelled_before = 0.0
        """The travelled amount (rad or m) before `_from`."""
        self._travelled = 0.0

    def start(self, handle: Handle[MotionGoal], now: int, previous: Handle[MotionGoal] | None) -> None:
        """Begin at the robot's present pose, or abort an invalid goal."""
        self._started = self._last = now
        self._interrupted = False
        self._from = self._robot.odometry()
        self._travelled_before = self._travelled = 0.0
        self._smoother.resume(now)
        error = self._goal_error(handle.goal)
        if error:
            handle.abort(self._codes.invalid_goal, error)

    def work(self, handle: Handle[MotionGoal], now: int) -> None:
        """Move for one period, or end the goal: at its distance, at its time limit or before a collision."""
        goal = handle.goal
        elapsed, self._last = now - self._last, now
        odometry = self._robot.odometry()
        if self._wait_for_sensors(handle, elapsed, now):
            return
        self._travelled = self._progress(odometry)
        handle.feedback = BehaviourFeedback(self._travelled)
        remaining = self._amount(goal) - self._travelled - self._braking()
        seconds = (now - self._started) / NS_PER_S
        if remaining <= _CLOSE_ENOUGH:
            handle.succeed()
        elif 0.0 < goal.time_allowance < seconds:
            handle.abort(
                self._codes.timeout, f"{self.name} exceeded its time allowance of {goal.time_allowance:g} s"
            )
        else:
            self._move(handle, remaining, odometry, now)
        if handle.done:
            self._smoother.send_command(0.0, 0.0, now)

    def _goal_error(self, goal: MotionGoal) -> str:
        """Return why *goal* is invalid, as a sentence; "" for a valid goal."""
        return "" if math.isfinite(self._amount(goal)) else f"{self.name} needs a finite amount"

    def _amount(self, goal: MotionGoal) -> float:
        """Return how far to move (rad or m, not negative)."""
        return abs(goal.dist)

    def _wait_for_sensors(self, handle: Handle[MotionGoal], elapsed: int, now: int) -> bool:
        """Brake if a sensor has an outage, and return whether it has.

        A goal without collision checks needs the odometry only. *elapsed* (ns) is the time since the last
        step.
        """
        odometry_outage = self._sensors.odometry_outage(now)
        outage = odometry_outage
        if outage is None and not handle.goal.disable_collision_checks:
            outage = self._sensors.outage(now)
        if odometry_outage is not None:
            self._interrupted = True
        elif self._interrupted:
            # The odometry may have jumped: the motion is measured from the first new reading on.
            self._interrupted = False
            self._from, self._travelled_before = self._robot.odometry(), self._travelled
        if outage is None:
            return False
        self._started += elapsed
        self._smoother.halt(now)
        if outage.exceeds_patience(now):
            handle.abort(self._codes.transform, outage.message(now))
        return True

    def _progress(self, odometry: Odometry) -> float:
        """Return how far the robot has moved since the start (rad or m)."""
        start, here = self._from.pose, odometry.pose
        return self._travelled_before + math.hypot(here.x - start.x, here.y - start.y)

    def _braking(self) -> float:
        """Return the braking distance (rad or m)."""
        return self._smoother.v**2 / (2 * self._smoother.limits.v_down)

    def _velocity(self, goal: MotionGoal, remaining: float) -> tuple[float, float]:
        """Return the velocity (m/s, rad/s); *remaining* (rad or m) is the way before the robot must brake."""
        raise NotImplementedError

    def _move(self, handle: Handle[MotionGoal], remaining: float, odometry: Odometry, now: int) -> None:
        v, w = self._velocity(handle.goal, remaining)
        if not handle.goal.disable_collision_checks:
            try:
                self._update_clearance()
            except TransformError as error:
                handle.abort(self._codes.transform, str(error))
                return
            if self._collides(v, remaining, odometry):
                handle.abort(
                    self._codes.collision,
                    f"{self.name} would touch something within {self.parameters.simulate_ahead_time:g} s",
                )
                return
        self._smoother.send_command(v, w, now)

    def _collides(self, v: float, remaining: float, odometry: Odometry) -> bool:
        pose = odometry.pose
        if v == 0.0:
            clearance = self.clearance.distance_at(pose.x, pose.y)
            return clearance < self._robot.base_info.radius - _GRID_ERROR
        times = np.arange(1, round(self.parameters.simulate_ahead_time / _STEP_S) + 1) * _STEP_S
        along = np.minimum(abs(v) * times, remaining) * math.copysign(1.0, v)
        x, y = pose.x + math.cos(pose.yaw) * along, pose.y + math.sin(pose.yaw) * along
        return self._is_blocked(odometry, x, y, along)

    def _is_blocked(
        self,
        odometry: Odometry,
        x: NDArray[np.float64],
        y: NDArray[np.float64],
        along: NDArray[np.float64],
    ) -> bool:
        """Return whether the robot comes too near something at its next positions: *x*, *y* (m, in odom).

        *along* are the distances (m) of these positions along the robot's axis.
        """
        clearance = self.clearance.distance_at(odometry.pose.x, odometry.pose.y)
        least = self.clearance.required_from(clearance)
        return bool((self.clearance.distances_at(x, y) < least).any()) or self._approaches_echo(along)

    def _approaches_echo(self, along: NDArray[np.float64]) -> bool:
        """Return whether the robot, moving *along* (m) its axis, comes too near an echo of a sonar."""
        for reading in self._robot.sonars():
            if reading.range == math.inf or math.isnan(reading.range):
                continue
            distance = max(reading.range, reading.range_min)
            sonar = self._tree.lookup(BASE_FRAME, reading.frame).to_pose()
            # The echo may come from anywhere in the cone: check its axis, and half-way to its edges.
            for side in (-reading.fov / 4, 0.0, reading.fov / 4):
                x = sonar.x + distance * math.cos(sonar.yaw + side)
                y = sonar.y + distance * math.sin(sonar.yaw + side)
                near = np.hypot(x - along, y)
                if bool((near < self.clearance.required_from(math.hypot(x, y))).any()):
                    return True
        return False


class SpinBehaviour(MotionBehaviour[SpinGoal]):
    """A turn on the spot at √(2 · acceleration limit · remaining angle), within the limits of the rate."""

    name = "spin"
    _codes = _Codes(
        Nav2ErrorCode.SPIN_TIMEOUT,
        Nav2ErrorCode.SPIN_TF_ERROR,
        Nav2ErrorCode.SPIN_COLLISION_AHEAD,
        Nav2ErrorCode.SPIN_UNKNOWN,
    )

    def _progress(self, odometry: Odometry) -> float:
        goal = self.current.goal if self.current is not None else SpinGoal()
        # Summed up step by step, since a goal may be more than half a turn.
        turned = wrap_angle(odometry.pose.yaw - self._from.pose.yaw)
        self._from = odometry
        return self._travelled + math.copysign(1.0, goal.dist) * turned

    def _braking(self) -> float:
        return self._smoother.w**2 / (2 * self._smoother.limits.w_down)

    def _velocity(self, goal: SpinGoal, remaining: float) -> tuple[float, float]:
        parameters = self.parameters
        rate = math.sqrt(2 * self._smoother.limits.w_down * remaining)
        rate = min(max(rate, parameters.min_rotational_vel), parameters.max_rotational_vel)
        return 0.0, math.copysign(rate, goal.dist)


class BackUpBehaviour(MotionBehaviour[BackUpGoal]):
    """A straight drive backward at the goal's speed, limited by the base's greatest speed."""

    name = "backup"
    _codes = _Codes(
        Nav2ErrorCode.BACKUP_TIMEOUT,
        Nav2ErrorCode.BACKUP_TF_ERROR,
        Nav2ErrorCode.BACKUP_COLLISION_AHEAD,
        Nav2ErrorCode.BACKUP_INVALID_INPUT,
    )

    def _goal_error(self, goal: BackUpGoal) -> str:
        if not (goal.dist and goal.speed and math.isfinite(goal.dist + goal.speed)):
            return f"backing up {goal.dist:g} m at {goal.speed:g} m/s never ends"
        return ""

    def _velocity(self, goal: BackUpGoal, remaining: float) -> tuple[float, float]:
        return max(-abs(goal.speed), self._robot.base_info.v_min), 0.0


class DriveOnHeadingBehaviour(MotionBehaviour[DriveOnHeadingGoal]):
    """A straight drive forward, or backward if distance and speed are negative."""

    name = "drive_on_heading"
    _codes = _Codes(
        Nav2ErrorCode.DRIVE_ON_HEADING_TIMEOUT,
        Nav2ErrorCode.DRIVE_ON_HEADING_TF_ERROR,
        Nav2ErrorCode.DRIVE_ON_HEADING_COLLISION_AHEAD,
        Nav2ErrorCode.DRIVE_ON_HEADING_INVALID_INPUT,
    )

    def _goal_error(self, goal: DriveOnHeadingGoal) -> str:
        if not (goal.dist * goal.speed > 0.0 and math.isfinite(goal.dist + goal.speed)):
            return f"driving {goal.dist:g} m at {goal.speed:g} m/s: both need the same sign"
        return ""

    def _velocity(self, goal: DriveOnHeadingGoal, remaining: float) -> tuple[float, float]:
        base = self._robot.base_info
        return min(max(goal.speed, base.v_min), base.v_max), 0.0


class AssistedTeleopBehaviour(MotionBehaviour[AssistedTeleopGoal]):
    """A drive by the commands of a user, which are slowed down or stopped before obstacles.

    A command is valid until the next command, as in Nav2.
    """

    name = "assisted_teleop"
    _codes = _Codes(
        Nav2ErrorCode.ASSISTED_TELEOP_TIMEOUT,
        Nav2ErrorCode.ASSISTED_TELEOP_TF_ERROR,
        Nav2ErrorCode.ASSISTED_TELEOP_UNKNOWN,
        Nav2ErrorCode.ASSISTED_TELEOP_UNKNOWN,
    )
    _command = Twist2D(0.0, 0.0)
    _is_finished = False

    def command(self, velocity: Twist2D) -> None:
        """Set the velocity that the user wants; without a goal it has no effect."""
        self._command = velocity

    def finish(self) -> None:
        """End the present goal as SUCCEEDED."""
        self._is_finished = True

    def send_goal(self, goal: AssistedTeleopGoal) -> Handle[AssistedTeleopGoal]:
        """Send *goal* and return its handle. Earlier commands have no effect."""
        self._command, self._is_finished = Twist2D(0.0, 0.0), False
        return super().send_goal(goal)

    def _goal_error(self, goal: AssistedTeleopGoal) -> str:
        return ""

    def _amount(self, goal: AssistedTeleopGoal) -> float:
        return 0.0 if self._is_finished else goal.dist

    def _progress(self, odometry: Odometry) -> float:
        return (self._last - self._started) / NS_PER_S

    def _move(
        self, handle: Handle[AssistedTeleopGoal], remaining: float, odometry: Odometry, now: int
    ) -> None:
        try:
            self._update_clearance()
        except TransformError as error:
            handle.abort(self._codes.transform, str(error))
            return
        share = self._safe_share(odometry)
        self._smoother.send_command(share * self._command.v, share * self._command.w, now)

    def _safe_share(self, odometry: Odometry) -> float:
        """Return the share (0–1) of the command that is safe, by Nav2's rule.

        It is the share of the simulated time before the first collision, and 0 for a collision at once.
        """
        pose, v, w = odometry.pose, self._command.v, self._command.w
        count = round(self.parameters.simulate_ahead_time / _STEP_S)
        yaws = pose.yaw + w * _STEP_S * (np.arange(count) + 0.5)
        x, y = pose.x + v * _STEP_S * np.cumsum(np.cos(yaws)), pose.y + v * _STEP_S * np.cumsum(np.sin(yaws))
        along: NDArray[np.float64] = v * _STEP_S * np.arange(1, count + 1, dtype=np.float64)
        if v == 0.0 or not self._is_blocked(odometry, x, y, along):
            return 1.0
        blocked = (self._is_blocked(odometry, *part) for part in zip(x, y, along, strict=True))
        first = next(index for index, is_blocked in enumerate(blocked) if is_blocked)
        return (first + 1) / count if first else 0.0


class WaitBehaviour(ActionServer[WaitGoal, BehaviourFeedback, None]):
    """A pause. Call `step` from the robot's schedule at 10 Hz in `Phase.CONTROLLER`."""

    name = "wait"
    node = "behavior_server"

    def __init__(self) -> None:
        super().__init__()
        self._until = 0

    def start(self, handle: WaitHandle, now: int, previous: WaitHandle | None) -> None:
        """Begin to wait, or abort a goal that would never end."""
        if not math.isfinite(handle.goal.duration):
            handle.abort(Nav2ErrorCode.WAIT_UNKNOWN, f"waiting for {handle.goal.duration} s never ends")
            return
        self._until = now + round(handle.goal.duration * NS_PER_S)

    def work(self, handle: WaitHandle, now: int) -> None:
        """Succeed once the time is over."""
        handle.feedback = BehaviourFeedback(max(self._until - now, 0) / NS_PER_S)
        if now >= self._until:
            handle.succeed()
