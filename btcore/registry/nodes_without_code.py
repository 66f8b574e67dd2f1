"""Classes of nodes that are known from a model alone: mock leaves, and controls and decorators."""

from collections.abc import Mapping, Sequence
from typing import Final

from btcore.blackboard.ports import Port
from btcore.engine.control import DecoratorNode
from btcore.engine.node import TreeNode
from btcore.engine.node_spec import NodeSpec
from btcore.nodes.sequences_and_fallbacks import Sequence as SequenceNode
from btcore.registry.mock_leaves import MockAction, MockCondition
from btcore.status import RUNNING, NodeType, Status


class MockControl(SequenceNode):
    """Ticks its children as a Sequence does."""

    spec = NodeSpec(symbol="")


class MockDecorator(DecoratorNode):
    """Returns the result of its child."""

    def tick(self) -> Status:
        """Tick the child, and return its result."""
        self.set_status(RUNNING)
        return self.child.execute_tick()


_MOCK_CLASSES: Final[dict[NodeType, type[TreeNode]]] = {
    NodeType.ACTION: MockAction,
    NodeType.CONDITION: MockCondition,
    NodeType.CONTROL: MockControl,
    NodeType.DECORATOR: MockDecorator,
}


def is_mock(cls: type[TreeNode]) -> bool:
    """Return whether *cls* is a mock node: its results and optional ports are unknown."""
    return issubclass(cls, tuple(_MOCK_CLASSES.values()))


def create_mock_class(
    id: str,
    node_type: NodeType,
    ports: Sequence[Port],
    description: str,
    origin: str,
    metadata: Mapping[str, str] | None = None,
) -> type[TreeNode]:
    """Return a new class of mock nodes, which have the ports of a model.

    Args:
        description: The docstring of the class, or "".
        origin: The module name of the class, which names the source of the model.
    """
    listed, fields = list(ports), dict(metadata or {})
    return type(
        id,
        (_MOCK_CLASSES[node_type],),
        {
            "provided_ports": staticmethod(lambda: listed),
            "metadata": staticmethod(lambda: fields),
            "__doc__": description,
            "__module__": origin,
        },
    )
