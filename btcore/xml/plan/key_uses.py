"""Find the blackboard keys that nodes name, in ports and in scripts, with how they use the entries."""

import enum
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Final, NamedTuple

from btcore.blackboard.blackboard import Blackboard
from btcore.blackboard.ports import SCRIPT_ROLES, Port, PortRole, remapped_key
from btcore.errors import ScriptError
from btcore.registry.manifest import Manifest
from btcore.script.expressions import (
    Assignment,
    Comparison,
    ConditionalExpression,
    Expression,
    Name,
    OperatorChain,
    UnaryOperation,
)
from btcore.script.program import Parser
from btcore.xml.plan.plan import Plans
from btcore.xml.plan.tree_plan import NodePlan, SubtreeCall


class AccessKind(enum.Enum):
    """How a script or a port uses an entry.

    - READS and WRITES: the value is read or written.
    - READS_AS_KEY: the value is read, and is the name of another entry, which is written.
    - ASSIGNS: the value is written, and the entry must exist already.
    - UPDATES: the value is read and written, for example by `+=`, and the entry must exist already.
    - MENTIONS: the entry is named, but its value is neither read nor written.
    """

    READS = enum.auto()
    WRITES = enum.auto()
    READS_AS_KEY = enum.auto()
    ASSIGNS = enum.auto()
    UPDATES = enum.auto()
    MENTIONS = enum.auto()


READING = (AccessKind.READS, AccessKind.READS_AS_KEY, AccessKind.UPDATES)
"""The kinds of access that read the entry."""
WRITING = (AccessKind.WRITES, AccessKind.ASSIGNS, AccessKind.UPDATES)
"""The kinds of access that write the entry."""
_ASSIGNMENTS = {":=": AccessKind.WRITES, "=": AccessKind.ASSIGNS}
NON_KEY_ATTRIBUTES: Final = ("name", "_description")
"""Attributes of a SubTree element that are no keys of the called tree."""


class NameUse(NamedTuple):
    """One use of a name in a script; *column* counts from 1.

    *statement* is the statement that assigns to the name; None if the name is not the target of a statement.
    """

    access: AccessKind
    name: str
    column: int
    statement: Assignment | None = None


def parse_statements(text: str, enums: Mapping[str, int]) -> Sequence[Expression]:
    """Parse a script into statements.

    Raises:
        ScriptError: *text* is not a valid script.
    """
    return _parse(text, tuple(enums.items()))


@lru_cache(maxsize=1_000)  # several checks parse each script, and an edit of a document changes few scripts
def _parse(text: str, enums: tuple[tuple[str, int], ...]) -> Sequence[Expression]:
    return Parser(text, dict(enums)).parse()


def find_name_uses(text: str, enums: Mapping[str, int]) -> list[NameUse]:
    """Return every use of an entry in a script, in the order of evaluation; none if the script is invalid.

    Args:
        enums: Values of the registered enum names, which are not entries.
    """
    try:
        statements = parse_statements(text, enums)
    except ScriptError:
        return []  # `report_invalid_scripts` has reported it
    uses: list[NameUse] = []
    for statement in statements:
        for part in iter_subexpressions(statement):
            if isinstance(part, Assignment) and isinstance(part.target, Name):
                target = part.target
                access = _ASSIGNMENTS.get(part.operator, AccessKind.UPDATES)
                is_statement = part is statement
                uses.append(NameUse(access, target.name, target.column, part if is_statement else None))
            elif isinstance(part, Name) and part.name not in enums:
                uses.append(NameUse(AccessKind.READS, part.name, part.column))
    return uses


def iter_subexpressions(expression: Expression) -> Iterator[Expression]:
    """Yield *expression* and all expressions in it, except for the names that it assigns to."""
    pending = [expression]
    while pending:
        part = pending.pop()
        yield part
        pending += reversed(_inner(part))


def _inner(part: Expression) -> list[Expression]:
    if isinstance(part, Assignment):
        return [part.value] if isinstance(part.target, Name) else [part.target, part.value]
    if isinstance(part, (OperatorChain, Comparison)):
        return [part.first, *part.operands]
    if isinstance(part, ConditionalExpression):
        return [part.condition, part.then, part.other]
    if isinstance(part, UnaryOperation):
        return [part.operand]
    return []


