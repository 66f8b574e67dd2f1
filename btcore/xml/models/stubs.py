"""Stubs for nodes without code: they have the ports of a model, and return planned results."""

from collections.abc import Mapping, Sequence
from typing import Final

from btcore.blackboard.ports import Port
from btcore.engine.control import DecoratorNode
from btcore.engine.leaf import Condition, StatefulAction
from btcore.engine.node import TreeNode
from btcore.engine.node_spec import NodeSpec
from btcore.errors import NodeError
from btcore.nodes.sequences_and_fallbacks import Sequence as SequenceNode
from btcore.status import FAILURE, RUNNING, SKIPPED, SUCCESS, NodeType, Status

_LETTERS: Final = {"R": RUNNING, "S": SUCCESS, "F": FAILURE, "K": SKIPPED}


class StubResults:
    """The results of stubs: *letters* maps the name or the ID of a node to the letters of its results.

    The letters are R (RUNNING), S (SUCCESS), F (FAILURE) and K (SKIPPED). Those of an action, such as
    `RRS|F`, have a segment for each start. Each tick uses the next letter of the segment; the last letter
    repeats. A condition uses one letter per tick. After its last letter or segment, a node begins again with
    the first. A node without letters returns SUCCESS.
    """

    def __init__(self, letters: Mapping[str, str] | None = None) -> None:
        self.letters = dict(letters or {})

    def letters_for(self, node: TreeNode) -> str:
        """Return the letters for the name of *node*, else for its ID, else `S`."""
        return self.letters.get(node.name) or self.letters.get(node.config.id) or "S"


def _read_letter(node: TreeNode, letter: str) -> Status:
    status = _LETTERS.get(letter)
    if status is None:
        raise NodeError(f"invalid letter {letter!r} in the plan of '{node.name}': use R, S, F and K")
    return status


class StubAction(StatefulAction):
    """Returns SUCCESS at once, or its planned results."""

    spec = NodeSpec(state_fields=("_segment", "_starts", "_calls"), uses=frozenset())

    def __init__(self, results: StubResults = StubResults()) -> None:  # noqa: B008 - never changed
        self._segments = results.letters_for(self).split("|")
        self._starts = 0
        self._calls = 0
        self._segment = ""

    def on_start(self) -> Status:
        """Start the next segment, and return the status of its first letter."""
        self._segment = self._segments[self._starts % len(self._segments)]
        self._starts += 1
        self._calls = 0
        return self.on_running()

    def on_running(self) -> Status:
        """Return the status of the next letter."""
        letter = self._segment[min(self._calls, len(self._segment) - 1)] if self._segment else ""
        self._calls += 1
        return _read_letter(self, letter)


class StubCondition(Condition):
    """Returns SUCCESS, or its planned results."""

    spec = NodeSpec(state_fields=("_ticks",))

    def __init__(self, results: StubResults = StubResults()) -> None:  # noqa: B008 - never changed
        self._letters = results.letters_for(self)
        self._ticks = 0

    def tick(self) -> Status:
        """Return the status of the next letter."""
        letter = self._letters[self._ticks % len(self._letters)]
        self._ticks += 1
        return _read_letter(self, letter)


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
    NodeType.ACTION: StubAction,
    NodeType.CONDITION: StubCondition,
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
