"""What a node class declares about its nodes for tools and static checks, in addition to its ports."""

from dataclasses import dataclass, field
from typing import Any, Final
from weakref import WeakKeyDictionary

from btcore.status import ANY_RESULT, RUNNING, NodeType, Status


@dataclass(frozen=True, kw_only=True, eq=False, match_args=False)
class ProofSpec:
    """The fields of `NodeSpec` that only proofs read.

    Attributes:
        hands_over: Whether another action may take over the resources in the tick in which the action is
            halted, before its halt, because the halt does not affect them.
        optional_inputs: The inputs of a leaf whose entries need not be written before the leaf reads them;
            without them it does not succeed.
        writes_early: Whether a leaf may write its outputs already while it is RUNNING.
        writes_on_halt: The outputs that a leaf writes when it is halted.
        results_without_child: The results, possibly RUNNING, that a decorator that needs resources may return
            without ticking its child.
        is_endless: Whether the node may run forever by design, so that its end is not expected. A port with
            the role REPETITIONS and the value −1 has the same effect.
    """

    hands_over: bool = False
    optional_inputs: tuple[str, ...] = ()
    writes_early: bool = False
    writes_on_halt: tuple[str, ...] = ()
    results_without_child: frozenset[Status] = frozenset({RUNNING})
    is_endless: bool = False


@dataclass(frozen=True, kw_only=True, eq=False, match_args=False)
class NodeSpec(ProofSpec):
    """What a node class declares about its nodes: `spec = NodeSpec(symbol="¬", never_pauses=True)`.

    A class declares the fields in which it differs from its base class. Reading `spec`, of a class or a node,
    returns all fields, with those that are inherited. Ticks do not read it, but attributes to which `prepare`
    has copied fields, which is faster. What only the methods of the class read, such as `Repeat.is_async`, is
    a class variable instead. The guide to proofs lists the fields of `ProofSpec`, which only proofs read.

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
        writes: The outputs that a leaf may write in any tick, whatever its result is, for proofs, and the
            keys of other entries that it writes. None = there are none, except that a leaf that gets the
            whole blackboard may write any key.
        must_complete: Whether a tick must not return RUNNING.
        may_complete_on_start: For a StatefulAction: whether `on_start` may complete the action at once. If
            so, `btcore validate` does not treat the action as asynchronous. None = proofs try both.
        never_pauses: Whether a tick only ticks children and, while a child is RUNNING, only this child. When
            such a node is RUNNING, a child is RUNNING or the node has requested the next tick at once.
        skips_alone: Whether a tick may return SKIPPED although no child was skipped.
        child_count: The minimum and maximum number of children with which a node can be ticked; None = any.
        child_count_at_load: The minimum and maximum number of children with which a tree is loaded. It
            differs from *child_count* because BehaviorTree.CPP loads some trees whose first tick raises.
        child_roles: The purpose of the children, for error messages about their number.
        continue_on: The result of a child after which the next child is ticked; SKIPPED has the same effect.
            None = the children are not ticked in order.
        branch_results: The results of the first child that select the second child, the third child, …
        formats: The XML formats in which the class is a built-in node; () = a base class. Not inherited.

    Examples:
        >>> import btcore
        >>> class Drive(btcore.StatefulAction):
        ...     spec = btcore.NodeSpec(uses=frozenset({"base"}), state_fields=("goal",))
        >>> Drive.spec.state_fields, Drive.spec.node_type
        (('goal',), <NodeType.ACTION: 1>)
    """

    node_type: NodeType = NodeType.UNDEFINED
    symbol: str = ""
    results: frozenset[Status] = ANY_RESULT
    state_fields: tuple[str, ...] | None = ()
    time_fields: tuple[str, ...] = ()
    uses: frozenset[str] | None = None
    writes: tuple[str, ...] | None = None
    must_complete: bool = False
    may_complete_on_start: bool | None = None
    never_pauses: bool = False
    skips_alone: bool = True
    child_count: tuple[int, int | None] = (0, 0)
    child_count_at_load: tuple[int, int | None] = (0, 0)
    child_roles: str = ""
    continue_on: Status | None = None
    branch_results: tuple[Status, ...] = ()
    formats: tuple[int, ...] = ()
    _declared: dict[str, Any] = field(init=False, repr=False)

    def __new__(cls, **declared: Any) -> "NodeSpec":
        """Return a spec that knows which fields were given to it."""
        spec = super().__new__(cls)
        object.__setattr__(spec, "_declared", declared)
        return spec

    def __get__(self, node: object, cls: type) -> "NodeSpec":
        """Return the complete spec of *cls*."""
        spec = _COMPLETE_SPECS.get(cls)
        if spec is None:
            _COMPLETE_SPECS[cls] = spec = _complete_spec(cls)
        return spec


_COMPLETE_SPECS: Final["WeakKeyDictionary[type, NodeSpec]"] = WeakKeyDictionary()


def declared_fields(cls: type) -> dict[str, Any]:
    """Return the fields that *cls* itself declares in its spec, with their values."""
    spec = vars(cls).get("spec")
    return spec._declared if isinstance(spec, NodeSpec) else {}


def _complete_spec(cls: type) -> NodeSpec:
    lineage = [declared_fields(parent) for parent in reversed(cls.__mro__)]
    values: dict[str, Any] = {}
    for declared in lineage:
        values |= declared
    values |= {"formats": ()} | declared_fields(cls)
    for name in ("state_fields", "time_fields"):
        if values.get(name) is not None:
            values[name] = tuple(sorted({item for declared in lineage for item in declared.get(name) or ()}))
    return NodeSpec(**values)
