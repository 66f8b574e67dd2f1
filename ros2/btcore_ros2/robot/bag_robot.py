"""`BagRobot`: a robot whose sensor readings come from a bag, without ROS."""

import math
import threading
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

from btcore.clock import NS_PER_S
from btcore.errors import EndOfTimeError
from btcore_bags.reader import BagReader
from btcore_robot.robot import CameraImage, CameraInfo, Phase, Twist2D
from btcore_robot.schedule import SimulatedSchedule
from btcore_ros2.errors import RosError
from btcore_ros2.robot.command_comparison import CommandComparison
from btcore_ros2.robot.description import FrameSources, RosRobotDescription, TopicSource
from btcore_ros2.robot.stamps import LateMessageError
from btcore_ros2.robot.topic_robot import TopicRobot

SUPERVISION_RATE = 20.0
"""The rate (Hz) at which topics are checked, and commands expire, as of a `RosRobot`."""

CLOCK = "/clock"

_LASER, _ODOMETRY, _JOINTS, _TF, _TEXT, _BATTERY, _RANGE, _CAMERA_INFO, _IMAGE, _TRAJECTORY = (
    "sensor_msgs/msg/LaserScan",
    "nav_msgs/msg/Odometry",
    "sensor_msgs/msg/JointState",
    "tf2_msgs/msg/TFMessage",
    "std_msgs/msg/String",
    "sensor_msgs/msg/BatteryState",
    "sensor_msgs/msg/Range",
    "sensor_msgs/msg/CameraInfo",
    "sensor_msgs/msg/Image",
    "trajectory_msgs/msg/JointTrajectory",
)
_CLOCK_TYPE = "rosgraph_msgs/msg/Clock"
_TWIST_TYPES = ("geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped")


BagMessage = tuple[str, int, bytes]
"""A message of a bag: its topic, its stamp (ns), and its content."""


class BagTime(SimulatedSchedule):
    """The time of the messages of a bag, and the periodic tasks on it.

    Waiting passes on the messages up to the end of the wait, at the times of their stamps. After the last
    message, waiting raises an EndOfTimeError.

    Args:
        messages: The messages in the order of their stamps.
        receive: Called with the topic and the content of each message.
    """

    def __init__(self, messages: Iterator[BagMessage], receive: Callable[[str, bytes], None]) -> None:
        self._messages = messages
        self._receive = receive
        self._next = next(messages, None)
        super().__init__(start=0 if self._next is None else self._next[1], pace=self._play)

    def advance(self) -> bool:
        """Pass on the next message; return whether there was one."""
        if self._next is None:
            return False
        topic, stamp, data = self._next
        self._now = max(self._now, stamp)
        self._receive(topic, data)
        self._next = next(self._messages, None)
        return True

    def finish_moment(self) -> None:
        """Pass on the messages with the present time."""
        while self._next is not None and self._next[1] <= self._now:
            self.advance()

    def _play(self, now: int, until: int, wake: threading.Event) -> bool:
        """Pass on the messages up to *until* (ns); see `SimulatedSchedule`."""
        while self._next is not None and self._next[1] <= until and not wake.is_set():
            self.advance()
        if self._next is None:
            raise EndOfTimeError("the bag has ended")
        return wake.is_set()


