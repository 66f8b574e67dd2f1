"""What RViz's default configuration for Nav2 displays, and how Nav2 publishes it.

The facts are those of Nav2 1.4.2 (branch kilted, commit 71a1d84f). Topics and QoS of the displays are from
`nav2_bringup/rviz/nav2_default_view.rviz`. QoS of the publishers and frames are from the sources of
map_server, amcl, costmap_2d, planner_server and dwb_core; those of `scan` and `robot_description` are from
TurtleBot 3 and robot_state_publisher.

    python tests/ros2/nav2/rviz_displays.py nav2_default_view.rviz

prints the differences between such a file and these facts.
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import yaml

TABLE = """
map                               |nav_msgs/OccupancyGrid      |reliable latched 1|reliable latched 1|map
scan                              |sensor_msgs/LaserScan       |best_effort new 5 |best_effort new 5 |any
robot_description                 |std_msgs/String             |reliable new 5    |reliable latched 1|none
particle_cloud                    |nav2_msgs/ParticleCloud     |best_effort new 5 |best_effort new 5 |map
plan                              |nav_msgs/Path               |reliable new 5    |reliable new 1    |map
local_plan                        |nav_msgs/Path               |reliable new 5    |reliable new 1    |odom
global_costmap/costmap            |nav_msgs/OccupancyGrid      |reliable latched 1|reliable latched 1|map
global_costmap/costmap_updates    |map_msgs/OccupancyGridUpdate|reliable new 5    |reliable latched 1|map
global_costmap/published_footprint|geometry_msgs/PolygonStamped|reliable new 5    |default default 0 |map
local_costmap/costmap             |nav_msgs/OccupancyGrid      |reliable latched 1|reliable latched 1|odom
local_costmap/costmap_updates     |map_msgs/OccupancyGridUpdate|reliable new 5    |reliable latched 1|odom
local_costmap/published_footprint |geometry_msgs/PolygonStamped|reliable new 5    |default default 0 |odom
"""
"""Topic, type, QoS of the display's subscription, QoS of Nav2's publisher, and frame of the messages.

A QoS is the reliability, the durability (`latched` is transient local, `new` volatile) and the depth.
"""

NOT_SHOWN = {
    "map_updates": "map_server does not publish it either",
    "downsampled_costmap": "belongs to the Smac planner",
    "downsampled_costmap_updates": "belongs to the Smac planner",
    "speed_filter_mask": "belongs to the speed filter",
    "speed_filter_mask_updates": "belongs to the speed filter",
    "global_costmap/voxel_marked_cloud": "the costmap has no voxels",
    "local_costmap/voxel_marked_cloud": "the costmap has no voxels",
    "marker": "the controller samples no trajectories, as DWB does",
    "route_graph": "there is no route server",
    "waypoints": "RViz's own panel publishes it",
    "mobile_base/sensors/bumper_pointcloud": "the robot has no bumper",
    "intel_realsense_r200_depth/image_raw": "the robot's camera has the topics of a TIAGo",
    "intel_realsense_r200_depth/points": "the robot's camera publishes no points",
}
"""Displays of topics that the navigation does not publish, and why."""

TYPES = {
    "RobotModel": "std_msgs/String",
    "LaserScan": "sensor_msgs/LaserScan",
    "PointCloud2": "sensor_msgs/PointCloud2",
    "Map": "nav_msgs/OccupancyGrid",
    "ParticleCloud": "nav2_msgs/ParticleCloud",
    "Path": "nav_msgs/Path",
    "Polygon": "geometry_msgs/PolygonStamped",
    "Image": "sensor_msgs/Image",
    "MarkerArray": "visualization_msgs/MarkerArray",
}
"""The types that the classes of displays subscribe to."""


class Qos(NamedTuple):
    """Reliability, durability and depth, with the names of the table."""

    reliability: str
    durability: str
    depth: int

    @classmethod
    def of(cls, text: str) -> "Qos":
        """Return the QoS of a column of the table."""
        reliability, durability, depth = text.split()
        return cls(reliability, durability, int(depth))

    def profile(self) -> Any:
        """Return the QoS for rclpy."""
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_system_default

        if self.reliability == "default":
            return qos_profile_system_default
        return QoSProfile(
            depth=self.depth,
            reliability=ReliabilityPolicy[self.reliability.upper()],
            durability=DurabilityPolicy.TRANSIENT_LOCAL
            if self.durability == "latched"
            else DurabilityPolicy.VOLATILE,
        )


class Display(NamedTuple):
    """A row of the table."""

    topic: str
    type: str
    subscription: Qos
    publisher: Qos
    frame: str


DISPLAYS = [
    Display(topic, type, Qos.of(subscription), Qos.of(publisher), frame)
    for line in TABLE.strip().splitlines()
    for topic, type, subscription, publisher, frame in [[cell.strip() for cell in line.split("|")]]
]


def displays_of(configuration: Any) -> Iterator[tuple[str, str, Qos]]:
    """Yield topic, type and QoS of the subscriptions of all displays in a configuration of RViz."""
    for display in configuration.get("Displays", ()):
        yield from displays_of(display)
        kind = display["Class"].partition("/")[2]
        for key, update in (("Topic", ""), ("Description Topic", ""), ("Update Topic", "Update")):
            topic = display.get(key)
            if topic is not None:
                type = "map_msgs/OccupancyGridUpdate" if update else TYPES.get(kind, f"unknown: {kind}")
                reliability = topic["Reliability Policy"].lower().replace(" ", "_")
                durability = "latched" if topic["Durability Policy"] == "Transient Local" else "new"
                yield topic["Value"].removeprefix("/"), type, Qos(reliability, durability, topic["Depth"])


def differences(configuration: Any) -> list[str]:
    """Return how the displays in a configuration of RViz differ from the table."""
    known = {display.topic: (display.type, display.subscription) for display in DISPLAYS}
    found = {topic: (type, qos) for topic, type, qos in displays_of(configuration["Visualization Manager"])}
    found = {topic: entry for topic, entry in found.items() if topic not in NOT_SHOWN}
    return [
        f"{topic}: the file has {found.get(topic)}, the table {known.get(topic)}"
        for topic in sorted(known.keys() | found.keys())
        if known.get(topic) != found.get(topic)
    ]


if __name__ == "__main__":
    content = yaml.safe_load(Path(sys.argv[1]).read_text(encoding="utf-8"))
    print("\n".join(differences(content)) or "no differences")
