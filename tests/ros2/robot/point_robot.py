"""A ROS 2 robot without physics, in a process of its own: a point with a laser in an empty round room.

Commands are JSON objects, one a line, on stdin: each sets attributes of the robot, for example
`{"silent": ["/scan"]}`. `{"end": true}` ends the process. The answer to each command is a line on stdout.
"""

import array
import collections
import json
import math
import queue
import sys
import threading
import time

import rclpy
from geometry_msgs.msg import TransformStamped, Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState, CameraInfo, Image, JointState, LaserScan, Range
from tf2_msgs.msg import TFMessage
from trajectory_msgs.msg import JointTrajectory

RATE = 50
WALL = 3.0
HEAD = ("head_1_joint", "head_2_joint")
SIZE = (8, 6)
SECOND = 1_000_000_000

BEST_EFFORT = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class PointRobot(Node):
    def __init__(self, settings: dict) -> None:
        super().__init__("point_robot")
        self.offset = 1_000_000.0  # s, of the stamps relative to the monotonic clock
        self.silent: list[str] = []
        self.factor = 1.0  # of simulated time
        self.sim_time = False
        self.stamped = False
        self.paused = False  # simulated time stands still, and only /clock is published
        self.repeating: list[str] = []  # topics on which the last message is repeated
        self.disorder = False  # each message arrives twice, and after or before it an old message
        self.sent: dict[str, collections.deque] = collections.defaultdict(lambda: collections.deque(maxlen=6))
        for key, value in settings.items():
            setattr(self, key, value)
        self.pose = [0.0, 0.0, 0.0]
        self.twist = (0.0, 0.0)
        self.sources: dict[str, tuple[int, int, float, float]] = {}
        self.commands: list[tuple[str, float, float]] = []
        self.joints = {**dict.fromkeys(HEAD, 0.0), "torso_lift_joint": 0.0}
        self.began = time.monotonic_ns()
        self.shift = 0
        self.makers = {
            "/clock": self.create_publisher(Clock, "/clock", 10) if self.sim_time else None,
            "/scan": self.create_publisher(LaserScan, "/scan", BEST_EFFORT),
            "/odom": self.create_publisher(Odometry, "/odom", 10),
            "/tf": self.create_publisher(TFMessage, "/tf", 100),
            "/joint_states": self.create_publisher(JointState, "/joint_states", 10),
            "/battery": self.create_publisher(BatteryState, "/battery", BEST_EFFORT),
            "/sonar": self.create_publisher(Range, "/sonar", BEST_EFFORT),
            "/image": self.create_publisher(Image, "/image", BEST_EFFORT),
            "/depth": self.create_publisher(Image, "/depth", BEST_EFFORT),
            "/camera_info": self.create_publisher(CameraInfo, "/camera_info", BEST_EFFORT),
        }
        static = self.create_publisher(TFMessage, "/tf_static", LATCHED)
        static.publish(
            TFMessage(
                transforms=[
                    frame("base_footprint", "base_link", z=0.1),
                    frame("base_link", "laser", x=0.2),
                    frame("base_link", "camera_optical", z=1.0),
                ]
            )
        )
        self.static = static
        for topic, priority in {"/cmd_vel": 10, "/key_vel": 90}.items():
            kind = TwistStamped if self.stamped else Twist
            self.create_subscription(
                kind, topic, lambda message, t=topic, p=priority: self.receive(t, p, message), 10
            )
        self.create_subscription(JointTrajectory, "/head_controller/joint_trajectory", self.move, 10)
        self.create_subscription(JointTrajectory, "/torso_controller/joint_trajectory", self.move, 10)
        self.targets = dict(self.joints)
        self.steps = 0
        self.last = self.now()

    def receive(self, topic: str, priority: int, message: object) -> None:
        twist = message.twist if self.stamped else message
        self.commands.append((topic, twist.linear.x, twist.angular.z))
        self.sources[topic] = (priority, self.now(), twist.linear.x, twist.angular.z)

    def move(self, message: JointTrajectory) -> None:
        self.targets.update(zip(message.joint_names, message.points[-1].positions, strict=True))

    def goal(self) -> tuple[float, float]:
        now = self.now()
        alive = [source for source in self.sources.values() if now - source[1] < SECOND // 2]
        if not alive:
            return 0.0, 0.0
        return max(alive)[2:]

    def now(self) -> int:
        if self.sim_time:
            return round((time.monotonic_ns() - self.began) * self.factor) + self.shift + SECOND
        return time.monotonic_ns() + round(self.offset * SECOND)

    def step(self) -> None:
        if self.paused:
            self.shift += self.last - self.now()
            self.send("/clock", self.last, lambda s: Clock(clock=s))
            return
        stamp = self.now()
        seconds = min(max((stamp - self.last) / SECOND, 0.0), 0.1)
        self.last = stamp
        goal = self.goal()
        v = self.twist[0] + min(max(goal[0] - self.twist[0], -seconds), seconds)
        w = self.twist[1] + min(max(goal[1] - self.twist[1], -2 * seconds), 2 * seconds)
        self.twist = v, w
        x, y, yaw = self.pose
        self.pose = [x + v * seconds * math.cos(yaw), y + v * seconds * math.sin(yaw), yaw + w * seconds]
        for name, target in self.targets.items():
            speed = 3.0 if name in HEAD else 0.3
            change = target - self.joints[name]
            self.joints[name] += min(max(change, -speed * seconds), speed * seconds)
        self.send("/clock", stamp, lambda s: Clock(clock=s))
        if self.steps % 5 == 0:
            self.send("/scan", stamp, self.scan)
            self.send("/battery", stamp, self.battery)
            self.send("/sonar", stamp, self.sonar)
            for topic in ("/image", "/depth", "/camera_info"):
                self.send(topic, stamp, getattr(self, topic[1:]))
        self.send("/odom", stamp, self.odometry)
        self.send("/tf", stamp, self.transforms)
        self.send("/joint_states", stamp, self.states)
        self.steps += 1

    def send(self, topic: str, stamp: int, make: object) -> None:
        if topic in self.silent or self.makers[topic] is None:
            return
        from builtin_interfaces.msg import Time

        message, sent = make(Time(sec=stamp // SECOND, nanosec=stamp % SECOND)), self.sent[topic]
        if topic in self.repeating and sent:
            message = sent[-1][1]
        sent.append((stamp, message))
        order = [message]
        if self.disorder:
            # An older message would be a jump of the clock, if the machine is slow.
            old = next(earlier for then, earlier in sent if stamp - then < SECOND // 2)
            order = [message, message, old] if self.steps % 2 else [old, message, message]
        for each in order:
            self.makers[topic].publish(each)

    def scan(self, stamp: object) -> LaserScan:
        message = LaserScan(
            angle_min=-1.5, angle_max=1.5, angle_increment=3.0 / 89, range_min=0.05, range_max=10.0
        )
        message.header.frame_id = "laser"
        message.header.stamp = stamp
        message.ranges = array.array("f", [WALL] * 90)
        return message

    def odometry(self, stamp: object) -> Odometry:
        message = Odometry(child_frame_id="base_footprint")
        message.header.frame_id = "odom"
        message.header.stamp = stamp
        x, y, yaw = self.pose
        message.pose.pose.position.x, message.pose.pose.position.y = x, y
        message.pose.pose.orientation.z = math.sin(yaw / 2)
        message.pose.pose.orientation.w = math.cos(yaw / 2)
        message.twist.twist.linear.x, message.twist.twist.angular.z = self.twist
        return message

    def transforms(self, stamp: object) -> TFMessage:
        base = frame("odom", "base_footprint", x=self.pose[0], y=self.pose[1])
        torso = frame("base_link", "torso", z=self.joints["torso_lift_joint"])
        base.header.stamp = torso.header.stamp = stamp
        return TFMessage(transforms=[base, torso])

    def states(self, stamp: object) -> JointState:
        message = JointState(name=list(self.joints), position=list(self.joints.values()))
        message.header.stamp = stamp
        return message

    def battery(self, stamp: object) -> BatteryState:
        message = BatteryState(percentage=0.75)
        message.header.stamp = stamp
        return message

    def sonar(self, stamp: object) -> Range:
        message = Range(field_of_view=0.5, min_range=0.02, max_range=1.0, range=2.0)
        message.header.frame_id = "base_link"
        message.header.stamp = stamp
        return message

    def image(self, stamp: object) -> Image:
        width, height = SIZE
        message = Image(width=width, height=height, encoding="bgr8", step=width * 3 + 4)
        message.data = bytes([10, 20, 30] * width + [0] * 4) * height
        message.header.frame_id = "camera_optical"
        message.header.stamp = stamp
        return message

    def depth(self, stamp: object) -> Image:
        width, height = SIZE
        message = Image(width=width, height=height, encoding="16UC1", step=width * 2)
        message.data = bytes([0, 0] + list((1500).to_bytes(2, "little")) * (width - 1)) * height
        message.header.stamp = stamp
        return message

    def camera_info(self, stamp: object) -> CameraInfo:
        message = CameraInfo(width=SIZE[0], height=SIZE[1])
        message.k = [100.0, 0.0, 4.0, 0.0, 100.0, 3.0, 0.0, 0.0, 1.0]
        message.header.frame_id = "camera_optical"
        message.header.stamp = stamp
        return message


def frame(parent: str, child: str, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> TransformStamped:
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id = parent
    message.transform.translation.x, message.transform.translation.y = x, y
    message.transform.translation.z = z
    return message


def main() -> None:
    lines: queue.Queue[str] = queue.Queue()
    threading.Thread(
        target=lambda: [lines.put(line) for line in sys.stdin] + [lines.put("")], daemon=True
    ).start()
    rclpy.init()
    robot = PointRobot(json.loads(sys.argv[1]))
    executor = rclpy.executors.SingleThreadedExecutor()
    executor.add_node(robot)
    print("ready", flush=True)
    period = round(SECOND / RATE / robot.factor)
    due = time.monotonic_ns()
    while True:
        due = max(due + period, time.monotonic_ns())
        robot.step()
        while time.monotonic_ns() < due + period:
            executor.spin_once(timeout_sec=max(0.0, (due + period - time.monotonic_ns()) / SECOND))
        while not lines.empty():
            line = lines.get()
            command = json.loads(line) if line.strip() else {"end": True}
            if "end" in command:
                # Announced to the other nodes, which would see the robot for 20 s more otherwise.
                executor.shutdown()
                robot.destroy_node()
                rclpy.shutdown()
                return
            for key, value in command.items():
                setattr(robot, key, value)
            print(json.dumps({"commands": robot.commands[-20:], "twist": robot.twist}), flush=True)


if __name__ == "__main__":
    main()
