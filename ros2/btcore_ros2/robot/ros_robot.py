"""`RosRobot`: a ROS 2 robot as a `Robot`, over its topics."""

import logging
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from btcore_robot.rigid_transform import Transform
from btcore_robot.robot import (
    CMD_VEL,
    NS_PER_S,
    BaseInfo,
    BatteryState,
    CameraImage,
    CameraInfo,
    HeadInfo,
    HeadPosition,
    LaserInfo,
    LaserScan,
    Odometry,
    Phase,
    Pose2D,
    Robot,
    RobotClock,
    SonarReading,
    TorsoInfo,
    TransformStamped,
    Twist2D,
)
from btcore_robot.schedule import RealTime, SimulatedTime
from btcore_ros2.errors import RosError
from btcore_ros2.robot.conversions import (
    ScanConverter,
    battery_level,
    camera_info_of,
    depth_of,
    rgb_of,
    sonar_of,
)
from btcore_ros2.robot.description import FrameSources, RosRobotDescription, TopicSource
from btcore_ros2.robot.frames import FOOTPRINT, FrameStore, pose_of
from btcore_ros2.robot.sim_time import SimTime
from btcore_ros2.robot.stamps import StampConverter
from btcore_ros2.robot.topic_report import DOMAIN_HINT, has_other_type, sees_others, takes, topic_problem
from btcore_ros2.robot.urdf import UrdfJoint, read_urdf
from btcore_ros2.robot.velocity import VelocityCommands, check_finite
from btcore_ros2.session import RosClock, RosSession

_log = logging.getLogger(__name__)

SUPERVISION_RATE = 20.0
"""The rate (Hz) at which topics are checked, and expired commands are replaced by zero."""
MISMATCH_TIME = 2.0
"""The time (s) after which a topic with another type than expected is an error at the start."""
CLOCK_SEARCH = 0.5
"""The time (s) in which a publisher of `/clock` is searched at the start."""
PAIRED = NS_PER_S // 10
"""The greatest difference (ns) between the stamps of a picture and its depth."""


@dataclass(slots=True)
class _Watch:
    """A topic from which messages are expected: the time *arrival* (ns) of the last message."""

    topic: str
    kind: type
    timeout: float | None
    arrival: int = -1


