"""The waypoints of a map, in a file beside it.

The waypoints of the map `house.yaml` are in `house.waypoints.yaml`:

    waypoints: # x, y (m) and yaw (rad) in the frame map
      recharge: [3.67, -0.24, 0.0]
      wp1: [1.07, -12.38, 1.57]
      wp2: [-5.32, -8.85] # yaw 0
"""

from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from btcore.output_files import write_file
from btcore.typed_data import convert
from btcore_robot.data_files import yaml_data
from btcore_robot.occupancy_map import MapError
from btcore_robot.robot import Pose2D, Waypoints

__all__ = ["load_waypoints", "save_waypoints", "waypoints_path"]


class _WaypointFile(msgspec.Struct):
    waypoints: dict[str, Annotated[tuple[float, ...], Meta(min_length=2, max_length=3)]]


def waypoints_path(map: Path) -> Path:
    """Return the path of the file with the waypoints of the map at *map* (a YAML file)."""
    return map.with_name(f"{map.stem}.waypoints.yaml")


def load_waypoints(path: Path) -> Waypoints:
    """Return the waypoints in the YAML file at *path*.

    Raises:
        MapError: The file can't be read or is invalid; the message has the file and the line.
    """
    with yaml_data(path, "waypoints", MapError) as data:
        places = convert(data, _WaypointFile).waypoints
    return Waypoints({name: _pose(*place) for name, place in places.items()}, source=str(path))


def save_waypoints(waypoints: Waypoints, path: Path) -> None:
    """Write waypoints to a YAML file that `load_waypoints` reads.

    Args:
        waypoints: The waypoints.
        path: The YAML file; it is replaced.

    Raises:
        MapError: The file cannot be written.
    """
    lines = [f"  {name}: [{pose.x!r}, {pose.y!r}, {pose.yaw!r}]\n" for name, pose in waypoints.places.items()]
    text = "waypoints: # x, y (m) and yaw (rad) in the frame map\n" + "".join(lines)
    try:
        write_file(path, text.encode())
    except OSError as error:
        raise MapError(f"{path}: cannot write the waypoints: {error.strerror}") from None


def _pose(x: float, y: float, yaw: float = 0.0) -> Pose2D:
    return Pose2D(x, y, yaw)
