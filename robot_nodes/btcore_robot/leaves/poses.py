"""Places as a tree's XML writes them."""

import math
from typing import Annotated, Final

from btcore import ConversionError, Registry
from btcore.values.types import ValueType, mismatch
from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import Pose2D

NAV2_PARTS: Final = 9
"""Of how many parts a pose is that Nav2 writes."""


def add_poses(nodes: Registry) -> None:
    """Let ports of *nodes* be poses, unless another library has done so."""
    if nodes.types.named(Pose2D.__name__) is None:
        nodes.add_type(Pose2D, pose_from_text, to_text=pose_to_text)


def pose_from_text(text: str) -> Pose2D:
    """The pose written ``x;y`` or ``x;y;yaw`` (m, rad), or as Nav2 does.

    Nav2 writes ``stamp;frame;x;y;z;qx;qy;qz;qw``, or without stamp and frame; the frame is ``map``.
    Raises ConversionError.
    """
    parts = [part.strip() for part in text.split(";")]
    if len(parts) == 9:
        frame, parts = parts[1], parts[2:]
        if frame.strip("/") not in ("", "map"):
            raise ConversionError(f"'{text}' is a pose in the frame '{frame}', and poses here are in map")
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        raise ConversionError(f"'{text}' is no pose: {FORM}") from None
    if not all(map(math.isfinite, numbers)):
        raise ConversionError(f"'{text}' is no pose: its numbers have to be finite")
    match numbers:
        case [x, y]:
            return Pose2D(x, y, 0.0)
        case [x, y, yaw]:
            return Pose2D(x, y, wrap_angle(yaw))
        case [x, y, _, qx, qy, qz, qw]:
            return Pose2D(x, y, math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz)))
    raise ConversionError(f"'{text}' is no pose: {FORM}, and this has {len(parts)} parts")


FORM = "the form is x;y or x;y;yaw in m and rad, like 1.5;-2;0.5"


def pose_to_text(pose: Pose2D) -> str:
    """``x;y;yaw``."""
    return f"{pose.x:g};{pose.y:g};{pose.yaw:g}"


class PoseList(ValueType):
    """Several poses, in text ``x;y;yaw|x;y;yaw``, or nine parts a pose between ``;`` as Nav2 has them."""

    def __init__(self) -> None:
        super().__init__(f"std::vector<{Pose2D.__name__}>", list)

    def from_text(self, text: str, format: int = 4) -> list[Pose2D]:
        """The poses; none for an empty text. Raises ConversionError."""
        if not text.strip():
            return []
        if "|" in text:
            return [pose_from_text(one) for one in text.split("|")]
        parts = text.rstrip("; ").split(";")
        if len(parts) > NAV2_PARTS and len(parts) % NAV2_PARTS == 0:
            starts = range(0, len(parts), NAV2_PARTS)
            return [pose_from_text(";".join(parts[start : start + NAV2_PARTS])) for start in starts]
        if len(parts) > NAV2_PARTS:
            raise ConversionError(f"'{text}' is no list of poses: a | stands between two of them")
        return [pose_from_text(text)]

    def to_text(self, value: object) -> str:
        """``x;y;yaw`` of each, with ``|`` between."""
        return "|".join(pose_to_text(one) for one in self.cast(value))

    def accepts(self, value: object) -> bool:
        """Whether *value* is a list of nothing but poses."""
        return isinstance(value, list) and all(isinstance(one, Pose2D) for one in value)

    def cast(self, value: object) -> list[Pose2D]:
        """A list or tuple of poses as a list. Raises ConversionError."""
        if not isinstance(value, list | tuple) or not self.accepts(list(value)):
            raise mismatch(value, self)
        return value if isinstance(value, list) else list(value)

    def adapt(self, value: object) -> list[Pose2D]:
        """The same. Raises ConversionError."""
        return self.cast(value)


Poses = Annotated[list[Pose2D], PoseList()]
"""An annotation for several poses."""
