"""A watch over the sensors that the navigation needs: odometry, scans, and the laser's pose on the robot."""

import logging
from dataclasses import dataclass

from btcore.clock import NS_PER_S
from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_robot.robot import BASE_FRAME, LaserScan, Robot
from btcore_robot.time_limits import (
    MAX_LASER_FRAME_AGE_S,
    MAX_ODOMETRY_AGE_S,
    MAX_OUTAGE_S,
    MAX_SCAN_AGE_S,
    is_stale,
)
from btcore_robot.transforms import ExtrapolationError, TransformError, TransformTree

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Outage:
    """A period without usable readings of a sensor.

    Attributes:
        sensor: The kind of the missing readings, for messages: "odometry".
        since: The stamp (ns) of the last usable reading.
        detail: The reason if it is known, for messages; otherwise "".
        is_transform: Whether the readings are poses of a frame; the odometry is the pose of the base.
    """

    sensor: str
    since: int
    detail: str = ""
    is_transform: bool = True

    def seconds(self, now: int) -> float:
        """Return the duration (s) of the outage until *now* (ns)."""
        return (now - self.since) / NS_PER_S

    def message(self, now: int) -> str:
        """Return a sentence about the outage at *now* (ns)."""
        seconds = self.seconds(now)
        duration = f"{seconds:.1f}" if seconds < 10.0 else f"{seconds:.0f}"
        detail = f" ({self.detail})" if self.detail else ""
        return f"no {self.sensor} for {duration} s{detail}: the robot stands until it arrives again"

    def error_code(self, tf_error: Nav2ErrorCode) -> Nav2ErrorCode:
        """Return the error code of goals that fail by the outage; *tf_error* is that of missing poses."""
        # CONTROLLER_TIMED_OUT is Nav2's code for a costmap without new observations.
        return tf_error if self.is_transform else Nav2ErrorCode.CONTROLLER_TIMED_OUT

    def exceeds_patience(self, now: int) -> bool:
        """Return whether goals that wait for the readings fail at *now* (ns)."""
        return self.seconds(now) > MAX_OUTAGE_S


class SensorWatch:
    """A check whether the readings of a robot are recent enough to drive.

    Only the newest readings are used, so that several servers can have a watch each. Call `report` regularly
    for the log: it has a warning at the beginning of each outage, and one at its end.

    Args:
        tree: The transform tree with the robot's frames.
        scan_limit: The greatest age of a scan (s).
        odometry_limit: The greatest age of the odometry (s).
    """

    def __init__(
        self,
        robot: Robot,
        tree: TransformTree,
        scan_limit: float = MAX_SCAN_AGE_S,
        odometry_limit: float = MAX_ODOMETRY_AGE_S,
    ) -> None:
        self._robot = robot
        self._tree = tree
        self._scan_limit = scan_limit
        self._odometry_limit = odometry_limit
        self._began = robot.clock.now()
        self._checked: LaserScan | None = None
        self._placed_at = self._began
        self._frame_outage: Outage | None = None
        self._reported: Outage | None = None

    def outage(self, now: int) -> Outage | None:
        """Return the present outage of a sensor at *now* (ns), or None if all readings are usable."""
        return self.odometry_outage(now) or self._scan_outage(now) or self._laser_frame_outage()

    def odometry_outage(self, now: int) -> Outage | None:
        """Return the present outage of the odometry at *now* (ns), or None if the odometry is recent."""
        odometry = self._robot.odometry()
        return Outage("odometry", odometry.stamp) if is_stale(odometry, now, self._odometry_limit) else None

    def report(self, now: int) -> None:
        """Log the beginning or the end of an outage at *now* (ns)."""
        outage, before = self.outage(now), self._reported
        if outage is not None and before is not None and outage.sensor == before.sensor:
            return
        if before is not None:
            log.warning("the %s arrives again after %.1f s", before.sensor, before.seconds(now))
        if outage is not None:
            log.warning("%s", outage.message(now))
        self._reported = outage

    def _scan_outage(self, now: int) -> Outage | None:
        scan = self._robot.scan()
        if not is_stale(scan, now, self._scan_limit):
            return None
        return Outage("laser scan", self._began if scan is None else scan.stamp, is_transform=False)

    def _laser_frame_outage(self) -> Outage | None:
        """Return an outage if the laser's pose at the time of the newest scan is not known."""
        scan = self._robot.scan()
        if scan is None or scan is self._checked:
            return self._frame_outage
        self._checked, self._frame_outage = scan, None
        name = f"transform of the laser's frame '{scan.frame}'"
        try:
            self._tree.lookup(BASE_FRAME, scan.frame, scan.stamp - round(MAX_LASER_FRAME_AGE_S * NS_PER_S))
        except ExtrapolationError as error:
            # Poses that begin later than this are recent.
            if error.future:
                self._frame_outage = Outage(name, self._placed_at)
        except TransformError as error:
            self._frame_outage = Outage(name, self._placed_at, str(error))
        if self._frame_outage is None:
            self._placed_at = scan.stamp
        return self._frame_outage
