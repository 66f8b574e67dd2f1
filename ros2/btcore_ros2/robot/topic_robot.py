"""`TopicRobot`: the readings and commands of a robot whose messages come from ROS 2 or from a bag."""

import logging
import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from btcore.clock import NS_PER_S
from btcore_robot.errors import RobotError
from btcore_robot.rigid_transform import Transform
from btcore_robot.robot import (
    BASE_FRAME,
    CMD_VEL,
    BaseInfo,
    BatteryState,
    CameraImage,
    CameraInfo,
    HeadInfo,
    HeadPosition,
    LaserInfo,
    LaserScan,
    Odometry,
    Pose2D,
    Robot,
    SonarReading,
    TorsoInfo,
    TransformStamped,
    Twist2D,
)
from btcore_robot.time_limits import MAX_DEPTH_OFFSET_S
from btcore_robot.urdf import Urdf, UrdfJoint, read_urdf
from btcore_ros2.errors import RosError
from btcore_ros2.robot.conversions import (
    ScanConverter,
    battery_level,
    camera_info_of,
    depth_of,
    rgb_of,
    sonar_of,
)
from btcore_ros2.robot.description import RosRobotDescription
from btcore_ros2.robot.frames import FrameStore, pose_of
from btcore_ros2.robot.scene import RobotScene
from btcore_ros2.robot.stamps import LateMessageError, StampConverter
from btcore_ros2.robot.velocity import VelocityCommands, check_finite
from btcore_scene import Frame, MovingScene, Part, StaticScene

_log = logging.getLogger(__name__)


