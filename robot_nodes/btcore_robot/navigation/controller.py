"""FollowPath: drives the robot along a path, round what stands in its way, or stops before it.

The law is a pure pursuit whose speed is regulated: by the curvature of its arc, by how much free way that arc
has in the newest scan, by how near obstacles are beside it, and by the way left. What blocks the path is
passed by a detour, searched anew as long as it blocks. Collisions are judged by the distance to obstacles.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from btcore_robot.navigation.action import ActionServer, GoalHandle
from btcore_robot.navigation.checkers import GoalChecker, ProgressChecker
from btcore_robot.navigation.clearance import ClearanceGrid, laser_pose
from btcore_robot.navigation.costmap import LocalCostmap
from btcore_robot.navigation.detour import detour
from btcore_robot.navigation.error_codes import Nav2ErrorCode
from btcore_robot.navigation.parameters import ControllerParameters
from btcore_robot.navigation.path import NavPath
from btcore_robot.navigation.pure_pursuit import Carrot, PurePursuit
from btcore_robot.navigation.velocity_smoother import Limits, VelocitySmoother
from btcore_robot.rigid_transform import Transform, wrap_angle
from btcore_robot.robot import NS_PER_S, Pose2D, Robot
from btcore_robot.transforms import TransformError, TransformTree

RADIUS = 0.30
"""How far (m) the robot's middle stays from obstacles: the hull's 0.27 m and something for errors."""

_ROOMY = 0.45  # m of clearance from which on speed isn't cut
_CREEP = 0.4  # share of the full speed right beside an obstacle
_STEP = 0.05  # m between the places of an arc or a path that are judged
_LOOK = 1.3  # m of the path that must be free, or a detour is looked for
_RETURN = 3.0  # m of the path on which a detour may come back to it, as far as is seen
_BLOCKED = 0.26  # m of clearance under which a path counts as blocked: planners leave RADIUS, maps err
_THIN = 2  # of so many places on the path one is looked at for an end of a detour
_BEYOND = 0.3  # m past what blocks the path at which a detour comes back to it
_OFF = 0.3  # m beside the path from which on the way back to it is searched, too
_SPARE = 0.02  # m that a detour keeps more than it has to
_MARGIN = 0.08  # m before the nearest place an arc may lead to at which the robot stops
_STUCK = 0.05, 0.15, 1.5  # m or rad within s; under that a way is searched though the path looks free
_ON = 0.6  # m along the path to which the way is searched then
_AGAIN = NS_PER_S // 3  # ns between two searches for a detour
_ALIGNED = 0.15  # rad: turning on the spot ends here
_STANDS = 0.02  # m/s under which a speed isn't worth driving
_CALM = 0.7  # share of the turning acceleration that turns on the spot are planned with


@dataclass(frozen=True, slots=True)
class FollowGoal:
    """A *path* to drive along, to its end. The ids name Nav2's plug-ins; there is one of each here."""

    path: NavPath
    controller_id: str = ""
    goal_checker_id: str = ""
    progress_checker_id: str = ""
    path_handler_id: str = ""


@dataclass(frozen=True, slots=True)
class FollowFeedback:
    """The way left (m), the *speed* asked for (m/s), and how well the robot keeps to the path.

    *position_error* (m) is + to the left of the path, - to its right; *heading_error* (rad) the same.
    """

    distance_to_goal: float = 0.0
    speed: float = 0.0
    position_error: float = 0.0
    heading_error: float = 0.0


