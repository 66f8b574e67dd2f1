"""Replace the leaves of a registry by mock leaves, which follow outcomes, in tests.

nodes = with_mock_leaves(nodes)                  # replaces all leaves except btcore's own
tree = btcore.load("patrol.xml", nodes=nodes, clock=SimClock())
Outcomes("RRS|F").drive(tree, ticks=6)
"""

from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from random import Random
from typing import Any, Final, get_type_hints

from btcore.blackboard.ports import Output
from btcore.engine.signature import In
from btcore.registry.mock_leaves import GivenOutputs, MockAction, MockCondition, check_outputs
from btcore.registry.registry import Registry
from btcore.status import NodeType
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

# Limits of the values that are drawn for output ports.
_MAX_NUMBER: Final = 100
_LETTERS: Final = "abc 12"
_MAX_DEPTH: Final = 4
"""The maximum number of classes and lists inside each other; a class may contain itself."""


def _draw_value(value_type: ValueType, source: Random, depth: int = _MAX_DEPTH) -> object:
    """Return a random value of a type, or None if values of the type cannot be drawn.

    Values can be drawn for bool, numbers, texts, enums, and for lists, dataclasses and named tuples of these.
    """
    if value_type is BOOL:
        return source.random() < 0.5
    if isinstance(value_type, IntegerType):
        return source.randint(max(value_type.low, -_MAX_NUMBER), min(value_type.high, _MAX_NUMBER))
    if isinstance(value_type, RealType):
        return round(source.uniform(-_MAX_NUMBER, _MAX_NUMBER), 3)
    if value_type is STRING:
        return "".join(source.choices(_LETTERS, k=source.randint(0, 5)))
    if isinstance(value_type, EnumType):
        return source.choice(value_type.members) if value_type.members else None
    if depth and isinstance(value_type, VectorType):
        items = [_draw_value(value_type.item, source, depth - 1) for _ in range(source.randint(0, 3))]
        return None if None in items else items
    if depth and isinstance(value_type, UserType):
        return _draw_record(value_type.python_type, source, depth - 1)
    return None


def _draw_record(cls: type[Any], source: Random, depth: int) -> object:
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


def _draw_output(leaf: MockAction, output: Output) -> object:
    """Return the given value of an output port, else a random value of its type, or None."""
    for name in (leaf.name, leaf.config.id):
        values = leaf.given_outputs.get(name, {})
        if output.name in values:
            return values[output.name]
    return _draw_value(output.type, leaf.tree_outcomes.source)


class Act(MockAction):
    """A mock action with a port for its own outcomes; without a value it follows those of the tree."""

    outcomes: In[str] = ""

    def own_outcomes(self) -> str | None:
        """Return the value of the port."""
        return self.outcomes or super().own_outcomes()


class Ask(Act, MockCondition):
    """A mock condition with a port for its own outcomes; without a value it follows those of the tree."""


def with_mock_leaves(nodes: Registry, outputs: GivenOutputs | None = None) -> Registry:
    """Return a copy of a registry in which mock leaves replace all leaves except btcore's own.

    The copy also has the mock action `<Act>` and the mock condition `<Ask>`, whose port `outcomes` may hold
    outcomes of their own. Mock leaves follow the `Outcomes` among the resources of the tree, or attached to
    it; otherwise they succeed. The resources of replaced leaves are not required.

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
    members = {"draw_output": _draw_output, "given_outputs": outputs or {}}
    for id, leaf in (("Act", Act), ("Ask", Ask)):
        if id not in copy:
            copy.add(type(id, (leaf,), members), ID=id)
    mocks = {
        node_type: type(mock.__name__, (mock,), members)
        for node_type, mock in ((NodeType.ACTION, MockAction), (NodeType.CONDITION, MockCondition))
    }
    for id, values in (outputs or {}).items():
        manifest = nodes.get(id) or nodes.get(id, 3)
        if manifest is not None:
            check_outputs({id: values}, {id: manifest.ports})
    for format in (3, 4):
        for id, manifest in copy.manifests_of(format).items():
            mock = mocks.get(manifest.type)
            if mock is not None and manifest.library != "btcore" and id not in copy.substitutions:
                copy.substitute(id, mock)
    return copy
