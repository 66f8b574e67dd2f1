"""The description of a ROS 2 robot, from a YAML file: its topics, and the facts that no topic has."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from btcore_robot.field_reader import did_you_mean
from btcore_robot.robot import BaseInfo, HeadInfo, TorsoInfo
from btcore_robot.time_limits import TOPIC
from btcore_ros2.errors import RosError
from btcore_ros2.robot.yaml_map import YamlMap, read_yaml_map

__all__ = ["RosRobotDescription", "bundled_robots", "load_robot"]

FOLDER = Path(__file__).parent
"""The folder of the bundled descriptions."""

RELIABILITIES = ("best_effort", "reliable")


@dataclass(frozen=True, slots=True)
class TopicSource:
    """A topic from which readings come.

    Attributes:
        topic: The name.
        reliable: Whether the subscription is reliable; otherwise it is best effort, which receives from
            publishers of both kinds.
        timeout: The time (s) without a message after which the run ends; None = the topic is not watched.
    """

    topic: str
    reliable: bool = False
    timeout: float | None = None


@dataclass(frozen=True, slots=True)
class ScanSource:
    """The laser: its *source*, and the *rate* (Hz) and noise, which no message contains.

    *sigma* (m) and *range_noise* are the standard deviations of `LaserInfo`.
    """

    source: TopicSource
    rate: float
    sigma: float
    range_noise: float = 0.0


@dataclass(frozen=True, slots=True)
class VelocityTopics:
    """The topics for velocity commands: *priorities* by topic, and whether they are TwistStamped."""

    priorities: dict[str, int]
    stamped: bool


@dataclass(frozen=True, slots=True)
class FrameSources:
    """The topics with the poses of links and sensors; None = not available.

    Either *tf* and *tf_static*, or *robot_description* together with the joint states, are given.
    """

    tf: str | None
    tf_static: str | None
    robot_description: str | None


@dataclass(frozen=True, slots=True)
class HeadControl:
    """The trajectory *topic* of the head, the joints *pan* and *tilt*, and the limits *info*."""

    topic: str
    pan: str
    tilt: str
    info: HeadInfo


@dataclass(frozen=True, slots=True)
class TorsoControl:
    """The trajectory *topic* of the torso, its *joint*, and the limits *info*."""

    topic: str
    joint: str
    info: TorsoInfo


@dataclass(frozen=True, slots=True)
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
    depth: TopicSource | None
    near: float
    far: float
    rate: float


@dataclass(frozen=True, slots=True)
class BatterySource:
    """The battery: its *source*, and the *full* value of `percentage`, which is 1 by ROS's definition."""

    source: TopicSource
    full: float


