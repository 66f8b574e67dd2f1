"""Nav2's tree nodes under Nav2's names, served by this navigation stack.

`btcore.nodes` is the entry-point group by which the engine finds this library.
"""

from btcore import Registry
from btcore_navigation.nodes import actions, conditions, control, decorators, goals, paths, services
from btcore_robot.leaves.pose_types import register_pose_type


def register(nodes: Registry) -> None:
    """Register every node of this library, and the pose type of their ports."""
    register_pose_type(nodes)
    for module in (control, decorators, conditions, goals, actions, paths, services):
        # Registers the node classes that the module defines, except base classes: their names begin with "_".
        nodes.add_plugin(module, "btcore_navigation")
