"""The base of the servers that drive the robot: the controller and the recoveries."""

from btcore_navigation.action import ActionServer, Feedback, Goal, GoalHandle
from btcore_navigation.clearance import ClearanceGrid, laser_pose
from btcore_navigation.sensor_watch import SensorWatch
from btcore_navigation.velocity_smoother import VelocityLimits, VelocitySmoother
from btcore_robot.robot import Robot
from btcore_robot.transforms import TransformTree


class MotionServer(ActionServer[Goal, Feedback, None]):
    """A server of goals that drive the robot. Without a goal it brakes until the robot stands.

    Call `step` from the robot's schedule in `Phase.CONTROLLER`.

    Args:
        robot: The robot.
        tree: The transform tree.
        clearance: The distances to obstacles; the servers of a robot share them.
        sensors: The watch over the sensors.
        limits: The limits of the velocity; those of the robot's base apply, too.
        rate: The rate (Hz) at which `step` is called.
    """

    def __init__(
        self,
        robot: Robot,
        tree: TransformTree,
        clearance: ClearanceGrid,
        sensors: SensorWatch,
        limits: VelocityLimits,
        rate: float,
    ) -> None:
        super().__init__()
        self.clearance = clearance
        """The distances to obstacles in the newest scan; public for displays."""
        self._robot = robot
        self._tree = tree
        self._sensors = sensors
        self._smoother = VelocitySmoother(robot, limits.within(robot.base_info), 1.0 / rate)
        self._last = 0

    def step(self, now: int) -> None:
        """Run one period at *now* (ns); without a goal, brake until the robot stands."""
        super().step(now)
        if not self.is_busy:
            self._smoother.slow_to_stop(now)

    def stop(self, handle: GoalHandle[Goal, Feedback, None], now: int) -> None:
        """Brake; later steps brake further until the robot stands."""
        self._smoother.send_command(0.0, 0.0, now)

    def _update_clearance(self) -> None:
        """Compute the clearance from the newest scan. Raise a TransformError without the laser's pose."""
        scan = self._robot.scan()
        if scan is not None and scan.stamp != self.clearance.stamp:
            self.clearance.update(scan, laser_pose(self._tree, self.clearance.frame, scan))
