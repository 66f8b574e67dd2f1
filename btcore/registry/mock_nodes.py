"""Mock leaves: leaves that return what a test or a user planned, in the order of their outcomes.

Leaves without code, leaves that a test replaces, and leaves of random trees are mock leaves. The grammar of
outcomes is described in `parse_outcomes`. Mock nodes are nodes without code of any type: mock leaves, and
controls and decorators that have the ports of a model.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from random import Random
from typing import TYPE_CHECKING, ClassVar, Final, NamedTuple

from btcore.blackboard.ports import Output, Port
from btcore.engine.control import DecoratorNode
from btcore.engine.leaf import StatefulAction
from btcore.engine.node import TreeNode
from btcore.engine.node_spec import NodeSpec
from btcore.nodes.sequences_and_fallbacks import Sequence as SequenceNode
from btcore.status import FAILURE, RUNNING, SKIPPED, SUCCESS, NodeType, Status
from btcore.suggestions import did_you_mean, join_names

if TYPE_CHECKING:
    from btcore.tree.tree import Tree

LETTERS: Final = {"R": RUNNING, "S": SUCCESS, "F": FAILURE, "K": SKIPPED}
"""The statuses of the letters of outcomes, except X, which raises an exception."""

_OUTCOME: Final = re.compile(r"([RSFKX])(?:\(((?:'(?:[^']|'')*'|[^'()])*)\))?(\|?)")
_OUTPUT: Final = re.compile(r"\s*([^=,'\s]+)\s*=\s*(?:'((?:[^']|'')*)'|([^,']*?))\s*(?:,|$)")


class MockLeafError(Exception):
    """Raised by a mock leaf whose outcome is X."""


class Outcome(NamedTuple):
    """What a mock leaf does in a tick.

    Attributes:
        letter: R (RUNNING), S (SUCCESS), F (FAILURE), K (SKIPPED) or X (raises `MockLeafError`).
        outputs: The names and the values of the output ports that the leaf writes; the values as texts.
    """

    letter: str
    outputs: tuple[tuple[str, str], ...] = ()

    def __str__(self) -> str:
        texts = [f"{port}={_quote(value)}" for port, value in self.outputs]
        return f"{self.letter}({', '.join(texts)})" if texts else self.letter


Start = tuple[Outcome, ...]
"""The outcomes of a leaf from its start until it completes or is halted, one for each tick."""


@lru_cache(maxsize=10_000)
def parse_outcomes(text: str) -> tuple[Start, ...]:
    """Return the outcomes of a text such as `RRS|F`: for each start of a leaf, an outcome for each tick.

    The letters are R (RUNNING), S (SUCCESS), F (FAILURE), K (SKIPPED) and X (raises `MockLeafError`). A start
    ends at the first letter other than R, or at a `|`, which may be omitted after such a letter. Output ports
    that the leaf writes follow in parentheses: `S(cups=3, text='a, b')`. A quote in quotes is doubled.
    """
    starts: list[Start] = []
    start: list[Outcome] = []
    end = 0
    while match := _OUTCOME.match(text, end):
        letter, outputs, bar = match.groups()
        end = match.end()
        start.append(Outcome(letter, _parse_outputs(outputs, text)))
        if letter != "R" or bar or end == len(text):
            starts.append(tuple(start))
            start.clear()
    if not starts or end < len(text) or text.endswith("|"):
        raise ValueError(
            f"invalid outcomes '{text}': write for example RRS|F; the letters are R (RUNNING), S (SUCCESS), "
            "F (FAILURE), K (SKIPPED) and X (an exception); | separates the starts of the leaf; "
            "S(port=value) writes an output port"
        )
    return tuple(starts)


def _parse_outputs(text: str | None, outcomes: str) -> tuple[tuple[str, str], ...]:
    outputs: dict[str, str] = {}
    end = 0
    while match := _OUTPUT.match(text or "", end):
        port, quoted, plain = match.groups()
        outputs[port] = plain if quoted is None else quoted.replace("''", "'")
        end = match.end()
    if text is not None and (end < len(text) or not outputs):
        raise ValueError(f"invalid outcomes '{outcomes}': write outputs as S(port=value, other='a, b')")
    return tuple(outputs.items())


def _quote(value: str) -> str:
    return value if re.fullmatch(r"[^',()\s]+", value) else "'" + value.replace("'", "''") + "'"


GivenOutputs = Mapping[str, Mapping[str, object]]
"""The values that mock leaves write: by the name or the ID of the leaf, then by the name of the port."""


def check_outputs(outputs: Mapping[str, Iterable[str]], ports: Mapping[str, Mapping[str, Port]]) -> None:
    """Check that mock leaves can write output ports.

    Args:
        outputs: The names of the output ports, by the name or the ID of the leaf.
        ports: The ports of the mock leaves, by name and by ID.
    """
    for name, names in outputs.items():
        if name not in ports:
            hint = did_you_mean(name, ports) or f"; it has {join_names(ports) or 'none'}"
            raise ValueError(f"the tree has no mock leaf '{name}'{hint}")
        known = [port.name for port in ports[name].values() if port.writes]
        for output in names:
            if output not in known:
                hint = did_you_mean(output, known)
                raise ValueError(f"outputs: '{name}' has no output port '{output}'{hint}")


class Outcomes:
    """The outcomes of the mock leaves of a tree, in the grammar of `parse_outcomes`.

    A leaf with outcomes of its own takes the next of its starts each time it starts, and a condition the next
    letter in each tick. All other leaves take the starts of the shared outcomes in turn. After the last
    start, the first follows again. Of the shared outcomes, a condition returns only the end of a start, and
    FAILURE for K, because several control nodes raise an exception if their condition is skipped.

    Args:
        shared: The outcomes that the leaves share.
        leaves: The outcomes of single leaves, by name or by ID; a name takes precedence.

    Attributes:
        shared: The outcomes that the leaves share.
        leaves: The outcomes of single leaves.
        source: The source of random values of output ports. Equal outcomes draw equal values.

    Raises:
        ValueError: A text is invalid.

    Examples:
        >>> import btcore
        >>> from btcore.testing import Outcomes, with_mock_leaves
        >>> nodes = with_mock_leaves(btcore.Registry.standard())
        >>> b = btcore.Builder(nodes)
        >>> tree = b.build(b.Sequence(b.Act(), b.Ask()), clock=btcore.SimClock())
        >>> [status.name for status in Outcomes("RRS|F").drive(tree, ticks=3)]
        ['RUNNING', 'RUNNING', 'FAILURE']
    """

    def __init__(self, shared: str = "S", leaves: Mapping[str, str] | None = None) -> None:
        self.shared = shared
        self.leaves = dict(leaves or {})
        for text in (shared, *self.leaves.values()):
            parse_outcomes(text)
        self._restart()

    def __repr__(self) -> str:
        return f"Outcomes({self.shared!r}{f', {self.leaves}' if self.leaves else ''})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Outcomes) and repr(self) == repr(other)

    def __hash__(self) -> int:
        return hash(self.shared)

    def _restart(self) -> None:
        self._next = 0
        self.source = Random(self.shared)

    def next_start(self, is_condition: bool = False) -> Start:
        """Return the next start of the shared outcomes.

        Args:
            is_condition: Whether the leaf is a condition.
        """
        starts = parse_outcomes(self.shared)
        start = starts[self._next % len(starts)]
        self._next += 1
        if not is_condition:
            return start
        return (start[-1]._replace(letter=start[-1].letter.replace("K", "F").replace("R", "S")),)

    def attach(self, tree: "Tree") -> None:
        """Make the mock leaves of *tree* follow these outcomes, beginning with the first start.

        Raises:
            ValueError: The tree has leaves that are not built in, but no mock leaves; or the outcomes, or the
                outputs of `with_mock_leaves`, name a leaf or an output port that does not exist.
        """
        leaves = tree.find(MockAction)
        ports: dict[str, Mapping[str, Port]] = {}
        ordinary = []
        for node in tree:
            manifest = tree.registry.get(node.config.id, node.config.format)
            if isinstance(node, MockAction):
                ports[node.config.id] = ports[node.name] = manifest.ports if manifest is not None else {}
            elif not node.children and (manifest is None or manifest.library != "btcore"):
                ordinary.append(node.config.path)
        if ordinary and not leaves:
            raise ValueError(
                f"the tree '{tree.id}' has no mock leaves ('{ordinary[0]}' is an ordinary leaf); "
                "load it with nodes=with_mock_leaves(nodes)"
            )
        self.check(ports)
        check_outputs(leaves[0].given_outputs if leaves else {}, ports)
        for leaf in leaves:
            leaf.tree_outcomes = self
        self._restart()

    def check(self, ports: Mapping[str, Mapping[str, Port]]) -> None:
        """Check that the leaves with outcomes of their own exist.

        Args:
            ports: The ports of the mock leaves of a tree, by the name and by the ID of the leaf.

        Raises:
            ValueError: There is no such leaf, or it does not have an output port of its outcomes.
        """
        outputs = {
            name: [port for start in parse_outcomes(text) for outcome in start for port, _ in outcome.outputs]
            for name, text in self.leaves.items()
        }
        check_outputs(outputs, ports)

    def drive(self, tree: "Tree", ticks: int = 10, period: float = 0.01) -> list[Status]:
        """Attach these outcomes to a tree, tick it, and return the results of the root.

        Args:
            tree: The tree.
            ticks: The number of ticks.
            period: The time between two ticks (s of the tree's clock).

        Raises:
            ValueError: The tree has no mock leaves, see `attach`.
            NodeExecutionError: A node raised an exception.
        """
        self.attach(tree)
        results = []
        for _ in range(ticks):
            results.append(tree.tick_exactly_once())
            tree.sleep(period)
        return results


SUCCEED: Final = Outcomes()
"""The outcomes of mock leaves for which nothing is planned."""


class MockAction(StatefulAction):
    """An action that follows outcomes; by default it succeeds.

    Args:
        tree_outcomes: The outcomes of the tree.

    Attributes:
        given_outputs: The values that the mock leaves of the tree write when they succeed.
        tree_outcomes: The outcomes of the tree.
        starts: The number of starts.
        remaining: The outcomes that remain of the current start.
    """

    spec = NodeSpec(state_fields=("tree_outcomes", "starts", "remaining"), uses=frozenset())
    given_outputs: ClassVar[GivenOutputs] = {}

    def __init__(self, tree_outcomes: Outcomes = SUCCEED) -> None:
        # Leaves of different trees do not share the source of random values.
        self.tree_outcomes = tree_outcomes if tree_outcomes is not SUCCEED else Outcomes()
        self.starts = 0
        self.remaining: Start = ()

    def on_start(self) -> Status:
        """Take the next start, and return the result of its first outcome."""
        text = self.own_outcomes()
        is_condition = self.spec.node_type is NodeType.CONDITION
        if text is None:
            self.remaining = self.tree_outcomes.next_start(is_condition)
        else:
            starts = parse_outcomes(text)
            if is_condition:
                starts = tuple((outcome,) for start in starts for outcome in start)
            self.remaining = starts[self.starts % len(starts)]
        self.starts += 1
        return self._next_result()

    def on_running(self) -> Status:
        """Return the result of the next outcome; the last outcome is repeated."""
        return self._next_result()

    def own_outcomes(self) -> str | None:
        """Return the outcomes of this leaf alone, or None if it follows the shared outcomes of its tree."""
        leaves = self.tree_outcomes.leaves
        return leaves.get(self.name) or leaves.get(self.config.id)

    def _next_result(self) -> Status:
        outcome = self.remaining[0]
        # After the last outcome, the rest is empty: keep the outcome for the next tick.
        self.remaining = self.remaining[1:] or self.remaining
        status = LETTERS.get(outcome.letter)
        if status is None:
            raise MockLeafError(f"the outcome of '{self.name}' is {outcome.letter}")
        texts = dict(outcome.outputs)
        for name, output in self.config.outputs.items():
            if output.key is None:
                continue
            if name in texts:
                output.write(output.type.from_text(texts[name], self.config.format))
            elif status is SUCCESS and (value := self.draw_output(output)) is not None:
                output.write(value)
        return status

    def draw_output(self, output: Output) -> object:
        """Return the value of an output port that an outcome S does not name; None = it is not written."""
        return None


class MockCondition(MockAction):
    """A condition that follows outcomes; by default it succeeds."""

    spec = NodeSpec(node_type=NodeType.CONDITION)

    def tick(self) -> Status:
        """Return the result of the next outcome. Each tick is a start."""
        return self.on_start()


# --- nodes without code


class MockControl(SequenceNode):
    """Ticks its children as a Sequence does."""

    spec = NodeSpec(symbol="")


class MockDecorator(DecoratorNode):
    """Returns the result of its child."""

    def tick(self) -> Status:
        """Tick the child, and return its result."""
        self.set_status(RUNNING)
        status = self.child.execute_tick()
        if status is SUCCESS or status is FAILURE:
            self.reset_child()
        return status


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
