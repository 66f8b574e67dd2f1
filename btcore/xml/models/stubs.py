"""Stubs for nodes without code: they have the ports of a model. Stubs of leaves are mock leaves."""

from collections.abc import Mapping, Sequence
from typing import Final

from btcore.blackboard.ports import Port
from btcore.engine.control import DecoratorNode
from btcore.engine.node import TreeNode
from btcore.engine.node_spec import NodeSpec
from btcore.nodes.sequences_and_fallbacks import Sequence as SequenceNode
from btcore.status import FAILURE, RUNNING, SUCCESS, NodeType, Status
from btcore.xml.models.mock_leaves import MockAction, MockCondition


class StubControl(SequenceNode):
    """Ticks its children as a Sequence does."""

    spec = NodeSpec(symbol="")


class StubDecorator(DecoratorNode):
    """Returns the result of its child."""

    def tick(self) -> Status:
        """Tick the child, and return its result."""
        self.set_status(RUNNING)
        status = self.child.execute_tick()
        if status is SUCCESS or status is FAILURE:
            self.reset_child()
        return status


_OF_TYPE: Final[dict[NodeType, type[TreeNode]]] = {
    NodeType.ACTION: MockAction,
    NodeType.CONDITION: MockCondition,
    NodeType.CONTROL: StubControl,
    NodeType.DECORATOR: StubDecorator,
}


def is_stub(cls: type[TreeNode]) -> bool:
    """Return whether *cls* is a stub made from a model: its results and optional ports are unknown."""
    return issubclass(cls, tuple(_OF_TYPE.values()))


def make_stub_class(
    id: str,
    kind: NodeType,
    ports: Sequence[Port],
    description: str,
    origin: str,
    metadata: Mapping[str, str] | None = None,
) -> type[TreeNode]:
    """Return a new stub class.

    Args:
        description: The docstring of the class, or "".
        origin: The module name of the class, which names the source of the model.
    """
    listed, fields = list(ports), dict(metadata or {})
    return type(
        id,
        (_OF_TYPE[kind],),
        {
            "provided_ports": staticmethod(lambda: listed),
            "metadata": staticmethod(lambda: fields),
            "__doc__": description or f"A stub: the code of <{id}> is elsewhere.",
            "__module__": origin,
        },
    )
