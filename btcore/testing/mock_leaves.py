"""Test doubles for leaves: all leaves of a tree follow the same plan.

A plan has a letter for each tick:

    nodes = with_mock_leaves(nodes)                  # replaces all leaves except btcore's own
    tree = btcore.load("patrol.xml", nodes=nodes, clock=SimClock())
    Outcomes("RRS", "F").drive(tree, ticks=6)
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from random import Random
from typing import Any, ClassVar, Final, get_type_hints

from btcore.blackboard.ports import Port
from btcore.engine.leaf import Condition, StatefulAction
from btcore.engine.node import TreeNode
from btcore.engine.node_spec import NodeSpec
from btcore.registry.registry import Registry
from btcore.status import SUCCESS, NodeType, Status
from btcore.suggestions import did_you_mean
from btcore.testing.plan_leaves import status_of
from btcore.tree.tree import Tree
from btcore.values import (
    BOOL,
    STRING,
    EnumType,
    IntegerType,
    RealType,
    TypeRegistry,
    UserType,
    ValueType,
    VectorType,
)

_ENTRY: Final = re.compile("R*[SFKX]")

# Limits of the values that are drawn for output ports.
_LARGEST: Final = 100
_LETTERS: Final = "abc 12"
_MAX_DEPTH: Final = 4
"""The maximum number of classes and lists inside each other; a class may contain itself."""


class Outcomes:
    """A plan for the results of all mock leaves of a tree.

    Each time a leaf starts, it takes the next entry of the plan. After the last entry, the plan starts again.
    An entry is S (SUCCESS), F (FAILURE), K (SKIPPED) or X (raises `LeafPlanError`), preceded by an R
    for each tick in which an action is RUNNING. A condition uses only the last letter of its entry, and
    returns FAILURE for K, because several control nodes raise an exception if their condition is skipped.

    A leaf that succeeds writes its output ports, see `with_mock_leaves`. Equal plans draw equal values.

    Args:
        entries: The entries of the plan, such as "S", "F" and "RRS".

    Attributes:
        entries: The entries of the plan.
        source: The source of the random values of output ports.

    Raises:
        ValueError: There is no entry, or an entry is invalid.

    Examples:
        >>> import btcore
        >>> from btcore.testing import Outcomes, with_mock_leaves
        >>> nodes = with_mock_leaves(btcore.Registry.standard())
        >>> b = btcore.Builder(nodes)
        >>> tree = b.build(b.Sequence(b.Act(), b.Ask()), clock=btcore.SimClock())
        >>> [status.name for status in Outcomes("RRS", "F").drive(tree, ticks=3)]
        ['RUNNING', 'RUNNING', 'FAILURE']
    """

    def __init__(self, *entries: str) -> None:
        invalid = [entry for entry in entries if not _ENTRY.fullmatch(entry)]
        if invalid or not entries:
            value = repr(invalid[0]) if invalid else "nothing"
            raise ValueError(f"a plan has entries such as 'S', 'F' and 'RRS', not {value}")
        self.entries = entries
        self._restart()

    def __repr__(self) -> str:
        return f"Outcomes({', '.join(map(repr, self.entries))})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Outcomes) and self.entries == other.entries

    def __hash__(self) -> int:
        return hash(self.entries)

    def _restart(self) -> None:
        self._next = 0
        self.source = Random(" ".join(self.entries))

    def next_entry(self) -> str:
        """Return the entry for the next start of a leaf."""
        entry = self.entries[self._next % len(self.entries)]
        self._next += 1
        return entry

    def attach(self, tree: Tree) -> None:
        """Make the mock leaves of *tree* follow this plan, beginning with its first entry.

        Raises:
            ValueError: The tree has leaves that are not built in, but no mock leaves; or the *outputs* of the
                mock leaves name a leaf that is not in the tree, or a port that a leaf does not have.
        """
        leaves: list[MockAction | MockCondition] = [*tree.find(MockAction), *tree.find(MockCondition)]
        own = [
            node.config.path for node in tree if not node.children and not _is_built_in(node, tree.registry)
        ]
        if own and not leaves:
            raise ValueError(
                f"the tree '{tree.id}' has no mock leaves ('{own[0]}' is an ordinary leaf); "
                "load it with nodes=with_mock_leaves(nodes)"
            )
        for leaf in leaves:
            _check_outputs(leaf.given_outputs, leaves, tree)
            leaf.outcomes = self
        self._restart()

    def drive(self, tree: Tree, ticks: int = 10, period: float = 0.01) -> list[Status]:
        """Attach this plan to a tree, tick it, and return the results of the root.

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


