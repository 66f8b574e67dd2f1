"""A model of the robot's battery: how much charge driving uses, and when the battery is empty."""

import math

from btcore_robot.robot import Twist2D

FULL = 100.0
"""The level (percent) of a full battery."""

PER_SPEED = 0.5
"""Charge used by one second of driving at 1 m/s or 1 rad/s (percent).

The BatteryChecker node of *A Concise Introduction to Robot Programming with ROS2* uses the same value.
"""

PER_SECOND = 0.01
"""Charge used by every second, standing or driving (percent)."""


class BatteryModel:
    """The battery's level (percent), its lowest level so far, and the number of recharges."""

    def __init__(self, level: float = FULL) -> None:
        self.level = level
        """The present level (percent)."""
        self.lowest = level
        """The lowest level so far (percent)."""
        self.recharges = 0
        """The number of calls of `fill`."""

    @property
    def is_empty(self) -> bool:
        """Whether the level is 0."""
        return self.level <= 0.0

    def drain(self, command: Twist2D, seconds: float) -> None:
        """Lower the level by `0.5 * sqrt(v² + w²) + 0.01` percent per second.

        Args:
            command: The commanded velocity (v in m/s, w in rad/s).
            seconds: How long the command was in effect (s).
        """
        self.level -= (PER_SPEED * math.hypot(command.v, command.w) + PER_SECOND) * seconds
        if self.level < 0.0:
            self.level = 0.0
        if self.level < self.lowest:
            self.lowest = self.level

    def fill(self) -> None:
        """Set the level to 100 % at once."""
        self.level = FULL
        self.recharges += 1