class RosRobot(Robot):
    """A robot over ROS 2 topics.

    The constructor waits until the laser, the odometry, the frames and a subscriber of the velocity are
    available. Messages are taken while a caller waits on `clock`. Stamps are converted to that clock.

    When a watched topic stops, or the robot's clock jumps, the robot is told to stop, and waiting on the
    clock raises a `RosError`. At the end of a program call `close`, which stops the robot.

    Args:
        session: The ROS node.
        description: The robot's topics and facts.

    Attributes:
        description: The robot's topics and facts.

    Raises:
        RosError: A topic is not available within the description's `start_timeout`, or a message package is
            not installed.
    """

    def __init__(self, session: RosSession, description: RosRobotDescription) -> None:
        self.description = description
        self._session = session
        self._node: Any = session.node
        self._failure: str | None = None
        self._start_deadline = time.monotonic() + description.start_timeout
        self._watches: list[_Watch] = []
        self._scans: ScanConverter | None = None
        self._raw_scan: tuple[Any, int] | None = None
        self._pending_scan: LaserScan | None = None
        self._scan: LaserScan | None = None
        self._odometry: Odometry | None = None
        self._frames = FrameStore(description.base_frame, description.odom_frame)
        self._joints: dict[str, tuple[float, int]] = {}
        self._moving_joints: dict[str, UrdfJoint] = {}
        self._battery: BatteryState | None = None
        self._sonars: dict[str, SonarReading] = {}
        self._camera_info: CameraInfo | None = None
        self._raw_image: tuple[Any, int] | None = None
        self._raw_depth: tuple[Any, int] | None = None
        self._image: CameraImage | None = None
        self._watches_camera = False
        try:
            self._time = self._choose_time()
            self._velocity = VelocityCommands(
                session, description.velocity, description.base, description.base_frame, self._stamp_message
            )
            self._trajectories = self._publish_trajectories()
            self._subscribe_all()
        except ModuleNotFoundError as missing:
            raise RosError(
                f"the message package '{missing.name}' is not installed: "
                "generate it with `btcore ros2 messages`, or source your ROS 2"
            ) from missing
        self._wait_for_topics()
        self.schedule.every(SUPERVISION_RATE, Phase.SENSORS, self._supervise)

    @property
    def clock(self) -> RobotClock:
        """The clock of all stamps; waiting on it takes messages."""
        return self._session.clock if self._time is self._session.clock.schedule else self._time

    @property
    def schedule(self) -> RealTime | SimulatedTime:
        """The periodic tasks that run while a caller waits on `clock`."""
        return self._time

    @property
    def base(self) -> BaseInfo:
        """The limits and the size of the base, from the description."""
        return self.description.base

    @property
    def laser(self) -> LaserInfo:
        """The properties of the laser, from the first scan and the description."""
        assert self._scans is not None
        return self._scans.info

    @property
    def head_info(self) -> HeadInfo | None:
        """The limits of the head, from the description."""
        return self.description.head.info if self.description.head is not None else None

    @property
    def torso(self) -> TorsoInfo | None:
        """The limits of the torso, from the description."""
        return self.description.torso.info if self.description.torso is not None else None

    def frames(self) -> Sequence[TransformStamped]:
        """Return the newest poses of links and sensors below `base_footprint`."""
        now = self._time.now()
        frames = self._frames.frames(now)
        extra = self._scans.frame if self._scans is not None else None
        if extra is not None:
            frames.append(TransformStamped(extra.child, extra.parent, extra.position, extra.quaternion, now))
        return frames

    def drive(self, v: float, w: float, *, priority: int = CMD_VEL) -> None:
        """Publish a velocity command within the limits of the base; see `Robot.drive`.

        After a failure the call has no effect.

        Args:
            v: The speed (m/s).
            w: The angular speed (rad/s).
            priority: The priority, which determines the topic.

        Raises:
            ValueError: *v* or *w* is not finite.
        """
        check_finite(v, w)
        if self._failure is None:
            self._velocity.send(v, w, priority, self._time.now())

    def stop(self) -> None:
        """Publish zero on all velocity topics with recent commands."""
        self._velocity.stop(self._time.now())

    def commanded_velocity(self) -> Twist2D:
        """Return the last accepted command; zero when it has expired."""
        return self._velocity.current(self._time.now())

    def scan(self) -> LaserScan | None:
        """Return the newest scan for whose stamp the odometry has arrived."""
        return self._scan

    def odometry(self) -> Odometry:
        """Return the newest odometry."""
        assert self._odometry is not None
        return self._odometry

    def move_head(self, pan: float, tilt: float) -> None:
        """Send the head to *pan* and *tilt* (rad), within its limits, at its maximum speed."""
        head, now = self.description.head, self.head()
        if head is None or now is None:
            return
        info = head.info
        pan = min(max(pan, info.pan_min), info.pan_max)
        tilt = min(max(tilt, info.tilt_min), info.tilt_max)
        seconds = max(abs(pan - now.pan), abs(tilt - now.tilt)) / info.speed
        self._move_joints(head.topic, {head.pan: pan, head.tilt: tilt}, seconds)

    def head(self) -> HeadPosition | None:
        """Return the position of the head from the joint states, or None without a head."""
        head = self.description.head
        if head is None or head.pan not in self._joints or head.tilt not in self._joints:
            return None
        (pan, stamp), (tilt, tilt_stamp) = self._joints[head.pan], self._joints[head.tilt]
        return HeadPosition(pan, tilt, min(stamp, tilt_stamp))

    def lift(self, height: float) -> None:
        """Move the torso to *height* (m), within its limits, at its maximum speed."""
        torso, now = self.description.torso, self.torso_height()
        if torso is None or now is None:
            return
        height = min(max(height, torso.info.lift_min), torso.info.lift_max)
        self._move_joints(torso.topic, {torso.joint: height}, abs(height - now) / torso.info.speed)

    def torso_height(self) -> float | None:
        """Return the height (m) of the torso from the joint states, or None without a torso."""
        torso = self.description.torso
        return self._joints[torso.joint][0] if torso is not None and torso.joint in self._joints else None

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

            raise RosError(
                f"{source.info}: {topic_problem(self._node, source.info, InfoMessage)}; "
                f"correct 'camera.info' in {self.description.path}, or remove 'camera'"
            )
        return self._camera_info

    def camera(self) -> CameraImage | None:
        """Return the newest picture. The first call subscribes to the camera, and returns None."""
        self._watch_camera()
        source, info, raw = self.description.camera, self._camera_info, self._raw_image
        if source is None or info is None or raw is None:
            return None
        message, stamp = raw
        if self._image is None or self._image.stamp != stamp:
            try:
                self._image = self._picture(message, stamp, info)
            except RosError as error:
                raise RosError(f"{source.image.topic}: {error}") from None
        return self._image

    def sonars(self) -> Sequence[SonarReading]:
        """Return the newest reading of every sonar."""
        return tuple(self._sonars.values())

    def battery(self) -> BatteryState | None:
        """Return the charge of the battery, or None if the robot does not report it."""
        return self._battery

    def recharge(self) -> None:
        """Do nothing: a program cannot charge a real battery."""
        return

    def close(self) -> None:
        """Stop the robot if it was driven. Call it before the session is closed."""
        if self._node.context.ok():
            self._velocity.finish(self._time.now())

    def __enter__(self) -> "RosRobot":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # Time

    def _choose_time(self) -> RealTime | SimulatedTime:
        """Return the time of the simulation if the robot uses it, else that of the session."""
        session, wanted = self._session, self.description.use_sim_time
        if isinstance(session.clock, SimulatedTime):  # in lockstep
            self._stamps = StampConverter(shared=True)
            return session.clock
        if wanted is None:
            # The publishers of a robot become visible together, so the clock is searched after the sensors.
            sensors = (self.description.scan.source.topic, self.description.odometry.topic)
            topics = [self._node.resolve_topic_name(topic) for topic in sensors]
            visible = session.wait_for(
                lambda: any(self._node.count_publishers(topic) for topic in topics),
                self._start_time_left() / 2,
            )
            search = CLOCK_SEARCH if visible else 0.0
            wanted = session.wait_for(lambda: self._node.count_publishers("/clock"), search)
        self._stamps = StampConverter(shared=bool(wanted))
        if not wanted:
            assert isinstance(session.clock, RosClock)
            return session.clock.schedule
        sim_time = SimTime(session)
        if not session.wait_for(lambda: sim_time.started, self._start_time_left()):
            from rosgraph_msgs.msg import Clock

            raise RosError(
                f"/clock: {topic_problem(self._node, '/clock', Clock)}; start the simulation, or set "
                f"'use_sim_time: false' in {self.description.path}"
            )
        return sim_time

    def _start_time_left(self) -> float:
        """Return the time (s) that is left until the robot has to be available."""
        return max(0.0, self._start_deadline - time.monotonic())

    def _stamp_message(self) -> Any:
        if isinstance(self._session.clock, RosClock) and self._time is self._session.clock.schedule:
            return self._node.get_clock().now().to_msg()
        from builtin_interfaces.msg import Time

        seconds, nanoseconds = divmod(self._time.now(), NS_PER_S)
        return Time(sec=seconds, nanosec=nanoseconds)

    def _converted(self, key: object, stamp: Any) -> int:
        """Return the stamp of a message in our clock."""
        return self._stamps.convert(key, stamp.sec * NS_PER_S + stamp.nanosec, self._time.now())

    # Subscriptions

    def _subscribe_all(self) -> None:
        from nav_msgs.msg import Odometry as OdometryMessage
        from sensor_msgs.msg import JointState, Range
        from sensor_msgs.msg import LaserScan as ScanMessage

        description = self.description
        self._subscribe(ScanMessage, description.scan.source, self._receive_scan)
        self._subscribe(OdometryMessage, description.odometry, self._receive_odometry)
        if description.joint_states is not None:
            self._subscribe(JointState, description.joint_states, self._receive_joints)
        self._subscribe_frames(description.frames)
        if description.battery is not None:
            from sensor_msgs.msg import BatteryState as BatteryMessage

            self._subscribe(BatteryMessage, description.battery.source, self._receive_battery)
        for source in description.sonars:
            self._subscribe(Range, source, self._receive_sonar)

    def _subscribe_frames(self, sources: FrameSources) -> None:
        try:
            if sources.tf is None:
                raise ModuleNotFoundError(name="tf2_msgs")
            from tf2_msgs.msg import TFMessage
        except ModuleNotFoundError:
            if sources.robot_description is None:
                raise
            from std_msgs.msg import String

            model = TopicSource(sources.robot_description, reliable=True)
            self._subscribe(String, model, self._receive_description, depth=1, latched=True)
            return
        tf = TopicSource(sources.tf, reliable=True)
        self._subscribe(TFMessage, tf, partial(self._receive_tf, static=False), depth=100)
        static = TopicSource(sources.tf_static or "/tf_static", reliable=True)
        receive = partial(self._receive_tf, static=True)
        self._subscribe(TFMessage, static, receive, depth=100, latched=True)

    def _subscribe(
        self,
        kind: type,
        source: TopicSource,
        receive: Callable[[Any], None],
        *,
        depth: int = 10,
        latched: bool = False,
    ) -> None:
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

        qos = QoSProfile(
            depth=depth,
            reliability=ReliabilityPolicy.RELIABLE if source.reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )
        watch = _Watch(self._node.resolve_topic_name(source.topic), kind, source.timeout)
        self._watches.append(watch)

        def received(message: Any) -> None:
            watch.arrival = self._time.now()
            try:
                receive(message)
            except RosError as error:
                self._fail(f"{watch.topic}: {error}")

        self._node.create_subscription(kind, source.topic, received, qos)

    def _receive_scan(self, message: Any) -> None:
        stamp = self._converted("scan", message.header.stamp)
        if self._scans is None:
            self._raw_scan = message, stamp
            return
        scan = self._scans.convert(message, stamp)
        if self._scan is None or scan.stamp > self._scan.stamp:
            # Like a message filter of tf2: a scan is published here once the pose at its stamp is known.
            self._pending_scan = scan
            self._release_scan()

    def _receive_odometry(self, message: Any) -> None:
        stamp = self._converted("odometry", message.header.stamp)
        if self._odometry is not None and stamp <= self._odometry.stamp:
            return
        pose, twist = message.pose.pose, message.twist.twist
        q = pose.orientation
        yaw = Transform((0.0, 0.0, 0.0), (q.x, q.y, q.z, q.w)).yaw
        place = Pose2D(pose.position.x, pose.position.y, yaw)
        velocity = Twist2D(twist.linear.x, twist.angular.z)
        if not math.isfinite(place.x + place.y + place.yaw + velocity.v + velocity.w):
            raise RosError("the odometry is not finite: its driver has failed")
        self._odometry = Odometry(place, velocity, stamp)
        self._release_scan()

    def _release_scan(self) -> None:
        scan, odometry = self._pending_scan, self._odometry
        if scan is not None and odometry is not None and scan.stamp <= odometry.stamp:
            self._scan, self._pending_scan = scan, None

    def _receive_tf(self, message: Any, static: bool) -> None:
        for transform in message.transforms:
            child = transform.child_frame_id
            stamp = None if static else self._converted(("tf", child), transform.header.stamp)
            self._frames.set(child, transform.header.frame_id, pose_of(transform.transform), stamp)

    def _receive_joints(self, message: Any) -> None:
        # Several nodes may publish joint states of different joints.
        stamp = self._converted(("joints", message.name[0] if message.name else ""), message.header.stamp)
        for name, position in zip(message.name, message.position, strict=False):
            if math.isfinite(position):
                self._joints[name] = position, stamp
                self._place_link(name)

    def _receive_description(self, message: Any) -> None:
        joints = read_urdf(message.data)
        for joint in joints:
            if not joint.moves:
                self._frames.set(joint.child, joint.parent, joint.origin, None)
        self._moving_joints = {joint.name: joint for joint in joints if joint.moves}
        for name in self._joints:
            self._place_link(name)

    def _place_link(self, name: str) -> None:
        """Store the pose of the link that the joint *name* moves, if there is a URDF."""
        joint = self._moving_joints.get(name)
        if joint is not None:
            position, stamp = self._joints[name]
            self._frames.set(joint.child, joint.parent, joint.pose(position), stamp)

    def _receive_battery(self, message: Any) -> None:
        source = self.description.battery
        level = battery_level(message, source.full if source is not None else 1.0)
        stamp = self._converted("battery", message.header.stamp)
        self._battery = None if level is None else BatteryState(level, stamp)

    def _receive_sonar(self, message: Any) -> None:
        frame = message.header.frame_id
        reading = sonar_of(message, self._converted(("sonar", frame), message.header.stamp))
        self._sonars[reading.frame] = reading

    def _watch_camera(self) -> None:
        """Subscribe to the camera, unless that was done before."""
        source = self.description.camera
        if source is None or self._watches_camera:
            return
        from sensor_msgs.msg import CameraInfo as InfoMessage
        from sensor_msgs.msg import Image

        def receive_info(message: Any) -> None:
            if self._camera_info is None:
                self._camera_info = camera_info_of(message, source)

        def receive_image(message: Any) -> None:
            self._raw_image = message, self._converted("image", message.header.stamp)

        def receive_depth(message: Any) -> None:
            self._raw_depth = message, self._converted("depth", message.header.stamp)

        self._watches_camera = True
        self._subscribe(InfoMessage, TopicSource(source.info), receive_info)
        self._subscribe(Image, source.image, receive_image, depth=1)
        if source.depth is not None:
            self._subscribe(Image, source.depth, receive_depth, depth=1)

    def _picture(self, message: Any, stamp: int, info: CameraInfo) -> CameraImage:
        rgb = rgb_of(message)
        if rgb.shape[:2] != (info.height, info.width):
            raise RosError(
                f"a picture has {rgb.shape[1]} x {rgb.shape[0]} pixels, but CameraInfo has {info.width} x "
                f"{info.height}: 'camera.image' and 'camera.info' must belong together"
            )
        depth = None
        if self._raw_depth is not None and abs(self._raw_depth[1] - stamp) <= PAIRED:
            depth = depth_of(self._raw_depth[0], info.far)
            if depth.shape != rgb.shape[:2]:
                raise RosError(
                    f"the depth has {depth.shape[1]} x {depth.shape[0]} pixels, but the picture has "
                    f"{info.width} x {info.height}: name a depth that is registered to the picture"
                )
        return CameraImage(rgb, stamp, info.frame, depth)

    # Start and supervision

    def _wait_for_topics(self) -> None:
        """Wait until the robot is complete; raise a RosError that names what is missing."""
        while not self._session.wait_for(
            lambda: not self._missing(), min(MISMATCH_TIME, self._start_time_left())
        ):
            if self._has_mismatch() or not self._start_time_left():
                raise RosError(self._missing_report())
        self._start_laser()
        now = self._time.now()
        for watch in self._watches:
            watch.arrival = now
        if self._failure is not None:
            raise RosError(self._failure)

    def _has_mismatch(self) -> bool:
        """Return whether the robot uses another type for one of the topics."""
        node, velocity = self._node, self._velocity
        return any(has_other_type(node, watch.topic, watch.kind) for watch in self._watches) or (
            has_other_type(node, velocity.topic, velocity.kind, published=False)
        )

    def _missing(self) -> list[str]:
        """Return the keys of the description for which something has not arrived yet."""
        description, missing = self.description, []
        if self._raw_scan is None:
            missing.append("scan")
        if self._odometry is None:
            missing.append("odometry")
        if self._raw_scan is not None and self._laser_mount() is None:
            missing.append("frames")
        if description.head is not None and self.head() is None:
            missing.append("head")
        if description.torso is not None and self.torso_height() is None:
            missing.append("torso")
        # Asked last, since a look at the graph is slow.
        if not (missing or takes(self._node, self._velocity.topic, self._velocity.kind)):
            missing.append("velocity")
        return missing

    def _missing_report(self) -> str:
        description, node = self.description, self._node
        lines = []
        missing = self._missing()
        velocity = self._velocity
        if "velocity" not in missing and not takes(node, velocity.topic, velocity.kind):
            missing.append("velocity")
        for key in missing:
            if key == "velocity":
                reason = topic_problem(node, velocity.topic, velocity.kind, published=False)
                lines.append(f"velocity: {velocity.topic}: {reason}")
            elif key == "frames":
                frame = self._raw_scan[0].header.frame_id if self._raw_scan is not None else ""
                known = ", ".join(self._frames.known()) or "none"
                lines.append(
                    f"frames: the laser's frame '{frame}' is not connected with '{description.base_frame}'; "
                    f"frames with a pose: {known}"
                )
            elif key in ("head", "torso"):
                known = ", ".join(self._joints) or "none"
                lines.append(f"{key}: its joints are not among the joint states; joints: {known}")
            else:
                source = description.scan.source if key == "scan" else description.odometry
                watch = next(w for w in self._watches if w.topic == node.resolve_topic_name(source.topic))
                lines.append(f"{key}: {watch.topic}: {topic_problem(node, watch.topic, watch.kind)}")
        hint = f"correct {description.path}" if sees_others(node) else DOMAIN_HINT
        details = "".join(f"\n  {line}" for line in lines)
        return f"the robot '{description.name}' is not available:{details}\n  {hint}"

    def _laser_mount(self) -> Transform | None:
        """Return the pose of the laser in the base, or None while it is unknown."""
        if self._raw_scan is None:
            return None
        name = self._raw_scan[0].header.frame_id.lstrip("/")
        parents = {frame.child: frame for frame in self._frames.frames(0)}
        pose = Transform()
        while name != FOOTPRINT:
            frame = parents.get(name)
            if frame is None:
                return None
            pose = Transform(frame.position, frame.quaternion) * pose
            name = frame.parent
        return pose

    def _start_laser(self) -> None:
        mount = self._laser_mount()
        assert mount is not None
        assert self._raw_scan is not None
        message, stamp = self._raw_scan
        facts = self.description.scan
        try:
            self._scans = ScanConverter(message, mount, facts.rate, facts.sigma)
        except RosError as error:
            raise RosError(f"{facts.source.topic}: {error}") from None
        self._scan = self._scans.convert(message, stamp)

    def _supervise(self, now: int) -> None:
        """Check that all watched topics are alive, and let an old command expire."""
        self._session.refresh()
        now = self._time.now()
        if self._failure is None:
            silent = self._silent(now, 1.0)
            if silent:
                # Topics of a robot that is down reach their limits one after another.
                self._fail(self._silence(self._silent(now, 0.5), now))
        if self._failure is not None:
            raise RosError(self._failure)
        self._velocity.expire(now)

    def _silent(self, now: int, part: float) -> list[_Watch]:
        """Return the watched topics without a message for longer than *part* of their limits."""
        return [
            watch
            for watch in self._watches
            if watch.timeout is not None and now - watch.arrival > part * watch.timeout * NS_PER_S
        ]

    def _silence(self, silent: Sequence[_Watch], now: int) -> str:
        parts = [
            f"{watch.topic}: no message for {(now - watch.arrival) / NS_PER_S:.1f} s "
            f"(limit {watch.timeout:g} s)"
            for watch in silent
        ]
        everything = len(silent) == sum(watch.timeout is not None for watch in self._watches)
        cause = "the robot or the network is down" if everything else "its driver has stopped"
        return f"{'; '.join(parts)}: {cause}"

    def _fail(self, reason: str) -> None:
        """Stop the robot, and let the next wait on the clock raise an error."""
        if self._failure is None:
            self._failure = f"{reason}; the robot was told to stop"
            self._velocity.stop(self._time.now())
            _log.error("%s", self._failure)

    # Trajectories

    def _publish_trajectories(self) -> dict[str, Any]:
        parts = (self.description.head, self.description.torso)
        topics = [part.topic for part in parts if part is not None]
        if not topics:
            return {}
        from trajectory_msgs.msg import JointTrajectory

        return {topic: self._node.create_publisher(JointTrajectory, topic, 10) for topic in topics}

    def _move_joints(self, topic: str, positions: dict[str, float], seconds: float) -> None:
        from builtin_interfaces.msg import Duration
        from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

        whole, rest = divmod(round(max(seconds, 0.1) * NS_PER_S), NS_PER_S)
        point = JointTrajectoryPoint(
            positions=list(positions.values()), time_from_start=Duration(sec=whole, nanosec=rest)
        )
        self._trajectories[topic].publish(JointTrajectory(joint_names=list(positions), points=[point]))
