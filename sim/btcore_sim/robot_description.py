"""Descriptions of robots, read from JSON files.

tiago.json beside this file is an example. A description names the URDF (a path relative to the JSON file),
the wheels, the base's limits and footprint, the laser, and optionally head, torso, camera and sonars. Sensors
are mounted on a link of the URDF at a `position` (m) and face forward; a sonar may be turned by `yaw`.
`frames` lists further frames, each fixed to a link or to another frame. `shells` lists rounded shapes that
the viewer draws instead of the URDF's shapes (see shells.py). Lengths are in metres, angles in radians,
frequencies in hertz, and latencies in seconds.
"""

from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import Annotated

from msgspec import Meta

from btcore.typed_data import DataError, FieldError, NotNegative, Positive, convert
from btcore_robot.data_files import json_data
from btcore_robot.robot import BaseInfo, HeadInfo, LaserInfo, TorsoInfo
from btcore_sim.errors import SimError
from btcore_sim.shells import Shell

TIAGO = Path(__file__).parent / "tiago.json"
"""The description of the Tiago robot, which is the default."""

Latency = Annotated[float, Meta(ge=0.0, le=1.0)]
"""The latency of a sensor (s). With older readings robots stand still."""

Share = Annotated[float, Meta(ge=0.0, le=1.0)]
"""A share, from 0 to 1."""

Point = tuple[float, float, float]
"""x, y and z (m)."""

ORIGIN = (0.0, 0.0, 0.0)
"""The default position of a sensor on its link."""


@dataclass(frozen=True, slots=True)
class Wheels:
    """The two driven wheels.

    Attributes:
        left: The joint of the left wheel.
        right: The joint of the right wheel.
        radius: The radius (m).
        separation: The distance between the wheels (m).
        torque: The greatest torque of a motor (N·m).
        ground: The links that touch only the floor (wheels and casters).
        sliding: The links without friction.
    """

    left: str
    right: str
    radius: Positive
    separation: Positive
    torque: Positive
    ground: tuple[str, ...] = ()
    sliding: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class LaserErrors:
    """The outliers of a laser: shares of rays, from 0 to 1.

    Attributes:
        missed: The share of rays that return no echo, for example from a dark or a shiny surface.
        short: The share of rays that return an echo at a random distance before the object, from dust.
        edge: The share of the rays beside an edge that hit both objects and return a range between them.
    """

    missed: Share = 0.0
    short: Share = 0.0
    edge: Share = 0.0

    @property
    def has_outliers(self) -> bool:
        """Whether there are outliers."""
        return max(self.missed, self.short, self.edge) > 0.0

    def scaled(self, factor: float) -> "LaserErrors":
        """Return the shares multiplied by *factor*; a share is limited to 1."""
        return LaserErrors(*(min(1.0, factor * share) for share in astuple(self)))


@dataclass(frozen=True, slots=True, kw_only=True)
class LaserMount:
    """A planar laser.

    Attributes:
        link: The link on which the laser is mounted.
        position: The position on the link (m).
        frame: The name of the laser's frame.
        rays: The number of rays of a scan.
        angle_min: The direction of the first ray (rad).
        angle_max: The direction of the last ray (rad).
        range_min: The smallest range (m).
        range_max: The greatest range (m).
        rate: The rate of scans (Hz).
        sigma: The standard deviation of the error that is the same at all ranges (m).
        range_noise: The standard deviation of the error that grows with the range (fraction of the range).
        outliers: The shares of rays with other errors.
        latency: The time between the measurement of a scan and its arrival (s).
    """

    link: str
    position: Point = ORIGIN
    frame: str
    rays: Annotated[int, Meta(ge=1)]
    angle_min: float
    angle_max: float
    range_min: Positive
    range_max: Positive
    rate: Positive
    sigma: NotNegative = 0.0
    range_noise: NotNegative = 0.0
    outliers: LaserErrors = LaserErrors()
    latency: Latency = 0.0

    def __post_init__(self) -> None:
        _check_order(self.angle_min, self.angle_max, "angle_min", "angle_max")

    @property
    def info(self) -> LaserInfo:
        """The properties of the laser."""
        increment = (self.angle_max - self.angle_min) / max(1, self.rays - 1)
        ranges = self.range_min, self.range_max
        return LaserInfo(
            self.rays, self.angle_min, increment, *ranges, self.rate, self.sigma, self.frame, self.range_noise
        )


def _check_order(low: float, high: float, low_key: str, high_key: str) -> None:
    if low >= high:
        raise FieldError(high_key, f"is {high:g}, and it has to be greater than '{low_key}'")


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraMount:
    """A camera on *link* at *position* (m); *roll* (rad) turns the link's axes to x forward, z up.

    *fov* (rad) is the horizontal angle of view, *near* and *far* (m) are the limits of the rendered depth,
    and *frame* is the optical frame. A picture arrives *latency* (s) after it was taken.
    """

    link: str
    position: Point = ORIGIN
    roll: float = 0.0
    fov: Positive
    near: Positive
    far: Positive
    frame: str
    latency: Latency = 0.0


@dataclass(frozen=True, slots=True)
class HeadJoints:
    """The joints that turn the head.

    Attributes:
        pan: The joint that turns the head to the left and right.
        tilt: The joint that turns the head up and down.
        pan_limits: The smallest and the greatest angle of *pan* (rad).
        tilt_limits: The smallest and the greatest angle of *tilt* (rad).
        speed: The maximum speed of the joints (rad/s).
        torque: The greatest torque of each motor (N·m).
    """

    pan: str
    tilt: str
    pan_limits: tuple[float, float]
    tilt_limits: tuple[float, float]
    speed: Positive
    torque: Positive

    @property
    def info(self) -> HeadInfo:
        """The limits of the joints."""
        return HeadInfo(*self.pan_limits, *self.tilt_limits, self.speed)


