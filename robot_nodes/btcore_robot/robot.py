"""The interface between leaves and a robot: the `Robot` protocol and its data types.

Conventions, which are those of ROS (REP 103, REP 105 and REP 117):

- Lengths are in metres, angles in radians, velocities in m/s and rad/s. Times and stamps are integer
  nanoseconds of the robot's own clock.
- In a body frame x points forward, y to the left and z up. Angles are positive counter-clockwise, seen from
  above, and 0 straight ahead. In an optical frame of a camera z points forward, x to the right and y down.
- The frame `base_footprint` is on the floor below the centre of the base. The frame `odom` is at the
  start of odometry. The frame `map` belongs to navigation: a robot knows its odometry, not its true
  position.
"""

import math
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Protocol, runtime_checkable

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from btcore.errors import BtcoreError
from btcore.typed_data import Positive

MAP_FRAME, ODOM_FRAME, BASE_FRAME = "map", "odom", "base_footprint"
"""The frames of the map, of odometry, and of the robot."""

CMD_VEL = 10
"""The priority of a tree's velocity commands, as in the twist_mux configuration of Tiago."""


_SAME_PLACE = 0.05  # m: the greatest distance between a waypoint and a pose that stands for it


class RobotClock(Protocol):
    """The robot's clock, in which all stamps are given.

    Waiting on the clock of a simulated robot runs the simulation.
    """

    def now(self) -> int:
        """Return the time (ns). It never decreases."""

    def wait_until(self, deadline: int, wake: threading.Event) -> bool:
        """Wait until *deadline*, and run the tasks of the robot's schedule that become due.

        Args:
            deadline: The time (ns) at which to return.
            wake: An event that ends the wait early; another thread may set it.

        Returns:
            Whether the wait ended because *wake* was set.
        """


class Phase(IntEnum):
    """The order of tasks that are due at the same time.

    Lower phases run first. A tree that is due at the same time is ticked after all tasks. EVALUATION is for
    tasks that measure the run.
    """

    PHYSICS = 0
    SENSORS = 1
    TRANSFORMS = 2
    LOCALISER = 3
    COSTMAPS = 4
    PLANNER = 5
    CONTROLLER = 6
    HEAD = 7
    COMPONENTS = 8
    EVALUATION = 9


class Schedule(Protocol):
    """The periodic tasks of a robot. All tasks run on the thread that waits on the robot's clock."""

    def add_task(
        self, hertz: float, phase: Phase, task: Callable[[int], None], *, first: int | None = None
    ) -> Callable[[], None]:
        """Call *task* periodically, with the time (ns) as its argument.

        Args:
            hertz: The rate (Hz).
            phase: The order of tasks that are due at the same time: a lower phase runs first.
            task: The function to call. It must return quickly, because everything runs on the same thread.
            first: The time (ns) of the first call; by default one period from now.

        Returns:
            A function that ends the periodic calls.
        """


@dataclass(frozen=True, slots=True)
class Pose2D:
    """A pose on the floor: position *x*, *y* (m) and heading *yaw* (rad, in (-π, π]).

    Examples:
        >>> from btcore_robot.robot import Pose2D
        >>> pose = Pose2D(1.0, 2.0, yaw=0.5)
        >>> pose.x, pose.yaw
        (1.0, 0.5)
    """

    x: float
    y: float
    yaw: float


@dataclass(frozen=True, slots=True)
class Twist2D:
    """A velocity on the floor: *v* forward (m/s) and *w* counter-clockwise (rad/s)."""

    v: float
    w: float


@dataclass(frozen=True, slots=True)
class TransformStamped:
    """The pose of the frame *child* in the frame *parent*.

    *position* is x, y, z (m). *quaternion* is x, y, z, w with length 1. *stamp* is the time (ns) of the pose.
    """

    child: str
    parent: str
    position: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]
    stamp: int


@dataclass(frozen=True, slots=True)
class Odometry:
    """The motion measured by the wheels: the *pose* of the base in the frame `odom`, and its *twist*.

    *stamp* is the time (ns) of the measurement. The pose drifts, but never jumps.
    """

    pose: Pose2D
    twist: Twist2D
    stamp: int


