"""The leaves that navigate and make maps, found in the entry point group `btcore.nodes`."""

from btcore import Registry
from btcore_navigation.leaves.explore import Explore, SaveMap
from btcore_navigation.leaves.navigate import Move
from btcore_robot.leaves.pose_types import register_pose_type

__all__ = ["Explore", "Move", "SaveMap", "register"]


def register(nodes: Registry) -> None:
    """Register every leaf of this library and the port type `Pose2D`."""
    register_pose_type(nodes)
    nodes.add(Explore, Move, SaveMap)
