"""Check the values that are written and read against the types of entries.

The codes are E202 (constant that a port rejects), W206 (value that doesn't convert), W213 (text for an entry
without a type) and W214 (object of a base class).
"""

from collections.abc import Mapping

from btcore.blackboard.blackboard import Blackboard, Entry
from btcore.blackboard.ports import Binding, Port, PortRole
from btcore.diagnostic_codes import (
    BASE_CLASS_READ,
    INCONVERTIBLE_TEXT,
    REFUSED_ENTRY_VALUE,
    TEXT_FOR_UNTYPED_ENTRY,
)
from btcore.diagnostics import HintAndFixes
from btcore.engine.control import ControlNode
from btcore.errors import BtcoreError, ConversionError, ScriptError
from btcore.lint.dry_run import DryRun, EntryUse
from btcore.lint.ports import conversion_error, entry_hint, is_listed, valid_literals
from btcore.lint.scripts import is_constant
from btcore.lint.unwritten_keys import is_declaration
from btcore.names import POSTCONDITION_ATTRIBUTES
from btcore.registry.manifest import Manifest
from btcore.registry.nodes_without_code import is_mock
from btcore.script.expressions import Assignment, Literal
from btcore.status import SUCCESS
from btcore.values import INT64, STRING
from btcore.xml.plan.key_uses import WRITING, AccessKind
from btcore.xml.plan.tree_plan import NodePlan, TreePlan

ChildPlace = tuple[NodePlan, int]
"""The parent of a node, and the node's index among the children."""


def check_value_types(dry_run: DryRun) -> None:
    """Warn about writes that always raise, and report constants that the reading ports reject.

    Also warn about texts that a SetBlackboard writes to entries without a type, which BehaviorTree.CPP
    handles differently, and about ports that read objects of a base class of their type.
    """
    if dry_run.format == 4 and not dry_run.has_untracked_access:
        untyped = _untyped_entries(dry_run)
        _check_untyped_entries(dry_run, untyped)
        _check_copied_integers(dry_run, untyped)
    for entry, uses in dry_run.uses.items():
        for use in uses:
            if use.access is AccessKind.WRITES and use.port is not None:
                _check_port(dry_run, entry, use, use.port)
            elif use.access is AccessKind.READS and use.port is not None:
                _check_base_class(dry_run, entry, use, use.port)
            elif use.statement is not None:
                _check_script(dry_run, entry, use, use.statement)
        _check_constant(dry_run, uses, entry)


def _warn_refused_write(dry_run: DryRun, entry: Entry, use: EntryUse, write: str) -> None:
    message = f"{write}, but the entry '{use.key}' has the type {entry.declared.name}: every write raises"
    declaration = dry_run.declared_by(entry)
    hint = f"declared by {declaration}; the type of an entry never changes" if declaration else ""
    dry_run.report(use, REFUSED_ENTRY_VALUE, message, hint)


def _check_port(dry_run: DryRun, entry: Entry, use: EntryUse, port: Port) -> None:
    if port.role is PortRole.WRITTEN_ENTRY:
        _check_written_literal(dry_run, entry, use)
    elif entry.declared is STRING and port.type.strong and not issubclass(port.type.python_type, str):
        _warn_refused_write(dry_run, entry, use, f"{use.title} writes {port.type.name}")


def _check_base_class(dry_run: DryRun, entry: Entry, use: EntryUse, port: Port) -> None:
    """Warn if *port* reads an entry whose type is a base class of the type of the port."""
    entry_type = entry.declared
    if not entry_type.is_related(port.type) or issubclass(entry_type.python_type, port.type.python_type):
        return
    message = (
        f"{use.title} reads {port.type.name}, but the entry '{use.key}' has the type {entry_type.name}: "
        f"reading any other {entry_type.name} raises"
    )
    origin = dry_run.declared_by(entry)
    dry_run.report(use, BASE_CLASS_READ, message, f"declared by {origin}" if origin else "")


def _written_value(use: EntryUse) -> Binding | None:
    """Return the port of a SetBlackboard that holds what it writes."""
    bindings = use.node.bindings
    return next((binding for binding in bindings if binding.port.role is PortRole.WRITTEN_VALUE), None)


