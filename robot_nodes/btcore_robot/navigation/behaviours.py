"""What a robot that is stuck may do: Nav2's Spin, BackUp, DriveOnHeading and Wait, with its figures.

A behaviour looks ahead for as long as ``simulate_ahead_time`` says, by the newest scan, by what the local
costmap remembers (behind the robot no laser looks) and by the sonars, and ends before it touches something.
"""

import math
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from btcore_robot.navigation.action import ActionServer, GoalHandle
from btcore_robot.navigation.clearance import ClearanceGrid, laser_pose
from btcore_robot.navigation.costmap import LocalCostmap
from btcore_robot.navigation.error_codes import Nav2ErrorCode
from btcore_robot.navigation.parameters import BehaviourParameters
from btcore_robot.navigation.velocity_smoother import Limits, VelocitySmoother
from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import NS_PER_S, Odometry, Robot
from btcore_robot.transforms import TransformError, TransformTree

RADIUS = 0.30
"""How far (m) the robot's middle stays from obstacles while it drives."""

_STEP = 0.1  # s between the poses of the look ahead
_OLD = NS_PER_S // 2  # ns of age from which on a scan is no use: the robot stands until there is a newer one
_NEARER = 0.01  # m that may be lost where the robot is too near already
_ACCELERATION = 2.5  # m/s²: Nav2's limit for driving straight; the base's own is mostly lower
_ROUNDING = 0.03  # m by which distances to obstacles may be under the hull's radius without contact
_CLOSE_ENOUGH = 1e-6  # rad or m: Nav2's


@dataclass(frozen=True, slots=True)
class SpinGoal:
    """Turn on the spot by *dist* (rad, + to the left). Times in s; no *time_allowance* is 0."""

    dist: float = 1.57
    time_allowance: float = 10.0
    disable_collision_checks: bool = False


@dataclass(frozen=True, slots=True)
class BackUpGoal:
    """Go back *dist* (m) at *speed* (m/s); signs don't matter. Times in s; no *time_allowance* is 0."""

    dist: float = 0.15
    speed: float = 0.025
    time_allowance: float = 10.0
    disable_collision_checks: bool = False


@dataclass(frozen=True, slots=True)
class DriveOnHeadingGoal:
    """Drive straight *dist* (m) at *speed* (m/s), both of one sign. No *time_allowance* (s) is 0."""

    dist: float = 0.15
    speed: float = 0.025
    time_allowance: float = 10.0
    disable_collision_checks: bool = False


@dataclass(frozen=True, slots=True)
class WaitGoal:
    """Do nothing for *duration* (s)."""

    duration: float = 1.0


@dataclass(frozen=True, slots=True)
class BehaviourFeedback:
    """How far it has come: m, for Spin rad, for Wait the seconds left."""

    travelled: float


MovingGoal = TypeVar("MovingGoal", SpinGoal, BackUpGoal, DriveOnHeadingGoal)


@dataclass(frozen=True, slots=True)
class _Codes:
    """What a moving behaviour ends with."""

    timeout: Nav2ErrorCode
    transform: Nav2ErrorCode
    collision: Nav2ErrorCode
    mistake: Nav2ErrorCode


