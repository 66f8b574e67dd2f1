"""Find writes of values that certainly don't convert to the type of the entry (W206)."""

from btcore.blackboard.blackboard import Entry
from btcore.blackboard.ports import Port, PortRole
from btcore.diagnostic_codes import REFUSED_ENTRY_VALUE
from btcore.errors import BtcoreError, ConversionError, ScriptError
from btcore.script.expressions import Assignment, Name
from btcore.values import STRING
from btcore.xml.lint.dry_run import DryRun, EntryUse
from btcore.xml.lint.reporter import LintReporter, node_label
from btcore.xml.lint.scripts import WRITING, AccessKind, is_constant, parse_statements


def check_value_types(dry_run: DryRun, enums: dict[str, int], reporter: LintReporter) -> None:
    """Warn about writes that always raise, and about constants that the reading ports can't convert.

    Args:
        dry_run: A completed dry run of the tree.
        enums: Values of the registered enum names.
        reporter: Collects the warnings.
    """
    for entry, uses in dry_run.uses.items():
        for use in uses:
            if use.access is AccessKind.WRITES and use.port is not None:
                _check_port(dry_run, entry, use, use.port, reporter)
            elif use.access in WRITING and use.within:
                _check_script(dry_run, entry, use, enums, reporter)
        _check_constant(uses, entry, reporter)


def _warn(dry_run: DryRun, entry: Entry, use: EntryUse, write: str, reporter: LintReporter) -> None:
    message = f"{write}, but the entry '{use.key}' has the type {entry.declared.name}: every write raises"
    declaration = dry_run.declared_by(entry)
    hint = f"declared by {declaration}; the type of an entry never changes" if declaration else ""
    reporter.warn(
        REFUSED_ENTRY_VALUE, message, use.document, use.node, use.attribute, hint, within=use.within
    )


def _check_port(dry_run: DryRun, entry: Entry, use: EntryUse, port: Port, reporter: LintReporter) -> None:
    """Warn if *port* writes a type that the entry does not accept."""
    if port.role is PortRole.WRITTEN_ENTRY:
        _check_copied_text(dry_run, entry, use, reporter)
    elif entry.declared is STRING and port.type.strong and not issubclass(port.type.python_type, str):
        write = f"the port '{use.attribute}' of {node_label(use.node)} writes {port.type.name}"
        _warn(dry_run, entry, use, write, reporter)


def _check_copied_text(dry_run: DryRun, entry: Entry, use: EntryUse, reporter: LintReporter) -> None:
    """Warn if the literal that a SetBlackboard writes doesn't convert to the type of the entry."""
    written = [bound for bound in use.node.bindings if bound.port.role is PortRole.WRITTEN_VALUE]
    if not written or written[0].key is not None or not entry.declared.strong:
        return
    text = written[0].text
    try:
        entry.declared.from_text(text, dry_run.format)
    except ConversionError:
        _warn(dry_run, entry, use, f"{node_label(use.node)} writes '{text}'", reporter)


def _check_script(
    dry_run: DryRun, entry: Entry, use: EntryUse, enums: dict[str, int], reporter: LintReporter
) -> None:
    """Warn if a constant that a script assigns doesn't convert to the type of the entry."""
    if not entry.declared.strong or entry.value is not None:
        return
    text = str(use.node.element.get(use.attribute) or "")
    try:
        statements = parse_statements(text, enums)
    except ScriptError:
        return
    for statement in statements:
        if not isinstance(statement, Assignment) or not isinstance(statement.target, Name):
            continue
        if statement.target.column != use.within:
            continue
        if statement.operator in (":=", "=") and is_constant(statement.value, enums):
            # The dry run's blackboard converts the value; the entry is emptied again below.
            try:
                statement.evaluate(use.scope)
            except BtcoreError as error:
                message = f"the script in '{use.attribute}' of {node_label(use.node)} always raises: "
                message += error.message if isinstance(error, ScriptError) else str(error)
                declaration = dry_run.declared_by(entry)
                hint = (
                    f"'{use.key}' has the type {entry.declared.name}, declared by {declaration}"
                    if declaration
                    else ""
                )
                reporter.warn(
                    REFUSED_ENTRY_VALUE, message, use.document, use.node, use.attribute, hint,
                    within=use.within, width=len(use.key),
                )  # fmt: skip
            finally:
                entry.value = None


def _check_constant(uses: list[EntryUse], entry: Entry, reporter: LintReporter) -> None:
    """Warn if a port of an inner tree can't convert the constant that the SubTree element passes."""
    writers = [use for use in uses if use.access in WRITING]
    constants = [use for use in writers if use.node.call is not None and not use.within]
    if len(constants) != 1 or len(writers) != 1 or not isinstance(entry.value, str):
        return
    use = constants[0]
    for reader in uses:
        if reader.access is not AccessKind.READS or reader.port is None:
            continue
        kind = reader.port.type
        if not kind.strong or not kind.converts:
            continue
        try:
            kind.from_text(entry.value)
        except ConversionError as error:
            message = f"'{use.key}' of {node_label(use.node)} is the text '{entry.value}': {error}"
            hint = f"the port '{reader.attribute}' of {node_label(reader.node)} reads it as {kind.name}"
            if entry.value.isidentifier():
                hint += f"; to pass the entry, write {{{entry.value}}}"
            reporter.warn(REFUSED_ENTRY_VALUE, message, use.document, use.node, use.attribute, hint)
            return
