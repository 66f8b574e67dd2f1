"""The topics of the simulated robot: readings are published, commands are taken."""

import math
from array import array
from collections.abc import Callable, Sequence
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped as TransformMessage
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState, CameraInfo, Image, JointState, LaserScan
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory

from btcore.clock import NS_PER_S
from btcore_robot.rigid_transform import Transform
from btcore_robot.robot import BASE_FRAME, ODOM_FRAME, CameraImage, Phase, TransformStamped
from btcore_ros2.session import RosSession
from btcore_sim.kinematics import Kinematics, complete_urdf
from btcore_sim.simulated_robot import SimulatedRobot

try:
    from tf2_msgs.msg import TFMessage
except ModuleNotFoundError:  # not on PyPI
    TFMessage = None

CLOCK_RATE = 50.0
"""The rate (Hz) of `/clock`."""

BATTERY_RATE = 1.0
"""The rate (Hz) of the battery's topic."""

TRAJECTORY_RATE = 50.0
"""The rate (Hz) at which head and torso follow a trajectory."""

VELOCITY_TOPICS = {"cmd_vel": 10, "key_vel": 90, "joy_vel": 100}
"""The priorities of the topics for velocity commands, as in the twist_mux configuration of Tiago."""

RELIABLE = QoSProfile(depth=10)
BEST_EFFORT = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
TRANSFORMS = QoSProfile(depth=100)

_CAMERA = "head_front_camera"
_WITHOUT_TF2 = (
    "tf2_msgs is not installed, so /tf and /tf_static are not published. To generate the package: "
    "btcore ros2 messages tf2_msgs"
)


class Topic:
    """A topic on which the simulated robot publishes.

    Args:
        node: The ROS node.
        name: The name of the topic, relative to the namespace of the ROS node.
        qos: The quality of service.

    Attributes:
        name: The resolved name of the topic.
        published: The number of messages so far.
    """

    def __init__(self, node: Any, message_class: type, name: str, qos: QoSProfile) -> None:
        self._publisher = node.create_publisher(message_class, name, qos)
        self.name: str = self._publisher.topic_name
        self.published = 0

    @property
    def is_subscribed(self) -> bool:
        """Whether a ROS node subscribes to the topic."""
        return bool(self._publisher.get_subscription_count())

    def publish(self, message: object) -> None:
        """Publish *message*, and count it."""
        self._publisher.publish(message)
        self.published += 1


