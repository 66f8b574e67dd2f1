"""The progress towards a goal over all attempts to reach it: plans, detours and recoveries."""

import math

from btcore_robot.robot import NS_PER_S

PROGRESS = 2.5
"""The distance (m) that counts as progress: the default `obstacle_max_range`.

At each attempt the robot notices a closed door at another distance, up to this range. A smaller value would
take these differences for progress.
"""

PATIENCE = 60.0
"""The time (s) without progress after which a goal fails, in addition to the time for a detour.

It is longer than the recoveries of the default trees, and than people usually stand in a doorway.
"""


class GoalProgress:
    """A check whether a robot comes closer to its goal.

    The robot makes progress when the rest of its path is shorter by `PROGRESS` than ever before, and while
    the rest is at most *tolerance* (m). A detour is longer than the path before. Without progress the robot
    may therefore take `PATIENCE` and the time in which it drives the longest path since the last progress at
    *speed* (m/s). By this rule a robot fails that drives back and forth between two closed doors, but not a
    robot that drives a detour at more than *speed*.
    """

    def __init__(self, tolerance: float, speed: float) -> None:
        self._tolerance = tolerance
        self._speed = speed
        self.begin(0)

    def begin(self, now: int) -> None:
        """Begin a goal at *now* (ns)."""
        self.last = now
        """The time (ns) of the last progress."""
        self.nearest = math.inf
        """The least rest of a path (m) that was progress; inf before the first path."""
        self._longest = 0.0
        self._paused = 0

    def pause(self, duration: int) -> None:
        """Exclude the last *duration* (ns), in which the robot had to stand."""
        self._paused += duration

    def update(self, rest: float, now: int) -> bool:
        """Take the rest of the robot's present path, and return whether the robot has made progress.

        Args:
            rest: The distance along the path to its end (m); 0 without a path.
            now: The time (ns).
        """
        self._longest = max(self._longest, rest)
        is_closer = rest <= max(self.nearest - PROGRESS, self._tolerance) or math.isinf(self.nearest)
        if rest <= 0 or not is_closer:
            return False
        self.last, self.nearest, self._longest, self._paused = now, rest, rest, 0
        return True

    def stalled(self, now: int) -> float:
        """Return the time (s) since the last progress, or 0 if the robot may try further.

        Args:
            now: The time (ns).
        """
        seconds = (now - self.last - self._paused) / NS_PER_S
        return seconds if seconds > PATIENCE + self._longest / self._speed else 0.0
