"""The exercises of the book's chapter 3: bump and go that turns to where it is free."""

import math

import numpy as np

from btcore_robot.control.bumpgo_fsm import OBSTACLE_DISTANCE, SPEED_ANGULAR, BumpGo, State
from btcore_robot.process.process import ProcessContext, ProcessOptions
from btcore_robot.robot import NS_PER_S, LaserScan, Twist2D

DIAGONAL = math.pi / 4
"""Where (rad) a diagonal points, to the left and to the right."""
AHEAD = math.radians(30.0)
"""How far (rad) to either side of a direction the way has to be free to count as clear.

At 1 m this is 0.5 m to either side: the robot's radius and 0.2 m to spare."""
LONGEST_TURN = 2 * math.pi / SPEED_ANGULAR
"""How long (s) a turn by the laser's eye may take: a whole one finds nothing that the next would."""


def reading(scan: LaserScan, angle: float) -> float:
    """The range (m) in the direction *angle* (rad), or in the nearest one that the laser sees."""
    index = round((angle - scan.angle_min) / scan.angle_increment)
    return float(scan.ranges[min(max(index, 0), len(scan.ranges) - 1)])


def clearances(scan: LaserScan) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """How far (m) it is free in each ray's direction, `AHEAD` to either side: shape ``(n,)``.

    No echo is as far as the laser sees; NaN counts as no room at all.
    """
    ranges = np.nan_to_num(scan.ranges.astype(np.float64), nan=0.0, posinf=scan.range_max, neginf=0.0)
    half = max(0, int(AHEAD / scan.angle_increment))
    padded = np.pad(ranges, half, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1)
    found: np.ndarray[tuple[int], np.dtype[np.float64]] = windows.min(axis=1)
    return found


def freest(scan: LaserScan) -> float:
    """The direction (rad) in which it is free for the longest way; of equal ones the one nearest to ahead."""
    free = clearances(scan)
    angles = scan.angles()
    best = np.flatnonzero(free >= free.max() - 1e-9)
    return float(angles[best[np.argmin(np.abs(angles[best]))]])


class Diagonals(BumpGo):
    """Sees ahead and along both diagonals, and turns to the side where there is more room."""

    side = 1.0
    """+1 to the left, -1 to the right."""

    def blocked(self, scan: LaserScan) -> bool:
        """Whether something is too near in one of the three directions."""
        return min(reading(scan, angle) for angle in (-DIAGONAL, 0.0, DIAGONAL)) < OBSTACLE_DISTANCE

    def enter(self, state: State) -> None:
        """Begin *state*; before a turn, choose the side."""
        if state is State.TURN and self.scan is not None:
            left, right = reading(self.scan, DIAGONAL), reading(self.scan, -DIAGONAL)
            self.side = 1.0 if left >= right else -1.0
        super().enter(state)

    def turn(self, scan: LaserScan, elapsed: int) -> tuple[Twist2D, State | None]:
        """Turn to the chosen side."""
        twist, following = super().turn(scan, elapsed)
        return Twist2D(twist.v, self.side * twist.w), following


class OpenLoop(BumpGo):
    """Turns to the freest direction by a time reckoned before: angle over speed."""

    def __init__(self, context: ProcessContext, options: ProcessOptions | None = None) -> None:
        super().__init__(context, options)
        self.angle = 0.0
        """Where to turn to (rad), seen from where the turn began."""

    def enter(self, state: State) -> None:
        """Begin *state*; before a turn, choose the direction."""
        if state is State.TURN and self.scan is not None:
            self.angle = freest(self.scan)
        super().enter(state)

    def turn(self, scan: LaserScan, elapsed: int) -> tuple[Twist2D, State | None]:
        """Turn for as long as the angle takes."""
        needed = abs(self.angle) / SPEED_ANGULAR * NS_PER_S
        return Twist2D(0.0, math.copysign(SPEED_ANGULAR, self.angle)), (
            State.FORWARD if elapsed >= needed else None
        )


class ClosedLoop(OpenLoop):
    """Turns towards the freest direction until it is clear ahead, whatever the wheels make of it.

    Clear is twice the obstacle's distance; where it is so nowhere, a whole turn ends it.
    """

    def turn(self, scan: LaserScan, elapsed: int) -> tuple[Twist2D, State | None]:
        """Turn until the laser shows a free way."""
        middle = int(np.argmin(np.abs(scan.angles())))
        clear = clearances(scan)[middle] >= 2 * OBSTACLE_DISTANCE
        done = bool(clear) or elapsed > LONGEST_TURN * NS_PER_S
        return Twist2D(0.0, math.copysign(SPEED_ANGULAR, self.angle)), State.FORWARD if done else None