class TopicRobot(Robot):
    """A robot whose readings are messages of ROS 2, and whose commands go to topics.

    A subclass passes the messages to the methods `_receive_…`, and calls `_start_laser` when `_missing`
    returns nothing. The messages may be objects of any classes with the fields of ROS 2's messages.

    Args:
        description: The robot's topics and facts.
        shared_clock: Whether the stamps of the messages are those of `clock`.
    """

    def __init__(self, description: RosRobotDescription, *, shared_clock: bool = False) -> None:
        self.description = description
        self._stamps = StampConverter(shared=shared_clock)
        self._velocity = VelocityCommands(description.velocity, description.base, self._publish_velocity)
        self._failure: str | None = None
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
        self._scene = RobotScene(self)
        self._shapes: list[Part] | None = None
        self._model_joints: Sequence[UrdfJoint] = []
        self._camera_info: CameraInfo | None = None
        self._raw_image: tuple[Any, int] | None = None
        self._raw_depth: tuple[Any, int] | None = None
        self._image: CameraImage | None = None

    @property
    def base_info(self) -> BaseInfo:
        """The limits and the size of the base, from the description."""
        return self.description.base

    @property
    def laser_info(self) -> LaserInfo:
        """The properties of the laser, from the first scan and the description."""
        assert self._scans is not None
        return self._scans.info

    @property
    def head_info(self) -> HeadInfo | None:
        """The limits of the head, from the description."""
        return self.description.head.info if self.description.head is not None else None

    @property
    def torso_info(self) -> TorsoInfo | None:
        """The limits of the torso, from the description."""
        return self.description.torso.info if self.description.torso is not None else None

    def frames(self) -> Sequence[TransformStamped]:
        """Return the newest poses of links and sensors below `base_footprint`."""
        now = self.clock.now()
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
            self._velocity.send(v, w, priority, self.clock.now())

    def stop(self) -> None:
        """Publish zero on all velocity topics with recent commands."""
        self._velocity.stop(self.clock.now())

    def commanded_velocity(self) -> Twist2D:
        """Return the last accepted command; zero when it has expired."""
        return self._velocity.current(self.clock.now())

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
        self._move_joints(head.topic, dict(zip(head.joints, (pan, tilt), strict=True)), seconds)

    def head(self) -> HeadPosition | None:
        """Return the position of the head from the joint states, or None without a head."""
        head = self.description.head
        if head is None or not all(joint in self._joints for joint in head.joints):
            return None
        (pan, stamp), (tilt, tilt_stamp) = (self._joints[joint] for joint in head.joints)
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
        """The camera's properties, or None without a camera or before the first `CameraInfo`."""
        return self._camera_info

    def camera(self) -> CameraImage | None:
        """Return the newest picture, or None without a camera or before the first picture."""
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

    def static_scene(self) -> StaticScene:
        """Return the robot's shapes and sensors, for the monitor."""
        return self._scene.static(self._shapes or (), self._camera_info)

    def moving_scene(self) -> MovingScene:
        """Return the robot's frames and newest readings, for the monitor.

        Pictures are included only if a leaf uses the camera.
        """
        return self._scene.moving(self._drawn_frames(), self._image)

    def sonars(self) -> Sequence[SonarReading]:
        """Return the newest reading of every sonar."""
        return tuple(self._sonars.values())

    def battery(self) -> BatteryState | None:
        """Return the charge of the battery, or None if the robot does not report it."""
        return self._battery

    def recharge(self) -> None:
        """Do nothing: a program cannot charge a real battery."""
        return

    # Commands

    @abstractmethod
    def _publish_velocity(self, topic: str, twist: Twist2D) -> None:
        """Publish a velocity command on *topic*, a name in the description."""

    @abstractmethod
    def _move_joints(self, topic: str, positions: dict[str, float], seconds: float) -> None:
        """Publish a trajectory on *topic* that moves joints to *positions* (rad or m) within *seconds*."""

    # Messages

    def _converted(self, key: object, stamp: Any) -> int:
        """Return the stamp of a message in our clock. Raise RosError if the message is late."""
        return self._stamps.convert(key, stamp.sec * NS_PER_S + stamp.nanosec, self.clock.now())

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
            try:
                stamp = None if static else self._converted(("tf", child), transform.header.stamp)
            except LateMessageError:
                continue
            self._frames.set(child, transform.header.frame_id, pose_of(transform.transform), stamp)

    def _receive_joints(self, message: Any) -> None:
        # Several nodes may publish joint states of different joints.
        stamp = self._converted(("joints", message.name[0] if message.name else ""), message.header.stamp)
        for name, position in zip(message.name, message.position, strict=False):
            if math.isfinite(position):
                self._joints[name] = position, stamp
                self._place_link(name)

    def _receive_description(self, message: Any) -> None:
        joints = _urdf_of(message).joints
        for joint in joints:
            if not joint.is_movable:
                self._frames.set(joint.child, joint.parent, joint.origin, None)
        self._moving_joints = {joint.name: joint for joint in joints if joint.is_movable}
        for name in self._joints:
            self._place_link(name)

    def _receive_shapes(self, message: Any) -> None:
        base = self.description.base_frame
        try:
            urdf = _urdf_of(message)
        except RosError as error:
            _log.warning("the monitor cannot draw the robot's shape: %s", error)
            urdf = Urdf((), (), ())
        self._model_joints = urdf.joints
        self._shapes = [
            replace(part, frame=BASE_FRAME) if part.frame == base else part for part in urdf.shapes
        ]

    def _drawn_frames(self) -> list[Frame]:
        """Return the frames, and the links of the model whose poses are on no topic, such as wheels."""
        frames = [Frame(link.child, link.parent, link.position, link.quaternion) for link in self.frames()]
        placed = {frame.child for frame in frames} | {BASE_FRAME, self.description.base_frame}
        for joint in self._model_joints:
            if joint.child not in placed:
                pose = (
                    joint.pose(self._joints.get(joint.name, (0.0, 0))[0])
                    if joint.is_movable
                    else joint.origin
                )
                parent = BASE_FRAME if joint.parent == self.description.base_frame else joint.parent
                frames.append(Frame(joint.child, parent, pose.position, pose.quaternion))
        return frames

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

    def _receive_camera_info(self, message: Any) -> None:
        source = self.description.camera
        if self._camera_info is None and source is not None:
            self._camera_info = camera_info_of(message, source)

    def _receive_image(self, message: Any) -> None:
        self._raw_image = message, self._converted("image", message.header.stamp)

    def _receive_depth(self, message: Any) -> None:
        self._raw_depth = message, self._converted("depth", message.header.stamp)

    def _picture(self, message: Any, stamp: int, info: CameraInfo) -> CameraImage:
        rgb = rgb_of(message)
        if rgb.shape[:2] != (info.height, info.width):
            raise RosError(
                f"a picture has {rgb.shape[1]} x {rgb.shape[0]} pixels, but CameraInfo has {info.width} x "
                f"{info.height}: 'camera.image' and 'camera.info' must belong together"
            )
        depth = None
        if self._raw_depth is not None and abs(self._raw_depth[1] - stamp) <= MAX_DEPTH_OFFSET_S * NS_PER_S:
            depth = depth_of(self._raw_depth[0], info.far)
            if depth.shape != rgb.shape[:2]:
                raise RosError(
                    f"the depth has {depth.shape[1]} x {depth.shape[0]} pixels, but the picture has "
                    f"{info.width} x {info.height}: name a depth that is registered to the picture"
                )
        return CameraImage(rgb, stamp, info.frame, depth)

    # The start

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
        return missing

    def _missing_reason(self, key: str) -> str:
        """Return why the readings of "frames", "head" or "torso" are missing."""
        if key == "frames":
            frame = self._raw_scan[0].header.frame_id if self._raw_scan is not None else ""
            known = ", ".join(self._frames.known()) or "none"
            return (
                f"frames: the laser's frame '{frame}' is not connected with '{self.description.base_frame}'; "
                f"frames with a pose: {known}"
            )
        known = ", ".join(self._joints) or "none"
        return f"{key}: its joints are not among the joint states; joints: {known}"

    def _laser_mount(self) -> Transform | None:
        """Return the pose of the laser in the base, or None while it is unknown."""
        if self._raw_scan is None:
            return None
        name = self._raw_scan[0].header.frame_id.lstrip("/")
        parents = {frame.child: frame for frame in self._frames.frames(0)}
        pose = Transform()
        while name != BASE_FRAME:
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
            self._scans = ScanConverter(message, mount, facts.rate, facts.sigma, facts.range_noise)
        except RosError as error:
            raise RosError(f"{facts.topic}: {error}") from None
        self._scan = self._scans.convert(message, stamp)


def _urdf_of(message: Any) -> Urdf:
    try:
        return read_urdf(message.data)
    except RobotError as error:
        raise RosError(str(error)) from None