@dataclass(frozen=True, slots=True)
class RosRobotDescription:
    """A ROS 2 robot.

    Attributes:
        path: The file from which the description was read.
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

    path: Path
    name: str
    use_sim_time: bool | None
    start_timeout: float
    odom_frame: str
    base_frame: str
    base: BaseInfo
    scan: ScanSource
    odometry: TopicSource
    velocity: VelocityTopics
    frames: FrameSources
    joint_states: TopicSource | None
    head: HeadControl | None
    torso: TorsoControl | None
    camera: CameraSource | None
    battery: BatterySource | None
    sonars: Sequence[TopicSource]


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
        raise RosError(f"there is no robot '{name}': {hint}known are {', '.join(known)}, or name a YAML file")
    return read_yaml_map(path, "a ROS 2 robot").read_whole(lambda entries: _description(entries, path))


def _description(entries: YamlMap, path: Path) -> RosRobotDescription:
    description = RosRobotDescription(
        path=path,
        name=entries.text("name"),
        use_sim_time=entries.flag("use_sim_time"),
        start_timeout=entries.number("start_timeout", 10.0, over=0.0),
        odom_frame=entries.text("odom_frame", "odom"),
        base_frame=entries.text("base_frame", "base_footprint"),
        base=entries.nested("base", _base),
        scan=entries.nested("scan", _scan),
        odometry=entries.nested("odometry", _watched),
        velocity=entries.nested("velocity", _velocity),
        frames=entries.nested("frames", _frames),
        joint_states=entries.nested("joint_states", _source) if entries.has("joint_states") else None,
        head=entries.nested("head", _head) if entries.has("head") else None,
        torso=entries.nested("torso", _torso) if entries.has("torso") else None,
        camera=entries.nested("camera", _camera) if entries.has("camera") else None,
        battery=entries.nested("battery", _battery) if entries.has("battery") else None,
        sonars=tuple(TopicSource(topic) for topic in entries.texts("sonars"))
        if entries.has("sonars")
        else (),
    )
    if description.joint_states is None:
        users = {"head": description.head, "torso": description.torso}
        for key, part in users.items():
            if part is not None:
                raise entries.mistake(key, "needs the positions of its joints: add 'joint_states'")
        if description.frames.robot_description is not None and description.frames.tf is None:
            raise entries.mistake("frames", "needs the positions of the joints: add 'joint_states'")
    return description


def _base(entries: YamlMap) -> BaseInfo:
    base = BaseInfo(
        v_min=entries.number("v_min"),
        v_max=entries.number("v_max", over=0.0),
        w_max=entries.number("w_max", over=0.0),
        v_rate=entries.number("v_rate", over=0.0),
        w_rate=entries.number("w_rate", over=0.0),
        command_timeout=entries.number("command_timeout", over=0.0),
        radius=entries.number("radius", over=0.0),
    )
    if base.v_min > 0.0:
        raise entries.mistake("v_min", f"is {base.v_min:g}, and it has to be at most 0: the base can stand")
    if base.command_timeout > 1.0:
        raise entries.mistake("command_timeout", f"is {base.command_timeout:g}, and it has to be at most 1 s")
    return base


def _source(entries: YamlMap, timeout: float | None = None) -> TopicSource:
    """Read a topic; *timeout* is the default of its time limit."""
    if entries.has("timeout") or timeout is not None:
        timeout = entries.number("timeout", timeout, over=0.0)
    reliability = entries.text("reliability", "best_effort", among=RELIABILITIES)
    return TopicSource(entries.text("topic"), reliability == "reliable", timeout)


def _watched(entries: YamlMap) -> TopicSource:
    return _source(entries, TOPIC)


def _scan(entries: YamlMap) -> ScanSource:
    return ScanSource(
        source=_watched(entries),
        rate=entries.number("rate", over=0.0),
        sigma=entries.number("sigma", 0.0),
        range_noise=entries.number("range_noise", 0.0),
    )


def _velocity(entries: YamlMap) -> VelocityTopics:
    stamped = entries.text("type", among=("Twist", "TwistStamped")) == "TwistStamped"
    priorities = entries.nested("topics", _priorities)
    if not priorities:
        raise entries.mistake("topics", "names no topic: write {/cmd_vel: 10}")
    return VelocityTopics(priorities, stamped)


def _priorities(entries: YamlMap) -> dict[str, int]:
    priorities: dict[str, int] = {}
    for topic in entries.names():
        priority = entries.number(topic)
        if priority != round(priority):
            raise entries.mistake(topic, f"is {priority:g}, and a priority is a whole number")
        priorities[topic] = round(priority)
    return priorities


def _frames(entries: YamlMap) -> FrameSources:
    tf = entries.text("tf") if entries.has("tf") else None
    model = entries.text("robot_description") if entries.has("robot_description") else None
    if tf is None and model is None:
        raise entries.mistake("tf", "is missing: name the topic /tf, or 'robot_description'")
    return FrameSources(tf, entries.text("tf_static", "/tf_static") if tf is not None else None, model)


def _limits(entries: YamlMap, key: str) -> tuple[float, float]:
    low, high = entries.numbers(key, [2])
    if low >= high:
        raise entries.mistake(key, f"is [{low:g}, {high:g}], and the second value has to be greater")
    return low, high


def _head(entries: YamlMap) -> HeadControl:
    pan, tilt = entries.texts("joints", [2])
    limits = *_limits(entries, "pan_limits"), *_limits(entries, "tilt_limits")
    return HeadControl(entries.text("topic"), pan, tilt, HeadInfo(*limits, entries.number("speed", over=0.0)))


def _torso(entries: YamlMap) -> TorsoControl:
    info = TorsoInfo(*_limits(entries, "limits"), entries.number("speed", over=0.0))
    return TorsoControl(entries.text("topic"), entries.text("joint"), info)


def _camera(entries: YamlMap) -> CameraSource:
    camera = CameraSource(
        image=entries.nested("image", _source),
        info=entries.text("info"),
        depth=entries.nested("depth", _source) if entries.has("depth") else None,
        near=entries.number("near", over=0.0),
        far=entries.number("far", over=0.0),
        rate=entries.number("rate", over=0.0),
    )
    if camera.near >= camera.far:
        raise entries.mistake("far", f"is {camera.far:g}, and it has to be greater than 'near'")
    return camera


def _battery(entries: YamlMap) -> BatterySource:
    return BatterySource(_source(entries), entries.number("full", 1.0, over=0.0))