@dataclass(frozen=True, slots=True)
class TorsoJoint:
    """The joint that lifts the torso.

    Attributes:
        joint: The name of the joint.
        limits: The lowest and the greatest height (m).
        speed: The maximum speed (m/s).
        force: The greatest force of its motor (N).
    """

    joint: str
    limits: tuple[float, float]
    speed: Positive
    force: Positive

    def __post_init__(self) -> None:
        if self.limits[0] >= self.limits[1]:
            raise FieldError("limits", f"is {list(self.limits)}, and the second value has to be greater")

    @property
    def info(self) -> TorsoInfo:
        """The limits of the joint."""
        return TorsoInfo(*self.limits, self.speed)


@dataclass(frozen=True, slots=True, kw_only=True)
class SonarMount:
    """A sonar and its place.

    Attributes:
        frame: The name of the sonar's frame.
        link: The link on which the sonar is mounted.
        position: The position on the link (m).
        yaw: The direction (rad).
        fov: The full angle of the cone (rad).
        range_min: The smallest range (m).
        range_max: The greatest range (m).
    """

    frame: str
    link: str
    position: Point = ORIGIN
    yaw: float = 0.0
    fov: Positive
    range_min: Positive
    range_max: Positive

    def __post_init__(self) -> None:
        _check_order(self.range_min, self.range_max, "range_min", "range_max")


@dataclass(frozen=True, slots=True)
class OdometryInfo:
    """The rate and the errors of the odometry. The errors, except the latency, are fractions; 0 is perfect.

    Attributes:
        rate: The number of readings per second.
        scale_sigma: The standard deviation of each wheel's scale (assumed radius divided by true radius),
            which is drawn once per run.
        slip: The fraction by which the wheels measure more turning than the base makes.
        slip_sigma: The standard deviation of *slip* between readings.
        latency: The time between a measurement and its arrival (s).
    """

    rate: Positive = 50.0
    scale_sigma: NotNegative = 0.0
    slip: float = 0.0
    slip_sigma: NotNegative = 0.0
    latency: Latency = 0.0


@dataclass(frozen=True, slots=True)
class FixedFrame:
    """A frame fixed in another frame.

    Attributes:
        name: The name of the frame.
        parent: The other frame.
        position: The position (m).
        rpy: Roll, pitch and yaw (rad).
    """

    name: str
    parent: str
    position: Point = ORIGIN
    rpy: Point = ORIGIN


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldJoint:
    """A joint that is held at a position.

    Attributes:
        joint: The name of the joint.
        position: The position (m or rad).
        force: The greatest force (N or N·m).
        speed: The greatest speed (m/s or rad/s).
    """

    joint: str
    position: float = 0.0
    force: Positive
    speed: Positive


PERFECT = OdometryInfo()
"""The odometry of a robot whose description has no `odometry`: 50 Hz, without errors."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotDescription:
    """The description of a robot.

    Attributes:
        name: The name of the robot.
        urdf: The URDF file.
        height: The height of the URDF's root link above the floor (m); 0 if the root is `base_footprint`.
        wheels: The driven wheels.
        base: The limits of the base.
        odometry: The errors of the odometry.
        laser: The laser.
        head: The joints of the head, or None.
        torso: The joint of the torso, or None.
        camera: The camera, or None.
        sonar_rate: The number of sonar readings per second.
        sonars: The sonars.
        sonar_latency: The time between the measurement of the sonars' readings and their arrival (s).
        frames: Further frames.
        held: The joints that keep their position.
        shells: The rounded shapes that the viewer draws for some links instead of the shapes of the URDF.
    """

    name: str
    urdf: Path
    height: NotNegative = 0.0
    wheels: Wheels
    base: BaseInfo
    odometry: OdometryInfo = PERFECT
    laser: LaserMount
    head: HeadJoints | None = None
    torso: TorsoJoint | None = None
    camera: CameraMount | None = None
    sonar_rate: Positive = 5.0
    sonars: tuple[SonarMount, ...] = ()
    sonar_latency: Latency = 0.0
    frames: tuple[FixedFrame, ...] = ()
    held: tuple[HeldJoint, ...] = ()
    shells: tuple[Shell, ...] = ()

    def with_noise(self, factor: float) -> "RobotDescription":
        """Return the same robot with the errors and latencies of its sensors multiplied by *factor*."""
        laser = replace(
            self.laser,
            sigma=factor * self.laser.sigma,
            range_noise=factor * self.laser.range_noise,
            outliers=self.laser.outliers.scaled(factor),
            latency=factor * self.laser.latency,
        )
        # All fields after the rate are errors.
        rate, *errors = astuple(self.odometry)
        odometry = OdometryInfo(rate, *(factor * error for error in errors))
        camera = self.camera and replace(self.camera, latency=factor * self.camera.latency)
        return replace(
            self, laser=laser, odometry=odometry, camera=camera, sonar_latency=factor * self.sonar_latency
        )


def load_robot_description(path: Path = TIAGO) -> RobotDescription:
    """Return the robot described by the JSON file at *path*.

    Raises:
        SimError: The file or its URDF does not exist, or a field is missing, unknown or invalid.
    """
    with json_data(path, "a robot", SimError) as data:
        description = convert(data, RobotDescription)
        return replace(description, urdf=_existing(path.parent / description.urdf))


def _existing(urdf: Path) -> Path:
    if not urdf.is_file():
        raise DataError(("urdf",), f"names {urdf}, but there is no such file")
    return urdf