class MotionBehaviour(ActionServer[MovingGoal, BehaviourFeedback, None], Generic[MovingGoal]):
    """A behaviour that moves the robot; `step` belongs on the schedule at 10 Hz, ``Phase.CONTROLLER``."""

    _codes: _Codes

    def __init__(
        self,
        robot: Robot,
        tree: TransformTree,
        local_costmap: LocalCostmap,
        parameters: BehaviourParameters | None = None,
    ) -> None:
        super().__init__()
        self.parameters = figures = parameters or BehaviourParameters()
        self.period = 1.0 / figures.cycle_frequency
        """The seconds between two steps."""
        self._robot = robot
        self._tree = tree
        self._costmap = local_costmap
        self._clearance = ClearanceGrid()
        base = robot.base
        turning = figures.rotational_acc_lim
        self._throttle = VelocitySmoother(
            robot,
            Limits(
                max(base.v_max, -base.v_min),
                figures.max_rotational_vel,
                _ACCELERATION,
                _ACCELERATION,
                turning,
                turning,
            ).within(base),
        )
        self._begun = 0
        self._last = 0
        self._from: Odometry = robot.odometry()
        self._travelled = 0.0

    def step(self, now: int) -> None:
        """One period; a robot that has nothing left to do comes to rest."""
        super().step(now)
        if not self.busy:
            self._throttle.ease(now, self.period)

    def start(
        self,
        handle: GoalHandle[MovingGoal, BehaviourFeedback, None],
        now: int,
        previous: GoalHandle[MovingGoal, BehaviourFeedback, None] | None,
    ) -> None:
        """Begin here and now, unless the goal makes no sense."""
        self._begun = now
        self._from = self._robot.odometry()
        self._travelled = 0.0
        self._throttle.wake(now)
        fault = self._mistake(handle.goal)
        if fault:
            handle.abort(self._codes.mistake, fault)

    def work(self, handle: GoalHandle[MovingGoal, BehaviourFeedback, None], now: int) -> None:
        """One period of moving."""
        goal = handle.goal
        odometry = self._robot.odometry()
        self._travelled = self._way(odometry)
        handle.feedback = BehaviourFeedback(self._travelled)
        left = self._amount(goal) - self._travelled - self._braking()
        elapsed = (now - self._begun) / NS_PER_S
        if left <= _CLOSE_ENOUGH:
            handle.succeed()
        elif 0.0 < goal.time_allowance < elapsed:
            handle.abort(
                self._codes.timeout, f"{self.name} took longer than the {goal.time_allowance:g} s it may"
            )
        else:
            self._move(handle, left, odometry, now)
        if handle.done:
            self._throttle.ask(0.0, 0.0, now, self.period)

    def stop(self, handle: GoalHandle[MovingGoal, BehaviourFeedback, None], now: int) -> None:
        """Brake; `step` goes on braking until the robot stands."""
        self._throttle.ask(0.0, 0.0, now, self.period)

    def _mistake(self, goal: MovingGoal) -> str:
        """What is wrong with *goal*, in a sentence; mostly nothing."""
        return "" if math.isfinite(self._amount(goal)) else f"{self.name} wants a finite amount"

    def _amount(self, goal: MovingGoal) -> float:
        """How far to go: rad or m, not negative."""
        raise NotImplementedError

    def _way(self, odometry: Odometry) -> float:
        """How far the robot has come since the start: rad or m."""
        start, here = self._from.pose, odometry.pose
        return math.hypot(here.x - start.x, here.y - start.y)

    def _braking(self) -> float:
        """How far the robot still goes when it brakes now: rad or m."""
        return self._throttle.v**2 / (2 * self._throttle.limits.v_down)

    def _velocity(self, goal: MovingGoal, left: float) -> tuple[float, float]:
        """The velocity (m/s, rad/s) to go at with *left* to go until it has to brake."""
        raise NotImplementedError

    def _move(
        self,
        handle: GoalHandle[MovingGoal, BehaviourFeedback, None],
        left: float,
        odometry: Odometry,
        now: int,
    ) -> None:
        v, w = self._velocity(handle.goal, left)
        if not handle.goal.disable_collision_checks:
            try:
                seen = self._see(now)
            except TransformError as fault:
                handle.abort(self._codes.transform, str(fault))
                return
            if not seen:
                self._throttle.ask(0.0, 0.0, now, self.period)
                return
            if self._collides(v, left, odometry):
                handle.abort(
                    self._codes.collision, f"{self.name} would touch something within the next metre"
                )
                return
        self._throttle.ask(v, w, now, self.period)

    def _see(self, now: int) -> bool:
        scan = self._robot.scan()
        if scan is None or now - scan.stamp > _OLD:
            return False
        laser = laser_pose(self._tree, self._costmap.frame, scan)
        self._clearance.update(scan, laser, self._costmap)
        return True

    def _collides(self, v: float, left: float, odometry: Odometry) -> bool:
        pose = odometry.pose
        here = self._clearance.here(pose.x, pose.y)
        if v == 0.0:
            return here < self._robot.base.radius - _ROUNDING
        times = np.arange(1, round(self.parameters.simulate_ahead_time / _STEP) + 1) * _STEP
        along = np.minimum(abs(v) * times, left) * math.copysign(1.0, v)
        x, y = pose.x + math.cos(pose.yaw) * along, pose.y + math.sin(pose.yaw) * along
        if bool((self._clearance.at(x, y) < min(RADIUS, here - _NEARER)).any()):
            return True
        return self._heard(along)

    def _heard(self, along: NDArray[np.float64]) -> bool:
        """Whether a sonar hears something that the robot comes near to, moving *along* (m) its axis."""
        for reading in self._robot.sonars():
            if reading.range == math.inf or math.isnan(reading.range):
                continue
            distance = max(reading.range, reading.range_min)
            sonar = self._tree.lookup("base_footprint", reading.frame).to_pose()
            for side in (-reading.fov / 4, 0.0, reading.fov / 4):
                x = sonar.x + distance * math.cos(sonar.yaw + side)
                y = sonar.y + distance * math.sin(sonar.yaw + side)
                near = np.hypot(x - along, y)
                if bool((near < min(RADIUS, math.hypot(x, y) - _NEARER)).any()):
                    return True
        return False


