"""SubTree: another tree in this one's place, with a blackboard of its own."""

from typing import ClassVar

from mypy_extensions import mypyc_attr

from btcore.blackboard.ports import Port
from btcore.engine.control import DecoratorNode
from btcore.engine.node import execute_tick
from btcore.status import (
    FAILURE,
    IDLE,
    RUNNING,
    SUCCESS,
    NodeType,
    Status,
)
from btcore.values import BOOL


@mypyc_attr(allow_interpreted_subclasses=True)
class SubTree(DecoratorNode):
    """Ticks the root of the tree named by `ID`.

    Its attributes connect the two blackboards: `inner="{outer}"` is one entry under two names,
    anything else a constant written into the inner one. With `_autoremap` every name that the inner
    tree uses is the outer one's, but for names that begin with an underscore.
    """

    builtin_formats: ClassVar[tuple[int, ...]] = (4,)
    node_symbol: ClassVar[str] = "▣"
    batch_class: ClassVar[str] = "btcore.batch.script_nodes:SubTree"
    node_type: ClassVar[NodeType] = NodeType.SUBTREE

    @staticmethod
    def provided_ports() -> list[Port]:
        """The ports."""
        return [Port("_autoremap", type=BOOL, default="false", description="names are the outer tree's")]

    def tick(self) -> Status:
        """Tick the root of the inner tree."""
        if self._status is IDLE:
            self.set_status(RUNNING)
        status = execute_tick(self.child)
        if status is SUCCESS or status is FAILURE:
            self.reset_child()
        return status
