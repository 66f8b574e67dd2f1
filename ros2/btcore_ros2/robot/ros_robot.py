"""`RosRobot`: a ROS 2 robot as a `Robot`, over its topics."""

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from btcore.clock import NS_PER_S
from btcore_robot import time_limits
from btcore_robot.robot import CameraImage, CameraInfo, Odometry, Phase, RobotClock, Twist2D
from btcore_robot.schedule import RealTimeSchedule, SimulatedSchedule
from btcore_robot.time_limits import MAX_ODOMETRY_AGE_S, is_stale
from btcore_ros2.errors import RosError
from btcore_ros2.robot.description import FrameSources, RosRobotDescription, TopicSource
from btcore_ros2.robot.sim_time import SimTime
from btcore_ros2.robot.stamps import LateMessageError, StampConverter
from btcore_ros2.robot.topic_report import DOMAIN_HINT, has_other_type, sees_others, takes, topic_problem
from btcore_ros2.robot.topic_robot import TopicRobot
from btcore_ros2.robot.velocity import STANDING, VelocityPublishers
from btcore_ros2.session import RosClock, RosSession
from btcore_scene import StaticScene

_log = logging.getLogger(__name__)

SUPERVISION_RATE = 20.0
"""The rate (Hz) at which topics are checked, and expired commands are replaced by zero."""
MISMATCH_TIME_S = 2.0
"""The time (s) after which a topic with another type than expected is an error at the start."""
MAX_CLOCK_SEARCH_S = 0.5
"""The time (s) in which a publisher of `/clock` is searched at the start."""
STABLE_TIME_S = 1.0
"""The time (s) without a failure after which a robot that had failed is available again."""
SHAPES_WAIT_S = 1.0
"""The longest time (s) for which the monitor waits for the robot's description."""


@dataclass(slots=True)
class _Watch:
    """A topic from which messages are expected.

    Attributes:
        topic: The name of the topic.
        message_class: The class of the messages.
        timeout: The longest time (s) without a new message; None = no limit.
        arrival: The time (ns) at which the last new message arrived.
        stamp: The stamp of that message.
        repeats: Whether messages with the same stamp, or with older stamps, have arrived since.
    """

    topic: str
    message_class: type
    timeout: float | None
    arrival: int = -1
    stamp: Any = None
    repeats: bool = False

    def note(self, message: Any, now: int) -> None:
        """Note the arrival of *message* at *now* (ns), unless the message is a repetition."""
        if self.timeout is not None:
            stamp = message.header.stamp
            self.repeats = stamp == self.stamp and bool(stamp.sec or stamp.nanosec)
            self.stamp = stamp
        if not self.repeats:
            self.arrival = now

    def reset(self) -> None:
        """Forget the messages."""
        self.arrival, self.stamp, self.repeats = -1, None, False


