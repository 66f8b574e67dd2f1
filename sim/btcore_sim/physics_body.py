"""A robot as a body of the physics engine: joints and links by name, motors and poses."""

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from btcore.suggestions import did_you_mean
from btcore_robot.robot import Pose2D
from btcore_robot.urdf import read_with_paths
from btcore_scene import Quaternion, Vector
from btcore_sim.errors import SimError
from btcore_sim.quiet_pybullet import pybullet
from btcore_sim.robot_description import RobotDescription
from btcore_sim.world import FLOOR, GROUND_LINK, HULL, OBJECTS, World

TOUCH = 0.001
"""Greatest distance (m) between bodies that touch: the engine stops bodies slightly before they overlap."""

_NO_INERTIA = (
    '<inertial><mass value="1e-3"/>'
    '<inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial>'
)

Pose3D = tuple[Vector, Quaternion]
"""A position (m) and a quaternion (x, y, z, w)."""


class PhysicsBody:
    """The robot's body in the physics engine.

    Raises:
        SimError: The engine cannot read the URDF, or the URDF lacks a link that the description names.
    """

    def __init__(self, world: World, description: RobotDescription, start: Pose2D) -> None:
        self.description = description
        self._client = world.client
        self.body_id = self._load(start)
        """PyBullet's ID of the body."""
        self.joints: dict[str, int] = {}
        """PyBullet's index of every joint, by name."""
        self.links = {pybullet.getBodyInfo(self.body_id, physicsClientId=self._client)[0].decode(): -1}
        """PyBullet's index of every link, by name; -1 is the base link."""
        for index in range(pybullet.getNumJoints(self.body_id, physicsClientId=self._client)):
            info = pybullet.getJointInfo(self.body_id, index, physicsClientId=self._client)
            self.joints[info[1].decode()] = index
            self.links[info[12].decode()] = index
        self._set_ground_links()

    def joint(self, name: str) -> int:
        """Return PyBullet's index of the joint *name*. Raises `SimError` for an unknown joint."""
        return self._known("joint", name, self.joints)

    def link(self, name: str) -> int:
        """Return PyBullet's index of the link *name*. Raises `SimError` for an unknown link."""
        return self._known("link", name, self.links)

    def hold_joint(self, joint: int, position: float, force: float, speed: float) -> None:
        """Move a joint to a position and hold it there.

        Args:
            joint: PyBullet's index of the joint.
            position: The target (m or rad).
            force: The motor's greatest force (N or N·m).
            speed: The joint's greatest speed (m/s or rad/s).
        """
        pybullet.setJointMotorControl2(
            self.body_id,
            joint,
            pybullet.POSITION_CONTROL,
            targetPosition=position,
            force=force,
            maxVelocity=speed,
            physicsClientId=self._client,
        )

    def spin_joints(self, joints: Sequence[int], rates: Sequence[float], torque: float) -> None:
        """Turn joints at constant speeds.

        Args:
            joints: PyBullet's indices of the joints.
            rates: The speed of each joint (rad/s).
            torque: The motors' greatest torque (N·m).
        """
        pybullet.setJointMotorControlArray(
            self.body_id,
            joints,
            pybullet.VELOCITY_CONTROL,
            targetVelocities=rates,
            forces=[torque] * len(joints),
            physicsClientId=self._client,
        )

    def joint_positions(self, joints: Sequence[int]) -> list[float]:
        """Return the positions (rad or m) of the joints with the indices *joints*."""
        # For an empty sequence PyBullet returns None.
        states = pybullet.getJointStates(self.body_id, joints, physicsClientId=self._client) or ()
        return [state[0] for state in states]

    def pose(self) -> Pose3D:
        """Return the pose of the base link in the world frame."""
        place, turned = pybullet.getBasePositionAndOrientation(self.body_id, physicsClientId=self._client)
        return place, turned

    def set_pose(self, pose: Pose2D, height: float | None = None) -> None:
        """Place the body at *pose*, upright and at rest.

        Args:
            pose: The pose of the base link on the floor.
            height: The height of the base link (m); None = its present height.
        """
        if height is None:
            height = self.pose()[0][2]
        turned = [0.0, 0.0, math.sin(pose.yaw / 2), math.cos(pose.yaw / 2)]
        engine = {"physicsClientId": self._client}
        pybullet.resetBasePositionAndOrientation(self.body_id, [pose.x, pose.y, height], turned, **engine)
        pybullet.resetBaseVelocity(self.body_id, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], **engine)

    def touched_object(self, world: World) -> str | None:
        """Return the name of an object of *world* that the hull overlaps or touches, or None.

        Wheels and casters are ignored: they touch only the floor.
        """
        ground = {self.link(name) for name in self.description.wheels.ground}
        for body, item in world.bodies.items():
            points = pybullet.getClosestPoints(self.body_id, body, TOUCH, physicsClientId=self._client)
            # Element 3 is the link of the robot.
            if any(point[3] not in ground for point in points):
                return item.name
        return None

    def link_pose(self, link: int) -> Pose3D:
        """Return the pose of the link with the index *link* in the world frame."""
        if link < 0:
            return self.pose()
        state = pybullet.getLinkState(
            self.body_id, link, computeForwardKinematics=1, physicsClientId=self._client
        )
        # Elements 4 and 5 are the URDF's link frame; 0 and 1 would be the centre of mass.
        return state[4], state[5]

    def _load(self, start: Pose2D) -> int:
        place = [start.x, start.y, self.description.height]
        turned = [0.0, 0.0, math.sin(start.yaw / 2), math.cos(start.yaw / 2)]
        # PyBullet does not know the folders in which ROS searches for packages, and takes 1 kg for the
        # mass of a link without inertia.
        robot = read_with_paths(self.description.urdf)
        for link in robot.iterfind("link"):
            if link.find("inertial") is None:
                link.append(ElementTree.fromstring(_NO_INERTIA))
        try:
            with TemporaryDirectory() as folder:
                urdf = Path(folder) / self.description.urdf.name
                robot.write(urdf, encoding="utf-8")
                number: int = pybullet.loadURDF(str(urdf), place, turned, physicsClientId=self._client)
        except pybullet.error:
            raise SimError(f"{self.description.urdf}: the physics engine cannot read this URDF") from None
        return number

    def _known(self, noun: str, name: str, known: dict[str, int]) -> int:
        if name not in known:
            raise SimError(
                f"{self.description.urdf}: robot '{self.description.name}' has no {noun} '{name}': "
                f"{noun}s are {', '.join(known)}{did_you_mean(name, known)}"
            )
        return known[name]

    def _set_ground_links(self) -> None:
        """Let wheels and casters touch only the floor, and the other links everything except the floor.

        A wheel is a sphere that extends beyond the hull, so it would climb up walls.
        """
        wheels = self.description.wheels
        ground = [self.link(name) for name in wheels.ground]
        sliding = [self.link(name) for name in wheels.sliding]
        engine = {"physicsClientId": self._client}
        for link in self.links.values():
            if link not in ground:
                pybullet.setCollisionFilterGroupMask(self.body_id, link, HULL, OBJECTS, **engine)
                continue
            pybullet.setCollisionFilterGroupMask(self.body_id, link, GROUND_LINK, FLOOR, **engine)
            # A separate call: the engine silently ignores a link's friction when the call also sets damping.
            friction = 0.0 if link in sliding else 1.0
            pybullet.changeDynamics(self.body_id, link, lateralFriction=friction, **engine)
