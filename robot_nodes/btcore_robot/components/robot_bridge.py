"""A component that connects the robot to topics: it publishes sensor data and subscribes to commands.

The topic names are those of the book *A Concise Introduction to Robot Programming with ROS2*.
"""

from collections.abc import Callable

from btcore_robot.components.component import Component, ComponentContext, ComponentOptions
from btcore_robot.components.messages import HeadCommand
from btcore_robot.robot import CameraImage, HeadPosition, LaserScan, Odometry, Twist2D

SCAN_TOPIC = "/scan_raw"
"""The topic of the laser scans."""

IMAGE_TOPIC = "/head_front_camera/rgb/image_raw"
"""The topic of the camera's images."""

ODOMETRY_TOPIC = "/mobile_base_controller/odom"
"""The topic of the odometry."""

JOINT_STATE = "/head_controller/state"
"""The topic of the head's position."""

JOINT_COMMAND = "/head_controller/joint_trajectory"
"""The topic of commands for the head."""

VELOCITIES = {"/cmd_vel": 10, "/nav_vel": 10, "/key_vel": 90, "/joy_vel": 100}
"""The velocity topics and the priority of each (twist_mux configuration of Tiago)."""

PERIOD_S = 0.02
"""The period (s) of the check for new data, which is the period of the odometry."""


class RobotBridge(Component):
    """Publish each new scan, image, odometry and head position; pass commands to the robot.

    Images are requested only while their topic has subscribers.
    """

    def __init__(self, context: ComponentContext, options: ComponentOptions | None = None) -> None:
        super().__init__("robot", context, options)
        if context.robot is None:
            raise ValueError("a bridge needs a robot, but the context has none")
        self.robot = context.robot
        self._scans = self.create_publisher(SCAN_TOPIC, LaserScan)
        self._images = self.create_publisher(IMAGE_TOPIC, CameraImage)
        self._odometry = self.create_publisher(ODOMETRY_TOPIC, Odometry)
        self._joints = self.create_publisher(JOINT_STATE, HeadPosition)
        self._sent: dict[str, int] = {}
        for topic, priority in VELOCITIES.items():
            self.create_subscription(topic, Twist2D, self._driver(priority))
        self.create_subscription(JOINT_COMMAND, HeadCommand, self._move_head)
        self.create_timer(PERIOD_S, self.publish)

    def publish(self) -> None:
        """Publish the scan, odometry, head position and image that are newer than the last published data."""
        robot = self.robot
        scan = robot.scan()
        if scan is not None and self._take_if_new(SCAN_TOPIC, scan.stamp):
            self._scans.publish(scan)
        odometry = robot.odometry()
        if self._take_if_new(ODOMETRY_TOPIC, odometry.stamp):
            self._odometry.publish(odometry)
        head = robot.head()
        if head is not None and self._take_if_new(JOINT_STATE, head.stamp):
            self._joints.publish(head)
        # A simulated camera renders an image when it is requested.
        if self._images.has_subscribers:
            image = robot.camera()
            if image is not None and self._take_if_new(IMAGE_TOPIC, image.stamp):
                self._images.publish(image)

    def _take_if_new(self, topic: str, stamp: int) -> bool:
        if self._sent.get(topic) == stamp:
            return False
        self._sent[topic] = stamp
        return True

    def _driver(self, priority: int) -> Callable[[Twist2D], None]:
        return lambda twist: self.robot.drive(twist.v, twist.w, priority=priority)

    def _move_head(self, command: HeadCommand) -> None:
        self.robot.move_head(command.pan, command.tilt)