class RosRobot(TopicRobot):
    """A robot over ROS 2 topics.

    The constructor waits until the laser, the odometry, the frames and a subscriber of the velocity are
    available. Messages are taken while a caller waits on `clock`. Stamps are converted to that clock.

    When a watched topic stops, or the robot's clock jumps, zero velocity is commanded, and waiting on the
    clock raises a `RosError`, until `recover` was called. While a simulated clock stands still, zero
    velocity is commanded. At the end of a program call `close`, which stops the robot.

    Args:
        session: The ROS node.
        description: The robot's topics and facts.

    Raises:
        RosError: A topic is not available within the description's `start_timeout`, or a message package is
            not installed.
    """

    def __init__(self, session: RosSession, description: RosRobotDescription) -> None:
        super().__init__(description)
        self._session = session
        self._node: Any = session.node
        self._start_deadline = time.monotonic() + description.start_timeout
        self._watches: list[_Watch] = []
        self._watches_camera = False
        self._watches_shapes = False
        self._camera_limit: int | None = None
        self._stopped_by_clock = False
        self._is_recovering = False
        self._may_miss_clock = False
        try:
            self._time = self._choose_time()
            self._publishers = VelocityPublishers(
                session, description.velocity, description.base_frame, self._stamp_message
            )
            self._trajectories = self._publish_trajectories()
            self._subscribe_all()
        except ModuleNotFoundError as missing:
            raise RosError(
                f"the message package '{missing.name}' is not installed: "
                "generate it with `btcore ros2 messages`, or source your ROS 2"
            ) from missing
        self._wait_for_topics()
        self.schedule.add_task(SUPERVISION_RATE, Phase.SENSORS, self._supervise)

    @property
    def clock(self) -> RobotClock:
        """The clock of all stamps; waiting on it takes messages."""
        return self._session.clock if self._time is self._session.clock.schedule else self._time

    @property
    def schedule(self) -> RealTimeSchedule | SimulatedSchedule:
        """The periodic tasks that run while a caller waits on `clock`."""
        return self._time

    def odometry(self) -> Odometry:
        """Return the newest odometry; messages that wait after a long computation are taken first."""
        if is_stale(self._odometry, self.clock.now(), MAX_ODOMETRY_AGE_S):
            self._session.refresh()
        return super().odometry()

    @property
    def camera_info(self) -> CameraInfo | None:
        """The camera's properties, or None without a camera.

        The first use subscribes to the camera, and waits for its `CameraInfo`.

        Raises:
            RosError: No `CameraInfo` arrives within the description's `start_timeout`.
        """
        source = self.description.camera
        if source is None:
            return None
        self._watch_camera()
        if self._camera_info is None and not self._session.wait_for(
            lambda: self._camera_info is not None, self.description.start_timeout
        ):
            from sensor_msgs.msg import CameraInfo as InfoMessage

            topic = self._node.resolve_topic_name(source.info)
            raise RosError(
                f"{topic}: {topic_problem(self._node, topic, InfoMessage)}; "
                f"correct 'camera.info' in {self.description.path}, or remove 'camera'"
            )
        return self._camera_info

    def camera(self) -> CameraImage | None:
        """Return the newest picture, or None while there is no picture.

        The first call subscribes to the camera, and returns None. A camera that sends nothing is reported by
        a warning; leaves that need no picture are not affected.
        """
        if not self._watches_camera:
            self._camera_limit = self._time.now() + round(time_limits.MAX_FIRST_PICTURE_WAIT_S * NS_PER_S)
        self._watch_camera()
        return super().camera()

    def static_scene(self) -> StaticScene:
        """Return the robot's shapes and sensors. The first call subscribes to the robot's description."""
        topic = self.description.frames.robot_description
        if topic is not None and not self._watches_shapes:
            self._watches_shapes = True
            from std_msgs.msg import String

            model = TopicSource(topic=topic, reliability="reliable")
            self._subscribe(String, model, self._receive_shapes, depth=1, latched=True)
            if self._node.count_publishers(self._node.resolve_topic_name(topic)):
                self._session.wait_for(lambda: self._shapes is not None, SHAPES_WAIT_S)
        return super().static_scene()

    def raise_failure(self) -> None:
        """Check the robot, as waiting on `clock` does.

        Raises:
            RosError: The robot has failed.
        """
        if self._failure is not None:
            raise RosError(self._failure)
        if isinstance(self._time, SimTime):
            self._time.check()

    def recover(self, error: RosError, is_cancelled: Callable[[], bool]) -> None:
        """Wait until the robot is available again after a failure.

        `clock` goes on from its present time, even if the robot's clock has jumped. The readings are those
        from before the failure, until new messages arrive.

        Args:
            error: The error that waiting on `clock` has raised.
            is_cancelled: A function that returns whether to end the wait.

        Raises:
            RosError: The session cannot be used. *error*: the robot is in lockstep with its simulation.
        """
        if isinstance(self._time, SimulatedSchedule):
            raise error
        _log.warning("%s; waiting until the robot '%s' is available", error, self.description.name)
        self._velocity.stop(self._time.now())
        self._is_recovering = is_broken = True
        try:
            while not is_cancelled():
                if is_broken:
                    self._start_again()
                is_broken = self._session.wait_for(lambda: is_cancelled() or self._is_broken(), STABLE_TIME_S)
                if not is_broken and self._is_available():
                    _log.warning("the robot '%s' is available again", self.description.name)
                    return
        finally:
            self._is_recovering = False

    def close(self) -> None:
        """Stop the robot if it was driven. Call it before the session is closed."""
        if self._node.context.ok():
            self._velocity.finish(self._time.now())
            self._publishers.wait_for_subscribers()

    def __enter__(self) -> "RosRobot":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # Time

    def _choose_time(self) -> RealTimeSchedule | SimulatedSchedule:
        """Return the time of the simulation if the robot uses it, else that of the session."""
        session, wanted = self._session, self.description.use_sim_time
        if isinstance(session.clock, SimulatedSchedule):  # in lockstep
            self._stamps = StampConverter(shared=True)
            return session.clock
        if wanted is None:
            # The publishers of a robot become visible together, so the clock is searched after the sensors.
            sensors = (self.description.scan.topic, self.description.odometry.topic)
            topics = [self._node.resolve_topic_name(topic) for topic in sensors]
            visible = session.wait_for(
                lambda: any(self._node.count_publishers(topic) for topic in topics),
                self._start_time_left() / 2,
            )
            search = MAX_CLOCK_SEARCH_S if visible else 0.0
            clock = self._node.resolve_topic_name("/clock")
            wanted = session.wait_for(lambda: self._node.count_publishers(clock), search)
        self._stamps = StampConverter(shared=bool(wanted))
        self._may_miss_clock = self.description.use_sim_time is None and not wanted
        if not wanted:
            assert isinstance(session.clock, RosClock)
            return session.clock.schedule
        sim_time = SimTime(session, self._on_standstill)
        if not session.wait_for(lambda: sim_time.has_started, self._start_time_left()):
            from rosgraph_msgs.msg import Clock

            raise RosError(
                f"/clock: {topic_problem(self._node, '/clock', Clock)}; start the simulation, or set "
                f"'use_sim_time: false' in {self.description.path}"
            )
        return sim_time

    def _on_standstill(self, stands: bool) -> None:
        """Stop the robot while its clock stands still, because its commands do not expire in this time."""
        if stands and self.commanded_velocity() != STANDING:
            self._velocity.stop(self._time.now())
            self._stopped_by_clock = True
            _log.warning("the time on /clock does not advance: the robot stands until it advances again")
        elif not stands and self._stopped_by_clock:
            self._stopped_by_clock = False
            _log.warning("the time on /clock advances again")

    def _start_time_left(self) -> float:
        """Return the time (s) that is left until the robot has to be available."""
        return max(0.0, self._start_deadline - time.monotonic())

    def _stamp_message(self) -> Any:
        if isinstance(self._session.clock, RosClock) and self._time is self._session.clock.schedule:
            return self._node.get_clock().now().to_msg()
        from builtin_interfaces.msg import Time

        offset = self._time.offset if isinstance(self._time, SimTime) else 0
        seconds, nanoseconds = divmod(self._time.now() - offset, NS_PER_S)
        return Time(sec=seconds, nanosec=nanoseconds)

    # Subscriptions

    def _subscribe_all(self) -> None:
        from nav_msgs.msg import Odometry as OdometryMessage
        from sensor_msgs.msg import JointState, Range
        from sensor_msgs.msg import LaserScan as ScanMessage

        description = self.description
        self._subscribe(ScanMessage, description.scan, self._receive_scan)
        self._subscribe(OdometryMessage, description.odometry, self._receive_odometry)
        if description.joint_states is not None:
            self._subscribe(JointState, description.joint_states, self._receive_joints)
        self._subscribe_frames(description.frames)
        if description.battery is not None:
            from sensor_msgs.msg import BatteryState as BatteryMessage

            self._subscribe(BatteryMessage, description.battery, self._receive_battery)
        for topic in description.sonars:
            self._subscribe(Range, TopicSource(topic=topic), self._receive_sonar)

    def _subscribe_frames(self, sources: FrameSources) -> None:
        try:
            if sources.tf is None:
                raise ModuleNotFoundError(name="tf2_msgs")
            from tf2_msgs.msg import TFMessage
        except ModuleNotFoundError:
            if sources.robot_description is None:
                raise
            from std_msgs.msg import String

            model = TopicSource(topic=sources.robot_description, reliability="reliable")
            self._subscribe(String, model, self._receive_description, depth=1, latched=True)
            return
        tf = TopicSource(topic=sources.tf, reliability="reliable")
        self._subscribe(TFMessage, tf, partial(self._receive_tf, static=False), depth=100)
        static = TopicSource(topic=sources.tf_static, reliability="reliable")
        receive = partial(self._receive_tf, static=True)
        self._subscribe(TFMessage, static, receive, depth=100, latched=True)

    def _subscribe(
        self,
        message_class: type,
        source: TopicSource,
        receive: Callable[[Any], None],
        *,
        depth: int = 10,
        latched: bool = False,
    ) -> None:
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

        qos = QoSProfile(
            depth=depth,
            reliability=ReliabilityPolicy[source.reliability.upper()],
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )
        watch = _Watch(self._node.resolve_topic_name(source.topic), message_class, source.timeout)
        self._watches.append(watch)

        def received(message: Any) -> None:
            try:
                receive(message)
            except LateMessageError:
                watch.repeats = True
                return
            except RosError as error:
                self._fail(f"{watch.topic}: {error}")
            watch.note(message, self._time.now())

        self._node.create_subscription(
            message_class, source.topic, received, qos, callback_group=self._session.callback_group
        )

    def _watch_camera(self) -> None:
        """Subscribe to the camera, unless that was done before."""
        source = self.description.camera
        if source is None or self._watches_camera:
            return
        from sensor_msgs.msg import CameraInfo as InfoMessage
        from sensor_msgs.msg import Image

        self._watches_camera = True
        self._subscribe(InfoMessage, TopicSource(topic=source.info), self._receive_camera_info)
        self._subscribe(Image, source.image, self._receive_image, depth=1)
        if source.depth is not None:
            self._subscribe(Image, source.depth, self._receive_depth, depth=1)

    # Start and supervision

    def _wait_for_topics(self) -> None:
        """Wait until the robot is complete; raise a RosError that names what is missing."""
        while not self._session.wait_for(self._is_complete, min(MISMATCH_TIME_S, self._start_time_left())):
            if self._has_mismatch() or not self._start_time_left():
                raise RosError(self._missing_report())
        self._start_laser()
        now = self._time.now()
        for watch in self._watches:
            watch.arrival = now
        if self._failure is not None:
            raise RosError(self._failure)

    def _start_again(self) -> None:
        """Forget the failure, the stamps and the arrivals."""
        offset = 0
        if isinstance(self._time, SimTime):
            self._time.follow_jump()
            offset = self._time.offset
        self._stamps = StampConverter(shared=isinstance(self._time, SimTime), offset=offset)
        for watch in self._watches:
            watch.reset()
        self._failure = None

    def _is_broken(self) -> bool:
        """Return whether something has failed since the last call of `_start_again`."""
        return self._failure is not None or (isinstance(self._time, SimTime) and self._time.has_jumped)

    def _is_available(self) -> bool:
        """Return whether messages arrive on all watched topics, and the velocity has a subscriber."""
        try:
            self.raise_failure()
        except RosError:
            return False
        return (
            all(watch.timeout is None or watch.arrival >= 0 for watch in self._watches)
            and not self._silent_topics(self._time.now(), 1.0)
            and self._is_complete()
        )

    def _has_mismatch(self) -> bool:
        """Return whether the robot uses another type for one of the topics."""
        node = self._node
        return any(has_other_type(node, watch.topic, watch.message_class) for watch in self._watches) or (
            has_other_type(node, self._velocity.topic, self._publishers.message_class, published=False)
        )

    def _is_complete(self) -> bool:
        """Return whether all readings have arrived and the velocity has a subscriber."""
        # In this order, since a look at the graph is slow.
        return not self._missing() and self._has_velocity_subscriber()

    def _has_velocity_subscriber(self) -> bool:
        return takes(self._node, self._velocity.topic, self._publishers.message_class)

    def _missing_report(self) -> str:
        description, node = self.description, self._node
        lines = []
        for key in self._missing():
            if key in ("frames", "head", "torso"):
                lines.append(self._missing_reason(key))
            else:
                source = description.scan if key == "scan" else description.odometry
                watch = next(w for w in self._watches if w.topic == node.resolve_topic_name(source.topic))
                lines.append(f"{key}: {watch.topic}: {topic_problem(node, watch.topic, watch.message_class)}")
        if not self._has_velocity_subscriber():
            topic = node.resolve_topic_name(self._velocity.topic)
            problem = topic_problem(node, topic, self._publishers.message_class, published=False)
            lines.append(f"velocity: {topic}: {problem}")
        hint = f"correct {description.path}" if sees_others(node) else DOMAIN_HINT
        details = "".join(f"\n  {line}" for line in lines)
        return f"the robot '{description.name}' is not available:{details}\n  {hint}"

    def _supervise(self, now: int) -> None:
        """Check that all watched topics are alive, and let an old command expire."""
        self._session.refresh()
        now = self._time.now()
        if self._failure is None:
            silent = self._silent_topics(now, 1.0)
            if silent:
                # Topics of a robot that is down reach their limits one after another.
                self._fail(self._silence_message(self._silent_topics(now, 0.5), now))
        if self._failure is not None:
            raise RosError(self._failure)
        self._velocity.expire(now)
        if self._may_miss_clock and self._node.count_publishers(self._node.resolve_topic_name("/clock")):
            self._may_miss_clock = False
            _log.warning(
                "/clock was found only after the start, and is not used: if the robot is simulated, run the "
                "tree again, or set 'use_sim_time: true' in %s",
                self.description.path,
            )
        if self._camera_limit is not None and now > self._camera_limit:
            self._camera_limit = None
            self._warn_without_pictures()

    def _warn_without_pictures(self) -> None:
        """Report a camera that is used, but from which no picture or no `CameraInfo` has arrived."""
        source = self.description.camera
        if source is None or (self._raw_image is not None and self._camera_info is not None):
            return
        from sensor_msgs.msg import CameraInfo as InfoMessage
        from sensor_msgs.msg import Image

        name, message_class = (
            (source.image.topic, Image) if self._raw_image is None else (source.info, InfoMessage)
        )
        topic = self._node.resolve_topic_name(name)
        problem = topic_problem(self._node, topic, message_class)
        _log.warning("there are no pictures: %s: %s; leaves that look for objects find none", topic, problem)

    def _silent_topics(self, now: int, part: float) -> list[_Watch]:
        """Return the watched topics without a message for longer than *part* of their limits."""
        return [
            watch
            for watch in self._watches
            if watch.timeout is not None and now - watch.arrival > part * watch.timeout * NS_PER_S
        ]

    def _silence_message(self, silent: Sequence[_Watch], now: int) -> str:
        parts = [
            f"{watch.topic}: no {'new ' if watch.repeats else ''}message for "
            f"{(now - watch.arrival) / NS_PER_S:.1f} s (limit {watch.timeout:g} s)"
            for watch in silent
        ]
        everything = len(silent) == sum(watch.timeout is not None for watch in self._watches)
        cause = "the robot or the network is down" if everything else "its driver has stopped"
        if any(watch.repeats for watch in silent):
            cause = "its stamps do not advance, so a driver or a bridge repeats old messages"
        return f"{'; '.join(parts)}: {cause}"

    def _fail(self, reason: str) -> None:
        """Stop the robot, and let the next wait on the clock raise an error."""
        if self._failure is None:
            self._failure = f"{reason}; zero velocity was commanded"
            if not self._is_recovering:
                self._velocity.stop(self._time.now())
                _log.error("%s", self._failure)

    # Commands

    def _publish_trajectories(self) -> dict[str, Any]:
        parts = (self.description.head, self.description.torso)
        topics = [part.topic for part in parts if part is not None]
        if not topics:
            return {}
        from trajectory_msgs.msg import JointTrajectory

        return {topic: self._node.create_publisher(JointTrajectory, topic, 10) for topic in topics}

    def _publish_velocity(self, topic: str, twist: Twist2D) -> None:
        self._publishers.publish(topic, twist)

    def _move_joints(self, topic: str, positions: dict[str, float], seconds: float) -> None:
        from builtin_interfaces.msg import Duration
        from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

        whole, rest = divmod(round(max(seconds, 0.1) * NS_PER_S), NS_PER_S)
        point = JointTrajectoryPoint(
            positions=list(positions.values()), time_from_start=Duration(sec=whole, nanosec=rest)
        )
        self._trajectories[topic].publish(JointTrajectory(joint_names=list(positions), points=[point]))