@dataclass(frozen=True, slots=True)
class LaserScan:
    """A scan of a planar laser, as `sensor_msgs/LaserScan`.

    Attributes:
        ranges: The ranges (m), float32 of shape `(n,)`. The ray with index *i* points at the angle `angle_min
            + i * angle_increment` in *frame*. By REP 117 a ray without an echo within *range_max* is `+inf`,
            and an echo nearer than *range_min* is `-inf`; NaN does not occur.
        stamp: The time (ns) of the measurement.
        angle_min: The angle of the first ray (rad).
        angle_increment: The angle between two rays (rad).
        range_min: The smallest range that is measured (m).
        range_max: The greatest range that is measured (m).
        frame: The frame of the laser.

    Examples:
        >>> import numpy as np
        >>> from btcore_robot.robot import LaserScan
        >>> ranges = np.array([1.0, 2.0, np.inf], dtype=np.float32)
        >>> scan = LaserScan(ranges, 0, -0.5, 0.5, 0.05, 10.0, "laser")
        >>> float(scan.ranges.min())
        1.0
    """

    ranges: NDArray[np.float32]
    stamp: int
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float
    frame: str

    def angles(self) -> NDArray[np.float64]:
        """Return the direction (rad) of every ray, shape `(n,)`."""
        return self.angle_min + self.angle_increment * np.arange(len(self.ranges), dtype=np.float64)

    def points(self) -> NDArray[np.float64]:
        """Return the end points x, y (m) of the rays with an echo, in the laser's frame: shape `(k, 2)`."""
        finite = np.isfinite(self.ranges)
        angles = self.angles()[finite]
        directions: NDArray[np.float64] = np.stack((np.cos(angles), np.sin(angles)), axis=1)
        return directions * self.ranges[finite, None]


@dataclass(frozen=True, slots=True)
class CameraImage:
    """A camera image in the optical frame *frame* (z forward, x right, y down).

    *rgb* has the shape `(height, width, 3)`. *depth* is the distance (m) along z of every pixel, with the
    shape `(height, width)`; it is `+inf` where nothing is within reach. For a camera that does not
    measure depth it is None. *stamp* is the time (ns) at which the image was taken.
    """

    rgb: NDArray[np.uint8]
    stamp: int
    frame: str
    depth: NDArray[np.float32] | None = None


@dataclass(frozen=True, slots=True)
class SonarReading:
    """A reading of a sonar.

    Attributes:
        range: The distance (m) of the nearest object in the cone. A reading without an echo within
            *range_max* is `+inf`, an echo nearer than *range_min* is `-inf`.
        stamp: The time (ns) of the measurement.
        fov: The full angle of the cone (rad), whose axis is x.
        range_min: The smallest range that is measured (m).
        range_max: The greatest range that is measured (m).
        frame: The frame of the sonar.
    """

    range: float
    stamp: int
    fov: float
    range_min: float
    range_max: float
    frame: str


@dataclass(frozen=True, slots=True)
class BatteryState:
    """The charge of the battery: *level* in percent (100 is full), *stamp* (ns) of the reading."""

    level: float
    stamp: int


@dataclass(frozen=True, slots=True)
class HeadPosition:
    """The direction (rad) in which the head points: *pan* positive to the left, *tilt* positive upwards.

    Both are 0 when the head points straight ahead. *stamp* is the time (ns) of the reading.
    """

    pan: float
    tilt: float
    stamp: int


