import threading

import numpy as np
import pytest

from robot_nodes.robot import (
    CMD_VEL,
    BaseFacts,
    HeadFacts,
    HeadPosition,
    LaserFacts,
    LaserScan,
    Odometry,
    Picture,
    Pose2D,
    Robot,
    Twist2D,
)


class SteppedClock:
    """Simulated time that jumps to the moment waited for."""

    def __init__(self) -> None:
        self.time = 0

    def now(self) -> int:
        return self.time

    def wait_until(self, deadline: int, wake: threading.Event) -> bool:
        if not wake.is_set():
            self.time = max(self.time, deadline)
        return wake.is_set()


class RecordingRobot(Robot):
    """A robot that notes what it is told, and sees what it is given."""

    def __init__(self) -> None:
        self._clock = SteppedClock()
        self.commands: list[tuple[float, float]] = []
        self.seen: LaserScan | None = None

    def see(self, *ranges: float, angle_min: float = 0.0, angle_increment: float = 0.1) -> None:
        """Have a scan of these ranges (m) now."""
        facts = self.laser
        self.seen = LaserScan(
            np.array(ranges, dtype=np.float32),
            self._clock.time,
            angle_min,
            angle_increment,
            facts.range_min,
            facts.range_max,
            facts.frame,
        )

    @property
    def clock(self) -> SteppedClock:
        return self._clock

    @property
    def base(self) -> BaseFacts:
        return BaseFacts(-0.2, 1.0, 2.09, 1.0, 2.09, 0.25, 0.27)

    @property
    def laser(self) -> LaserFacts:
        return LaserFacts(1, 0.0, 0.1, 0.05, 25.0, 10.0, 0.0, "base_laser_link")

    @property
    def neck(self) -> HeadFacts | None:
        return None

    def drive(self, v: float, w: float, *, priority: int = CMD_VEL) -> None:
        self.commands.append((v, w))

    def stop(self) -> None:
        self.drive(0.0, 0.0)

    def scan(self) -> LaserScan | None:
        return self.seen

    def odometry(self) -> Odometry:
        return Odometry(Pose2D(0.0, 0.0, 0.0), Twist2D(0.0, 0.0), self._clock.time)

    def look(self, pan: float, tilt: float) -> None:
        pass

    def head(self) -> HeadPosition | None:
        return None

    def camera(self) -> Picture | None:
        return None


@pytest.fixture
def robot() -> RecordingRobot:
    return RecordingRobot()
