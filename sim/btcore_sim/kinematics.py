"""Forward kinematics of a robot from its description: frames of URDF links, sensors and fixed frames.

The root is `base_footprint`, on the floor below the base link. Wheels and casters have no frames, because
no sensor is mounted on them.
"""

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence

from btcore.suggestions import did_you_mean
from btcore_robot.rigid_transform import Transform, from_rpy
from btcore_robot.robot import BASE_FRAME, TransformStamped
from btcore_robot.urdf import Urdf, read_urdf
from btcore_sim.errors import SimError
from btcore_sim.robot_description import FixedFrame, Point, RobotDescription

_QUARTER = math.pi / 2
OPTICAL: Point = (-_QUARTER, 0.0, -_QUARTER)
"""Roll, pitch and yaw (rad) from body axes (x forward, z up) to optical axes (z forward, x right, y down).

REP 103 defines both conventions.
"""


class Kinematics:
    """Computes the frames of a robot from the positions of its joints.

    Raises:
        SimError: A frame has an unknown parent, is its own ancestor, or is defined twice; or the height does
            not fit the root of the URDF.
    """

    def __init__(self, description: RobotDescription) -> None:
        urdf = _read(description)
        if (urdf.root == BASE_FRAME) != (description.height == 0.0):
            raise SimError(
                f"robot '{description.name}': 'height' is {description.height:g}, and the root link is "
                f"'{urdf.root}': write the height of the root above the floor, and none for '{BASE_FRAME}'"
            )
        still = [(frame.name, frame.parent, Transform(frame.position)) for frame in _base(description, urdf)]
        joints = [joint for joint in urdf.joints if joint.child not in description.wheels.ground]
        still += [(joint.child, joint.parent, joint.origin) for joint in joints if not joint.is_movable]
        self._moving = [joint for joint in joints if joint.is_movable]
        self.joints = [joint.name for joint in self._moving]
        """The names of the moving joints, in the order in which `frames` expects their positions."""
        self.moving_frames = frozenset(joint.child for joint in self._moving)
        """The names of the frames whose poses in their parent frames change."""
        for fixed in (*description.frames, *_mounted(description)):
            still.append((fixed.name, fixed.parent, Transform(fixed.position, from_rpy(fixed.rpy))))
        self._still = [(child, parent, place.position, place.quaternion) for child, parent, place in still]
        self._check(description)

    def frames(self, positions: Sequence[float], stamp: int) -> list[TransformStamped]:
        """Return the pose of every frame in its parent frame.

        Args:
            positions: The positions of the joints in `joints` (rad or m).
            stamp: The time of the transforms (ns).
        """
        frames = [
            TransformStamped(child, parent, position, quaternion, stamp)
            for child, parent, position, quaternion in self._still
        ]
        return frames + self.frames_of_joints(positions, stamp)

    def frames_of_joints(self, positions: Sequence[float], stamp: int) -> list[TransformStamped]:
        """Return the poses of the frames in `moving_frames`; see `frames` for the parameters."""
        frames = []
        for joint, angle in zip(self._moving, positions, strict=True):
            place = joint.pose(angle)
            frames.append(
                TransformStamped(joint.child, joint.parent, place.position, place.quaternion, stamp)
            )
        return frames

    def _check(self, description: RobotDescription) -> None:
        parents: dict[str, str] = {}
        for frame in self.frames([0.0] * len(self._moving), 0):
            if frame.child in parents:
                raise SimError(f"robot '{description.name}': there are two frames '{frame.child}'")
            parents[frame.child] = frame.parent
        known = [BASE_FRAME, *parents]
        for child, parent in parents.items():
            if parent not in known:
                raise SimError(
                    f"robot '{description.name}': frame '{child}' is fixed to '{parent}', which does not "
                    f"exist: frames are {', '.join(known)}{did_you_mean(parent, known)}"
                )
        for child in parents:
            chain = [child]
            while chain[-1] in parents:
                if parents[chain[-1]] in chain:
                    raise SimError(f"robot '{description.name}': frame '{child}' is fixed to itself")
                chain.append(parents[chain[-1]])


def complete_urdf(description: RobotDescription) -> str:
    """Return the robot's URDF, completed by `base_footprint` and by the frames of the sensors."""
    tree = ElementTree.parse(description.urdf).getroot()
    urdf = _read(description)
    links = set(urdf.links)
    for frame in (*_base(description, urdf), *description.frames, *_mounted(description)):
        for name in (frame.parent, frame.name):
            if name not in links:
                ElementTree.SubElement(tree, "link", name=name)
                links.add(name)
        joint = ElementTree.SubElement(tree, "joint", name=f"{frame.name}_joint", type="fixed")
        ElementTree.SubElement(joint, "parent", link=frame.parent)
        ElementTree.SubElement(joint, "child", link=frame.name)
        xyz, rpy = (" ".join(map(repr, triple)) for triple in (frame.position, frame.rpy))
        ElementTree.SubElement(joint, "origin", xyz=xyz, rpy=rpy)
    return ElementTree.tostring(tree, encoding="unicode")


def _read(description: RobotDescription) -> Urdf:
    return read_urdf(description.urdf.read_text(encoding="utf-8"))


def _base(description: RobotDescription, urdf: Urdf) -> list[FixedFrame]:
    """Return the frame of the root link above `base_footprint`, or nothing if that is the root."""
    if urdf.root == BASE_FRAME:
        return []
    return [FixedFrame(urdf.root, BASE_FRAME, (0.0, 0.0, description.height), (0.0, 0.0, 0.0))]


def _mounted(description: RobotDescription) -> list[FixedFrame]:
    """Return the frames of sensors that neither the description nor its URDF defines."""
    laser, camera, sonars = description.laser, description.camera, description.sonars
    frames = [FixedFrame(laser.frame, laser.link, laser.position, (0.0, 0.0, 0.0))]
    frames += [FixedFrame(sonar.frame, sonar.link, sonar.position, (0.0, 0.0, sonar.yaw)) for sonar in sonars]
    if camera is not None:
        mount = f"{camera.frame}_mount"
        frames.append(FixedFrame(mount, camera.link, camera.position, (camera.roll, 0.0, 0.0)))
        frames.append(FixedFrame(camera.frame, mount, (0.0, 0.0, 0.0), OPTICAL))
        if any(frame.name == camera.frame for frame in description.frames):
            del frames[-2:]
    named = {*(frame.name for frame in description.frames), *_read(description).links}
    return [frame for frame in frames if frame.name not in named]
