"""Text formats of poses in a tree's XML."""

import math
from typing import Annotated, Final

from btcore import ConversionError, Registry
from btcore.values.types import ValueType, mismatch
from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import MAP_FRAME, Pose2D

NAV2_PARTS: Final = 9
"""The number of parts of a pose in Nav2's format: `stamp;frame;x;y;z;qx;qy;qz;qw`."""


def register_pose_type(nodes: Registry) -> None:
    """Register `Pose2D` as a port type in *nodes*, unless it is registered already."""
    if not nodes.types.of(Pose2D).has_converters:
        nodes.add_type(Pose2D, pose_from_text, to_text=pose_to_text)


def pose_from_text(text: str) -> Pose2D:
    """Return the pose in *text*: `x;y` or `x;y;yaw` (m, rad), or Nav2's format.

    Nav2's format is `stamp;frame;x;y;z;qx;qy;qz;qw`, with or without stamp and frame; the frame must be
    `map`.

    Raises:
        ConversionError: The text is not a pose, or the frame is not `map`.
    """
    parts = [part.strip() for part in text.split(";")]
    if len(parts) == NAV2_PARTS:
        frame, parts = parts[1], parts[2:]
        if frame.strip("/") not in ("", MAP_FRAME):
            raise ConversionError(f"'{text}' is a pose in the frame '{frame}', but poses must be in map")
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        raise ConversionError(f"'{text}' is not a pose: {POSE_FORMAT_HINT}") from None
    if not all(map(math.isfinite, numbers)):
        raise ConversionError(f"'{text}' is not a pose: its numbers must be finite")
    match numbers:
        case [x, y]:
            return Pose2D(x, y, 0.0)
        case [x, y, yaw]:
            return Pose2D(x, y, wrap_angle(yaw))
        case [x, y, _, qx, qy, qz, qw]:
            return Pose2D(x, y, math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz)))
    raise ConversionError(f"'{text}' is not a pose: {POSE_FORMAT_HINT}, but there are {len(parts)} parts")


POSE_FORMAT_HINT = "the form is x;y or x;y;yaw in m and rad, like 1.5;-2;0.5"


def pose_to_text(pose: Pose2D) -> str:
    """Return *pose* as the text `x;y;yaw` (m, rad)."""
    return f"{pose.x:g};{pose.y:g};{pose.yaw:g}"


class PoseList(ValueType):
    """A list of poses, in text `x;y;yaw|x;y;yaw`, or nine parts per pose separated by `;` as in Nav2."""

    def __init__(self) -> None:
        super().__init__(f"std::vector<{Pose2D.__name__}>", list)

    def from_text(self, text: str, format: int = 4) -> list[Pose2D]:
        """Return the poses in *text*; an empty text is an empty list. Raises ConversionError."""
        if not text.strip():
            return []
        if "|" in text:
            return [pose_from_text(part) for part in text.split("|")]
        parts = text.rstrip("; ").split(";")
        if len(parts) > NAV2_PARTS and len(parts) % NAV2_PARTS == 0:
            starts = range(0, len(parts), NAV2_PARTS)
            return [pose_from_text(";".join(parts[start : start + NAV2_PARTS])) for start in starts]
        if len(parts) > NAV2_PARTS:
            raise ConversionError(f"'{text}' is not a list of poses: separate poses with |")
        return [pose_from_text(text)]

    def to_text(self, value: object) -> str:
        """Return the poses as `x;y;yaw` (m, rad), separated by `|`."""
        return "|".join(pose_to_text(pose) for pose in self.cast(value))

    def accepts(self, value: object) -> bool:
        """Return whether *value* is a list that contains poses only."""
        return isinstance(value, list) and all(isinstance(item, Pose2D) for item in value)

    def cast(self, value: object) -> list[Pose2D]:
        """Return a list or tuple of poses as a list. Raises ConversionError."""
        if not isinstance(value, list | tuple) or not self.accepts(list(value)):
            raise mismatch(value, self)
        return value if isinstance(value, list) else list(value)

    def adapt(self, value: object) -> list[Pose2D]:
        """Return a list or tuple of poses as a list. Raises ConversionError."""
        return self.cast(value)


Poses = Annotated[list[Pose2D], PoseList()]
"""The type annotation of a port with a list of poses."""