def _written_literal(use: EntryUse) -> str | None:
    """Return the literal that a SetBlackboard writes, or None if it copies an entry."""
    written = _written_value(use)
    return written.text if written is not None and written.key is None else None


def _check_written_literal(dry_run: DryRun, entry: Entry, use: EntryUse) -> None:
    """Warn if the literal that a SetBlackboard writes doesn't convert to the type of the entry."""
    text = _written_literal(use)
    if text is None or not entry.declared.strong:
        return
    try:
        entry.declared.from_text(text, dry_run.format)
        is_refused = dry_run.format == 4 and not entry.declared.converts
    except ConversionError:
        is_refused = True
    if is_refused:
        _warn_refused_write(dry_run, entry, use, f"{use.node.label} writes '{text}'")


def _assigns_integer(use: EntryUse) -> bool:
    statement = use.statement
    return (
        statement is not None
        and statement.operator in (":=", "=")
        and isinstance(statement.value, Literal)
        and isinstance(statement.value.value, int)
    )


def _untyped_entries(dry_run: DryRun) -> list[Entry]:
    """Return the entries that certainly have no type before the first tick."""
    homes = dry_run.homes
    return [
        entry
        for entry in dry_run.uses
        if not entry.declared.strong and entry in homes and not dry_run.may_be_given(*homes[entry])
    ]


def _check_copied_integers(dry_run: DryRun, untyped: list[Entry]) -> None:
    """Warn about the SetBlackboard nodes that copy an integer of 64 bits to an entry of another type.

    Integers have 64 bits in the entries that only scripts write.
    """
    sources = set(untyped)
    copies = [
        (entry, use)
        for entry, uses in dry_run.uses.items()
        if entry.declared.strong and not entry.declared.same(INT64)
        for use in uses
        if use.port is not None and use.port.role is PortRole.WRITTEN_ENTRY
    ]
    for entry, use in copies:
        value = _written_value(use)
        source = use.scope.find(value.key) if value is not None and value.key is not None else None
        if source not in sources:
            continue
        writers = [other for other in dry_run.uses[source] if other.access in WRITING]
        if writers and all(map(_assigns_integer, writers)):
            write = f"{use.node.label} copies an integer of 64 bits, which a script has written"
            _warn_refused_write(dry_run, entry, use, write)


def _check_untyped_entries(dry_run: DryRun, untyped: list[Entry]) -> None:
    places: dict[TreePlan, dict[NodePlan, ChildPlace]] = {}
    for entry in untyped:
        uses = dry_run.uses[entry]
        texts = [use for use in uses if _writes_literal(use)]
        if not texts or any(_may_set_type(use) for use in uses):
            continue
        creators = [use for use in uses if _creates_untyped(use)]
        # Ports and constants create their entries when the tree is loaded, scripts when they run.
        creator = next((use for use in creators if not use.is_in_script), creators[0] if creators else None)
        if creator is None:
            continue
        plan = dry_run.plan_of(creator.scope)
        if creator.is_in_script and plan not in places:
            children = ((node, *at) for node in plan.node_plans() for at in enumerate(node.children))
            places[plan] = {child: (node, index) for node, index, child in children}
        for use in texts:
            if not creator.is_in_script or (
                use.scope is creator.scope and _runs_before(creator, use, places[plan])
            ):
                _warn_untyped(use, creator, dry_run)


def _writes_literal(use: EntryUse) -> bool:
    is_entry = use.port is not None and use.port.role is PortRole.WRITTEN_ENTRY
    return is_entry and use.access is AccessKind.WRITES and _written_literal(use) is not None


def _may_set_type(use: EntryUse) -> bool:
    """Return whether *use* may give the entry a type when the tree runs: a leaf writes it, or has no code."""
    if use.port is None or use.port.role is PortRole.WRITTEN_ENTRY:
        return False
    is_unknown = is_mock(use.node.manifest.cls)
    return use.access is AccessKind.WRITES or (is_unknown and not use.port.type.strong)


def _creates_untyped(use: EntryUse) -> bool:
    """Return whether *use* creates the entry without a type: a script, a constant, or a port in braces."""
    if use.port is not None:
        return is_declaration(use)
    return use.access is AccessKind.WRITES and (use.is_in_script or use.node.subtree_call is not None)


