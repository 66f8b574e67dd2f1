"""W206: values that the type of an entry is certain to refuse."""

from btcore.blackboard.blackboard import Entry
from btcore.blackboard.ports import PortRole
from btcore.diagnostic_codes import REFUSED_ENTRY_VALUE
from btcore.errors import BtcoreError, ConversionError, ScriptError
from btcore.script.expressions import Assignment, Name
from btcore.values import STRING
from btcore.xml.lint.advice import LintReporter, node_label
from btcore.xml.lint.dry_run import AccessKind, DryRun, EntryUse
from btcore.xml.lint.script_analysis import is_constant, parse_statements


def check_value_types(dry_run: DryRun, enums: dict[str, int], reporter: LintReporter) -> None:
    """Warn of the writes that raise whenever they happen, and of constants that their readers can't read."""
    for entry, uses in dry_run.uses.items():
        for use in uses:
            if use.access is AccessKind.WRITES and use.port is not None and use.value_type is not None:
                _port(dry_run, entry, use, reporter)
            elif use.access in (AccessKind.WRITES, AccessKind.ASSIGNS) and use.within:
                _script(dry_run, entry, use, enums, reporter)
        _constant(uses, entry, reporter)


def _warn(dry_run: DryRun, entry: Entry, use: EntryUse, what: str, reporter: LintReporter) -> None:
    message = f"{what}, but the entry '{use.key}' is {entry.declared.name}: every write raises"
    by = dry_run.declared_by(entry)
    hint = f"it was declared by {by}; the type of an entry never changes" if by else ""
    reporter.warn(
        REFUSED_ENTRY_VALUE, message, use.document, use.node, use.attribute, hint, within=use.within
    )


def _port(dry_run: DryRun, entry: Entry, use: EntryUse, reporter: LintReporter) -> None:
    kind = use.value_type
    assert kind is not None
    assert use.port is not None
    if use.port.role is PortRole.WRITTEN_ENTRY:
        _copied_text(dry_run, entry, use, reporter)
    elif entry.declared is STRING and kind.strong and not issubclass(kind.python_type, str):
        what = f"the port '{use.attribute}' of {node_label(use.node)} writes {kind.name}"
        _warn(dry_run, entry, use, what, reporter)


def _copied_text(dry_run: DryRun, entry: Entry, use: EntryUse, reporter: LintReporter) -> None:
    """The text that a SetBlackboard writes."""
    written = [bound for bound in use.node.bindings if bound.port.role is PortRole.WRITTEN_VALUE]
    if not written or written[0].key is not None or not entry.declared.strong:
        return
    text = written[0].text
    try:
        entry.declared.from_text(text, dry_run.format)
    except ConversionError:
        _warn(dry_run, entry, use, f"{node_label(use.node)} writes '{text}'", reporter)


def _script(
    dry_run: DryRun, entry: Entry, use: EntryUse, enums: dict[str, int], reporter: LintReporter
) -> None:
    """A constant that a script assigns."""
    if not entry.declared.strong or entry.value is not None:
        return
    text = str(use.node.element.get(use.attribute) or "")
    try:
        found = parse_statements(text, enums)
    except ScriptError:
        return
    for one in found:
        target = one.target if isinstance(one, Assignment) else None
        if not isinstance(one, Assignment) or not isinstance(target, Name) or target.column != use.within:
            continue
        if one.operator in (":=", "=") and is_constant(one.value, enums):
            try:
                one.evaluate(use.scope)
            except BtcoreError as error:
                message = (
                    f"the script in '{use.attribute}' of {node_label(use.node)} raises whenever it runs: "
                )
                message += error.message if isinstance(error, ScriptError) else str(error)
                by = dry_run.declared_by(entry)
                hint = f"'{use.key}' is {entry.declared.name}, declared by {by}" if by else ""
                reporter.warn(
                    REFUSED_ENTRY_VALUE, message, use.document, use.node, use.attribute, hint,
                    within=use.within, width=len(use.key),
                )  # fmt: skip
            finally:
                entry.value = None


def _constant(uses: list[EntryUse], entry: Entry, reporter: LintReporter) -> None:
    """A text that a SubTree element gives, and that a port of the inner tree can't read."""
    writing = [use for use in uses if use.access in (AccessKind.WRITES, AccessKind.ASSIGNS)]
    given = [use for use in writing if use.node.call is not None and not use.within]
    if len(given) != 1 or len(writing) != 1 or not isinstance(entry.value, str):
        return
    use = given[0]
    for reader in uses:
        kind = reader.value_type
        if reader.access is not AccessKind.READS or kind is None or not kind.strong or not kind.converts:
            continue
        try:
            kind.from_text(entry.value)
        except ConversionError as error:
            message = f"'{use.key}' of {node_label(use.node)} is given the text '{entry.value}': {error}"
            port = f"the port '{reader.attribute}' of {node_label(reader.node)}"
            hint = f"{port} reads it as {kind.name}; for an entry write {{{entry.value}}}"
            if not entry.value.isidentifier():
                hint = f"{port} reads it as {kind.name}"
            reporter.warn(REFUSED_ENTRY_VALUE, message, use.document, use.node, use.attribute, hint)
            return
