"""What a leaf may ask of a body: the `Robot` protocol and the values that it speaks in.

Frames are the field's: x forward, y left, z up; angles counter-clockwise, 0 ahead. Lengths are
metres, angles radians, times integer nanoseconds of the robot's own clock. Nothing here tells
where the robot truly is: a body knows its odometry, and no more.
"""

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

NS_PER_S = 1_000_000_000

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


class Phase(IntEnum):
    """The order of what is due at the same moment. A tree, which waits for that moment, comes after all."""

    PHYSICS = 0
    SENSORS = 1
    TRANSFORMS = 2
    LOCALISER = 3
    COSTMAPS = 4
    PLANNER = 5
    CONTROLLER = 6
    HEAD = 7
    PROCESSES = 8
    JUDGE = 9


class Schedule(Protocol):
    """The periodic tasks of a world or of a real robot, all run on one thread while somebody waits."""

    def every(
        self, hertz: float, rank: Phase, task: Callable[[int], None], *, first: int | None = None
    ) -> Callable[[], None]:
        """Call *task* with the time (ns) at *hertz*, from *first* (ns; one period from now unless given) on.

        At equal times a lower *rank* goes first. Gives a callable that ends the task.
        """
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
class TransformStamped:
    """Where the frame *child* is in the frame *parent*: *position* (m) and *quaternion* (x, y, z, w)."""

    child: str
    parent: str
    position: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]
    stamp: int


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
class CameraImage:
    """A camera's picture: *rgb* has shape ``(height, width, 3)``; *frame* has z ahead, x right, y down.

    *depth*, of a camera that measures it, has shape ``(height, width)``: the distance (m) along z, +inf
    where there is nothing within reach.
    """

    rgb: NDArray[np.uint8]
    stamp: int
    frame: str
    depth: NDArray[np.float32] | None = None


@dataclass(frozen=True, slots=True)
class SonarReading:
    """What a sonar hears: the *range* (m; no echo is +inf, too near is -inf) within a cone of *fov* (rad)."""

    range: float
    stamp: int
    fov: float
    range_min: float
    range_max: float
    frame: str


@dataclass(frozen=True, slots=True)
class BatteryState:
    """How full the battery is: *level* in percent, 100 when full."""

    level: float
    stamp: int


@dataclass(frozen=True, slots=True)
class HeadPosition:
    """Where the head looks (rad): *pan* + is left, *tilt* + is up."""

    pan: float
    tilt: float
    stamp: int


@dataclass(frozen=True, slots=True)
class LaserInfo:
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
class BaseInfo:
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
class HeadInfo:
    """How far the head turns (rad) and how fast (rad/s)."""

    pan_min: float
    pan_max: float
    tilt_min: float
    tilt_max: float
    speed: float


@dataclass(frozen=True, slots=True)
class CameraInfo:
    """The pinhole of a camera: *width* and *height* (pixels), focal lengths and centre (pixels), *rate* (Hz).

    The distances of what is drawn lie between *near* and *far* (m); *frame* has z ahead, x right, y down.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    near: float
    far: float
    rate: float
    frame: str


@dataclass(frozen=True, slots=True)
class TorsoInfo:
    """How far (m) the torso lifts, and how fast (m/s)."""

    lift_min: float
    lift_max: float
    speed: float


@runtime_checkable
class Robot(Protocol):
    """A body with a differential base, a planar laser and perhaps a head with a camera.

    A leaf asks for it by type. Readings are the newest there are, each with the stamp of the moment
    it was taken: whoever cares how old one is compares it with ``clock.now()``. What not every robot has
    (battery, sonars, torso, depth) is none for a class that derives from this one and says nothing of it.
    """

    @property
    def clock(self) -> RobotClock:
        """The clock that all stamps are read from."""
        ...

    @property
    def schedule(self) -> Schedule:
        """What runs periodically while somebody waits on the clock."""
        ...

    @property
    def base(self) -> BaseInfo:
        """The base's limits and size."""
        ...

    @property
    def laser(self) -> LaserInfo:
        """The laser's geometry and range."""
        ...

    @property
    def head_info(self) -> HeadInfo | None:
        """The head's limits, or None for a robot without one."""
        ...

    @property
    def camera_info(self) -> CameraInfo | None:
        """The camera's geometry, or None without a camera."""
        return None

    @property
    def torso(self) -> TorsoInfo | None:
        """The torso's limits, or None for a robot that has none or whose torso is fixed."""
        return None

    def frames(self) -> Sequence[TransformStamped]:
        """Where the robot's own frames are now, below ``base_footprint``: links and sensors."""
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

    def commanded_velocity(self) -> Twist2D:
        """The velocity that was asked for last and still holds; zero once it has lapsed."""
        ...

    def scan(self) -> LaserScan | None:
        """The newest scan, or None before the first."""
        ...

    def odometry(self) -> Odometry:
        """The newest odometry."""
        ...

    def move_head(self, pan: float, tilt: float) -> None:
        """Turn the head to *pan* (+ left) and *tilt* (+ up) in rad, held within the neck's limits."""
        ...

    def head(self) -> HeadPosition | None:
        """Where the head looks now, or None for a robot without one."""
        ...

    def camera(self) -> CameraImage | None:
        """The newest picture, or None without a camera."""
        ...

    def sonars(self) -> Sequence[SonarReading]:
        """The newest reading of every sonar."""
        return ()

    def battery(self) -> BatteryState | None:
        """The battery, or None for a robot that doesn't tell."""
        return None

    def recharge(self) -> None:
        """Fill the battery at once, as a charger would that somebody plugs in."""

    def lift(self, height: float) -> None:
        """Bring the torso to *height* (m), held within its limits."""

    def torso_height(self) -> float | None:
        """How high (m) the torso is now, or None without one."""
        return None


@dataclass(frozen=True, slots=True)
class Waypoints:
    """The named places of a world, in the frame ``map``: ``recharge``, ``wp1``, ``wp2``, ``wp3`` …"""

    places: Mapping[str, Pose2D]


@dataclass(frozen=True, slots=True)
class GoalOutcome:
    """How a drive to a place ended: *goal* in the frame ``map``, the *status* in words, and when (ns)."""

    goal: Pose2D
    status: str
    stamp: int


@runtime_checkable
class NavigationReporter(Protocol):
    """What a judge or a viewer may ask of whoever navigates."""

    def estimate(self) -> Pose2D | None:
        """Where the robot takes itself to be in the frame ``map``, now; None when it doesn't know."""
        ...

    def outcomes(self) -> Sequence[GoalOutcome]:
        """Every goal that has ended, in order."""
        ...