def _runs_before(script: EntryUse, use: EntryUse, places: Mapping[NodePlan, ChildPlace]) -> bool:
    """Return whether *script* runs before the node of *use*, in a sequence or as a pre-condition above it."""
    if script.node is use.node:
        return script.attribute not in POSTCONDITION_ATTRIBUTES
    # For each ancestor of the node: the index of the child below which the node is.
    indices: dict[NodePlan, int] = {}
    place = places.get(use.node)
    while place is not None:
        indices[place[0]] = place[1]
        place = places.get(place[0])
    if script.node in indices:
        return script.attribute not in POSTCONDITION_ATTRIBUTES
    common, index = places[script.node]
    while common not in indices:
        common, index = places[common]
    cls = common.manifest.cls
    is_sequence = issubclass(cls, ControlNode) and cls.spec.continue_on is SUCCESS
    return is_sequence and index < indices[common]


def _warn_untyped(use: EntryUse, creator: EntryUse, dry_run: DryRun) -> None:
    text = _written_literal(use) or ""
    text = "…" if "'" in text else text
    line = creator.document.line(creator.node.element)
    message = (
        f"{use.node.label} writes a text to the entry '{use.key}', which has no type: "
        "BehaviorTree.CPP 4.10 empties the entry instead, and raises at the next text"
    )
    hint = (
        f"'{creator.attribute}' of {creator.node.label} in line {line} "
        f"creates the entry; a Script works in both: {use.key} := '{text}'"
    )
    dry_run.report(use, TEXT_FOR_UNTYPED_ENTRY, message, hint)


def _check_script(dry_run: DryRun, entry: Entry, use: EntryUse, statement: Assignment) -> None:
    """Warn if *statement*, of a script, assigns a constant that the entry's type refuses."""
    if not entry.declared.strong or entry.value is not None:
        return
    if statement.operator not in (":=", "=") or not is_constant(statement.value, dry_run.enums):
        return
    board = Blackboard()  # with an entry of the same type, because the evaluation writes the value
    board.declare(use.key, entry.declared)
    try:
        statement.evaluate(board)
    except BtcoreError as error:
        reason = error.message if isinstance(error, ScriptError) else str(error)
        declaration = dry_run.declared_by(entry)
        place = f"'{use.key}' has the type {entry.declared.name}, declared by {declaration}"
        hint = place if declaration else ""
        message = f"{use.title} always raises: {reason}"
        dry_run.report(use, REFUSED_ENTRY_VALUE, message, hint)


def _check_constant(dry_run: DryRun, uses: list[EntryUse], entry: Entry) -> None:
    """Report a constant of a SubTree element that a port of the inner tree rejects.

    This is an error (E202), as for a literal of the port, unless a leaf with the whole blackboard may replace
    the value, or the code of the leaf reads the port in its own way.
    """
    writers = [use for use in uses if use.access in WRITING]
    constants = [use for use in writers if use.node.subtree_call is not None and not use.is_in_script]
    if len(constants) != 1 or len(writers) != 1 or not isinstance(entry.value, str):
        return
    use, text = constants[0], entry.value
    for reader in uses:
        manifest = reader.node.manifest
        if reader.access is not AccessKind.READS or reader.port is None:
            continue
        reason = _rejection(reader, reader.port, manifest, text, dry_run.format)
        if not reason:
            continue
        is_certain = not (dry_run.has_untracked_access or is_listed(manifest, reader.port))
        code = INCONVERTIBLE_TEXT if is_certain else REFUSED_ENTRY_VALUE
        message = f"'{use.key}' of {use.node.label} is the text '{text}': {reason}"
        hint = f"the port '{reader.attribute}' of {reader.node.label} reads it as {reader.port.type.name}"
        passed, fixes = entry_hint("pass the entry", text) if text.isidentifier() else HintAndFixes()
        if passed:
            hint += f"; {passed}"
        dry_run.report(use, code, message, hint, fixes)
        return


def _rejection(reader: EntryUse, port: Port, manifest: Manifest, text: str, format: int) -> str:
    """Return why the node of *reader* rejects *text* as the value of *port*, or ""."""
    error = conversion_error(port, text, format)
    if error is not None:
        return str(error)
    problems = manifest.cls.check_literals({**valid_literals(reader.node), port.name: text})
    own = (problem for problem in problems if problem.port == port.name and not problem.is_unchecked)
    return next((problem.message for problem in own), "")
