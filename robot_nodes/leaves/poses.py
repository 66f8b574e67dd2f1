"""Places as a tree's XML writes them."""

import math

from btcore import ConversionFault, Registry
from robot_nodes.robot import Pose2D


def add_poses(nodes: Registry) -> None:
    """Let ports of *nodes* be poses, unless another library has done so."""
    if nodes.types.named(Pose2D.__name__) is None:
        nodes.add_type(Pose2D, pose_from_text, to_text=pose_to_text)


def pose_from_text(text: str) -> Pose2D:
    """The pose written ``x;y`` or ``x;y;yaw`` (m, rad), or as Nav2 does.

    Nav2 writes ``stamp;frame;x;y;z;qx;qy;qz;qw``, or without stamp and frame; the frame is ``map``.
    Raises ConversionFault.
    """
    parts = [part.strip() for part in text.split(";")]
    if len(parts) == 9:
        frame, parts = parts[1], parts[2:]
        if frame.strip("/") not in ("", "map"):
            raise ConversionFault(f"'{text}' is a pose in the frame '{frame}', and poses here are in map")
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        raise ConversionFault(f"'{text}' is no pose: {FORM}") from None
    if not all(map(math.isfinite, numbers)):
        raise ConversionFault(f"'{text}' is no pose: its numbers have to be finite")
    match numbers:
        case [x, y]:
            return Pose2D(x, y, 0.0)
        case [x, y, yaw]:
            return Pose2D(x, y, math.remainder(yaw, math.tau))
        case [x, y, _, qx, qy, qz, qw]:
            return Pose2D(x, y, math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz)))
    raise ConversionFault(f"'{text}' is no pose: {FORM}, and this has {len(parts)} parts")


FORM = "the form is x;y or x;y;yaw in m and rad, like 1.5;-2;0.5"


def pose_to_text(pose: Pose2D) -> str:
    """``x;y;yaw``."""
    return f"{pose.x:g};{pose.y:g};{pose.yaw:g}"
