"""The description of a ROS 2 robot, from a YAML file: its topics, and the facts that no topic has."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from btcore.suggestions import did_you_mean
from btcore.typed_data import FieldError, Positive, convert
from btcore_robot.data_files import yaml_data
from btcore_robot.robot import BaseInfo, HeadInfo, TorsoInfo
from btcore_robot.time_limits import MAX_TOPIC_SILENCE_S
from btcore_ros2.errors import RosError

__all__ = ["RosRobotDescription", "bundled_robots", "load_robot"]

FOLDER = Path(__file__).parent
"""The folder of the bundled descriptions."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicSource:
    """A topic from which readings come.

    Attributes:
        topic: The name.
        reliability: The reliability of the subscription; best effort receives from publishers of both kinds.
        timeout: The time (s) without a message after which the run ends; None = the topic is not watched.
    """

    topic: str
    reliability: Literal["best_effort", "reliable"] = "best_effort"
    timeout: Positive | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchedSource(TopicSource):
    """A topic that is watched by default."""

    timeout: Positive | None = MAX_TOPIC_SILENCE_S


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanSource(WatchedSource):
    """The laser: its topic, and the *rate* (Hz) and noise, which no message contains.

    *sigma* (m) and *range_noise* are the standard deviations of `LaserInfo`.
    """

    rate: Positive
    sigma: float = 0.0
    range_noise: float = 0.0


@dataclass(frozen=True, slots=True)
class VelocityTopics:
    """The topics for velocity commands: their type, and their priorities by name."""

    type: Literal["Twist", "TwistStamped"]
    topics: Annotated[dict[str, int], Meta(min_length=1)]


@dataclass(frozen=True, slots=True)
class FrameSources:
    """The topics with the poses of links and sensors; None = not available.

    Either *tf* and *tf_static*, or *robot_description* together with the joint states, are given.
    """

    tf: str | None = None
    tf_static: str = "/tf_static"
    robot_description: str | None = None

    def __post_init__(self) -> None:
        if self.tf is None and self.robot_description is None:
            raise FieldError("tf", "is missing: name the topic /tf, or 'robot_description'")


def _check_limits(key: str, limits: tuple[float, float]) -> None:
    if limits[0] >= limits[1]:
        raise FieldError(key, f"is {list(limits)}, and the second value has to be greater")


@dataclass(frozen=True, slots=True)
class HeadControl:
    """The trajectory *topic* of the head, its *joints* pan and tilt, and their limits (rad, rad/s)."""

    topic: str
    joints: tuple[str, str]
    pan_limits: tuple[float, float]
    tilt_limits: tuple[float, float]
    speed: Positive

    def __post_init__(self) -> None:
        _check_limits("pan_limits", self.pan_limits)
        _check_limits("tilt_limits", self.tilt_limits)

    @property
    def info(self) -> HeadInfo:
        """The limits."""
        return HeadInfo(*self.pan_limits, *self.tilt_limits, self.speed)


@dataclass(frozen=True, slots=True)
class TorsoControl:
    """The trajectory *topic* of the torso, its *joint*, and its limits (m, m/s)."""

    topic: str
    joint: str
    limits: tuple[float, float]
    speed: Positive

    def __post_init__(self) -> None:
        _check_limits("limits", self.limits)

    @property
    def info(self) -> TorsoInfo:
        """The limits."""
        return TorsoInfo(*self.limits, self.speed)


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSource:
    """The topics of a camera.

    Attributes:
        image: The pictures.
        info: The topic of `CameraInfo`.
        depth: The depth pictures, or None.
        near: The smallest depth (m).
        far: The greatest depth (m).
        rate: The rate of pictures (Hz).
    """

    image: TopicSource
    info: str
    depth: TopicSource | None = None
    near: Positive
    far: Positive
    rate: Positive

    def __post_init__(self) -> None:
        if self.near >= self.far:
            raise FieldError("far", f"is {self.far:g}, and it has to be greater than 'near'")


@dataclass(frozen=True, slots=True, kw_only=True)
class BatterySource(TopicSource):
    """The battery: its topic, and the *full* value of `percentage`, which is 1 by ROS's definition."""

    full: Positive = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RosRobotDescription:
    """A ROS 2 robot.

    Attributes:
        path: The file of the description.
        name: The name of the robot.
        use_sim_time: Whether the robot's clock is the topic `/clock`; None = if that topic is published.
        start_timeout: The time (s) within which all topics have to be available.
        odom_frame: The robot's name of the odometry frame.
        base_frame: The robot's name of the frame on the floor below the centre of the base.
        base: The limits and the size of the base.
        scan: The laser.
        odometry: The odometry.
        velocity: The velocity commands.
        frames: The frames.
        joint_states: The positions of the joints, or None.
        head: The head, or None.
        torso: The torso, or None.
        camera: The camera, or None.
        battery: The battery, or None.
        sonars: The topics of the sonars.
    """

    path: Path = field(default_factory=Path)
    name: str
    use_sim_time: bool | None = None
    start_timeout: Positive = 10.0
    odom_frame: str = "odom"
    base_frame: str = "base_footprint"
    base: BaseInfo
    scan: ScanSource
    odometry: WatchedSource
    velocity: VelocityTopics
    frames: FrameSources
    joint_states: TopicSource | None = None
    head: HeadControl | None = None
    torso: TorsoControl | None = None
    camera: CameraSource | None = None
    battery: BatterySource | None = None
    sonars: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.joint_states is None:
            for key, part in {"head": self.head, "torso": self.torso}.items():
                if part is not None:
                    raise FieldError(key, "needs the positions of its joints: add 'joint_states'")
            if self.frames.robot_description is not None and self.frames.tf is None:
                raise FieldError("frames", "needs the positions of the joints: add 'joint_states'")


def bundled_robots() -> list[str]:
    """Return the names of the bundled descriptions."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def load_robot(name: str | Path) -> RosRobotDescription:
    """Return the description of a robot.

    Args:
        name: A YAML file, or the name of a bundled description, for example `tiago`.

    Raises:
        RosError: The file does not exist, or a key is missing, unknown or invalid.
    """
    path = Path(name)
    known = bundled_robots()
    if str(name) in known and not path.is_file():
        path = FOLDER / f"{name}.yaml"
    elif path.suffix not in (".yaml", ".yml") and not path.exists():
        hint = did_you_mean(str(name), known)
        raise RosError(f"there is no robot '{name}': known are {', '.join(known)}, or name a YAML file{hint}")
    with yaml_data(path, "a ROS 2 robot", RosError) as data:
        return convert({**data, "path": str(path)}, RosRobotDescription)
