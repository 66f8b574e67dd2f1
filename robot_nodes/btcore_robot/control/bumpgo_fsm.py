"""Bump and go by a state machine, and variants that turn to free space.

The state machine is from chapter 3 of the book *A Concise Introduction to Robot Programming with ROS2*, the
variants are the chapter's exercises.
"""

import math
from collections.abc import Callable
from enum import Enum

import numpy as np

from btcore.clock import NS_PER_S
from btcore_robot.components.component import Component, ComponentContext, ComponentOptions
from btcore_robot.robot import LaserScan, Twist2D
from btcore_robot.time_limits import MAX_BOOK_SCAN_AGE_S, is_stale

__all__ = ["BumpGo", "BumpGoState", "ClosedLoop", "Diagonals", "OpenLoop"]

PERIOD_S = 0.05
"""The period (s) of the control cycle: 20 Hz."""
SPEED_LINEAR = 0.3
"""The speed (m/s) forward and backward."""
SPEED_ANGULAR = 0.3
"""The angular speed (rad/s) of a turn."""
OBSTACLE_DISTANCE = 1.0
"""The distance (m) at the middle beam below which there is an obstacle."""
BACKING_TIME = 2 * NS_PER_S
TURNING_TIME = 2 * NS_PER_S

DIAGONAL = math.pi / 4
"""The angle (rad) of a diagonal, to the left and to the right."""
AHEAD = math.radians(30.0)
"""A direction is free if there is no obstacle within this angle (rad) to either side.

At 1 m this is 0.5 m to each side: the robot's radius and 0.2 m of margin.
"""
HALF_WIDTH = 0.4
"""Half the width (m) of the lane that `OpenLoop` and `ClosedLoop` keep free: Tiago's radius and 0.13 m."""
MAX_TURN_S = 2 * math.pi / SPEED_ANGULAR
"""The maximum duration (s) of a turn in `ClosedLoop`: after a full turn the laser has seen all directions."""


class BumpGoState(Enum):
    """A state of the state machine of `BumpGo`."""

    FORWARD = "forward"
    BACK = "back"
    TURN = "turn"
    STOP = "stop"


StateHandler = Callable[[LaserScan, int], tuple[Twist2D, BumpGoState | None]]
"""A function that handles a state in each control cycle.

Its arguments are the newest scan and the time (ns) since the state began. It returns the velocity and the
next state. The next state is None if the state does not change.
"""


