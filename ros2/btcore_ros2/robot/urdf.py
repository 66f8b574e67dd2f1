"""The joints of a URDF, and the poses of their links (forward kinematics)."""

import math
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass

from btcore_robot.rigid_transform import Transform, Vector
from btcore_ros2.errors import RosError
from btcore_sim.kinematics import from_rpy

TURNING = ("revolute", "continuous")
SLIDING = "prismatic"


@dataclass(frozen=True, slots=True)
class UrdfJoint:
    """A joint, which connects the link *child* with the link *parent*.

    Attributes:
        name: The name of the joint.
        child: The link that moves.
        parent: The link that the joint is fixed to.
        origin: The pose of *child* in *parent* at position 0.
        axis: The axis of the motion, in the frame of *child*.
        kind: The type of the joint: `fixed`, `revolute`, `continuous`, `prismatic` …
    """

    name: str
    child: str
    parent: str
    origin: Transform
    axis: Vector
    kind: str

    @property
    def moves(self) -> bool:
        """Whether the joint has a position."""
        return self.kind in TURNING or self.kind == SLIDING

    def pose(self, position: float) -> Transform:
        """Return the pose of the link *child* in *parent*.

        Args:
            position: The position of the joint (rad or m).
        """
        x, y, z = self.axis
        if self.kind == SLIDING:
            return self.origin * Transform((x * position, y * position, z * position))
        sine = math.sin(position / 2)
        return self.origin * Transform(quaternion=(x * sine, y * sine, z * sine, math.cos(position / 2)))


def read_urdf(text: str) -> list[UrdfJoint]:
    """Return the joints of a URDF.

    Raises:
        RosError: The text is not a URDF, or a number in it is invalid.
    """
    try:
        robot = ElementTree.fromstring(text)
        return [_joint(element) for element in robot.iterfind("joint")]
    except (ElementTree.ParseError, ValueError) as error:
        raise RosError(f"the robot's description is not a valid URDF: {error}") from None


def _joint(element: ElementTree.Element) -> UrdfJoint:
    name = element.get("name", "")
    axis = _triple(element, "axis", "xyz", "1 0 0")
    length = math.hypot(*axis) or 1.0
    return UrdfJoint(
        name=name,
        child=_link(element, "child", name),
        parent=_link(element, "parent", name),
        origin=Transform(
            _triple(element, "origin", "xyz", "0 0 0"), from_rpy(_triple(element, "origin", "rpy", "0 0 0"))
        ),
        axis=(axis[0] / length, axis[1] / length, axis[2] / length),
        kind=element.get("type", ""),
    )


def _link(element: ElementTree.Element, tag: str, joint: str) -> str:
    inner = element.find(tag)
    link = inner.get("link") if inner is not None else None
    if not link:
        raise ValueError(f"the joint '{joint}' has no {tag} link")
    return link


def _triple(element: ElementTree.Element, tag: str, key: str, default: str) -> Vector:
    inner = element.find(tag)
    text = default if inner is None else inner.get(key, default)
    numbers = [float(word) for word in text.split()]
    if len(numbers) != 3:
        raise ValueError(f'{tag} {key}="{text}" does not have three numbers')
    return numbers[0], numbers[1], numbers[2]
