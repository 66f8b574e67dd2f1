"""A robot's body in a world, made from its description: the simulator's `Robot`."""

import math
from collections.abc import Sequence
from typing import Any

from robot_nodes.robot import (
    CMD_VEL,
    BaseFacts,
    HeadFacts,
    HeadPosition,
    LaserFacts,
    LaserScan,
    Odometry,
    Picture,
    Pose2D,
    Robot,
)
from sim.camera import Camera, PictureSize
from sim.contacts import ContactCounter
from sim.description import Description, load_description
from sim.drive import CommandMultiplexer, DifferentialBase, WheelOdometry
from sim.engine import pybullet
from sim.faults import Fault, Faults
from sim.laser import Laser, Outlines
from sim.model import Model
from sim.schedule import Rank
from sim.show import frames, robot_parts, world_parts
from sim.world import PHYSICS_RATE, World

_SETTLING = 0.5  # s in which the wheels find the floor before the run begins


class Body(Robot):
    """A differential base with a planar laser and perhaps a head and a camera, standing in *world*.

    The start pose is drawn by the scene's rule from the world's seed. When this returns there is a scan
    and an odometry, both of time 0. What the Robot protocol does not offer (the true pose, contacts, the
    way driven) is for whoever judges a run, not for leaves.
    """

    def __init__(
        self,
        world: World,
        description: Description | None = None,
        *,
        camera: PictureSize | None = None,
        faults: Sequence[Fault] = (),
    ) -> None:
        self.world = world
        self.description = description if description is not None else load_description()
        self._faults = Faults(faults)
        wheels = self.description.wheels
        start = world.scene.start(world.random("start"), self.description.base.radius)
        self.model = Model(world, self.description, start)
        for held in self.description.held:
            self.model.hold(self.model.joint(held.joint), held.position, held.force, held.speed)
        self._wheels = [self.model.joint(wheels.left), self.model.joint(wheels.right)]
        self._laser_link = self.model.link(self.description.laser.link)
        self._camera_link = self.model.link(self.description.camera.link) if self.description.camera else -1
        head = self.description.head
        self._head = [self.model.joint(head.pan), self.model.joint(head.tilt)] if head else []
        self._base = DifferentialBase(self.description.base, wheels.radius, wheels.separation)
        self._sources = CommandMultiplexer()
        self._rates: tuple[float, float] | None = None
        self.look(0.0, 0.0)
        self._obey(0)
        world.settle(_SETTLING)
        self.contacts = ContactCounter(world.client, self.model.number, world.floor)
        self._place = self.model.place()[0]
        self.distance = 0.0
        """The length (m) of the way driven, in truth."""
        still = [thing for thing in world.scene.things if thing.mass == 0.0]
        facts = self.description.laser.facts
        self._laser = Laser(facts, Outlines(still), world.random("laser"), world.client, world.movable)
        self._camera = (
            Camera(world.client, self.description.camera, camera)
            if camera and self.description.camera
            else None
        )
        angles = self.model.angles(self._wheels)
        self._dead_reckoning = WheelOdometry(wheels.radius, wheels.separation, angles)
        self._odometry = self._dead_reckoning.update(angles, 0)
        self._scan: LaserScan | None = None
        self._sense_laser(0)
        every = world.schedule.every
        every(facts.rate, Rank.SENSORS, self._sense_laser, first=round(1e9 / facts.rate))
        rate = self.description.odometry_rate
        every(rate, Rank.SENSORS, self._sense_wheels, first=round(1e9 / rate))
        world.around_steps(self._before_step, self._after_step)

    @property
    def clock(self) -> World:
        """The world: to wait on this clock is to run it."""
        return self.world

    @property
    def base(self) -> BaseFacts:
        """The base's limits and size."""
        return self.description.base

    @property
    def laser(self) -> LaserFacts:
        """The laser's geometry and range."""
        return self.description.laser.facts

    @property
    def neck(self) -> HeadFacts | None:
        """The head's limits, or None without a head."""
        return self.description.head.facts if self.description.head else None

    def drive(self, v: float, w: float, *, priority: int = CMD_VEL) -> None:
        """Ask for *v* (m/s) and *w* (rad/s); see `Robot.drive`."""
        if not (math.isfinite(v) and math.isfinite(w)):
            raise ValueError(f"a velocity command of v={v} m/s, w={w} rad/s is not a number")
        now = self.world.now()
        if self._sources.admits(priority, now):
            self._base.command(v, w, now)

    def stop(self) -> None:
        """Stand still, whoever asked for what before."""
        self._sources.clear()
        self._base.command(0.0, 0.0, self.world.now())

    def scan(self) -> LaserScan | None:
        """The newest scan; its ranges are read-only."""
        return self._scan

    def odometry(self) -> Odometry:
        """The newest odometry."""
        return self._odometry

    def look(self, pan: float, tilt: float) -> None:
        """Turn the head to *pan* and *tilt* (rad), held within the neck's limits, at its speed."""
        head = self.description.head
        if head is None:
            return
        pan = min(max(pan, head.facts.pan_min), head.facts.pan_max)
        tilt = min(max(tilt, head.facts.tilt_min), head.facts.tilt_max)
        self.model.hold(self._head[0], pan, head.torque, head.facts.speed)
        self.model.hold(self._head[1], tilt, head.torque, head.facts.speed)

    def head(self) -> HeadPosition | None:
        """Where the head looks now, or None without one."""
        if not self._head:
            return None
        pan, tilt = self.model.angles(self._head)
        return HeadPosition(pan, tilt, self.world.now())

    def camera(self) -> Picture | None:
        """The newest picture, drawn now if it is time for one; None without a camera."""
        if self._camera is None:
            return None
        now = self.world.now()
        return self._camera.picture(self.model, self._camera_link, now, self._faults.dead("camera", now))

    def true_pose(self) -> Pose2D:
        """Where the base truly is, in the frame of the world."""
        place, turned = self.model.place()
        return Pose2D(place[0], place[1], pybullet.getEulerFromQuaternion(turned)[2])

    def twist_asked(self) -> tuple[float, float]:
        """The velocity (m/s, rad/s) that the wheels are asked for now."""
        return self._base.twist.v, self._base.twist.w

    def scene_static(self) -> dict[str, Any]:
        """The shapes of the world and of the robot, the laser's geometry and the footprint, as plain data."""
        facts = self.laser
        return {
            "frame": "map",
            "parts": world_parts(self.world) + robot_parts(self.world, self.model),
            "laser": {
                "frame": facts.frame,
                "angle_min": facts.angle_min,
                "angle_increment": facts.angle_increment,
                "range_min": facts.range_min,
                "range_max": facts.range_max,
            },
            "footprint_radius": self.base.radius,
        }

    def scene_moving(self) -> dict[str, Any]:
        """Every frame now, the newest scan, the velocity and the contacts, as plain data."""
        twist = self._odometry.twist
        moving: dict[str, Any] = {
            "stamp": self.world.now(),
            "frames": frames(self.world, self.model),
            "velocity": [twist.v, twist.w],
            "collisions": self.contacts.collisions,
            "grazes": self.contacts.grazes,
        }
        if self._scan is not None:
            ranges = self._scan.ranges.astype("<f4", copy=False).tobytes()
            moving["scan"] = {"stamp": self._scan.stamp, "ranges": ranges}
        return moving

    def _before_step(self, now: int) -> None:
        self._obey(now)
        self.contacts.before_step(now)

    def _after_step(self, now: int) -> None:
        place = self.model.place()[0]
        self.distance += math.dist(place[:2], self._place[:2])
        self._place = place
        self.contacts.after_step(now)

    def _obey(self, now: int) -> None:
        self._base.step(now, 1.0 / PHYSICS_RATE)
        left, right = self._base.wheel_rates()
        if self._faults.dead("wheel", now):
            left = 0.0
        if (left, right) != self._rates:
            self._rates = (left, right)
            self.model.spin(self._wheels, self._rates, self.description.wheels.torque)

    def _sense_laser(self, now: int) -> None:
        if self._faults.dead("laser", now):
            return
        place, turned = self.model.link_place(self._laser_link)
        origin, turned = pybullet.multiplyTransforms(
            place, turned, self.description.laser.position, (0.0, 0.0, 0.0, 1.0)
        )
        heading = pybullet.getEulerFromQuaternion(turned)[2]
        self._scan = self._laser.sweep(origin[0], origin[1], origin[2], heading, now)
        self._scan.ranges.flags.writeable = False

    def _sense_wheels(self, now: int) -> None:
        if not self._faults.dead("odometry", now):
            self._odometry = self._dead_reckoning.update(self.model.angles(self._wheels), now)
