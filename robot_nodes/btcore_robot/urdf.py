"""The joints of a URDF, the poses of their links (forward kinematics), and the shapes of the links."""

import math
import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from btcore_robot.errors import RobotError
from btcore_robot.rigid_transform import Transform, from_rpy
from btcore_scene import Box, Color, Cylinder, Part, Sphere, Vector

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
        type: The type of the joint: `fixed`, `revolute`, `continuous`, `prismatic` …
    """

    name: str
    child: str
    parent: str
    origin: Transform
    axis: Vector
    type: str

    @property
    def is_movable(self) -> bool:
        """Whether the joint has a position."""
        return self.type in TURNING or self.type == SLIDING

    def pose(self, position: float) -> Transform:
        """Return the pose of the link *child* in *parent*.

        Args:
            position: The position of the joint (rad or m).
        """
        x, y, z = self.axis
        if self.type == SLIDING:
            return self.origin * Transform((x * position, y * position, z * position))
        sine = math.sin(position / 2)
        return self.origin * Transform(quaternion=(x * sine, y * sine, z * sine, math.cos(position / 2)))


@dataclass(frozen=True, slots=True)
class Urdf:
    """What this package reads of a URDF.

    Attributes:
        links: The names of the links.
        joints: The joints.
        shapes: The boxes, cylinders and spheres that the URDF draws, each in the frame of its link.
    """

    links: Sequence[str]
    joints: Sequence[UrdfJoint]
    shapes: Sequence[Part]

    @property
    def root(self) -> str:
        """The first link that no joint connects with a parent."""
        children = {joint.child for joint in self.joints}
        return next(link for link in self.links if link not in children)


def read_urdf(text: str) -> Urdf:
    """Return the links, the joints and the shapes of a URDF; meshes are left out.

    Raises:
        RobotError: The text is not a URDF, or a number in it is invalid.
    """
    try:
        robot = ElementTree.fromstring(text)
        colors = {each.get("name", ""): _color(each) for each in robot.iterfind("material")}
        links = {link.get("name", ""): link for link in robot.iterfind("link")}
        shapes = [
            _shape(visual, name, colors) for name, link in links.items() for visual in link.iterfind("visual")
        ]
        joints = [_joint(element) for element in robot.iterfind("joint")]
    except (ElementTree.ParseError, ValueError) as error:
        raise RobotError(f"the robot's description is not a valid URDF: {error}") from None
    return Urdf(tuple(links), joints, [shape for shape in shapes if shape is not None])


def read_with_paths(urdf: Path) -> "ElementTree.ElementTree[ElementTree.Element]":
    """Return the XML of a URDF file with the paths of its meshes and textures in place of their names.

    A name is relative to the folder of the URDF, or `package://NAME/PATH`. A package is searched in
    `ROS_PACKAGE_PATH`, in the folders `share` of `AMENT_PREFIX_PATH`, and among the folders that contain the
    URDF.

    Raises:
        RobotError: The text is not XML, or a package or its file is not found.
    """
    try:
        robot = ElementTree.parse(urdf)
    except ElementTree.ParseError as error:
        raise RobotError(f"{urdf}: not a valid URDF: {error}") from None
    for element in robot.iter():
        if element.tag in ("mesh", "texture") and (name := element.get("filename")):
            element.set("filename", str(_file_of(name, urdf.resolve())))
    return robot


def _file_of(name: str, urdf: Path) -> Path:
    package, _, inner = name.removeprefix("package://").partition("/")
    files = [urdf.parent / name.removeprefix("file://")]
    hint = ""
    if name.startswith("package://"):
        sources = [*_folders("ROS_PACKAGE_PATH"), *(path / "share" for path in _folders("AMENT_PREFIX_PATH"))]
        folders = [folder for folder in (*sources, *urdf.parents) if folder.name == package]
        files = [folder / inner for folder in (*folders, *(source / package for source in sources))]
        hint = f"; source the setup file of the workspace that contains '{package}', or set ROS_PACKAGE_PATH"
    found = next((file for file in files if file.is_file()), None)
    if found is None:
        raise RobotError(f"{urdf}: there is no file '{name}'{hint}")
    return found


def _folders(variable: str) -> list[Path]:
    return [Path(text) for text in os.environ.get(variable, "").split(os.pathsep) if text]


def _shape(visual: ElementTree.Element, link: str, colors: Mapping[str, Color | None]) -> Part | None:
    origin = _origin(visual)
    material = visual.find("material")
    color = None
    if material is not None:
        color = _color(material) or colors.get(material.get("name", ""))
    where: dict[str, Any] = {
        "frame": link,
        "position": origin.position,
        "quaternion": origin.quaternion,
        "color": color,
    }
    geometry = visual.find("geometry")
    solid = next(iter(geometry), None) if geometry is not None else None
    if solid is None:
        return None
    if solid.tag == "box":
        return Box(**where, size=_numbers(solid, "size", "0 0 0"))
    if solid.tag == "cylinder":
        return Cylinder(
            **where, radius=float(solid.get("radius", "0")), length=float(solid.get("length", "0"))
        )
    if solid.tag == "sphere":
        return Sphere(**where, radius=float(solid.get("radius", "0")))
    return None


def _color(material: ElementTree.Element) -> Color | None:
    color = material.find("color")
    if color is None:
        return None
    values = [round(255 * float(word)) for word in color.get("rgba", "").split()]
    if len(values) != 4:
        raise ValueError(f'color rgba="{color.get("rgba")}" does not have four numbers')
    red, green, blue, opacity = values
    return red, green, blue, opacity


def _joint(element: ElementTree.Element) -> UrdfJoint:
    name = element.get("name", "")
    axis = _triple(element, "axis", "xyz", "1 0 0")
    length = math.hypot(*axis) or 1.0
    return UrdfJoint(
        name=name,
        child=_link(element, "child", name),
        parent=_link(element, "parent", name),
        origin=_origin(element),
        axis=(axis[0] / length, axis[1] / length, axis[2] / length),
        type=element.get("type", ""),
    )


def _link(element: ElementTree.Element, tag: str, joint: str) -> str:
    inner = element.find(tag)
    link = inner.get("link") if inner is not None else None
    if not link:
        raise ValueError(f"the joint '{joint}' has no {tag} link")
    return link


def _origin(element: ElementTree.Element) -> Transform:
    position, angles = (_triple(element, "origin", key, "0 0 0") for key in ("xyz", "rpy"))
    return Transform(position, from_rpy(angles))


def _triple(element: ElementTree.Element, tag: str, key: str, default: str) -> Vector:
    inner = element.find(tag)
    return _numbers(inner if inner is not None else ElementTree.Element(tag), key, default)


def _numbers(element: ElementTree.Element, key: str, default: str) -> Vector:
    text = element.get(key, default)
    numbers = [float(word) for word in text.split()]
    if len(numbers) != 3:
        raise ValueError(f'{element.tag} {key}="{text}" does not have three numbers')
    return numbers[0], numbers[1], numbers[2]
