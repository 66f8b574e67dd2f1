"""The battery in the body: what driving takes from it, and when it is empty."""

import math

from btcore_robot.robot import Twist2D

FULL = 100.0
"""The level (percent) of a full battery."""

PER_SPEED = 0.5
"""What a second at 1 m/s or 1 rad/s takes (percent); the book's BatteryChecker has the same figure."""

PER_SECOND = 0.01
"""What a second takes that is spent standing (percent)."""


class BatteryModel:
    """A level from 100 down to 0, the lowest that there was, and how often it was filled."""

    def __init__(self, level: float = FULL) -> None:
        self.level = level
        """How full it is now (percent)."""
        self.lowest = level
        """How full it was when it was emptiest (percent)."""
        self.recharges = 0
        """How often it has been filled."""

    @property
    def empty(self) -> bool:
        """Whether nothing is left."""
        return self.level <= 0.0

    def drain(self, asked: Twist2D, seconds: float) -> None:
        """Take ``0.5 * sqrt(v² + w²) + 0.01`` a second for *seconds* (s) of the velocity *asked* for."""
        self.level -= (PER_SPEED * math.hypot(asked.v, asked.w) + PER_SECOND) * seconds
        if self.level < 0.0:
            self.level = 0.0
        if self.level < self.lowest:
            self.lowest = self.level

    def fill(self) -> None:
        """Fill it at once."""
        self.level = FULL
        self.recharges += 1
