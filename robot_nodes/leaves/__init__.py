"""The robot's leaves: a library of tree nodes, found by the entry point group ``btcore.nodes``."""

from btcore import Registry
from robot_nodes.leaves.drive import Back, Forward, Turn
from robot_nodes.leaves.obstacle import WaitForScan, is_obstacle

__all__ = ["Back", "Forward", "Turn", "WaitForScan", "is_obstacle", "register"]


def register(nodes: Registry) -> None:
    """Add every leaf of this library."""
    nodes.add(Back, Forward, Turn, WaitForScan, is_obstacle)
