"""Bags of a small robot, written by rosbags without ROS."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from btcore.clock import NS_PER_S
from tests.ros2.robot.conftest import DESCRIPTION

SCAN, ODOMETRY, TF = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage"
TWIST = "geometry_msgs/msg/Twist"
STORE = get_typestore(Stores.ROS2_KILTED)


def message(kind: str, **fields: Any) -> Any:
    """Return a message of the type *kind* with *fields*; the other fields are 0 or empty."""
    return _fill(("", kind), fields)


def _fill(content: Any, value: Any) -> Any:
    kind = content[1]
    definitions = STORE.fielddefs[kind][1]
    given = value if isinstance(value, Mapping) else {}
    unknown = given.keys() - {name for name, _ in definitions}
    assert not unknown, f"{kind} has no {unknown}"
    return STORE.types[kind](**{name: _value(of, given.get(name)) for name, of in definitions})


def _value(description: Any, value: Any) -> Any:
    kind, content = description
    if kind == Nodetype.NAME:
        return value if value is not None and not isinstance(value, Mapping) else _fill(description, value)
    if kind == Nodetype.BASE:
        if value is not None:
            return value
        return "" if content[0] == "string" else False if content[0] == "bool" else 0
    inner = content[0]
    length = content[1] if kind == Nodetype.ARRAY else 0
    items = [] if value is None else value
    if inner[0] == Nodetype.BASE and inner[1][0] != "string":
        return np.zeros(length, inner[1][0]) if value is None else np.asarray(items, inner[1][0])
    return [_value(inner, item) for item in items]


def header(seconds: float, frame: str = "") -> dict[str, Any]:
    return {"stamp": time(seconds), "frame_id": frame}


def time(seconds: float) -> dict[str, int]:
    whole, rest = divmod(round(seconds * NS_PER_S), NS_PER_S)
    return {"sec": whole, "nanosec": rest}


class BagFile:
    """A bag of the robot of `DESCRIPTION`. `write` writes the messages that were added, and returns the file.

    Args:
        folder: The folder of the file.
        seconds: The length of the bag (s): for this time there are a scan and odometry every 0.1 s.
        distance: What the laser measures (m), by time.
    """

    def __init__(
        self, folder: Path, seconds: float = 1.0, distance: Mapping[float, float] | None = None
    ) -> None:
        self._folder = folder
        self._messages: list[tuple[float, str, str, Any]] = []
        mount = {
            "translation": {"x": 0.2, "y": 0.0, "z": 0.1},
            "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
        }
        laser = {"header": header(0.0, "base_footprint"), "child_frame_id": "laser", "transform": mount}
        self.add(0.0, "/tf", TF, transforms=[laser])
        reach = 5.0
        for count in range(round(seconds * 10) + 1):
            now = count / 10
            reach = (distance or {}).get(now, reach)
            rays = {
                "angle_min": -0.5,
                "angle_max": 0.5,
                "angle_increment": 0.5,
                "range_min": 0.1,
                "range_max": 10.0,
            }
            self.add(now, "/scan", SCAN, header=header(now, "laser"), **rays, ranges=[reach] * 3)
            pose = {"pose": {"position": {"x": now, "y": 0.0, "z": 0.0}, "orientation": {"w": 1.0}}}
            self.add(now, "/odom", ODOMETRY, header=header(now, "odom"), pose=pose)

    def add(self, seconds: float, topic: str, kind: str, **fields: Any) -> "BagFile":
        """Add a message that was recorded at *seconds*."""
        self._messages.append((seconds, topic, kind, message(kind, **fields)))
        return self

    def drive(self, seconds: float, v: float, w: float = 0.0, topic: str = "/cmd_vel") -> "BagFile":
        """Add a velocity command."""
        return self.add(seconds, topic, TWIST, linear={"x": v}, angular={"z": w})

    def without(self, topic: str, start: float = 0.0) -> "BagFile":
        """Remove the messages on *topic* from *start* (s) on."""
        self._messages = [each for each in self._messages if each[1] != topic or each[0] < start]
        return self

    def renamed(self, topic: str, name: str) -> "BagFile":
        """Rename a topic."""
        self._messages = [(at, name if on == topic else on, kind, it) for at, on, kind, it in self._messages]
        return self

    def write(self, origin: float = 1000.0) -> Path:
        """Write the file; the time 0 is recorded at *origin* (s)."""
        folder = self._folder / "bag"
        connections: dict[str, Any] = {}
        with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            for seconds, topic, kind, content in sorted(self._messages, key=lambda each: each[0]):
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
                stamp = round((origin + seconds) * NS_PER_S)
                writer.write(connections[topic], stamp, STORE.serialize_cdr(content, kind))
        return next(folder.glob("*.mcap")).rename(self._folder / "run.mcap")


def description_file(folder: Path, text: str = DESCRIPTION) -> Path:
    """Write the description of the robot, and return its file."""
    path = folder / "point.yaml"
    path.write_text(text)
    return path
