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

from btcore_robot.robot import BaseInfo, HeadInfo, LaserInfo, TorsoInfo
from btcore_sim.json_records import JsonRecord, read_record
from btcore_sim.shells import Shell, read_shell

TIAGO = Path(__file__).parent / "tiago.json"
"""The description of the Tiago robot, which is the default."""

MAX_LATENCY = 1.0
"""The greatest latency of a sensor (s). With older readings robots stand still."""

Point = tuple[float, float, float]
"""x, y and z (m)."""


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
    radius: float
    separation: float
    torque: float
    ground: tuple[str, ...]
    sliding: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class LaserErrors:
    """The errors of a laser besides the noise of its ranges, which `LaserInfo` has.

    *missed*, *short* and *edge* are the outliers: shares of rays, from 0 to 1.

    Attributes:
        missed: The share of rays that return no echo, for example from a dark or a shiny surface.
        short: The share of rays that return an echo at a random distance before the object, from dust.
        edge: The share of the rays beside an edge that hit both objects and return a range between them.
        latency: The time between the measurement of a scan and its arrival (s).
    """

    missed: float = 0.0
    short: float = 0.0
    edge: float = 0.0
    latency: float = 0.0

    @property
    def has_outliers(self) -> bool:
        """Whether there are outliers."""
        return max(self.missed, self.short, self.edge) > 0.0

    def scaled(self, factor: float) -> "LaserErrors":
        """Return the errors multiplied by *factor*; a share is limited to 1."""
        return LaserErrors(
            missed=min(1.0, factor * self.missed),
            short=min(1.0, factor * self.short),
            edge=min(1.0, factor * self.edge),
            latency=factor * self.latency,
        )


@dataclass(frozen=True, slots=True)
class LaserMount:
    """A planar laser with the properties *info* and the *errors*, on *link* at *position* (m)."""

    info: LaserInfo
    link: str
    position: Point
    errors: LaserErrors = LaserErrors()


@dataclass(frozen=True, slots=True)
class CameraMount:
    """A camera on *link* at *position* (m); *roll* (rad) turns the link's axes to x forward, z up.

    *fov* (rad) is the horizontal angle of view, *near* and *far* (m) are the limits of the rendered depth,
    and *frame* is the optical frame. A picture arrives *latency* (s) after it was taken.
    """

    link: str
    position: Point
    roll: float
    fov: float
    near: float
    far: float
    frame: str
    latency: float = 0.0


@dataclass(frozen=True, slots=True)
class HeadJoints:
    """The joints that turn the head.

    Attributes:
        info: The limits of the joints.
        pan: The joint that turns the head to the left and right.
        tilt: The joint that turns the head up and down.
        torque: The greatest torque of each motor (N·m).
    """

    info: HeadInfo
    pan: str
    tilt: str
    torque: float


@dataclass(frozen=True, slots=True)
class TorsoJoint:
    """The joint that lifts the torso.

    Attributes:
        info: The limits of the joint.
        joint: The name of the joint.
        force: The greatest force of its motor (N).
    """

    info: TorsoInfo
    joint: str
    force: float


@dataclass(frozen=True, slots=True)
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
    position: Point
    yaw: float
    fov: float
    range_min: float
    range_max: float


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

    rate: float
    scale_sigma: float
    slip: float
    slip_sigma: float
    latency: float = 0.0


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
    position: Point
    rpy: Point


@dataclass(frozen=True, slots=True)
class HeldJoint:
    """A joint that is held at a position.

    Attributes:
        joint: The name of the joint.
        position: The position (m or rad).
        force: The greatest force (N or N·m).
        speed: The greatest speed (m/s or rad/s).
    """

    joint: str
    position: float
    force: float
    speed: float


