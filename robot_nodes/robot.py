"""What a leaf may ask of a body: the `Robot` protocol and the values that it speaks in.

Frames are the field's: x forward, y left, z up; angles counter-clockwise, 0 ahead. Lengths are
metres, angles radians, times integer nanoseconds of the robot's own clock. Nothing here tells
where the robot truly is: a body knows its odometry, and no more.
"""

import threading
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

CMD_VEL = 10
"""The priority of a tree's own velocity commands (twist_mux of Tiago's start-up files)."""


class RobotClock(Protocol):
    """The time that stamps are written in. A simulated robot's clock steps its world while it waits."""

    def now(self) -> int:
        """The time (ns), never decreasing."""
        ...

    def wait_until(self, deadline: int, wake: threading.Event) -> bool:
        """Return at *deadline* (ns), or as soon as *wake* is set; whether *wake* was set."""
        ...


@dataclass(frozen=True, slots=True)
class Pose2D:
    """A place on the floor: *x*, *y* (m) and the heading *yaw* (rad, in (-π, π])."""

    x: float
    y: float
    yaw: float


@dataclass(frozen=True, slots=True)
class Twist2D:
    """A velocity of a body that drives on the floor: *v* forward (m/s), *w* counter-clockwise (rad/s)."""

    v: float
    w: float


@dataclass(frozen=True, slots=True)
class Odometry:
    """Where the wheels say that the body is: *pose* in the frame ``odom`` (where it started), and *twist*."""

    pose: Pose2D
    twist: Twist2D
    stamp: int


@dataclass(frozen=True, slots=True)
class LaserScan:
    """One sweep of a planar laser.

    *ranges* has shape ``(n,)``, float32, in metres; the ray with index *i* points at
    ``angle_min + i * angle_increment`` in *frame*. As REP 117 has it, no echo is ``+inf`` and an echo
    from under *range_min* is ``-inf``.
    """

    ranges: NDArray[np.float32]
    stamp: int
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float
    frame: str

    def angles(self) -> NDArray[np.float64]:
        """The direction of every ray (rad), shape ``(n,)``."""
        return self.angle_min + self.angle_increment * np.arange(len(self.ranges), dtype=np.float64)

    def points(self) -> NDArray[np.float64]:
        """What the finite readings hit: x, y (m) in the laser's frame, shape ``(k, 2)``, k ≤ n."""
        seen = np.isfinite(self.ranges)
        angles = self.angles()[seen]
        directions: NDArray[np.float64] = np.stack((np.cos(angles), np.sin(angles)), axis=1)
        return directions * self.ranges[seen, None]


@dataclass(frozen=True, slots=True)
class Picture:
    """A camera's picture: *rgb* has shape ``(height, width, 3)``; *frame* has z ahead, x right, y down."""

    rgb: NDArray[np.uint8]
    stamp: int
    frame: str


@dataclass(frozen=True, slots=True)
class HeadPosition:
    """Where the head looks (rad): *pan* + is left, *tilt* + is up."""

    pan: float
    tilt: float
    stamp: int


@dataclass(frozen=True, slots=True)
class LaserFacts:
    """What is known of the laser before its first scan; *rate* in Hz, *sigma* (m) of its noise."""

    rays: int
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float
    rate: float
    sigma: float
    frame: str


@dataclass(frozen=True, slots=True)
class BaseFacts:
    """What the base can do.

    *v_min* … *v_max* (m/s; *v_min* < 0 is backwards), *w_max* (rad/s, both ways), accelerations *v_rate*
    (m/s²) and *w_rate* (rad/s²), *command_timeout* (s) after which a velocity command lapses, and the
    *radius* (m) of the smallest circle about the base's centre that holds its footprint.
    """

    v_min: float
    v_max: float
    w_max: float
    v_rate: float
    w_rate: float
    command_timeout: float
    radius: float


@dataclass(frozen=True, slots=True)
class HeadFacts:
    """How far the head turns (rad) and how fast (rad/s)."""

    pan_min: float
    pan_max: float
    tilt_min: float
    tilt_max: float
    speed: float


@runtime_checkable
class Robot(Protocol):
    """A body with a differential base, a planar laser and perhaps a head with a camera.

    A leaf asks for it by type. Readings are the newest there are, each with the stamp of the moment
    it was taken: whoever cares how old one is compares it with ``clock.now()``.
    """

    @property
    def clock(self) -> RobotClock:
        """The clock that all stamps are read from."""
        ...

    @property
    def base(self) -> BaseFacts:
        """The base's limits and size."""
        ...

    @property
    def laser(self) -> LaserFacts:
        """The laser's geometry and range."""
        ...

    @property
    def neck(self) -> HeadFacts | None:
        """The head's limits, or None for a robot without one."""
        ...

    def drive(self, v: float, w: float, *, priority: int = CMD_VEL) -> None:
        """Ask for *v* (m/s, forward) and *w* (rad/s, counter-clockwise).

        The base obeys as far as its limits go, keeping the turning radius, and stops by itself when
        no command has come for ``base.command_timeout`` seconds. Of several sources the one with the
        highest *priority* wins, for 0.5 s after its last word.
        """
        ...

    def stop(self) -> None:
        """Stand still: the same as a command of zero that no earlier command outranks."""
        ...

    def scan(self) -> LaserScan | None:
        """The newest scan, or None before the first."""
        ...

    def odometry(self) -> Odometry:
        """The newest odometry."""
        ...

    def look(self, pan: float, tilt: float) -> None:
        """Turn the head to *pan* (+ left) and *tilt* (+ up) in rad, held within the neck's limits."""
        ...

    def head(self) -> HeadPosition | None:
        """Where the head looks now, or None for a robot without one."""
        ...

    def camera(self) -> Picture | None:
        """The newest picture, or None without a camera."""
        ...
