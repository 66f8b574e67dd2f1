"""The simulator's implementation of the `Robot` protocol."""

import logging
import math
from collections.abc import Sequence
from itertools import accumulate, pairwise

import numpy as np

from btcore.clock import NS_PER_S
from btcore_robot.command_multiplexer import CommandMultiplexer
from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import (
    CMD_VEL,
    MAP_FRAME,
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
from btcore_robot.scene_messages import camera_message, laser_message, picture_message, scan_message
from btcore_robot.schedule import SimulatedSchedule
from btcore_scene import Frame, MovingScene, StaticScene
from btcore_sim import scene_messages
from btcore_sim.battery import FULL, BatteryModel
from btcore_sim.camera import Camera, CameraSettings
from btcore_sim.contacts import ContactCounter
from btcore_sim.differential_drive import DifferentialDrive
from btcore_sim.errors import SimError
from btcore_sim.faults import Fault, FaultSchedule
from btcore_sim.kinematics import Kinematics
from btcore_sim.physics_body import PhysicsBody
from btcore_sim.quiet_pybullet import pybullet
from btcore_sim.robot_description import RobotDescription, load_robot_description
from btcore_sim.robot_sensors import RobotSensors
from btcore_sim.visible_faces import VisibleFaces
from btcore_sim.world import World

_log = logging.getLogger(__name__)

_SETTLE_TIME_S = 0.5  # s of physics before the run begins, in which the wheels settle on the floor


class CarryPath:
    """The path along which a robot is carried: straight lines between *poses*, at a constant speed.

    Args:
        poses: The poses of the robot's base.
        speed: The speed (m/s).
        start_time: The time of the first pose (ns).
        height: The height of the robot's base link (m).

    Attributes:
        end: The time of the last pose (ns).
    """

    def __init__(self, poses: Sequence[Pose2D], speed: float, start_time: int, height: float) -> None:
        steps = [math.hypot(end.x - start.x, end.y - start.y) for start, end in pairwise(poses)]
        self._times = [start_time + length / speed * NS_PER_S for length in accumulate(steps, initial=0.0)]
        self._columns = [p.x for p in poses], [p.y for p in poses], np.unwrap([p.yaw for p in poses])
        self.end = round(self._times[-1])
        self.height = height

    def pose(self, now: int) -> Pose2D:
        """Return the pose at the time *now* (ns)."""
        x, y, yaw = (float(np.interp(now, self._times, column)) for column in self._columns)
        return Pose2D(x, y, wrap_angle(yaw))

    def remaining_poses(self, now: int) -> list[Pose2D]:
        """Return the pose at the time *now* (ns), and the poses of the way that follow."""
        return [self.pose(now), *(self.pose(round(time)) for time in self._times if time > now)]


class SimulatedRobot(Robot):
    """A robot with a differential drive and a laser, and optionally head, torso, camera and sonars.

    The rule and the seed of the world determine the start pose. A new robot already has a scan and
    odometry, both with time 0. The attributes that are not part of the Robot protocol (true pose,
    contacts, distance driven) are for the report of a run. Leaves must not use them.

    Args:
        world: The world.
        description: The robot's description; the Tiago by default.
        camera: The settings of the camera, or None to switch it off.
        faults: The parts that fail, and the periods in which they fail.
        battery: The battery's level at the start (percent).

    Attributes:
        physics_body: The robot's body in the physics engine.
        contacts: The counter of collisions.

    Raises:
        SimError: The description does not fit the URDF, the world has no room for a start pose, the robot
            would touch an object there, or the world already has a robot.
    """

    def __init__(
        self,
        world: World,
        description: RobotDescription | None = None,
        *,
        camera: CameraSettings | None = None,
        faults: Sequence[Fault] = (),
        battery: float = FULL,
    ) -> None:
        world.add_robot()
        self.world = world
        self.description = description if description is not None else load_robot_description()
        self.faults = FaultSchedule(faults)
        """The parts that fail, with the periods."""
        self.battery_model = BatteryModel(battery)
        """The model of the battery."""
        self._was_battery_empty = False
        wheels = self.description.wheels
        start = world.description.start(world.random("start"), self.description.base.radius)
        self.physics_body = PhysicsBody(world, self.description, start)
        touched = self.physics_body.touched_object(world)
        if touched is not None:
            raise SimError(
                f"world '{world.description.name}': the robot cannot start at ({start.x:g}, {start.y:g}), "
                f"because it would touch '{touched}' there: use another start pose, or --start random"
            )
        for held in self.description.held:
            joint = self.physics_body.joint(held.joint)
            self.physics_body.hold_joint(joint, held.position, held.force, held.speed)
        self._wheels = [self.physics_body.joint(wheels.left), self.physics_body.joint(wheels.right)]
        mount = self.description.camera
        self._camera_link = self.physics_body.link(mount.link) if mount else -1
        # Raises an error for an unknown link.
        for link in (self.description.laser.link, *(shell.link for shell in self.description.shells)):
            self.physics_body.link(link)
        head = self.description.head
        self._head = [self.physics_body.joint(head.pan), self.physics_body.joint(head.tilt)] if head else []
        torso = self.description.torso
        self._torso = [self.physics_body.joint(torso.joint)] if torso else []
        self._kinematics = Kinematics(self.description)
        # In the order in which `Kinematics.frames` expects the positions.
        self._joints = [self.physics_body.joint(name) for name in self._kinematics.joints]
        self._differential_drive = DifferentialDrive(self.description.base, wheels.radius, wheels.separation)
        self._command_multiplexer = CommandMultiplexer()
        self._wheel_rates: tuple[float, float] | None = None
        self._carry_path: CarryPath | None = None
        # The motors hold their positions before the physics settles, so that head and torso do not sag.
        self.move_head(0.0, 0.0)
        self.lift(0.0)
        self._command_wheels(0)
        world.settle(_SETTLE_TIME_S)
        self.contacts = ContactCounter(world.client, self.physics_body.body_id, world.floor)
        self._position = self.physics_body.pose()[0]
        self.distance = 0.0
        """The true distance driven (m), without kidnappings."""
        self.kidnap_times: list[int] = []
        """The times (ns) at which the robot was kidnapped: `kidnap` or `carry` was called."""
        self._camera = (
            Camera(VisibleFaces(world, self.physics_body), self.description.camera, camera)
            if camera and self.description.camera
            else None
        )
        self.start_pose = self.true_pose()
        """The true pose of the base at time 0."""
        self.sensors = RobotSensors(world, self.physics_body, self.description, self.faults)
        """The laser, the odometry and the sonars."""
        self._camera_frames: list[Frame] = []
        self._last_picture_stamp = -1
        world.add_step_callbacks(self._before_step, self._after_step)

    @property
    def clock(self) -> World:
        """The world. Waiting on this clock runs the simulation."""
        return self.world

    @property
    def schedule(self) -> SimulatedSchedule:
        """The schedule of the tasks that run while the clock advances."""
        return self.world.schedule

    @property
    def base_info(self) -> BaseInfo:
        """The base's limits and size."""
        return self.description.base

    @property
    def laser_info(self) -> LaserInfo:
        """The laser's geometry and range."""
        return self.description.laser.info

    @property
    def head_info(self) -> HeadInfo | None:
        """The head's limits, or None if the robot has no head."""
        return self.description.head.info if self.description.head else None

    @property
    def camera_info(self) -> CameraInfo | None:
        """The camera's geometry, or None if there is no camera."""
        return self._camera.info if self._camera is not None else None

    @property
    def torso_info(self) -> TorsoInfo | None:
        """The torso's limits, or None if the torso cannot be lifted."""
        return self.description.torso.info if self.description.torso else None

    def frames(self) -> list[TransformStamped]:
        """Return the transforms of links and sensors below `base_footprint`, from the joints' positions."""
        return self._kinematics.frames(self.physics_body.joint_positions(self._joints), self.world.now())

    def moving_frames(self) -> list[TransformStamped]:
        """Return the transforms of the links that a joint moves; the other frames are fixed."""
        positions = self.physics_body.joint_positions(self._joints)
        return self._kinematics.frames_of_joints(positions, self.world.now())

    def joint_positions(self) -> dict[str, float]:
        """Return the positions (rad or m) of the moving joints of the URDF, including the wheels, by name."""
        wheels = self.description.wheels
        names = (*self._kinematics.joints, wheels.left, wheels.right)
        positions = self.physics_body.joint_positions([*self._joints, *self._wheels])
        return dict(zip(names, positions, strict=True))

    def drive(self, v: float, w: float, *, priority: int = CMD_VEL) -> None:
        """Command the velocity *v* (m/s) and *w* (rad/s); see `Robot.drive`.

        Raises:
            ValueError: *v* or *w* is not finite.
        """
        if not (math.isfinite(v) and math.isfinite(w)):
            raise ValueError(f"the velocity command v={v} m/s, w={w} rad/s is not finite")
        now = self.world.now()
        if self._command_multiplexer.admits(priority, now):
            self._differential_drive.command(v, w, now)

    def stop(self) -> None:
        """Stop the base, and forget the commands of all sources."""
        self._command_multiplexer.clear()
        self._differential_drive.command(0.0, 0.0, self.world.now())

    def commanded_velocity(self) -> Twist2D:
        """Return the last commanded velocity, without limits; zero after the command's timeout."""
        return self._differential_drive.commanded_twist(self.world.now())

    def scan(self) -> LaserScan | None:
        """Return the newest scan that has arrived; its ranges are read-only."""
        return self.sensors.delayed_scans.newest(self.world.now())

    def odometry(self) -> Odometry:
        """Return the newest odometry that has arrived."""
        return self.sensors.delayed_odometry.newest(self.world.now()) or self.sensors.odometry

    def move_head(self, pan: float, tilt: float) -> None:
        """Turn the head to *pan* and *tilt* (rad), limited to `head_info`, at the head's greatest speed."""
        head = self.description.head
        if head is None:
            return
        pan = min(max(pan, head.info.pan_min), head.info.pan_max)
        tilt = min(max(tilt, head.info.tilt_min), head.info.tilt_max)
        self.physics_body.hold_joint(self._head[0], pan, head.torque, head.info.speed)
        self.physics_body.hold_joint(self._head[1], tilt, head.torque, head.info.speed)

    def head(self) -> HeadPosition | None:
        """Return the head's present position, or None if the robot has no head."""
        if not self._head:
            return None
        pan, tilt = self.physics_body.joint_positions(self._head)
        return HeadPosition(pan, tilt, self.world.now())

    def camera(self) -> CameraImage | None:
        """Return the newest picture, rendered now if the camera's rate allows it; None without a camera."""
        if self._camera is None:
            return None
        now = self.world.now()
        has_failed = self.faults.has_failed("camera", now)
        return self._camera.picture(self.physics_body, self._camera_link, now, has_failed)

    def sonars(self) -> tuple[SonarReading, ...]:
        """Return the newest reading of every sonar that has arrived."""
        return self.sensors.delayed_sonars.newest(self.world.now()) or ()

    def battery(self) -> BatteryState:
        """Return the battery's state. With an empty battery the base does not move."""
        return BatteryState(self.battery_model.level, self.world.now())

    def recharge(self) -> None:
        """Set the battery's level to 100 % at once."""
        self.battery_model.fill()

    def lift(self, height: float) -> None:
        """Move the torso to *height* (m), limited to `torso_info`, at the maximum speed of the torso."""
        torso = self.description.torso
        if torso is not None:
            height = min(max(height, torso.info.lift_min), torso.info.lift_max)
            self.physics_body.hold_joint(self._torso[0], height, torso.force, torso.info.speed)

    def torso_height(self) -> float | None:
        """Return the torso's present height (m), or None if the torso cannot be lifted."""
        return self.physics_body.joint_positions(self._torso)[0] if self._torso else None

    def true_pose(self) -> Pose2D:
        """Return the base's true pose in the world frame."""
        position, quaternion = self.physics_body.pose()
        return Pose2D(position[0], position[1], pybullet.getEulerFromQuaternion(quaternion)[2])

    def kidnap(self, pose: Pose2D) -> None:
        """Move the robot to *pose* at once: the odometry does not change."""
        self.kidnap_times.append(self.world.now())
        self._carry_path = None
        self.physics_body.set_pose(pose)
        self._position = self.physics_body.pose()[0]

    def carry(self, poses: Sequence[Pose2D], speed: float) -> None:
        """Begin to carry the robot along *poses*; see `CarryPath`.

        Until the end of the way the wheels stand still, the odometry does not change, and contacts are not
        counted. Laser and camera show the way.

        Args:
            poses: The poses of the base, from the present pose on.
            speed: The speed (m/s).
        """
        now = self.world.now()
        self.kidnap_times.append(now)
        self._carry_path = CarryPath(poses, speed, now, self.physics_body.pose()[0][2])

    @property
    def is_carried(self) -> bool:
        """Whether the robot is being carried to another place."""
        return self._carry_path is not None

    def carried_along(self) -> Sequence[Pose2D]:
        """Return the poses along which the robot is still to be carried; empty if it is not being carried."""
        return () if self._carry_path is None else self._carry_path.remaining_poses(self.world.now())

    def ramped_twist(self) -> tuple[float, float]:
        """Return the velocity (m/s, rad/s) that is commanded to the wheels, after limits and ramps."""
        return self._differential_drive.twist.v, self._differential_drive.twist.w

    def static_scene(self) -> StaticScene:
        """Return the parts of the scene that do not change: shapes, the sensors' geometry, and waypoints."""
        self._last_picture_stamp = -1  # a new viewer gets the newest picture even if it is an old picture
        lens = self.camera_info
        if lens is not None:
            links = self.physics_body.links
            self._camera_frames = scene_messages.frame_chain(lens.frame, self.frames(), links)
        return StaticScene(
            frame=MAP_FRAME,
            parts=scene_messages.world_parts(self.world)
            + scene_messages.robot_parts(self.world, self.physics_body),
            meshes=scene_messages.world_meshes(self.world)
            + scene_messages.robot_meshes(self.world, self.physics_body),
            laser=laser_message(self.laser_info),
            places=scene_messages.waypoint_data(self.world),
            footprint_radius=self.base_info.radius,
            battery=self.battery_model.level,
            cameras=() if lens is None else [camera_message(lens)],
        )

    def moving_scene(self) -> MovingScene:
        """Return the present frames, and the newest scan, velocity, battery level and contacts.

        The newest picture is included if it was taken since the last call. Latencies are ignored, because the
        viewer draws the readings at the present poses.
        """
        twist, scan = self.sensors.odometry.twist, self.sensors.scan
        picture = self._camera.newest if self._camera is not None else None
        if picture is not None and picture.stamp == self._last_picture_stamp:
            picture = None
        elif picture is not None:
            self._last_picture_stamp = picture.stamp
        return MovingScene(
            stamp=self.world.now(),
            frames=scene_messages.frames(self.world, self.physics_body) + self._camera_frames,
            velocity=(twist.v, twist.w),
            battery=self.battery_model.level,
            collisions=self.contacts.collisions,
            grazes=self.contacts.grazes,
            scan=None if scan is None else scan_message(scan),
            pictures=() if picture is None else [picture_message(picture)],
        )

    def _before_step(self, now: int) -> None:
        self._command_wheels(now)
        if self._carry_path is not None:
            self.physics_body.set_pose(self._carry_path.pose(now), self._carry_path.height)
        self.battery_model.drain(self._differential_drive.commanded_twist(now), 1.0 / self.world.rate)
        if self.battery_model.is_empty and not self._was_battery_empty:
            _log.warning("the robot's battery is empty: the robot stands until it is recharged")
        self._was_battery_empty = self.battery_model.is_empty
        self.contacts.before_step(self._position)

    def _after_step(self, now: int) -> None:
        position = self.physics_body.pose()[0]
        if self._carry_path is None:
            self.distance += math.dist(position[:2], self._position[:2])
            self.contacts.after_step(now)
        elif now >= self._carry_path.end:
            self._carry_path = None
        self._position = position

    def _command_wheels(self, now: int) -> None:
        seconds = 1.0 / self.world.rate
        can_drive = not self.battery_model.is_empty and self._carry_path is None
        self._differential_drive.step(now, seconds, accepts_commands=can_drive)
        left, right = self._differential_drive.wheel_rates() if self._carry_path is None else (0.0, 0.0)
        if self.faults.has_failed("wheel", now):
            left = 0.0
        if (left, right) != self._wheel_rates:
            # Only changes are sent to the engine: its motors keep their targets.
            self._wheel_rates = (left, right)
            self.physics_body.spin_joints(self._wheels, self._wheel_rates, self.description.wheels.torque)