class RobotTopics:
    """Publishes the readings of a simulated robot, and passes the commands that arrive on to it.

    A reading is published once, when it is new: if a sensor has failed, its topic is silent. Nothing is
    published on a topic without subscribers, and the camera renders no picture then. All names are relative,
    except `/tf`, `/tf_static` and `/clock`.

    Args:
        session: The ROS node.
        scan: The name of the laser's topic.
        ros_time: Returns the ROS time (ns) for stamps from a simulated time (ns). Without it, stamps are the
            simulated time, which is published on `/clock`.
    """

    def __init__(
        self,
        session: RosSession,
        robot: SimulatedRobot,
        *,
        scan: str = "scan_raw",
        ros_time: Callable[[int], int] | None = None,
    ) -> None:
        self._robot = robot
        self._ros_time = ros_time or (lambda now: now)
        self._logger = session.node.get_logger()
        self._kinematics = Kinematics(robot.description)
        self._published_stamps: dict[Topic, int] = {}
        self._topics: list[Topic] = []
        node = session.node

        def topic(message_class: type, name: str, qos: QoSProfile = RELIABLE) -> Topic:
            created = Topic(node, message_class, name, qos)
            self._topics.append(created)
            return created

        self._clock = topic(Clock, "/clock") if ros_time is None else None
        self._scan = topic(LaserScan, scan, BEST_EFFORT)
        self._odometry = topic(Odometry, "mobile_base_controller/odom")
        self._joints = topic(JointState, "joint_states")
        self._battery = topic(BatteryState, "power/battery")
        if robot.camera_info is not None:
            self._camera_info = topic(CameraInfo, f"{_CAMERA}/rgb/camera_info")
            self._rgb = topic(Image, f"{_CAMERA}/rgb/image_raw")
            self._depth = topic(Image, f"{_CAMERA}/depth_registered/image_raw")
        topic(String, "robot_description", LATCHED).publish(String(data=complete_urdf(robot.description)))
        self._tf: Topic | None = None
        if TFMessage is None:
            self._logger.warning(_WITHOUT_TF2)
        else:
            self._tf = topic(TFMessage, "/tf", TRANSFORMS)
            static = self._transforms(self._frames(moving=False))
            topic(TFMessage, "/tf_static", LATCHED).publish(static)
        self._received: dict[str, int] = {}
        for name, priority in VELOCITY_TOPICS.items():
            self._subscribe(node, Twist, name, self._velocity_command(priority))
        self._controllers: list[TrajectoryController] = []
        head, torso = robot.description.head, robot.description.torso
        if head is not None:
            joints = (head.pan, head.tilt)
            self._control(node, "head_controller", joints, lambda goal: robot.move_head(*goal))
        if torso is not None:
            self._control(node, "torso_controller", (torso.joint,), lambda goal: robot.lift(*goal))
        add_task = robot.schedule.add_task
        add_task(robot.laser_info.rate, Phase.SENSORS, self._publish_scan)
        add_task(robot.description.odometry.rate, Phase.SENSORS, self._publish_motion)
        add_task(BATTERY_RATE, Phase.SENSORS, self._publish_battery)
        add_task(CLOCK_RATE, Phase.SENSORS, self.publish_clock)
        if robot.camera_info is not None:
            add_task(robot.camera_info.rate, Phase.SENSORS, self._publish_camera)

    def published(self) -> dict[str, int]:
        """Return the number of messages so far on each topic, by resolved names."""
        return {topic.name: topic.published for topic in self._topics}

    def received(self) -> dict[str, int]:
        """Return the number of the newest message on each topic for commands, by resolved names."""
        return self._received

    def publish_clock(self, now: int) -> None:
        """Publish the simulated time *now* (ns)."""
        if self._clock is not None and self._take_if_new(self._clock, now):
            self._clock.publish(Clock(clock=time_of(now)))

    def publish_again(self) -> None:
        """Publish the newest readings again, for subscribers that have just come."""
        self._published_stamps.clear()
        now = self._robot.clock.now()
        for publish in (self._publish_scan, self._publish_motion, self._publish_battery):
            publish(now)
        self._publish_camera(now)
        self.publish_clock(now)

    def _take_if_new(self, topic: Topic, stamp: int) -> bool:
        """Return whether a reading of *stamp* (ns) has to be published on *topic*, which is true once."""
        if not topic.is_subscribed or self._published_stamps.get(topic) == stamp:
            return False
        self._published_stamps[topic] = stamp
        return True

    def _publish_scan(self, now: int) -> None:
        scan = self._robot.scan()
        if scan is None or not self._take_if_new(self._scan, scan.stamp):
            return
        message = LaserScan(
            angle_min=scan.angle_min,
            angle_max=scan.angle_min + (len(scan.ranges) - 1) * scan.angle_increment,
            angle_increment=scan.angle_increment,
            scan_time=1.0 / self._robot.laser_info.rate,
            range_min=scan.range_min,
            range_max=scan.range_max,
            # rclpy takes an array 15 times faster than numpy's
            ranges=array("f", scan.ranges.tobytes()),
        )
        self._set_header(message, scan.stamp, scan.frame)
        self._scan.publish(message)

    def _publish_motion(self, now: int) -> None:
        odometry = self._robot.odometry()
        if self._take_if_new(self._odometry, odometry.stamp):
            message = Odometry(child_frame_id=BASE_FRAME)
            self._set_header(message, odometry.stamp, ODOM_FRAME)
            place = Transform.from_pose(odometry.pose)
            _set_xyz(message.pose.pose.position, place.position)
            _set_quaternion(message.pose.pose.orientation, place.quaternion)
            message.twist.twist.linear.x = odometry.twist.v
            message.twist.twist.angular.z = odometry.twist.w
            self._odometry.publish(message)
        if self._tf is not None and self._take_if_new(self._tf, now):
            place = Transform.from_pose(odometry.pose)
            base = TransformStamped(BASE_FRAME, ODOM_FRAME, place.position, place.quaternion, odometry.stamp)
            self._tf.publish(self._transforms([base, *self._frames(moving=True)]))
        if self._take_if_new(self._joints, now):
            positions = self._robot.joint_positions()
            joints = JointState(name=list(positions), position=list(positions.values()))
            self._set_header(joints, now, "")
            self._joints.publish(joints)

    def _publish_battery(self, now: int) -> None:
        if not self._take_if_new(self._battery, now):
            return
        state = self._robot.battery()
        unknown = dict.fromkeys(("voltage", "current", "charge", "capacity", "design_capacity"), math.nan)
        message = BatteryState(
            percentage=state.level / 100.0,
            power_supply_status=BatteryState.POWER_SUPPLY_STATUS_DISCHARGING,
            present=True,
            **unknown,
        )
        self._set_header(message, state.stamp, "")
        self._battery.publish(message)

    def _publish_camera(self, now: int) -> None:
        lens = self._robot.camera_info
        if lens is None:
            return
        picture = self._robot.camera() if self._rgb.is_subscribed or self._depth.is_subscribed else None
        if picture is not None:
            if self._take_if_new(self._rgb, picture.stamp):
                self._rgb.publish(self._image(picture, "rgb8", picture.rgb.tobytes(), 3))
            if picture.depth is not None and self._take_if_new(self._depth, picture.stamp):
                self._depth.publish(self._image(picture, "32FC1", picture.depth.tobytes(), 4))
        stamp = now if picture is None else picture.stamp
        if self._take_if_new(self._camera_info, stamp):
            fx, fy, cx, cy = lens.fx, lens.fy, lens.cx, lens.cy
            message = CameraInfo(
                width=lens.width,
                height=lens.height,
                distortion_model="plumb_bob",
                d=[0.0] * 5,
                k=[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
                r=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
                p=[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
            )
            self._set_header(message, stamp, lens.frame)
            self._camera_info.publish(message)

    def _frames(self, *, moving: bool) -> list[TransformStamped]:
        children = self._kinematics.moving_frames
        return [frame for frame in self._robot.frames() if (frame.child in children) is moving]

    def _set_header(self, message: Any, stamp: int, frame: str) -> None:
        message.header.stamp = time_of(self._ros_time(stamp))
        message.header.frame_id = frame

    def _transforms(self, frames: Sequence[TransformStamped]) -> object:
        messages = []
        for frame in frames:
            message = TransformMessage(child_frame_id=frame.child)
            self._set_header(message, frame.stamp, frame.parent)
            _set_xyz(message.transform.translation, frame.position)
            _set_quaternion(message.transform.rotation, frame.quaternion)
            messages.append(message)
        return TFMessage(transforms=messages)

    def _image(self, picture: CameraImage, encoding: str, data: bytes, pixel_size: int) -> Image:
        height, width = picture.rgb.shape[:2]
        message = Image(
            height=height, width=width, encoding=encoding, step=width * pixel_size, data=array("B", data)
        )
        self._set_header(message, picture.stamp, picture.frame)
        return message

    def _subscribe(self, node: Any, message_class: type, name: str, take: Callable[[Any], None]) -> None:
        topic = node.resolve_topic_name(name)
        self._received[topic] = 0

        def receive(message: Any, info: Any) -> None:
            # The greatest number: the topic may have several publishers.
            self._received[topic] = max(self._received[topic], info["publication_sequence_number"])
            take(message)

        node.create_subscription(message_class, name, receive, RELIABLE)

    def _velocity_command(self, priority: int) -> Callable[[Twist], None]:
        """Return the callback of a topic for velocity commands of *priority*."""

        def take(message: Twist) -> None:
            v, w = message.linear.x, message.angular.z
            try:
                self._robot.drive(v, w, priority=priority)
            except ValueError as error:
                self._logger.warning(f"ignored: {error}")

        return take

    def _control(
        self, node: Any, name: str, joints: Sequence[str], move: Callable[[Sequence[float]], None]
    ) -> None:
        """Let *joints* follow the trajectories on the topic of the controller *name*."""
        controller = TrajectoryController(self._robot, joints, move)

        def take(message: JointTrajectory) -> None:
            try:
                controller.follow(message)
            except ValueError as error:
                self._logger.warning(f"{name}: ignored: {error}")

        self._subscribe(node, JointTrajectory, f"{name}/joint_trajectory", take)
        self._robot.schedule.add_task(TRAJECTORY_RATE, Phase.HEAD, controller.step)


class TrajectoryController:
    """Moves joints along trajectories, with linear interpolation between the points.

    A trajectory starts when it arrives; the stamp of its header is ignored. A new trajectory replaces the
    previous trajectory.

    Args:
        joints: The names of the joints.
        move: A function that moves the joints to the positions that it is given, in the order of *joints*.
    """

    def __init__(
        self, robot: SimulatedRobot, joints: Sequence[str], move: Callable[[Sequence[float]], None]
    ) -> None:
        self._robot = robot
        self._names = joints
        self._move = move
        self._points: list[tuple[int, Sequence[float]]] = []

    def follow(self, trajectory: JointTrajectory) -> None:
        """Start *trajectory*; one without points ends the present one.

        Raises:
            ValueError: The trajectory does not name exactly the joints of the controller, a point has a wrong
                number of positions, or a time does not increase.
        """
        names = list(trajectory.joint_names)
        if sorted(names) != sorted(self._names):
            raise ValueError(
                f"the joints of the trajectory are {', '.join(names) or 'missing'}, but the controller "
                f"has {', '.join(self._names)}"
            )
        now = self._robot.clock.now()
        present = self._robot.joint_positions()
        points: list[tuple[int, Sequence[float]]] = [(now, [present[name] for name in self._names])]
        for number, point in enumerate(trajectory.points):
            positions = dict(zip(names, point.positions, strict=False))
            if len(point.positions) != len(names) or not all(map(math.isfinite, point.positions)):
                raise ValueError(f"point {number} needs {len(names)} finite positions")
            time = now + point.time_from_start.sec * NS_PER_S + point.time_from_start.nanosec
            if time < points[-1][0] or (number and time == points[-1][0]):
                raise ValueError(f"time_from_start of point {number} is not after that of the previous point")
            points.append((time, [positions[name] for name in self._names]))
        self._points = points if len(points) > 1 else []
        self.step(now)

    def step(self, now: int) -> None:
        """Move the joints to their positions of the time *now* (ns)."""
        points = self._points
        if not points:
            return
        while len(points) > 1 and points[1][0] <= now:
            del points[0]
        time, positions = points[0]
        if len(points) == 1:
            self._points = []
        else:
            next_time, next_positions = points[1]
            fraction = (now - time) / (next_time - time)
            positions = [a + fraction * (b - a) for a, b in zip(positions, next_positions, strict=True)]
        self._move(positions)


def time_of(stamp: int) -> Time:
    """Return *stamp* (ns) as a ROS message."""
    return Time(sec=stamp // NS_PER_S, nanosec=stamp % NS_PER_S)


def _set_xyz(vector: Any, xyz: Sequence[float]) -> None:
    vector.x, vector.y, vector.z = xyz


def _set_quaternion(message: Any, quaternion: Sequence[float]) -> None:
    message.x, message.y, message.z, message.w = quaternion
