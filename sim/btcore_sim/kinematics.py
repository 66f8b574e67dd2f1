"""Forward kinematics of a robot from its description: frames of URDF links, sensors and fixed frames.

The root is `base_footprint`, on the floor below the base link. Wheels and casters have no frames, because
no sensor is mounted on them.
"""

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass

from btcore.suggestions import did_you_mean
from btcore_robot.rigid_transform import Quaternion, Transform
from btcore_robot.robot import TransformStamped
from btcore_sim.errors import SimError
from btcore_sim.robot_description import FixedFrame, Point, RobotDescription

FOOTPRINT = "base_footprint"

_QUARTER = math.pi / 2
OPTICAL: Point = (-_QUARTER, 0.0, -_QUARTER)
"""Roll, pitch and yaw (rad) from body axes (x forward, z up) to optical axes (z forward, x right, y down).

REP 103 defines both conventions.
"""


@dataclass(frozen=True, slots=True)
class _Joint:
    """A joint of the URDF. The child is at *origin* for position 0, and moves along or about *axis*."""

    name: str
    child: str
    parent: str
    origin: Transform
    axis: Point
    slides: bool

    def place(self, angle: float) -> Transform:
        x, y, z = self.axis
        if self.slides:
            return self.origin * Transform((x * angle, y * angle, z * angle))
        sine = math.sin(angle / 2)
        return self.origin * Transform(quaternion=(x * sine, y * sine, z * sine, math.cos(angle / 2)))


class Kinematics:
    """Computes the frames of a robot from the positions of its joints.

    Raises:
        SimError: A frame has an unknown parent, is its own ancestor, or is defined twice.
    """

    def __init__(self, description: RobotDescription) -> None:
        root, joints = _joints(description)
        still = [(root, FOOTPRINT, Transform((0.0, 0.0, description.height)))]
        self._moving: list[_Joint] = []
        for joint, moves in joints:
            if moves:
                self._moving.append(joint)
            else:
                still.append((joint.child, joint.parent, joint.origin))
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
            place = joint.place(angle)
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
        known = [FOOTPRINT, *parents]
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
    """Return the robot's URDF, completed by `base_footprint` and by the frames of the sensors.

    Args:
        description: The description of the robot, whose URDF contains neither.
    """
    tree = ElementTree.parse(description.urdf).getroot()
    root, _ = _joints(description)
    links = {link.get("name") for link in tree.iterfind("link")}
    base = FixedFrame(root, FOOTPRINT, (0.0, 0.0, description.height), (0.0, 0.0, 0.0))
    for frame in (base, *description.frames, *_mounted(description)):
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


def from_rpy(rpy: Point) -> Quaternion:
    """Return the quaternion (x, y, z, w) of a URDF's roll, pitch, yaw (rad; fixed axes x, then y, then z)."""
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(angle / 2), math.cos(angle / 2)) for angle in rpy)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def _joints(description: RobotDescription) -> tuple[str, list[tuple[_Joint, bool]]]:
    """Return the root link, and the joints (without wheels and casters), each with whether it moves."""
    robot = ElementTree.parse(description.urdf).getroot()
    children = {child.get("link") for child in robot.iterfind("joint/child")}
    roots = [str(link.get("name")) for link in robot.iterfind("link") if link.get("name") not in children]
    joints: list[tuple[_Joint, bool]] = []
    for element in robot.iterfind("joint"):
        kind, child = element.get("type", ""), _attribute(element, "child", "link")
        if child in description.wheels.ground:
            continue
        joint = _Joint(
            name=str(element.get("name")),
            child=child,
            parent=_attribute(element, "parent", "link"),
            origin=Transform(
                _triple(_attribute(element, "origin", "xyz", "0 0 0")),
                from_rpy(_triple(_attribute(element, "origin", "rpy", "0 0 0"))),
            ),
            axis=_unit(_triple(_attribute(element, "axis", "xyz", "1 0 0"))),
            slides=kind == "prismatic",
        )
        joints.append((joint, kind in ("prismatic", "revolute", "continuous")))
    return roots[0], joints


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
    links = {link.get("name") for link in ElementTree.parse(description.urdf).getroot().iterfind("link")}
    named = {frame.name for frame in description.frames} | links
    return [frame for frame in frames if frame.name not in named]


def _attribute(element: ElementTree.Element, tag: str, key: str, default: str = "") -> str:
    inner = element.find(tag)
    return default if inner is None else inner.get(key, default)


def _triple(text: str) -> Point:
    x, y, z = map(float, text.split())
    return x, y, z


def _unit(axis: Point) -> Point:
    length = math.hypot(*axis) or 1.0
    return axis[0] / length, axis[1] / length, axis[2] / length
