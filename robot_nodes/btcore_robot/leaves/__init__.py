"""The robot's leaves: a library of tree nodes, found in the entry point group `btcore.nodes`."""

from btcore import Registry
from btcore_robot.leaves.battery import BatteryChecker, Recharge
from btcore_robot.leaves.drive import Back, Forward, Patrol, Turn, TurnToFree
from btcore_robot.leaves.lifecycle_leaves import LocateObjects, TrackObjects
from btcore_robot.leaves.obstacle import WaitForScan, is_obstacle
from btcore_robot.leaves.pose_types import register_pose_type
from btcore_robot.leaves.waypoint import GetWaypoint

__all__ = [
    "Back",
    "BatteryChecker",
    "Forward",
    "GetWaypoint",
    "LocateObjects",
    "Patrol",
    "Recharge",
    "TrackObjects",
    "Turn",
    "TurnToFree",
    "WaitForScan",
    "is_obstacle",
    "register",
]


def register(nodes: Registry) -> None:
    """Register every leaf of this library and the port type `Pose2D`."""
    register_pose_type(nodes)
    nodes.add(Back, Forward, Patrol, Turn, TurnToFree, WaitForScan, is_obstacle)
    nodes.add(BatteryChecker, GetWaypoint, LocateObjects, Recharge, TrackObjects)