class ControllerServer(ActionServer[FollowGoal, FollowFeedback, None]):
    """Serves FollowGoals; `step` belongs on the schedule at ``controller_frequency``, ``Phase.CONTROLLER``.

    While *hold* says so, or the newest scan is too old, the robot stands and nothing fails.
    """

    name = "follow_path"

    def __init__(
        self,
        robot: Robot,
        tree: TransformTree,
        local_costmap: LocalCostmap,
        parameters: ControllerParameters | None = None,
        *,
        hold: Callable[[], bool] | None = None,
    ) -> None:
        super().__init__()
        self.parameters = figures = parameters or ControllerParameters()
        self.period = 1.0 / figures.controller_frequency
        """The seconds between two steps."""
        self.clearance = ClearanceGrid()
        """How far obstacles are, by the newest scan; for whoever draws it."""
        self._robot = robot
        self._tree = tree
        self._costmap = local_costmap
        self._hold = hold
        self._throttle = VelocitySmoother(
            robot,
            Limits(
                v=figures.max_vel_x,
                w=figures.max_vel_theta,
                v_up=figures.acc_lim_x,
                v_down=abs(figures.decel_lim_x),
                w_up=figures.acc_lim_theta,
                w_down=abs(figures.decel_lim_theta),
            ).within(robot.base),
        )
        self._goals = GoalChecker(figures.xy_goal_tolerance, figures.yaw_goal_tolerance, figures.stateful)
        self._progress = ProgressChecker(
            figures.required_movement_radius,
            figures.required_movement_angle,
            figures.movement_time_allowance,
        )
        self._creeps = ProgressChecker(*_STUCK)
        self._pursuit: PurePursuit | None = None
        self._round: PurePursuit | None = None
        self._keep = 0.0
        self._searched = 0
        self._judged: int | None = None
        self._turning = 0.0
        self._able = 0
        self._last = 0

    def step(self, now: int) -> None:
        """One period; a robot that has nothing left to do comes to rest."""
        super().step(now)
        if not self.busy:
            self._throttle.ease(now, self.period)

    def start(
        self,
        handle: GoalHandle[FollowGoal, FollowFeedback, None],
        now: int,
        previous: GoalHandle[FollowGoal, FollowFeedback, None] | None,
    ) -> None:
        """Take the path; with a *previous* goal the robot drives on and what was checked counts on."""
        path = handle.goal.path
        if not len(path) or not np.isfinite(path.poses).all():
            handle.abort(
                Nav2ErrorCode.INVALID_PATH, "the path has no poses" if not len(path) else _NOT_FINITE
            )
            if previous is not None:
                self._throttle.halt(now)
            return
        old = previous.goal.path if previous is not None else None
        self._pursuit = PurePursuit(path.points)
        if old is None:
            self._throttle.wake(now)
            self._progress.reset()
            self._creeps.reset()
            self._able = self._last = now
            self._turning = 0.0
        if old is None or old.frame != path.frame or old.goal != path.goal:
            self._goals.reset()
        self._round = None
        self._judged = None

    def work(self, handle: GoalHandle[FollowGoal, FollowFeedback, None], now: int) -> None:
        """Drive on for one period."""
        passed, self._last = now - self._last, now
        path, pursuit = handle.goal.path, self._pursuit
        goal = path.goal
        assert pursuit is not None
        assert goal is not None
        try:
            frame = self._costmap.frame
            to_path = Transform() if path.frame == frame else self._tree.lookup(path.frame, frame)
            self._see(now)
        except TransformError as fault:
            self._fail(handle, now, Nav2ErrorCode.FOLLOW_PATH_TF_ERROR, str(fault))
            return
        odometry = self._robot.odometry().pose
        pose = _moved(to_path, odometry)
        pursuit.locate(pose)
        turned = 0.0 if pursuit.heading is None else wrap_angle(pose.yaw - pursuit.heading)
        handle.feedback = FollowFeedback(pursuit.left, self._throttle.v, pursuit.aside, turned)
        if self._blind(now) or (self._hold is not None and self._hold()):
            self._progress.pause(passed)
            self._creeps.pause(passed)
            self._able += passed
            self._throttle.ask(0.0, 0.0, now, self.period)
            return
        if self._goals.reached(pose, goal):
            handle.succeed()
            self._throttle.ask(0.0, 0.0, now, self.period)
            return
        if not self._progress.check(pose, now):
            seconds = self.parameters.movement_time_allowance
            handle.abort(
                Nav2ErrorCode.FAILED_TO_MAKE_PROGRESS, f"the robot has made no progress for {seconds:g} s"
            )
            self._throttle.ask(0.0, 0.0, now, self.period)
            return
        if self._goals.arrived(pose, goal):
            self._able = now
            self._turn(wrap_angle(goal.yaw - pose.yaw), now)
            return
        self._keep_round(pursuit, to_path, odometry, now)
        if self._drive(pursuit, pose, odometry, now):
            self._able = now
        else:
            self._fail(
                handle,
                now,
                Nav2ErrorCode.NO_VALID_CONTROL,
                "there is no way on that keeps clear of obstacles",
            )

    def stop(self, handle: GoalHandle[FollowGoal, FollowFeedback, None], now: int) -> None:
        """Brake; `step` goes on braking until the robot stands."""
        self._throttle.ask(0.0, 0.0, now, self.period)

    def _see(self, now: int) -> None:
        scan = self._robot.scan()
        if scan is not None and scan.stamp != self.clearance.stamp:
            laser = laser_pose(self._tree, self._costmap.frame, scan)
            self.clearance.update(scan, laser, self._costmap)

    def _blind(self, now: int) -> bool:
        stamp = self.clearance.stamp
        return stamp is None or now - stamp > self.parameters.scan_timeout * NS_PER_S

    def _fail(
        self,
        handle: GoalHandle[FollowGoal, FollowFeedback, None],
        now: int,
        code: Nav2ErrorCode,
        message: str,
    ) -> None:
        """Stand, and give up when there has been no way to move for longer than is tolerated."""
        self._throttle.ask(0.0, 0.0, now, self.period)
        tolerance = self.parameters.failure_tolerance
        if tolerance == 0.0:
            handle.abort(code, message)
        elif tolerance > 0.0 and now - self._able > tolerance * NS_PER_S:
            if code is Nav2ErrorCode.NO_VALID_CONTROL:
                code = Nav2ErrorCode.PATIENCE_EXCEEDED
            handle.abort(code, f"{message}, for {tolerance:g} s")

    def _keep_round(self, pursuit: PurePursuit, to_path: Transform, odometry: Pose2D, now: int) -> None:
        """Look once a scan whether the way is blocked; begin, keep, renew or end a detour."""
        if self._judged == self.clearance.stamp:
            return
        self._judged = self.clearance.stamp
        ahead = _carried(to_path.inverse(), pursuit.ahead(_RETURN, _STEP))
        room = self.clearance.at(ahead[:, 0], ahead[:, 1])
        blocked = np.flatnonzero(room[: int(_LOOK / _STEP)] < _BLOCKED)
        stuck = not self._creeps.check(odometry, now)
        if self._round is not None:
            self._round.locate(odometry)
        kept = self._round is not None and (self._round.passed or 0.0) < self._keep
        if not len(blocked) and pursuit.off < _OFF and not stuck and not kept:
            self._round = None
            return
        if self._round is not None and not stuck:
            way = self._round.ahead(_LOOK, _STEP)
            free = self.clearance.at(way[:, 0], way[:, 1])
            if self._round.off < _OFF and (free >= min(_BLOCKED, float(free[0]) - _SPARE)).all():
                return
        if now - self._searched < _AGAIN:
            return
        self._searched = now
        past = int(blocked[-1]) if len(blocked) else min(int(_ON / _STEP), len(ahead) - 1) if stuck else 0
        returns = _returns(room, past)
        last = None if self._round is None else self._round.ahead(math.inf, _STEP)
        found = detour(self.clearance, odometry, ahead[returns], RADIUS + _SPARE, last) if returns else None
        if found is None:
            self._round = None
            return
        chosen, way = found
        length = float(np.hypot(*np.diff(way, axis=0).T).sum())
        self._round = PurePursuit(np.concatenate((way, ahead[returns[chosen] :])))
        self._keep = 0.0 if len(blocked) else length

    def _drive(self, pursuit: PurePursuit, pose: Pose2D, odometry: Pose2D, now: int) -> bool:
        """Ask for the velocity towards the carrot; whether there is any way to move."""
        figures = self.parameters
        here = self.clearance.here(odometry.x, odometry.y)
        reach = min(max(here, figures.min_lookahead_dist), figures.lookahead_dist)
        if self._round is not None:
            self._round.locate(odometry)
            carrot = self._round.carrot(odometry, min(reach, 0.4))
        else:
            carrot = pursuit.carrot(pose, reach)
        free = self._free(carrot, odometry, here)
        speed = min(figures.max_vel_x * free[1], (free[0] - _MARGIN) / figures.time_to_collision)
        ahead = abs(carrot.angle)
        sharp = _ALIGNED if self._turning or speed < _STANDS else figures.rotate_to_heading_min_angle
        if ahead > sharp:
            self._turn(carrot.angle, now)
            return True
        self._turning = 0.0
        if speed < _STANDS:
            return False
        left = pursuit.left if self._round is None else math.inf
        if left < figures.approach_velocity_scaling_dist:
            share = left / figures.approach_velocity_scaling_dist
            speed = min(speed, max(figures.max_vel_x * share, figures.min_approach_linear_velocity))
        curvature = carrot.curvature
        if abs(curvature) * speed > figures.max_vel_theta:
            speed = figures.max_vel_theta / abs(curvature)
        turn = curvature * self._throttle.speed(speed, self.period)
        self._throttle.ask(speed, turn, now, self.period)
        return True

    def _free(self, carrot: Carrot, odometry: Pose2D, here: float) -> tuple[float, float]:
        """How far (m) the arc to the carrot is free, and the share of the speed that its tightness allows."""
        curvature = carrot.curvature
        along = np.arange(1, 13) * _STEP
        turned = odometry.yaw + curvature * along / 2
        chord = along * np.sinc(curvature * along / (2 * math.pi))
        room = self.clearance.at(odometry.x + chord * np.cos(turned), odometry.y + chord * np.sin(turned))
        # Whoever is too near already may move, but not nearer still.
        tight = room < min(RADIUS, here - 0.01)
        free = float(along[int(tight.argmax())]) - _STEP if tight.any() else math.inf
        narrowest = float(room[:6].min())
        share = _CREEP + (1 - _CREEP) * (narrowest - RADIUS) / (_ROOMY - RADIUS)
        return free, min(max(share, _CREEP), 1.0)

    def _turn(self, angle: float, now: int) -> None:
        """Turn on the spot by *angle* (rad), slowing down in time; round turns keep their direction."""
        if self._turning and abs(angle) > 2.5:
            angle = math.copysign(angle, self._turning)
        self._turning = math.copysign(1.0, angle)
        limits = self._throttle.limits
        rate = math.sqrt(2 * _CALM * limits.w_down * abs(angle))
        self._throttle.ask(0.0, math.copysign(max(rate, 0.05), angle), now, self.period)


