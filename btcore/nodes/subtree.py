"""SubTree: a node that stands for another tree, which has its own blackboard."""

from typing import ClassVar

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Port
from btcore.engine.control import DecoratorNode
from btcore.engine.node import execute_tick, reset_status, set_status
from btcore.engine.node_spec import NodeSpec
from btcore.status import FAILURE, IDLE, RUNNING, SUCCESS, NodeType, Status
from btcore.values import BOOL


@mypyc_attr(allow_interpreted_subclasses=True)
class SubTree(DecoratorNode):
    """Ticks the root of the tree named by `ID`, and returns its result.

    The inner tree has its own blackboard. The other attributes connect it with the outer tree's blackboard.
    `inner="{outer}"` makes the key `inner` of the inner tree the entry `outer` of the outer tree. Any other
    value is a constant that is written to the key `inner`. With `_autoremap` every key that the inner tree
    uses is the entry of the same name in the outer tree, except keys that begin with an underscore.
    """

    spec: ClassVar[NodeSpec] = NodeSpec(
        node_type=NodeType.SUBTREE, symbol="▣", never_pauses=True, formats=(4,)
    )

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ports."""
        # For listings and models only: the attribute is read by TreePlanner, never by a node.
        return [Port("_autoremap", type=BOOL, default="false", description="use the outer tree's entries")]

    def tick(self) -> Status:
        """Tick the root of the inner tree."""
        if self._status is IDLE:
            set_status(self, RUNNING)
        status = execute_tick(self.child)
        if status is SUCCESS or status is FAILURE:
            reset_status(self.child)
        return status