def _is_built_in(node: TreeNode, nodes: Registry) -> bool:
    manifest = nodes.get(node.config.id, node.config.format)
    return manifest is not None and manifest.distribution == "btcore"


GivenOutputs = Mapping[str, Mapping[str, object]]
"""The values that mock leaves write: by the name or the ID of the leaf, then by the name of the port."""


def _check_outputs(given: GivenOutputs, leaves: Iterable[TreeNode], tree: Tree) -> None:
    """Raise ValueError if *given* names a leaf that is not in *leaves*, or a port that the leaf lacks."""
    known = {name: leaf for leaf in leaves for name in (leaf.config.id, leaf.name)} if given else {}
    for name, values in given.items():
        leaf = known.get(name)
        if leaf is None:
            raise ValueError(f"outputs: the tree has no mock leaf '{name}'{did_you_mean(name, known)}")
        manifest = tree.registry.get(leaf.config.id, leaf.config.format)
        _check_ports(name, values, manifest.ports if manifest is not None else {})


def _check_ports(name: str, values: Mapping[str, object], ports: Mapping[str, Port]) -> None:
    """Raise ValueError if *values* has a key that is no output of the leaf *name*."""
    outputs = [port.name for port in ports.values() if port.writes]
    for port in values:
        if port not in outputs:
            hint = did_you_mean(port, outputs)
            raise ValueError(f"outputs: '{name}' has no output port '{port}'{hint}")


def _write_outputs(leaf: TreeNode, given: GivenOutputs, source: Random) -> None:
    """Write the connected output ports of *leaf*: given values, else values that are drawn."""
    values = {**given.get(leaf.config.id, {}), **given.get(leaf.name, {})}
    for name, output in leaf.config.outputs.items():
        if output.key is None:
            continue
        value = values[name] if name in values else _draw_value(output.type, source)
        if value is not None:
            output.write(value)


def _draw_value(kind: ValueType, source: Random, depth: int = _MAX_DEPTH) -> object:
    """Return a random value of a type, or None if values of the type cannot be drawn.

    Values can be drawn for bool, numbers, texts, enums, and for lists, dataclasses and named tuples of these.
    """
    if kind is BOOL:
        return source.random() < 0.5
    if isinstance(kind, IntegerType):
        return source.randint(max(kind.low, -_LARGEST), min(kind.high, _LARGEST))
    if isinstance(kind, RealType):
        return round(source.uniform(-_LARGEST, _LARGEST), 3)
    if kind is STRING:
        return "".join(source.choices(_LETTERS, k=source.randint(0, 5)))
    if isinstance(kind, EnumType):
        return source.choice(kind.members) if kind.members else None
    if depth and isinstance(kind, VectorType):
        items = [_draw_value(kind.item, source, depth - 1) for _ in range(source.randint(0, 3))]
        return None if None in items else items
    if depth and isinstance(kind, UserType):
        return _draw_record(kind.python_type, source, depth - 1)
    return None


def _draw_record(cls: type[Any], source: Random, depth: int) -> object:
    """Return a dataclass or a named tuple with random values, or None."""
    if is_dataclass(cls):
        required = {
            field.name: field.default is MISSING and field.default_factory is MISSING
            for field in fields(cls)
            if field.init
        }
    elif names := getattr(cls, "_fields", ()):  # a named tuple
        defaults: Mapping[str, object] = getattr(cls, "_field_defaults", {})
        required = {name: name not in defaults for name in names}
    else:
        return None
    types = TypeRegistry()
    try:
        hints = get_type_hints(cls, include_extras=True)
        values = {name: _draw_value(types.of(hints[name]), source, depth) for name in required}
        if any(values[name] is None for name in required if required[name]):
            return None
        return cls(**{name: value for name, value in values.items() if value is not None})
    except Exception:
        return None  # the class rejects the values