class SpinBehaviour(MotionBehaviour[SpinGoal]):
    """Turns on the spot at √(2 · rot_acc · left), within the least and the most turning rate."""

    name = "spin"
    _codes = _Codes(
        Nav2ErrorCode.SPIN_TIMEOUT,
        Nav2ErrorCode.SPIN_TF_ERROR,
        Nav2ErrorCode.SPIN_COLLISION_AHEAD,
        Nav2ErrorCode.SPIN_UNKNOWN,
    )

    def _amount(self, goal: SpinGoal) -> float:
        return abs(goal.dist)

    def _way(self, odometry: Odometry) -> float:
        goal = self.current.goal if self.current is not None else SpinGoal()
        turned = wrap_angle(odometry.pose.yaw - self._from.pose.yaw)
        self._from = odometry
        return self._travelled + math.copysign(1.0, goal.dist) * turned

    def _braking(self) -> float:
        return self._throttle.w**2 / (2 * self._throttle.limits.w_down)

    def _velocity(self, goal: SpinGoal, left: float) -> tuple[float, float]:
        figures = self.parameters
        rate = math.sqrt(2 * self._throttle.limits.w_down * left)
        rate = min(max(rate, figures.min_rotational_vel), figures.max_rotational_vel)
        return 0.0, math.copysign(rate, goal.dist)


class BackUpBehaviour(MotionBehaviour[BackUpGoal]):
    """Goes straight back, as fast as the base can at most."""

    name = "backup"
    _codes = _Codes(
        Nav2ErrorCode.BACKUP_TIMEOUT,
        Nav2ErrorCode.BACKUP_TF_ERROR,
        Nav2ErrorCode.BACKUP_COLLISION_AHEAD,
        Nav2ErrorCode.BACKUP_INVALID_INPUT,
    )

    def _mistake(self, goal: BackUpGoal) -> str:
        if not (goal.dist and goal.speed and math.isfinite(goal.dist + goal.speed)):
            return f"backing up {goal.dist:g} m at {goal.speed:g} m/s never ends"
        return ""

    def _amount(self, goal: BackUpGoal) -> float:
        return abs(goal.dist)

    def _velocity(self, goal: BackUpGoal, left: float) -> tuple[float, float]:
        return max(-abs(goal.speed), self._robot.base.v_min), 0.0


class DriveOnHeadingBehaviour(MotionBehaviour[DriveOnHeadingGoal]):
    """Drives straight, forward or, with both figures negative, backward."""

    name = "drive_on_heading"
    _codes = _Codes(
        Nav2ErrorCode.DRIVE_ON_HEADING_TIMEOUT,
        Nav2ErrorCode.DRIVE_ON_HEADING_TF_ERROR,
        Nav2ErrorCode.DRIVE_ON_HEADING_COLLISION_AHEAD,
        Nav2ErrorCode.DRIVE_ON_HEADING_INVALID_INPUT,
    )

    def _mistake(self, goal: DriveOnHeadingGoal) -> str:
        if not (goal.dist * goal.speed > 0.0 and math.isfinite(goal.dist + goal.speed)):
            return f"driving {goal.dist:g} m at {goal.speed:g} m/s: both need the same sign"
        return ""

    def _amount(self, goal: DriveOnHeadingGoal) -> float:
        return abs(goal.dist)

    def _velocity(self, goal: DriveOnHeadingGoal, left: float) -> tuple[float, float]:
        base = self._robot.base
        return min(max(goal.speed, base.v_min), base.v_max), 0.0


class WaitBehaviour(ActionServer[WaitGoal, BehaviourFeedback, None]):
    """Lets time pass; `step` belongs on the schedule at 10 Hz, ``Phase.CONTROLLER``."""

    name = "wait"

    def __init__(self) -> None:
        super().__init__()
        self._until = 0

    def start(
        self,
        handle: GoalHandle[WaitGoal, BehaviourFeedback, None],
        now: int,
        previous: GoalHandle[WaitGoal, BehaviourFeedback, None] | None,
    ) -> None:
        """Begin to wait, unless that would never end."""
        if not math.isfinite(handle.goal.duration):
            handle.abort(Nav2ErrorCode.WAIT_UNKNOWN, f"waiting for {handle.goal.duration} s never ends")
            return
        self._until = now + round(handle.goal.duration * NS_PER_S)

    def work(self, handle: GoalHandle[WaitGoal, BehaviourFeedback, None], now: int) -> None:
        """See whether the time is over."""
        handle.feedback = BehaviourFeedback(max(self._until - now, 0) / NS_PER_S)
        if now >= self._until:
            handle.succeed()