def port_uses(
    port: Port, text: str, is_explicit: bool, format: int
) -> tuple[str | None, tuple[AccessKind, ...]]:
    """Return the key that the text of a port names, or None, and how a node uses the entry.

    The entries that a script uses are those of `find_name_uses`, unless the script itself is in an entry.

    Args:
        text: The text of the port.
        is_explicit: Whether the document sets the port; otherwise the text is its default.
        format: The XML format, 3 or 4.
    """
    key = remapped_key(text, port.name, format)
    # A loop takes items out of its queue, but never fills it.
    writes = port.writes and port.role is not PortRole.QUEUE
    if key is None:
        if text and port.role in _ACCESS_BY_NAME:
            return text, (_ACCESS_BY_NAME[port.role],)
        # In format 3 an output port accepts the key without braces.
        is_bare_key = text and writes and format == 3 and is_explicit and port.role not in SCRIPT_ROLES
        return (text, (AccessKind.WRITES,)) if is_bare_key else (None, ())
    if port.role in SCRIPT_ROLES:
        return key, (AccessKind.READS,)
    if port.role is PortRole.WRITTEN_ENTRY:
        return key, (AccessKind.READS_AS_KEY,)
    reading = (AccessKind.READS,) if port.reads else ()
    # In format 3 the default of an output port is not connected.
    return key, (*reading, AccessKind.WRITES) if writes and (is_explicit or format == 4) else reading


_ACCESS_BY_NAME = {
    PortRole.WRITTEN_ENTRY: AccessKind.WRITES,
    PortRole.WATCHED_ENTRY: AccessKind.READS,
    PortRole.REMOVED_ENTRY: AccessKind.MENTIONS,
}


def uses_whole_blackboard(manifest: Manifest) -> bool:
    """Return whether the leaf gets the blackboard itself as a resource, so that it may use any entry."""
    return any(
        isinstance(parameter.resource_type, type) and issubclass(parameter.resource_type, Blackboard)
        for parameter in manifest.resource_parameters
    )


class TreeKeys:
    """The keys that each tree uses in its own blackboard; None for a tree that may use any key."""

    def __init__(self, plans: Plans) -> None:
        self._plans = plans
        self._format = plans.format
        self._enums = plans.registry.types.enums
        self._known: dict[str, set[str] | None] = {}

    def keys_of(self, tree: str) -> set[str] | None:
        """Return the keys of *tree* and of called trees that share its blackboard; None means any key."""
        if tree not in self._known:
            self._known[tree] = None  # ends the recursion of trees that call each other
            plan = self._plans.trees.get(tree)
            if plan is not None and not plan.has_unknown_nodes:
                self._known[tree] = self.keys_in(plan.node_plans())
        return self._known[tree]

    def keys_in(self, nodes: Iterable[NodePlan]) -> set[str] | None:
        """Return the keys that *nodes* of a tree use; None means any key."""
        keys: set[str] = set()
        for node in nodes:
            own = self._node_keys(node) if node.subtree_call is None else self._call_keys(node.subtree_call)
            if own is None:
                return None
            for text in node.conditions.values():
                own |= self._script_keys(text)
            keys |= own
        return keys

    def _node_keys(self, node: NodePlan) -> set[str] | None:
        if uses_whole_blackboard(node.manifest):
            return None
        keys: set[str] = set()
        for binding in node.bindings:
            key, _ = port_uses(binding.port, binding.text, binding.is_explicit, self._format)
            is_script = binding.port.role in SCRIPT_ROLES
            if key is None:
                keys |= self._script_keys(binding.text) if is_script else set()
            elif is_script:
                return None  # a script from an entry may use any key
            else:
                keys.add(key)
        return keys

    def _script_keys(self, text: str) -> set[str]:
        return {use.name for use in find_name_uses(text, self._enums)}

    def _call_keys(self, call: SubtreeCall) -> set[str] | None:
        keys = {outer for key, outer in call.remaps.items() if key not in NON_KEY_ATTRIBUTES}
        keys |= call.outer_constants
        if call.shares_blackboard or call.autoremap:
            inner = self.keys_of(call.tree_id) if self._plans.is_finite else None
            if inner is None:
                return None
            keys |= {outer for key in inner if (outer := call.outer_key(key)) is not None}
        return keys