class MockAction(StatefulAction):
    """An action that follows the `Outcomes` that are attached to the tree; by default it succeeds.

    Attributes:
        given_outputs: The values that the action writes when it succeeds; others are drawn.
        outcomes: The plan that the action follows.
        left: The results that remain of the current start.
    """

    spec = NodeSpec(state_fields=("outcomes", "left"))
    given_outputs: ClassVar[GivenOutputs] = {}

    def __init__(self) -> None:
        self.outcomes = Outcomes("S")
        self.left = ""

    def on_start(self) -> Status:
        """Take the next entry of the plan, and return the result of its first letter."""
        self.left = self.outcomes.next_entry()
        return self.on_running()

    def on_running(self) -> Status:
        """Return the result of the entry's next letter; the last letter is repeated."""
        # After the last letter, the rest of the entry is empty: keep the letter for the next tick.
        letter, self.left = self.left[0], self.left[1:] or self.left
        status = status_of(letter)
        if status is SUCCESS:
            _write_outputs(self, self.given_outputs, self.outcomes.source)
        return status


class MockCondition(Condition):
    """A condition that follows the `Outcomes` that are attached to the tree.

    Attributes:
        given_outputs: The values that the condition writes when it succeeds; others are drawn.
        outcomes: The plan that the condition follows.
    """

    spec = NodeSpec(state_fields=("outcomes",))
    given_outputs: ClassVar[GivenOutputs] = {}

    def __init__(self) -> None:
        self.outcomes = Outcomes("S")

    def tick(self) -> Status:
        """Take the next entry of the plan, and return the result of its last letter."""
        status = status_of(self.outcomes.next_entry()[-1].replace("K", "F"))
        if status is SUCCESS:
            _write_outputs(self, self.given_outputs, self.outcomes.source)
        return status


def with_mock_leaves(nodes: Registry, outputs: GivenOutputs | None = None) -> Registry:
    """Return a copy of a registry in which mock leaves replace all leaves except btcore's own.

    The copy also has the mock action `<Act>` and the mock condition `<Ask>`. Mock leaves succeed until an
    `Outcomes` is attached to the tree, which they then follow. The resources of replaced
    leaves are not required.

    A mock leaf that succeeds writes its output ports to the blackboard: the values in *outputs*, else random
    values of the port's type (bool, numbers, texts, enums, and lists, dataclasses and named tuples of
    these). An output of another type is only written if its value is given.

    Args:
        nodes: The registry.
        outputs: The values to write, by the name or the ID of the leaf, then by the name of the port. A name
            takes precedence.

    Raises:
        ValueError: *outputs* names a port that the leaf does not have.

    Examples:
        >>> import btcore
        >>> from btcore.testing import with_mock_leaves
        >>> @btcore.action
        ... def grasp():
        ...     raise OSError("no gripper")
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(grasp)
        >>> b = btcore.Builder(with_mock_leaves(nodes))
        >>> b.build(b.Grasp()).tick_once()
        <Status.SUCCESS: 2>
    """
    copy = nodes.copy()
    for ID, leaf in (("Act", MockAction), ("Ask", MockCondition)):
        if ID not in copy:
            copy.add(leaf, ID=ID)
    mocks: dict[NodeType, type[TreeNode]] = {NodeType.ACTION: MockAction, NodeType.CONDITION: MockCondition}
    if outputs:
        given = {"given_outputs": outputs}
        mocks = {kind: type(mock.__name__, (mock,), given) for kind, mock in mocks.items()}
        for ID, values in outputs.items():
            manifest = nodes.get(ID) or nodes.get(ID, 3)
            if manifest is not None:
                _check_ports(ID, values, manifest.ports)
    for format in (3, 4):
        for ID, manifest in copy.manifests_of(format).items():
            mock = mocks.get(manifest.type)
            if mock is not None and manifest.distribution != "btcore" and ID not in copy.substitutions:
                copy.substitute(ID, mock)
    return copy