class BagRobot(TopicRobot):
    """A robot that was recorded: its readings come from a bag, and its commands go nowhere.

    The clock jumps from message to message. Its time is that at which the messages were recorded, or that of
    the recorded topic `/clock` if the description has `use_sim_time`, or leaves it open and the bag contains
    the topic. The run begins when scan, odometry, frames and joints are complete. At the end of the bag, and
    when a watched topic stops, waiting on the clock raises an EndOfTimeError.

    The commands are compared with the recorded commands on the same topics. The readings do not depend on
    the commands: after a decision that differs from the recorded decision, the readings no longer fit.

    Args:
        description: The robot's topics and facts.

    Attributes:
        warning: Why the run ended before the end of the bag, or "".

    Raises:
        LogError: The bag is damaged.
        RosError: The bag lacks a topic, or a topic has another type.
    """

    def __init__(self, reader: BagReader, description: RosRobotDescription) -> None:
        self._reader = reader
        self.warning = ""
        use_clock = description.use_sim_time
        if use_clock is None:
            use_clock = reader.topics.get(CLOCK) == _CLOCK_TYPE
        super().__init__(description, shared_clock=use_clock)
        self._comparison = CommandComparison(round(description.base.command_timeout / 2 * NS_PER_S))
        self._receivers: dict[str, Callable[[Any], None]] = {}
        self._problems: list[str] = []
        self._arrivals: dict[str, int] = {}
        self._timeouts: dict[str, float] = {}
        self._watches_camera = False
        self._cameras: set[str] = set()
        self._take_readings()
        self._take_commands()
        if use_clock:
            self._take("use_sim_time", CLOCK, (_CLOCK_TYPE,), lambda message: None, required=True)
        if self._problems:
            raise RosError(self._report(self._problems))
        messages = reader.messages(self._receivers)
        self._time = BagTime(self._on_clock(messages) if use_clock else messages, self._receive)
        self._play_start()
        self._start = self._time.now()
        self._time.add_task(SUPERVISION_RATE, Phase.SENSORS, self._supervise)

    @property
    def clock(self) -> BagTime:
        """The time of the bag; waiting on it passes on messages."""
        return self._time

    @property
    def schedule(self) -> BagTime:
        """The periodic tasks that run while a caller waits on `clock`."""
        return self._time

    @property
    def camera_info(self) -> CameraInfo | None:
        """The camera's properties, or None if the bag does not contain them."""
        self._watches_camera = True
        return super().camera_info

    def camera(self) -> CameraImage | None:
        """Return the newest picture since the first call, or the first use of `camera_info`."""
        self._watches_camera = True
        return super().camera()

    def compare_commands(self) -> dict[str, object]:
        """Return the comparison of the commands until now with the recorded commands, by topic.

        The commands at the present time do not count: among them is the stop at the end of a run.
        """
        return self._comparison.report(self._start, self._time.now())

    def close(self) -> None:
        """Close the bag."""
        self._reader.close()

    def __enter__(self) -> "BagRobot":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # Topics

    def _take_readings(self) -> None:
        """Choose the receivers of the sensors' topics."""
        description, take = self.description, self._take
        self._watch("scan", description.scan, _LASER, self._receive_scan)
        self._watch("odometry", description.odometry, _ODOMETRY, self._receive_odometry)
        if description.joint_states is not None:
            take("joint_states", description.joint_states.topic, (_JOINTS,), self._receive_joints)
        self._take_frames(description.frames)
        if description.battery is not None:
            take("battery", description.battery.topic, (_BATTERY,), self._receive_battery)
        for topic in description.sonars:
            take("sonars", topic, (_RANGE,), self._receive_sonar)
        camera = description.camera
        if camera is not None:
            take("camera.image", camera.image.topic, (_IMAGE,), self._receive_image)
            self._cameras.add(_resolved(camera.image.topic))
            if camera.depth is not None:
                take("camera.depth", camera.depth.topic, (_IMAGE,), self._receive_depth)
                self._cameras.add(_resolved(camera.depth.topic))
            self._read_camera_info(_resolved(camera.info))

    def _take_frames(self, sources: FrameSources) -> None:
        """Choose the receivers of the frames: transforms, or the URDF if the bag lacks transforms."""
        model, tf, static = sources.robot_description, sources.tf, sources.tf_static
        has_transforms = all(
            name is not None and _resolved(name) in self._reader.topics for name in (tf, static)
        )
        if model is not None and not has_transforms:
            receive = self._receive_description
            self._take("frames.robot_description", model, (_TEXT,), receive, required=tf is None)
            if _resolved(model) in self._reader.topics:
                return
        if tf is not None:
            self._take("frames.tf", tf, (_TF,), partial(self._receive_tf, static=False), required=True)
            self._take("frames.tf_static", static, (_TF,), partial(self._receive_tf, static=True))

    def _take_commands(self) -> None:
        """Choose the receivers of the topics for commands."""
        description = self.description
        for topic in description.velocity.topics:
            self._take("velocity", topic, _TWIST_TYPES, partial(self._receive_velocity, topic))
        for control in (description.head, description.torso):
            if control is not None:
                receive = partial(self._receive_trajectory, control.topic)
                self._take("head or torso", control.topic, (_TRAJECTORY,), receive)

    def _watch(
        self, key: str, source: TopicSource, message_type: str, receive: Callable[[Any], None]
    ) -> None:
        self._take(key, source.topic, (message_type,), receive, required=True)
        if source.timeout is not None:
            self._timeouts[_resolved(source.topic)] = source.timeout

    def _take(
        self,
        key: str,
        topic: str,
        message_types: tuple[str, ...],
        receive: Callable[[Any], None],
        *,
        required: bool = False,
    ) -> None:
        """Let *receive* take the messages on *topic*; note a problem for the *key* of the description."""
        topics, topic = self._reader.topics, _resolved(topic)
        topic_type = topics.get(topic)
        if topic_type in message_types:
            self._receivers[topic] = receive
        elif topic_type is not None:
            self._problems.append(
                f"{key}: {topic} is {topic_type}, but {' or '.join(message_types)} is expected"
            )
        elif required:
            others = ", ".join(sorted(name for name, other in topics.items() if other in message_types))
            alternatives = f"; topics of {message_types[0]}: {others}" if others else ""
            self._problems.append(f"{key}: the bag has no topic {topic}{alternatives}")

    def _read_camera_info(self, topic: str) -> None:
        """Read the first `CameraInfo`, which a tree may need at its start."""
        if self._reader.topics.get(topic) == _CAMERA_INFO:
            for _, _, data in self._reader.messages((topic,)):
                self._receive_camera_info(self._reader.decode(topic, data))
                return

    def _report(self, problems: list[str]) -> str:
        details = "".join(f"\n  {problem}" for problem in problems)
        return (
            f"{self._reader.path}: this is not a bag of the robot '{self.description.name}':{details}\n"
            f"  describe the recorded robot in a copy of {self.description.path} (--ros2)"
        )

    # Messages

    def _on_clock(self, messages: Iterator[BagMessage]) -> Iterator[BagMessage]:
        """Yield *messages* with the time of `/clock` instead of their stamps.

        The stamps are kept if they are the time of the simulation already, as with `ros2 bag record
        --use-sim-time`.
        """
        first = next(self._reader.messages((CLOCK,)), None)
        if first is None:
            raise RosError(self._report([f"use_sim_time: the bag has no message on {CLOCK}"]))
        _, stamp, data = first
        now = self._clock_time(data)
        if abs(now - stamp) < NS_PER_S:
            yield from messages
            return
        for topic, _, data in messages:
            if topic == CLOCK:
                before, now = now, self._clock_time(data)
                if now < before:
                    raise RosError(
                        f"{self._reader.path}: {CLOCK} jumped back by {(before - now) / NS_PER_S:.1f} s: the "
                        "simulation was reset while it was recorded"
                    )
            else:
                yield topic, now, data

    def _clock_time(self, data: bytes) -> int:
        """Return the time (ns) in a message of `/clock`."""
        time = self._reader.decode(CLOCK, data).clock
        return int(time.sec * NS_PER_S + time.nanosec)

    def _receive(self, topic: str, data: bytes) -> None:
        self._arrivals[topic] = self._time.now()
        if topic in self._cameras and not self._watches_camera:
            return
        message = self._reader.decode(topic, data)
        try:
            self._receivers[topic](message)
        except LateMessageError:
            return
        except RosError as error:
            raise RosError(f"{self._reader.path}: {topic}: {error}") from None

    def _receive_velocity(self, topic: str, message: Any) -> None:
        twist = getattr(message, "twist", message)
        values = {"v": twist.linear.x, "w": twist.angular.z}
        if all(map(math.isfinite, values.values())):
            self._comparison.add_recorded(_resolved(topic), self._time.now(), values)

    def _receive_trajectory(self, topic: str, message: Any) -> None:
        if message.points:
            positions = dict(zip(message.joint_names, map(float, message.points[-1].positions), strict=False))
            names = self._joints_of(topic)
            if all(math.isfinite(positions.get(name, math.nan)) for name in names):
                values = {name: positions[name] for name in names}
                self._comparison.add_recorded(_resolved(topic), self._time.now(), values)

    def _joints_of(self, topic: str) -> tuple[str, ...]:
        """Return the joints that are moved by trajectories on *topic*."""
        head, torso = self.description.head, self.description.torso
        if head is not None and head.topic == topic:
            return head.joints
        return (torso.joint,) if torso is not None else ()

    # Commands

    def _publish_velocity(self, topic: str, twist: Twist2D) -> None:
        self._comparison.add_sent(_resolved(topic), self._time.now(), {"v": twist.v, "w": twist.w})

    def _move_joints(self, topic: str, positions: Mapping[str, float], seconds: float) -> None:
        self._comparison.add_sent(_resolved(topic), self._time.now(), positions)

    # The start, and supervision

    def _play_start(self) -> None:
        """Pass on messages until the robot is complete; the rest of that moment is passed on, too."""
        while self._missing():
            if not self._time.advance():
                raise RosError(self._report([self._missing_reason(key) for key in self._missing()]))
        self._start_laser()
        self._time.finish_moment()

    def _missing_reason(self, key: str) -> str:
        topics = {"scan": self.description.scan.topic, "odometry": self.description.odometry.topic}
        if key in topics:
            return f"{key}: the bag has no message on {_resolved(topics[key])}"
        return super()._missing_reason(key)

    def _supervise(self, now: int) -> None:
        """End the run if a watched topic has stopped, and let an old command expire."""
        for topic, timeout in self._timeouts.items():
            silence = (now - self._arrivals[topic]) / NS_PER_S
            if silence > timeout:
                seconds = (now - self._start) / NS_PER_S
                self.warning = (
                    f"{self._reader.path}: the run ends after {seconds:.1f} s, because {topic} has no "
                    f"message for {silence:.1f} s (limit {timeout:g} s)"
                )
                raise EndOfTimeError(self.warning)
        self._velocity.expire(now)


def _resolved(topic: str) -> str:
    """Return the name of a topic in a bag."""
    return topic if topic.startswith("/") else f"/{topic}"
