"""The laser, the odometry and the sonars of a simulated robot."""

from btcore_robot.robot import LaserScan, Odometry, Phase, SonarReading
from btcore_sim.differential_drive import WheelErrorModel, WheelOdometry
from btcore_sim.faults import FaultSchedule
from btcore_sim.laser import Laser, MovableObstacles, RayCaster
from btcore_sim.latency import DelayedReadings
from btcore_sim.physics_body import PhysicsBody
from btcore_sim.quiet_pybullet import pybullet
from btcore_sim.robot_description import RobotDescription
from btcore_sim.sonar import Sonars
from btcore_sim.world import World


class RobotSensors:
    """Reads the laser, the wheels and the sonars of a robot at their rates, as tasks of the schedule.

    Attributes:
        scan: The newest scan, which may not have arrived yet; None before the first.
        odometry: The newest odometry, which may not have arrived yet.
        delayed_scans: The scans with their latency.
        delayed_odometry: The odometry with its latency.
        delayed_sonars: The readings of all sonars with their latency.
        laser: The laser.
        wheel_odometry: The computation of the odometry.
    """

    def __init__(
        self, world: World, body: PhysicsBody, description: RobotDescription, faults: FaultSchedule
    ) -> None:
        self._body = body
        self._faults = faults
        mount, wheels = description.laser, description.wheels
        self._mount = mount
        self._laser_link = body.link(mount.link)
        # The laser's light passes through glass.
        opaque = {id: item for id, item in world.bodies.items() if not item.is_glass}
        static_objects = [item for item in opaque.values() if item.is_static]
        movable_bodies = {id: opaque[id] for id in world.movable if id in opaque}
        movable_objects = MovableObstacles(world.client, movable_bodies)
        static_ray_caster = RayCaster.of(static_objects, world.description.walls)
        random = world.random("laser")
        self.laser = Laser(mount.info, static_ray_caster, random, movable_objects, mount.outliers)
        self.scan: LaserScan | None = None
        self.delayed_scans = DelayedReadings[LaserScan](mount.latency)

        self._wheels = [body.joint(wheels.left), body.joint(wheels.right)]
        angles = body.joint_positions(self._wheels)
        wheel_errors = WheelErrorModel(description.odometry, world.random("odometry"))
        self.wheel_odometry = WheelOdometry(wheels.radius, wheels.separation, angles, wheel_errors)
        self.odometry = self.wheel_odometry.update(angles, 0)
        self.delayed_odometry = DelayedReadings[Odometry](description.odometry.latency)
        self.delayed_odometry.add(self.odometry, 0)

        self._sonar_links = [body.link(sonar.link) for sonar in description.sonars]
        self._sonars = Sonars(world.client, description.sonars)
        self.delayed_sonars = DelayedReadings[tuple[SonarReading, ...]](description.sonar_latency)

        self._sense_laser(0)
        add_task = world.schedule.add_task
        add_task(mount.rate, Phase.SENSORS, self._sense_laser)
        add_task(description.odometry.rate, Phase.SENSORS, self._sense_wheels)
        if description.sonars:
            self._sense_sonars(0)
            add_task(description.sonar_rate, Phase.SENSORS, self._sense_sonars)

    def _sense_laser(self, now: int) -> None:
        if self._faults.has_failed("laser", now):
            return
        position, quaternion = self._body.link_pose(self._laser_link)
        origin, quaternion = pybullet.multiplyTransforms(
            position, quaternion, self._mount.position, (0.0, 0.0, 0.0, 1.0)
        )
        heading = pybullet.getEulerFromQuaternion(quaternion)[2]
        self.scan = self.laser.sweep(origin[0], origin[1], origin[2], heading, now)
        self.scan.ranges.flags.writeable = False
        self.delayed_scans.add(self.scan, now)

    def _sense_wheels(self, now: int) -> None:
        if not self._faults.has_failed("odometry", now):
            self.odometry = self.wheel_odometry.update(self._body.joint_positions(self._wheels), now)
            self.delayed_odometry.add(self.odometry, now)

    def _sense_sonars(self, now: int) -> None:
        readings = self._sonars.read([self._body.link_pose(link) for link in self._sonar_links], now)
        self.delayed_sonars.add(readings, now)
