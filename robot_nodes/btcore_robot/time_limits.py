"""The time limits (s) of readings, transforms and clocks: how old they may be, and how long to wait for them.

All limits of readings are here. A reading is too old when its age is greater than its limit. The
parameters `scan_timeout` and `odometry_timeout` of the controller replace `MAX_SCAN_AGE_S` and
`MAX_ODOMETRY_AGE_S` in the navigation, and the key `timeout` of a topic in the description of a ROS 2 robot
replaces `MAX_TOPIC_SILENCE_S`.
"""

from typing import Protocol

from btcore.clock import NS_PER_S

MAX_ODOMETRY_AGE_S = 0.2
"""The greatest age of the odometry while the navigation drives.

Within this time a robot at 0.3 m/s drives 6 cm that it does not notice. Together with a period of a
behaviour (0.1 s) the robot is commanded to stop within 0.3 s. The limit is two periods of an odometry at
10 Hz, the lowest usual rate.
"""
MAX_SCAN_AGE_S = 0.5
"""The greatest age of a scan while the navigation drives: at 0.3 m/s a person may have come 0.5 m nearer.

It is two and a half periods of a laser at 5 Hz, the lowest usual rate.
"""
MAX_LASER_FRAME_AGE_S = 0.5
"""The greatest age of the laser's pose on the robot when a scan is taken.

A laser on a moving part is usually published at 10 Hz or more; a fixed laser always has a pose.
"""
MAX_OUTAGE_S = 60.0
"""The time without usable readings after which the goals that wait for them fail.

A driver that is started again, or a network that is restored, mostly takes less than a minute.
"""
MAX_BOOK_SCAN_AGE_S = 1.0
"""The greatest age of a scan in the book's programs, bump and go and VFF; the value is the book's."""
MAX_SCAN_GAP_S = 0.5
"""The greatest time between two scans whose beams are compared to notice that the robot was kidnapped.

After a longer time, people and the robot itself may have changed most of the beams.
"""
MAP_TRANSFORM_VALIDITY_S = 1.0
"""The time after a scan for which the pose of `odom` in `map` is valid, as in nav2_amcl and slam_toolbox."""
MAX_TOPIC_SILENCE_S = 1.0
"""The time without a message on a ROS topic of a required sensor after which the run ends."""
MAX_SENSOR_WAIT_S = 2.0
"""The real time without a message after which a simulation in lockstep no longer waits for a sensor."""
MAX_CLOCK_STANDSTILL_S = 0.3
"""The real time in which `/clock` has to advance; otherwise the robot is commanded to stop.

Commands expire by the same clock, so that a command would remain valid while the clock stands still.
"""
MAX_CLOCK_SILENCE_S = 3.0
"""The real time in which `/clock` has to advance; otherwise the run ends."""
MAX_FIRST_PICTURE_WAIT_S = 3.0
"""The time after the first use of the camera after which a warning reports that there is no picture."""
MAX_DEPTH_OFFSET_S = 0.1
"""The greatest difference between the stamps of a picture and of its depth: three periods at 30 Hz."""


class Stamped(Protocol):
    """A reading with the time of its measurement."""

    @property
    def stamp(self) -> int:
        """The time (ns) of the measurement."""


def is_stale(reading: Stamped | None, now: int, limit: float) -> bool:
    """Return whether a reading is missing or too old.

    Args:
        reading: The newest reading; None before the first reading.
        now: The present time (ns).
        limit: The greatest age (s).
    """
    return reading is None or now - reading.stamp > limit * NS_PER_S