class BumpGo(Component):
    """Drives forward up to an obstacle 1 m ahead; then back for 2 s, turns left for 2 s, and forward again.

    The robot stops when the newest scan is older than 1 s, until there is a newer scan. The component
    subscribes to `input_scan` and publishes on `output_vel`, starting with the first scan. In the cycle
    of a state change the velocity is still the old state's velocity. In the state FORWARD an obstacle takes
    precedence over an old scan.
    """

    def __init__(self, context: ComponentContext, options: ComponentOptions | None = None) -> None:
        super().__init__("bump_go", context, options)
        self.velocities = self.create_publisher("output_vel", Twist2D)
        self.create_subscription("input_scan", LaserScan, self.on_scan)
        self.create_timer(PERIOD_S, self.control_cycle)
        self.state = BumpGoState.FORWARD
        self.since = self.now()
        """The time (ns) at which the current state began."""
        self.changes = 0
        """The number of state changes."""
        self.scan: LaserScan | None = None
        self._handlers: dict[BumpGoState, StateHandler] = {
            BumpGoState.FORWARD: self.forward,
            BumpGoState.BACK: self.back,
            BumpGoState.TURN: self.turn,
            BumpGoState.STOP: self.stop,
        }

    def on_scan(self, scan: LaserScan) -> None:
        """Store the newest scan."""
        self.scan = scan

    def control_cycle(self) -> None:
        """Publish the velocity of the current state, then change the state if necessary."""
        scan = self.scan
        if scan is None:
            return
        twist, next_state = self._handlers[self.state](scan, self.now() - self.since)
        self.velocities.publish(twist)
        if next_state is not None:
            self.enter(next_state)

    def enter(self, state: BumpGoState) -> None:
        """Change to *state*."""
        self.info(f"{self.state.value} -> {state.value}")
        self.state = state
        self.since = self.now()
        self.changes += 1

    def forward(self, scan: LaserScan, elapsed: int) -> tuple[Twist2D, BumpGoState | None]:
        """Return the velocity forward and the next state.

        Args:
            scan: The newest scan.
            elapsed: The time (ns) since the state began; not used in this state.

        Returns:
            The velocity, and the next state: BACK at an obstacle, otherwise STOP without a recent scan.
            None if the state does not change.
        """
        next_state = None
        if self.is_stale(scan):
            next_state = BumpGoState.STOP
        # Checked last: an obstacle takes precedence over an old scan.
        if self.is_blocked(scan):
            next_state = BumpGoState.BACK
        return Twist2D(SPEED_LINEAR, 0.0), next_state

    def back(self, scan: LaserScan, elapsed: int) -> tuple[Twist2D, BumpGoState | None]:
        """Return the velocity backwards and the next state.

        Args:
            scan: The newest scan; not used in this state.
            elapsed: The time (ns) since the state began.

        Returns:
            The velocity, and the next state: TURN after 2 s. None if the state does not change.
        """
        # Strictly more than the time, as in the book.
        return Twist2D(-SPEED_LINEAR, 0.0), BumpGoState.TURN if elapsed > BACKING_TIME else None

    def turn(self, scan: LaserScan, elapsed: int) -> tuple[Twist2D, BumpGoState | None]:
        """Return the velocity of a turn to the left and the next state.

        Args:
            scan: The newest scan; not used here, but by `ClosedLoop`.
            elapsed: The time (ns) since the state began.

        Returns:
            The velocity, and the next state: FORWARD after 2 s. None if the state does not change.
        """
        return Twist2D(0.0, SPEED_ANGULAR), BumpGoState.FORWARD if elapsed > TURNING_TIME else None

    def stop(self, scan: LaserScan, elapsed: int) -> tuple[Twist2D, BumpGoState | None]:
        """Return the velocity 0 and the next state.

        Args:
            scan: The newest scan.
            elapsed: The time (ns) since the state began; not used in this state.

        Returns:
            The velocity, and the next state: FORWARD when the scan is recent. None if the state does not
            change.
        """
        return Twist2D(0.0, 0.0), None if self.is_stale(scan) else BumpGoState.FORWARD

    def is_stale(self, scan: LaserScan) -> bool:
        """Return whether the newest scan is too old to drive by."""
        return is_stale(scan, self.now(), MAX_BOOK_SCAN_AGE_S)

    def is_blocked(self, scan: LaserScan) -> bool:
        """Return whether there is an obstacle at the middle beam."""
        return bool(scan.ranges[len(scan.ranges) // 2] < OBSTACLE_DISTANCE)


def range_at(scan: LaserScan, angle: float) -> float:
    """Return the range (m) in a direction.

    Args:
        scan: The scan to read.
        angle: The direction (rad) in the laser's frame. Outside the laser's field of view the first or the
            last ray is used.

    Returns:
        The range as in the scan: `+inf` without an echo, `-inf` for an echo that is too near.
    """
    index = round((angle - scan.angle_min) / scan.angle_increment)
    return float(scan.ranges[min(max(index, 0), len(scan.ranges) - 1)])


def clearances(scan: LaserScan) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the free distance (m) in the direction of each ray, within `AHEAD` to each side: shape `(n,)`.

    A ray without an echo is free up to the laser's maximum range; NaN counts as 0.
    """
    ranges = np.nan_to_num(scan.ranges.astype(np.float64), nan=0.0, posinf=scan.range_max, neginf=0.0)
    half = max(0, int(AHEAD / scan.angle_increment))
    padded = np.pad(ranges, half, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1)
    clear: np.ndarray[tuple[int], np.dtype[np.float64]] = windows.min(axis=1)
    return clear


def clearance_ahead(scan: LaserScan) -> float:
    """Return the free distance (m) straight ahead, within `AHEAD` to each side."""
    return float(clearances(scan)[np.argmin(np.abs(scan.angles()))])


def freest_direction(scan: LaserScan) -> float:
    """Return the direction (rad) with the most free space; if several are equal, the nearest to 0."""
    free = clearances(scan)
    angles = scan.angles()
    freest = np.flatnonzero(free >= free.max() - 1e-9)
    return float(angles[freest[np.argmin(np.abs(angles[freest]))]])


def is_lane_blocked(scan: LaserScan, length: float = OBSTACLE_DISTANCE) -> bool:
    """Return whether an obstacle is in the lane ahead, *length* (m) long and twice `HALF_WIDTH` wide.

    An echo that is too near for the laser is an obstacle.
    """
    angles = scan.angles()
    ranges = np.where(np.isneginf(scan.ranges), 0.0, scan.ranges)
    # Rays without an echo are infinite or NaN: their products with a sine or cosine are no distances.
    near = ranges <= math.hypot(length, HALF_WIDTH)
    ahead, aside = ranges[near] * np.cos(angles[near]), ranges[near] * np.sin(angles[near])
    in_lane = (ahead >= 0.0) & (ahead < length) & (np.abs(aside) < HALF_WIDTH)
    return bool(in_lane.any())


def is_free_ahead(scan: LaserScan, clear: float) -> bool:
    """Return whether *clear* metres are free within `AHEAD` to each side, and the lane of the robot is free.

    Near the robot, the lane is wider than the directions within `AHEAD`.
    """
    return clearance_ahead(scan) >= clear and not is_lane_blocked(scan, min(clear, OBSTACLE_DISTANCE))


class Diagonals(BumpGo):
    """Check the middle beam and both diagonals for obstacles, and turn to the side with more room."""

    side = 1.0
    """+1 for a turn to the left, -1 for a turn to the right."""

    def is_blocked(self, scan: LaserScan) -> bool:
        """Return whether there is an obstacle in one of the three directions."""
        return min(range_at(scan, angle) for angle in (-DIAGONAL, 0.0, DIAGONAL)) < OBSTACLE_DISTANCE

    def enter(self, state: BumpGoState) -> None:
        """Change to *state*; before a turn, choose the side."""
        if state is BumpGoState.TURN and self.scan is not None:
            left, right = range_at(self.scan, DIAGONAL), range_at(self.scan, -DIAGONAL)
            self.side = 1.0 if left >= right else -1.0
        super().enter(state)

    def turn(self, scan: LaserScan, elapsed: int) -> tuple[Twist2D, BumpGoState | None]:
        """Return the velocity of a turn to the chosen side; the next state after 2 s is FORWARD."""
        twist, next_state = super().turn(scan, elapsed)
        return Twist2D(twist.v, self.side * twist.w), next_state


class OpenLoop(BumpGo):
    """Turns to the freest direction for a time that is computed before the turn: angle divided by speed.

    The freest direction often leads past corners that the middle beam misses. Therefore an obstacle is
    anything in the lane ahead that is as wide as the robot.
    """

    def __init__(self, context: ComponentContext, options: ComponentOptions | None = None) -> None:
        super().__init__(context, options)
        self.angle = 0.0
        """The angle (rad) to turn by, from the direction in which the turn starts."""

    def is_blocked(self, scan: LaserScan) -> bool:
        """Return whether there is an obstacle in the lane ahead."""
        return is_lane_blocked(scan)

    def enter(self, state: BumpGoState) -> None:
        """Change to *state*; before a turn, choose the direction."""
        if state is BumpGoState.TURN and self.scan is not None:
            self.angle = freest_direction(self.scan)
        super().enter(state)

    def turn(self, scan: LaserScan, elapsed: int) -> tuple[Twist2D, BumpGoState | None]:
        """Return the velocity of the turn; the next state is FORWARD after the time for the angle."""
        needed = abs(self.angle) / SPEED_ANGULAR * NS_PER_S
        return Twist2D(0.0, math.copysign(SPEED_ANGULAR, self.angle)), (
            BumpGoState.FORWARD if elapsed >= needed else None
        )


class ClosedLoop(OpenLoop):
    """Turns towards the freest direction until the laser shows free space ahead, even if the wheels slip.

    Space is free when it is clear for twice the obstacle distance. Without free space a full turn ends the
    state.
    """

    def turn(self, scan: LaserScan, elapsed: int) -> tuple[Twist2D, BumpGoState | None]:
        """Return the velocity of the turn; the next state is FORWARD when there is free space ahead."""
        done = is_free_ahead(scan, 2 * OBSTACLE_DISTANCE) or elapsed > MAX_TURN_S * NS_PER_S
        return Twist2D(0.0, math.copysign(SPEED_ANGULAR, self.angle)), BumpGoState.FORWARD if done else None
