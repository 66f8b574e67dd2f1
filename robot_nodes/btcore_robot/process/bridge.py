"""The robot as a process: its readings as topics, and topics that drive it, under the book's names."""

from collections.abc import Callable

from btcore_robot.process.messages import HeadCommand
from btcore_robot.process.process import Process, ProcessContext, ProcessOptions
from btcore_robot.robot import CameraImage, HeadPosition, LaserScan, Odometry, Twist2D

SCAN = "/scan_raw"
IMAGE = "/head_front_camera/rgb/image_raw"
ODOMETRY = "/mobile_base_controller/odom"
JOINT_STATE = "/head_controller/state"
JOINT_COMMAND = "/head_controller/joint_trajectory"

VELOCITIES = {"/cmd_vel": 10, "/nav_vel": 10, "/key_vel": 90, "/joy_vel": 100}
"""The topics of velocities, and the priority of each (twist_mux of Tiago's start-up files)."""

PERIOD = 0.02
"""How often (s) it looks whether there is something new: the rate of the odometry."""


class Bridge(Process):
    """Publishes each new scan, picture, odometry and head position; passes velocities and head commands on.

    A picture is asked for only while somebody listens to it.
    """

    def __init__(self, context: ProcessContext, options: ProcessOptions | None = None) -> None:
        super().__init__("robot", context, options)
        if context.robot is None:
            raise ValueError("a bridge is for a robot, and there is none around")
        self.robot = context.robot
        self._scans = self.publisher(SCAN, LaserScan)
        self._pictures = self.publisher(IMAGE, CameraImage)
        self._odometry = self.publisher(ODOMETRY, Odometry)
        self._joints = self.publisher(JOINT_STATE, HeadPosition)
        self._sent: dict[str, int] = {}
        for topic, priority in VELOCITIES.items():
            self.subscribe(topic, Twist2D, self._driver(priority))
        self.subscribe(JOINT_COMMAND, HeadCommand, self._look)
        self.timer(PERIOD, self.publish)

    def publish(self) -> None:
        """Publish what is new."""
        robot = self.robot
        scan = robot.scan()
        if scan is not None and self._is_new(SCAN, scan.stamp):
            self._scans.publish(scan)
        odometry = robot.odometry()
        if self._is_new(ODOMETRY, odometry.stamp):
            self._odometry.publish(odometry)
        head = robot.head()
        if head is not None and self._is_new(JOINT_STATE, head.stamp):
            self._joints.publish(head)
        if self._pictures.has_subscribers:
            picture = robot.camera()
            if picture is not None and self._is_new(IMAGE, picture.stamp):
                self._pictures.publish(picture)

    def _is_new(self, topic: str, stamp: int) -> bool:
        if self._sent.get(topic) == stamp:
            return False
        self._sent[topic] = stamp
        return True

    def _driver(self, priority: int) -> Callable[[Twist2D], None]:
        return lambda twist: self.robot.drive(twist.v, twist.w, priority=priority)

    def _look(self, command: HeadCommand) -> None:
        self.robot.move_head(command.pan, command.tilt)