@dataclass(frozen=True, slots=True)
class LaserInfo:
    """The properties of a laser that do not change.

    *angle_min* and *angle_increment* (rad), *range_min* and *range_max* (m) and *frame* are those of every
    `LaserScan`. *rays* is the number of rays of a scan, *rate* (Hz) the rate of scans. A range has two
    independent errors: *sigma* (m) is the standard deviation of the error that is the same at all ranges, and
    *range_noise* that of the error that grows with the range, as a fraction of the range.
    """

    rays: int
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float
    rate: float
    sigma: float
    frame: str
    range_noise: float = 0.0

    def deviation(self, ranges: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the standard deviation (m) of each of *ranges* (m)."""
        deviations: NDArray[np.float64] = np.hypot(self.sigma, self.range_noise * ranges)
        return deviations


@dataclass(frozen=True, slots=True)
class BaseInfo:
    """The limits and the size of the base.

    *v_min* and *v_max* (m/s) limit the speed; *v_min* is negative for a base that can drive backwards,
    otherwise 0. *w_max* (rad/s) limits the angular speed in both directions. *v_rate* (m/s²) and *w_rate*
    (rad/s²) limit the accelerations. *command_timeout* (s) is the time after which a velocity command
    expires, at most 1 s. *radius* (m) is the radius of the smallest circle around the centre of the base that
    contains its footprint.
    """

    v_min: Annotated[float, Meta(le=0.0)]
    v_max: Positive
    w_max: Positive
    v_rate: Positive
    w_rate: Positive
    command_timeout: Annotated[float, Meta(gt=0.0, le=1.0)]
    radius: Positive

    def check_rate(self, rate: float) -> None:
        """Check that a tree that drives is ticked before its velocity commands expire.

        Args:
            rate: The ticks per second (Hz).

        Raises:
            BtcoreError: The rate is too low.
        """
        least = 1.0 / self.command_timeout
        if rate < least:
            raise BtcoreError(
                f"--rate {rate:g} is too slow for a tree that drives: the base stops "
                f"{self.command_timeout:g} s after a velocity command, so the tree has to be ticked at least "
                f"{least:g} times a second"
            )


@dataclass(frozen=True, slots=True)
class HeadInfo:
    """The limits of the head's joints; signs as in `HeadPosition`.

    Attributes:
        pan_min: The smallest angle of the pan joint (rad).
        pan_max: The greatest angle of the pan joint (rad).
        tilt_min: The smallest angle of the tilt joint (rad).
        tilt_max: The greatest angle of the tilt joint (rad).
        speed: The maximum speed of the joints (rad/s).
    """

    pan_min: float
    pan_max: float
    tilt_min: float
    tilt_max: float
    speed: float


@dataclass(frozen=True, slots=True)
class CameraInfo:
    """The intrinsic parameters of a camera by the pinhole model.

    *width* and *height* are in pixels, as are the focal lengths *fx*, *fy* and the principal point *cx*,
    *cy*. Visible objects are between *near* and *far* (m). *rate* (Hz) is the rate of images. *frame* is the
    optical frame (z forward, x right, y down).
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
    """The limits of a lifting torso.

    Attributes:
        lift_min: The lowest height (m).
        lift_max: The greatest height (m).
        speed: The maximum speed (m/s).
    """

    lift_min: float
    lift_max: float
    speed: float


class _RobotType(type(Protocol)):  # type: ignore[misc]
    """The type of `Robot`, whose isinstance does not read the properties of a derived class.

    A property may be slow: the properties of a camera may have to arrive first. Since Python 3.12, isinstance
    does not read properties at all.
    """

    def __instancecheck__(cls, instance: object) -> bool:
        return cls in type(instance).__mro__ or super().__instancecheck__(instance)


@runtime_checkable
class Robot(Protocol, metaclass=_RobotType):
    """A robot with a differential base, a planar laser and optionally a head with a camera.

    A leaf obtains the robot by annotating a constructor parameter with this type. All methods return at once:
    reading methods return the newest data that the driver has received, and command methods do not wait for
    the motion.

    Every reading carries the stamp of its measurement, not of the call. If a sensor stops, its last reading
    is returned again with its old stamp; a caller that needs recent data compares the stamp with
    `clock.now()`.

    A robot without a battery, sonars, a torso or a camera with depth derives from this class and omits the
    methods for them: the defaults below mean "not available". `btcore_robot.testing.check_robot` checks an
    implementation.
    """

    @property
    def clock(self) -> RobotClock:
        """The clock of all stamps."""

    @property
    def schedule(self) -> Schedule:
        """The schedule of periodic tasks, which run while a caller waits on `clock`."""

    @property
    def base_info(self) -> BaseInfo:
        """The limits and the size of the base; they do not change."""

    @property
    def laser_info(self) -> LaserInfo:
        """The properties of the laser; they do not change."""

    @property
    def head_info(self) -> HeadInfo | None:
        """The limits of the head, or None for a robot without a movable head."""

    @property
    def camera_info(self) -> CameraInfo | None:
        """The intrinsic parameters of the camera, or None for a robot without a camera."""
        return None

    @property
    def torso_info(self) -> TorsoInfo | None:
        """The limits of the torso, or None for a robot without a lifting torso."""
        return None

    def frames(self) -> Sequence[TransformStamped]:
        """Return the current poses of the robot's links and sensors.

        The frames form a tree whose root is `base_footprint`: each frame occurs once as a child, and the
        frames of the laser, the camera and the sonars are among them.
        """

    def moving_frames(self) -> Sequence[TransformStamped]:
        """Return those of `frames` whose poses in their parents can change; by default all frames.

        A robot with many fixed frames overrides this method, so that they are stored only once.
        """
        return self.frames()

    def drive(self, v: float, w: float, *, priority: int = CMD_VEL) -> None:
        """Command the base to drive. Repeat the command within its timeout as long as the base should drive.

        The base follows the command within its limits; if it has to reduce the speed it keeps the radius of
        the curve. It stops when no command has arrived for `base_info.command_timeout` seconds.

        Several sources may send commands. A command is ignored if a command of a higher priority arrived
        within the last 0.5 s.

        Args:
            v: The speed (m/s), positive forward.
            w: The angular speed (rad/s), positive counter-clockwise.
            priority: The priority of the source; a higher number wins.
        """

    def stop(self) -> None:
        """Stop the base, whatever the priority of earlier commands. Later commands apply again."""

    def commanded_velocity(self) -> Twist2D:
        """Return the last accepted command, before any limit; zero when it has expired or after `stop`."""

    def scan(self) -> LaserScan | None:
        """Return the newest scan, or None before the first scan."""

    def odometry(self) -> Odometry:
        """Return the newest odometry. It is available from the start."""

    def move_head(self, pan: float, tilt: float) -> None:
        """Turn the head, within the limits of `head_info`. Without a head the call has no effect.

        Args:
            pan: The direction (rad) to the side: 0 is straight ahead, positive to the left.
            tilt: The direction (rad) up or down: 0 is straight ahead, positive upwards.
        """

    def head(self) -> HeadPosition | None:
        """Return the current direction of the head, or None for a robot without a movable head."""

    def camera(self) -> CameraImage | None:
        """Return the newest camera image, or None without a camera or before the first image."""

    def sonars(self) -> Sequence[SonarReading]:
        """Return the newest reading of every sonar; empty without sonars or before the first readings."""
        return ()

    def battery(self) -> BatteryState | None:
        """Return the charge of the battery, or None for a robot that does not report it."""
        return None

    def recharge(self) -> None:
        """Fill the battery at once, as if it had been charged. Without a battery the call has no effect."""

    def lift(self, height: float) -> None:
        """Move the torso to *height* (m), limited to `torso_info`.

        Without a lifting torso the call has no effect.
        """

    def torso_height(self) -> float | None:
        """Return the current height (m) of the torso, or None without a lifting torso."""
        return None


@dataclass(frozen=True, slots=True)
class Waypoints:
    """The named poses of a world, in the frame `map`: `recharge`, `wp1`, `wp2`, `wp3` …

    Attributes:
        places: The poses by name.
        source: The origin of the poses, for error messages: a file, or "this world".
        remedy: How to add a waypoint that is missing, for error messages. `{name}` stands for its name.
    """

    places: Mapping[str, Pose2D]
    source: str = "this world"
    remedy: str = ""

    def name_at(self, pose: Pose2D) -> str | None:
        """Return the name of the first waypoint at most 5 cm from *pose* with any heading, or None."""
        return next(
            (
                name
                for name, place in self.places.items()
                if math.hypot(place.x - pose.x, place.y - pose.y) <= _SAME_PLACE
            ),
            None,
        )


@dataclass(frozen=True, slots=True)
class WorldPlaces:
    """The places in the frame `map` that are known without a map file.

    Attributes:
        waypoints: The named poses.
        start: The pose of the robot at the start of the run, with which the localiser begins; if it is None,
            the pose is unknown, and the localiser searches the whole map.
    """

    waypoints: Waypoints
    start: Pose2D | None


@dataclass(frozen=True, slots=True)
class GoalOutcome:
    """The end of a navigation to *goal* (in the frame `map`) at the time *stamp* (ns).

    *status* is `SUCCEEDED`, `CANCELED` or `ABORTED`. *cause* is the reason of an aborted goal.
    """

    goal: Pose2D
    status: str
    stamp: int
    cause: str = ""


@runtime_checkable
class NavigationReporter(Protocol):
    """A navigation system that reports its pose estimate and the outcomes of its goals."""

    def estimate(self) -> Pose2D | None:
        """Return the estimated pose of the base in the frame `map`, or None while it is unknown."""

    def outcomes(self) -> Sequence[GoalOutcome]:
        """Return the outcome of every goal that has ended, oldest first."""