def _returns(room: NDArray[np.float32], past: int) -> list[int]:
    """The places of a path, the nearest first, at which a detour round what blocks it up to *past* may end.

    *room* is the clearance at each place. A bit further on is better where there is room all the way.
    """
    free = room >= RADIUS + _SPARE
    beyond = int(_BEYOND / _STEP)
    places = np.flatnonzero(free[past:])[::_THIN] + past
    chosen = [min(place + beyond, len(free) - 1) for place in places.tolist()]
    fits = [free[place : end + 1].all() for place, end in zip(places, chosen, strict=True)]
    return [end if fit else place for place, end, fit in zip(places.tolist(), chosen, fits, strict=True)]


_NOT_FINITE = "a pose of the path is not finite"


def _moved(transform: Transform, pose: Pose2D) -> Pose2D:
    """*pose* in the frame that *transform*, one on the floor, leads to."""
    turn = transform.yaw
    cos, sin = math.cos(turn), math.sin(turn)
    x, y, _ = transform.position
    yaw = wrap_angle(turn + pose.yaw)
    return Pose2D(x + cos * pose.x - sin * pose.y, y + sin * pose.x + cos * pose.y, yaw)


def _carried(transform: Transform, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """*points* (m, shape ``(n, 2)``) in the frame that *transform*, one on the floor, leads to."""
    yaw = transform.yaw
    cos, sin = math.cos(yaw), math.sin(yaw)
    x, y, _ = transform.position
    east = x + cos * points[:, 0] - sin * points[:, 1]
    north = y + sin * points[:, 0] + cos * points[:, 1]
    return np.stack((east, north), axis=1)