@dataclass(frozen=True, slots=True)
class RobotDescription:
    """The description of a robot.

    Attributes:
        name: The name of the robot.
        urdf: The URDF file.
        height: The height of the base link above the floor (m).
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
    height: float
    wheels: Wheels
    base: BaseInfo
    odometry: OdometryInfo
    laser: LaserMount
    head: HeadJoints | None
    torso: TorsoJoint | None
    camera: CameraMount | None
    sonar_rate: float
    sonars: tuple[SonarMount, ...]
    sonar_latency: float
    frames: tuple[FixedFrame, ...]
    held: tuple[HeldJoint, ...]
    shells: tuple[Shell, ...]

    def with_noise(self, factor: float) -> "RobotDescription":
        """Return the same robot with the errors and latencies of its sensors multiplied by *factor*."""
        info = self.laser.info
        info = replace(info, sigma=factor * info.sigma, range_noise=factor * info.range_noise)
        laser = replace(self.laser, info=info, errors=self.laser.errors.scaled(factor))
        # All fields after the rate are errors.
        rate, *errors = astuple(self.odometry)
        odometry = OdometryInfo(rate, *(factor * error for error in errors))
        camera = self.camera and replace(self.camera, latency=factor * self.camera.latency)
        return replace(
            self, laser=laser, odometry=odometry, camera=camera, sonar_latency=factor * self.sonar_latency
        )


PERFECT = OdometryInfo(50.0, 0.0, 0.0, 0.0)
"""The odometry of a robot whose description has no `odometry`: 50 Hz, without errors."""


def load_robot_description(path: Path = TIAGO) -> RobotDescription:
    """Return the robot described by the JSON file at *path*.

    Raises:
        SimError: The file or its URDF does not exist, or a field is missing, unknown or invalid.
    """
    return read_record(path, "a robot").read_whole(lambda record: _description(record, path.parent))


def _description(record: JsonRecord, folder: Path) -> RobotDescription:
    urdf = folder / record.text("urdf")
    if not urdf.is_file():
        raise record.error(f"'urdf' names {urdf}, but there is no such file")
    return RobotDescription(
        name=record.text("name"),
        urdf=urdf,
        height=record.number("height", over=0.0),
        wheels=record.nested("wheels", _wheels),
        base=record.nested("base", _base),
        odometry=record.nested("odometry", _odometry) if record.has("odometry") else PERFECT,
        laser=record.nested("laser", _laser),
        head=record.nested("head", _head) if record.has("head") else None,
        torso=record.nested("torso", _torso) if record.has("torso") else None,
        camera=record.nested("camera", _camera) if record.has("camera") else None,
        sonar_rate=record.number("sonar_rate", 5.0, over=0.0),
        sonars=tuple(record.nested_list("sonars", _sonar)) if record.has("sonars") else (),
        sonar_latency=_latency(record, "sonar_latency"),
        frames=tuple(record.nested_list("frames", _frame)) if record.has("frames") else (),
        held=tuple(record.nested_list("held", _held)) if record.has("held") else (),
        shells=tuple(record.nested_list("shells", read_shell)) if record.has("shells") else (),
    )


def _point(record: JsonRecord, key: str) -> Point:
    x, y, z = record.numbers(key, [3], [0.0, 0.0, 0.0])
    return x, y, z


def _wheels(record: JsonRecord) -> Wheels:
    return Wheels(
        left=record.text("left"),
        right=record.text("right"),
        radius=record.number("radius", over=0.0),
        separation=record.number("separation", over=0.0),
        torque=record.number("torque", over=0.0),
        ground=tuple(record.texts("ground")),
        sliding=tuple(record.texts("sliding")),
    )


def _base(record: JsonRecord) -> BaseInfo:
    info = BaseInfo(
        v_min=record.number("v_min"),
        v_max=record.number("v_max", over=0.0),
        w_max=record.number("w_max", over=0.0),
        v_rate=record.number("v_rate", over=0.0),
        w_rate=record.number("w_rate", over=0.0),
        command_timeout=record.number("command_timeout", over=0.0),
        radius=record.number("radius", over=0.0),
    )
    if info.v_min > 0.0:
        raise record.error(
            f"'v_min' is {info.v_min:g}, but it has to be at most 0, so that the base can stand"
        )
    return info


def _laser(record: JsonRecord) -> LaserMount:
    rays = record.whole("rays")
    angle_min, angle_max = record.number("angle_min"), record.number("angle_max")
    if angle_max <= angle_min:
        raise record.error("'angle_max' has to be greater than 'angle_min'")
    info = LaserInfo(
        rays=rays,
        angle_min=angle_min,
        angle_increment=(angle_max - angle_min) / max(1, rays - 1),
        range_min=record.number("range_min", over=0.0),
        range_max=record.number("range_max", over=0.0),
        rate=record.number("rate", over=0.0),
        sigma=record.number("sigma", 0.0),
        frame=record.text("frame"),
        range_noise=record.number("range_noise", 0.0),
    )
    errors = LaserErrors(
        *(record.nested("outliers", _outliers) if record.has("outliers") else (0.0, 0.0, 0.0)),
        latency=_latency(record),
    )
    if min(info.sigma, info.range_noise) < 0.0:
        raise record.error("'sigma' and 'range_noise' are standard deviations and have to be at least 0")
    return LaserMount(info, record.text("link"), _point(record, "position"), errors)


def _outliers(record: JsonRecord) -> tuple[float, float, float]:
    shares = record.number("missed", 0.0), record.number("short", 0.0), record.number("edge", 0.0)
    if not all(0.0 <= share <= 1.0 for share in shares):
        raise record.error("'missed', 'short' and 'edge' are shares and have to be from 0 to 1")
    return shares


def _latency(record: JsonRecord, key: str = "latency") -> float:
    latency = record.number(key, 0.0)
    if not 0.0 <= latency <= MAX_LATENCY:
        raise record.error(f"'{key}' is {latency:g} s, but it has to be from 0 to {MAX_LATENCY:g} s")
    return latency


def _head(record: JsonRecord) -> HeadJoints:
    pan_min, pan_max = record.numbers("pan_limits", [2])
    tilt_min, tilt_max = record.numbers("tilt_limits", [2])
    info = HeadInfo(pan_min, pan_max, tilt_min, tilt_max, record.number("speed", over=0.0))
    return HeadJoints(info, record.text("pan"), record.text("tilt"), record.number("torque", over=0.0))


def _camera(record: JsonRecord) -> CameraMount:
    return CameraMount(
        link=record.text("link"),
        position=_point(record, "position"),
        roll=record.number("roll", 0.0),
        fov=record.number("fov", over=0.0),
        near=record.number("near", over=0.0),
        far=record.number("far", over=0.0),
        frame=record.text("frame"),
        latency=_latency(record),
    )


def _torso(record: JsonRecord) -> TorsoJoint:
    low, high = record.numbers("limits", [2])
    if low >= high:
        raise record.error(f"'limits' is [{low:g}, {high:g}], but the second value has to be greater")
    info = TorsoInfo(low, high, record.number("speed", over=0.0))
    return TorsoJoint(info, record.text("joint"), record.number("force", over=0.0))


def _sonar(record: JsonRecord) -> SonarMount:
    mount = SonarMount(
        frame=record.text("frame"),
        link=record.text("link"),
        position=_point(record, "position"),
        yaw=record.number("yaw", 0.0),
        fov=record.number("fov", over=0.0),
        range_min=record.number("range_min", over=0.0),
        range_max=record.number("range_max", over=0.0),
    )
    if mount.range_max <= mount.range_min:
        raise record.error("'range_max' has to be greater than 'range_min'")
    return mount


def _odometry(record: JsonRecord) -> OdometryInfo:
    info = OdometryInfo(
        rate=record.number("rate", PERFECT.rate, over=0.0),
        scale_sigma=record.number("scale_sigma", 0.0),
        slip=record.number("slip", 0.0),
        slip_sigma=record.number("slip_sigma", 0.0),
        latency=_latency(record),
    )
    if min(info.scale_sigma, info.slip_sigma) < 0.0:
        raise record.error("'scale_sigma' and 'slip_sigma' are standard deviations and have to be at least 0")
    return info


def _frame(record: JsonRecord) -> FixedFrame:
    roll, pitch, yaw = record.numbers("rpy", [3], [0.0, 0.0, 0.0])
    name, parent = record.text("name"), record.text("parent")
    return FixedFrame(name, parent, _point(record, "position"), (roll, pitch, yaw))


def _held(record: JsonRecord) -> HeldJoint:
    return HeldJoint(
        joint=record.text("joint"),
        position=record.number("position", 0.0),
        force=record.number("force", over=0.0),
        speed=record.number("speed", over=0.0),
    )
