"""The robot's leaves: a library of tree nodes, found by the entry point group ``btcore.nodes``."""

from btcore import Registry
from robot_nodes.leaves.battery import BatteryChecker, Recharge
from robot_nodes.leaves.drive import Back, Forward, Patrol, Turn
from robot_nodes.leaves.explore import Explore, SaveMap
from robot_nodes.leaves.free_space import TurnToFree
from robot_nodes.leaves.locate import LocateObjects
from robot_nodes.leaves.navigate import Move
from robot_nodes.leaves.obstacle import WaitForScan, is_obstacle
from robot_nodes.leaves.poses import add_poses
from robot_nodes.leaves.track import TrackObjects
from robot_nodes.leaves.waypoint import GetWaypoint

__all__ = [
    "Back",
    "BatteryChecker",
    "Explore",
    "Forward",
    "GetWaypoint",
    "LocateObjects",
    "Move",
    "Patrol",
    "Recharge",
    "SaveMap",
    "TrackObjects",
    "Turn",
    "TurnToFree",
    "WaitForScan",
    "is_obstacle",
    "register",
]


def register(nodes: Registry) -> None:
    """Add every leaf of this library, and the type of its places."""
    add_poses(nodes)
    nodes.add(Back, Forward, Patrol, Turn, TurnToFree, WaitForScan, is_obstacle)
    nodes.add(BatteryChecker, GetWaypoint, LocateObjects, Move, Recharge, TrackObjects)
    nodes.add(Explore, SaveMap)
