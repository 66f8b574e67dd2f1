"""Ports that a tree may leave out, and goals that stand on the blackboard by themselves."""

from typing import Any, Final

from btcore import BlackboardError, Direction, NodeError, Port, Status, TreeNode
from btcore_robot.navigation.path import NavPath
from btcore_robot.robot import Pose2D

OPTIONAL: Final[Any] = None
"""The default of a port that a tree may leave out: an input is None then, and an output goes nowhere."""

Goals = tuple[Pose2D | None, tuple[Pose2D, ...]]
"""The goal and the goals of a navigation, either of which may be absent."""


def blackboard_default(key: str) -> Any:
    """The default of an input that is the entry *key* of the blackboard where a tree leaves it out."""
    return f"{{{key}}}"


def is_first_tick(node: TreeNode) -> bool:
    """Whether *node* is ticked for the first time since it was reset, or skipped."""
    return node.status is Status.IDLE or node.status is Status.SKIPPED


def optional_input(node: TreeNode, port: str) -> object:
    """The value of input *port*; None where the tree doesn't give it, or its entry holds nothing yet."""
    if port not in node.config.inputs:
        return None
    try:
        return node.get_input(port)
    except (BlackboardError, NodeError):
        return None


def path_input(node: TreeNode, port: str) -> NavPath | None:
    """The path of input *port*, or None while there is none, or an empty one."""
    value = optional_input(node, port)
    return value if isinstance(value, NavPath) and len(value) else None


def pose_input(node: TreeNode, port: str) -> Pose2D | None:
    """The pose of input *port*, or None while there is none."""
    value = optional_input(node, port)
    return value if isinstance(value, Pose2D) else None


def poses_input(node: TreeNode, port: str) -> tuple[Pose2D, ...]:
    """The poses of input *port*; none while there are none."""
    value = optional_input(node, port)
    return tuple(value) if isinstance(value, list | tuple) else ()


def plugin_input(node: TreeNode, port: str) -> str:
    """The plug-in that input *port* names; "" while it names none, say, before a selector chose one."""
    value = optional_input(node, port)
    return value if isinstance(value, str) else ""


def goals_of(node: TreeNode) -> Goals:
    """The ports ``goal`` and ``goals``."""
    return pose_input(node, "goal"), poses_input(node, "goals")


def write_outputs(node: TreeNode, **outputs: object) -> None:
    """Write those of *outputs* that the tree connects."""
    for port, value in outputs.items():
        if port in node.config.outputs:
            node.set_output(port, value)


def path_input_port(description: str) -> Port:
    """An input port called ``path``."""
    return Port("path", description=description)


def path_output_port(description: str) -> Port:
    """An output port called ``path``."""
    return Port("path", Direction.OUT, default="", description=description)
