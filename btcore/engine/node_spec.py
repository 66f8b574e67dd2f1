"""What a node class declares about its nodes for tools and static checks, in addition to its ports."""

from dataclasses import dataclass, field, fields, replace
from typing import Any, Final
from weakref import WeakKeyDictionary

from btcore.status import ANY_RESULT, NodeType, Status

_NOT_DECLARED: Final[Any] = object()
_ADDED: Final = ("state_fields", "time_fields")
"""The fields to which a class adds names, instead of replacing those of its base classes."""


def _inherited(default: Any) -> Any:
    """Return a field that a class inherits unless it declares it; `TreeNode` has the value *default*."""
    return field(default=_NOT_DECLARED, metadata={"default": default})


@dataclass(frozen=True, kw_only=True, eq=False, match_args=False)
class NodeSpec:
    """What a node class declares about its nodes: `spec = NodeSpec(symbol="¬", never_pauses=True)`.

    A class declares the fields in which it differs from its base class. Reading `spec`, of a class or a node,
    returns all fields, with those that are inherited. Ticks do not read it, but attributes to which `prepare`
    has copied fields, which is faster. What only the methods of the class read, such as `Repeat.is_async`, is
    a class variable instead. Only btcore reads a spec; the static method `metadata()` returns the texts that
    are also written to the TreeNodesModel, so that Groot and C++ see them.

    Attributes:
        node_type: The type of the nodes: action, condition, control or decorator.
        symbol: The symbol of the nodes in listings and pictures; "" = the symbol of the node type. Of a
            symbol of two characters, listings show the first, and pictures the second.
        results: The end results (SUCCESS, FAILURE, SKIPPED) that a tick may return, for static checks and
            tree coverage.
        state_fields: The attributes that a node remembers between ticks, in addition to those of the base
            classes. To save and restore a tree, these attributes are sufficient together with the statuses,
            the blackboard and the time. None = a RUNNING node cannot be saved. A user's class with attributes
            must declare this field, if only as (), before a tree with the class can be saved.
        time_fields: The state fields that hold the time (ns, tree's clock) until which a node waits; ≤ 0 = no
            time. Added to those of the base classes.
        uses: The names of the things that only one action may use at a time, such as a robot's base, for
            proofs. None = an action uses the resources that it gets as parameters; other nodes use nothing.
        must_complete: Whether a tick must not return RUNNING.
        may_complete_on_start: For a StatefulAction: whether `on_start` may complete the action at once. If
            so, `btcore validate` does not treat the action as asynchronous.
        never_pauses: Whether a tick only ticks children and, while a child is RUNNING, only this child. When
            such a node is RUNNING, a child is RUNNING or the node has requested the next tick at once.
        skips_alone: Whether a tick may return SKIPPED although no child was skipped.
        is_endless: Whether the node may run forever by design, so that proofs do not expect its end. A port
            with the role REPETITIONS and the value −1 has the same effect.
        child_count: The minimum and maximum number of children with which a node can be ticked; None = any.
        child_count_at_load: The minimum and maximum number of children with which a tree is loaded. It
            differs from *child_count* because BehaviorTree.CPP loads some trees whose first tick raises.
        child_roles: The purpose of the children, for error messages about their number.
        continue_on: The result of a child after which the next child is ticked; SKIPPED has the same effect.
            None = the children are not ticked in order.
        branch_results: The results of the first child that select the second child, the third child, …
        formats: The XML formats in which the class is a built-in node; () = a base class. Not inherited.
        id: The ID of the built-in node; "" = the name of the class. Not inherited.

    Examples:
        >>> import btcore
        >>> class Drive(btcore.StatefulAction):
        ...     spec = btcore.NodeSpec(uses=frozenset({"base"}), state_fields=("goal",))
        >>> Drive.spec.state_fields, Drive.spec.node_type
        (('goal',), <NodeType.ACTION: 1>)
    """

    node_type: NodeType = _inherited(NodeType.UNDEFINED)  # noqa: RUF009 (a field)
    symbol: str = _inherited("")
    results: frozenset[Status] = _inherited(ANY_RESULT)
    state_fields: tuple[str, ...] | None = _inherited(())
    time_fields: tuple[str, ...] = _inherited(())
    uses: frozenset[str] | None = _inherited(None)
    must_complete: bool = _inherited(False)
    may_complete_on_start: bool = _inherited(False)
    never_pauses: bool = _inherited(False)
    skips_alone: bool = _inherited(True)
    is_endless: bool = _inherited(False)
    child_count: tuple[int, int | None] = _inherited((0, 0))
    child_count_at_load: tuple[int, int | None] = _inherited((0, 0))
    child_roles: str = _inherited("")
    continue_on: Status | None = _inherited(None)  # noqa: RUF009
    branch_results: tuple[Status, ...] = _inherited(())
    formats: tuple[int, ...] = ()
    id: str = ""

    def __get__(self, node: object, cls: type) -> "NodeSpec":
        """Return the complete spec of *cls*."""
        spec = _COMPLETE_SPECS.get(cls)
        if spec is None:
            _COMPLETE_SPECS[cls] = spec = _complete_spec(cls)
        return spec


_COMPLETE_SPECS: Final["WeakKeyDictionary[type, NodeSpec]"] = WeakKeyDictionary()
_DEFAULTS: Final = {each.name: each.metadata["default"] for each in fields(NodeSpec) if each.metadata}
"""The inherited fields, with their values for `TreeNode`."""


def declared_fields(cls: type) -> dict[str, Any]:
    """Return the inherited fields that *cls* itself declares in its spec, with their values."""
    spec = _own_spec(cls)
    return {name: value for name in _DEFAULTS if (value := getattr(spec, name)) is not _NOT_DECLARED}


def _own_spec(cls: type) -> NodeSpec:
    spec = vars(cls).get("spec")
    return spec if isinstance(spec, NodeSpec) else NodeSpec()


def _complete_spec(cls: type) -> NodeSpec:
    values = dict(_DEFAULTS)
    added: dict[str, set[str]] = {name: set() for name in _ADDED}
    for parent in reversed(cls.__mro__):
        declared = declared_fields(parent)
        values.update(declared)
        for name, items in added.items():
            items.update(declared.get(name) or ())
    for name, items in added.items():
        if values[name] is not None:
            values[name] = tuple(sorted(items))
    return replace(_own_spec(cls), **values)
