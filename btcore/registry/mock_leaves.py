"""Mock leaves, which do what their outcomes plan, and `Outcomes`, which plans and drives those of a tree."""

from collections.abc import Iterable, Mapping
from random import Random
from typing import TYPE_CHECKING, ClassVar

from btcore.blackboard.ports import Output, Port
from btcore.engine.leaf import StatefulAction
from btcore.engine.node_spec import NodeSpec
from btcore.registry.outcome_grammar import LETTERS, Start, parse_outcomes
from btcore.status import SUCCESS, NodeType, Status
from btcore.suggestions import did_you_mean, join_names

if TYPE_CHECKING:
    from btcore.tree.tree import Tree


class MockLeafError(Exception):
    """Raised by a mock leaf whose outcome is X."""


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

    Attributes:
        shared: The outcomes that the leaves share.
        leaves: The outcomes of single leaves, by name or by ID; a name takes precedence.
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


class MockAction(StatefulAction):
    """An action that follows outcomes; by default it succeeds.

    Attributes:
        given_outputs: The values that the mock leaves of the tree write when they succeed.
        tree_outcomes: The outcomes of the tree; None = each start succeeds.
        starts: The number of starts.
        remaining: The outcomes that remain of the current start.
    """

    spec = NodeSpec(state_fields=("tree_outcomes", "starts", "remaining"), uses=frozenset())
    given_outputs: ClassVar[GivenOutputs] = {}

    def __init__(self, tree_outcomes: Outcomes | None = None) -> None:
        self.tree_outcomes = tree_outcomes or Outcomes()
        self.starts = 0
        self.remaining: Start = ()

    def on_start(self) -> Status:
        """Take the next start, and return the result of its first outcome."""
        self.remaining = self._next_start()
        self.starts += 1
        return self._next_result()

    def on_running(self) -> Status:
        """Return the result of the next outcome; the last outcome is repeated."""
        return self._next_result()

    def own_outcomes(self) -> str | None:
        """Return the outcomes of this leaf alone, or None if it follows the shared outcomes of its tree."""
        leaves = self.tree_outcomes.leaves
        return leaves.get(self.name) or leaves.get(self.config.id)

    def _next_start(self) -> Start:
        text = self.own_outcomes()
        if text is None:
            return self.tree_outcomes.next_start()
        starts = parse_outcomes(text)
        return starts[self.starts % len(starts)]

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

    def _next_start(self) -> Start:
        """Return a single outcome: of its own outcomes, a condition takes the next letter in each tick."""
        text = self.own_outcomes()
        if text is None:
            return self.tree_outcomes.next_start(is_condition=True)
        outcomes = [outcome for start in parse_outcomes(text) for outcome in start]
        return (outcomes[self.starts % len(outcomes)],)
