"""Access to optional ports, and to the goal ports that default to blackboard entries."""

from typing import Annotated, Any, Final

from btcore import IDLE, SKIPPED, BlackboardError, Direction, In, NodeError, Port, TreeNode
from btcore_navigation.path import NavPath
from btcore_robot.leaves.pose_types import Poses
from btcore_robot.robot import Pose2D

OPTIONAL: Final[Any] = None
"""The default of an optional port: an omitted input is None, an omitted output is not written."""

Goal = Annotated[In[Pose2D], "The goal."]
GoalList = Annotated[In[Poses], "The goals."]

Goals = tuple[Pose2D | None, tuple[Pose2D, ...]]
"""The goal and the goals of a navigation; None and () stand for missing values."""


def blackboard_default(key: str) -> Any:
    """Return the default of an input port: the blackboard entry *key*."""
    return f"{{{key}}}"


def is_first_tick(node: TreeNode) -> bool:
    """Return whether this is the first tick of *node* since it was reset or skipped."""
    return node.status in (IDLE, SKIPPED)


def optional_input(node: TreeNode, port: str) -> object:
    """Return the value of an input port, or None if the port is omitted or its blackboard entry is empty.

    Raises:
        ConversionError: The value does not convert to the type of the port, also in the functions below.
    """
    try:
        return node.get_input(port)
    except (BlackboardError, NodeError):
        return None


def path_input(node: TreeNode, port: str) -> NavPath | None:
    """Return the path of an input port, or None if the path is missing or empty."""
    value = optional_input(node, port)
    return value if isinstance(value, NavPath) and len(value) else None


def pose_input(node: TreeNode, port: str) -> Pose2D | None:
    """Return the pose of an input port, or None if the pose is missing."""
    value = optional_input(node, port)
    return value if isinstance(value, Pose2D) else None


def poses_input(node: TreeNode, port: str) -> tuple[Pose2D, ...]:
    """Return the poses of an input port, or an empty tuple if the poses are missing."""
    value = optional_input(node, port)
    return tuple(value) if isinstance(value, list | tuple) else ()


def plugin_input(node: TreeNode, port: str) -> str:
    """Return the plug-in name of an input port, or "" if there is none, for example before a selector ran."""
    value = optional_input(node, port)
    return value if isinstance(value, str) else ""


def goal_inputs(node: TreeNode) -> Goals:
    """Return the values of the ports `goal` and `goals`."""
    return pose_input(node, "goal"), poses_input(node, "goals")


def write_outputs(node: TreeNode, **outputs: object) -> None:
    """Write values to the output ports that are connected in the tree.

    Args:
        node: The node with the ports.
        outputs: The values by port name. Values of ports that are not connected are ignored.

    Raises:
        BlackboardError: A port is not bound to an entry, or the entry has another type.
        ConversionError: A value is not of the type of its port.
    """
    for port, value in outputs.items():
        if port in node.config.outputs:
            node.set_output(port, value)


def path_port(description: str, direction: Direction = Direction.IN) -> "staticmethod[[], list[Port]]":
    """Return the static method `provided_ports` of a node with a port named `path`.

    mypy rejects an annotation of this name, because `TreeNode.path` is a str: the node's path in the tree.

    Args:
        description: The description of the port.
        direction: IN for a mandatory input, OUT for an optional output.
    """
    default = None if direction is Direction.IN else ""
    return staticmethod(lambda: [Port("path", direction, default=default, description=description)])
