"""Find keys that are read but never written (W201), or assigned to but never created (W209)."""

from collections.abc import Collection, Sequence

from btcore.blackboard.blackboard import Blackboard
from btcore.blackboard.ports import SCRIPT_ROLES
from btcore.diagnostic_codes import ASSIGNMENT_TO_MISSING_ENTRY, UNWRITTEN_KEY
from btcore.diagnostics import HintAndFixes
from btcore.fixes import Connect, CreateEntry, SetValue
from btcore.lint.dry_run import DryRun, EntryUse, has_writer
from btcore.suggestions import nearest_name
from btcore.xml.plan.key_uses import READING, AccessKind


def check_keys(dry_run: DryRun) -> None:
    """Warn about keys that are never written."""
    for entry, uses in dry_run.uses.items():
        if entry not in dry_run.homes or entry.value is not None:
            continue
        board, key = dry_run.homes[entry]
        of_root = board is dry_run.blackboard
        # Braces in a key come from a <SubTree> of format 3, for which W205 is reported.
        if dry_run.may_be_given(board, key) or (dry_run.format == 3 and key.startswith("{")):
            continue
        if _warn_empty_script_entry(uses, dry_run, of_root) or dry_run.has_untracked_writes:
            continue
        if has_writer(uses):
            _warn_never_created(uses, dry_run, key if of_root else "")
        # A name in capitals may be an enum member that only the C++ code registers.
        elif not (dry_run.has_mocks and all(use.is_in_script and use.key.isupper() for use in uses)):
            _warn_never_written(dry_run, uses, board, key)


def _warn_empty_script_entry(uses: Sequence[EntryUse], dry_run: DryRun, of_root: bool) -> bool:
    """Warn about a script that is read from an empty entry. Returns whether there is such a script.

    The script is compiled when the tree is built, so the entry must have a value by then.
    """
    for use in uses:
        if use.port is None or use.port.role not in SCRIPT_ROLES:
            continue
        label = use.node.label
        message = f"{label} reads its script from {{{use.key}}}, which is empty when the tree is built"
        hint = "load the tree with a blackboard that holds the script: load(…, blackboard=…)"
        if not of_root:
            hint = f'pass the script in the SubTree element: {use.key}="…"'
        dry_run.report(use, UNWRITTEN_KEY, message, hint)
        return True
    return False


def _warn_never_created(uses: Sequence[EntryUse], dry_run: DryRun, root_key: str) -> None:
    """Warn about the first `x = …` if neither a `:=` nor a port creates the entry.

    *root_key* is the key of the entry on the main tree's blackboard, or "" if it is not there.
    """
    assignments = [use for use in uses if use.access in (AccessKind.ASSIGNS, AccessKind.UPDATES)]
    if not assignments or any(use.access is AccessKind.WRITES or is_declaration(use) for use in uses):
        return
    use = assignments[0]
    message = f"{use.title} assigns to the entry '{use.key}', which is never created"
    hint = f"to create it, write {use.key} := …"
    if root_key:
        hint += f"; or fill the blackboard before the first tick: {fill_example(root_key)}"
    fixes = [CreateEntry()] if use.access is AccessKind.ASSIGNS else []
    dry_run.report(use, ASSIGNMENT_TO_MISSING_ENTRY, message, hint, fixes, root_key)


def is_declaration(use: EntryUse) -> bool:
    """Return whether *use* is a port whose text in the document, `{key}`, creates the entry."""
    return use.port is not None and use.node.element.get(use.attribute) is not None and is_pointer(use)


def fill_example(key: str) -> str:
    """Return the Python statement and the option that set the entry *key*."""
    return f'tree.blackboard["{key}"] = …, or btcore run --set {key}=VALUE'


def _warn_never_written(dry_run: DryRun, uses: Sequence[EntryUse], board: Blackboard, key: str) -> None:
    readers = [use for use in uses if use.access in READING]
    if not readers:
        return
    # The same place in a tree that is called several times counts once.
    places = {(use.document.file, use.node.element, use.attribute) for use in readers}
    use = readers[0]
    others = len(places) - 1
    more = f" ({others} more {'place reads' if others == 1 else 'places read'} it)" if others else ""
    key_text = f"{{{use.key}}}" if use.port is not None and is_pointer(use) else f"'{use.key}'"
    message = f"{use.title} reads {key_text}, which is never written{more}"
    correction = _correction(dry_run, use, board, key)
    if correction is not None:
        dry_run.report(use, UNWRITTEN_KEY, message, *correction)
        return
    hint = f"write it first, or fill the blackboard before the first tick: {fill_example(key)}"
    if use.is_in_script and use.key.isupper():
        hint = f"if it is the name of an enum member, register the enum with nodes.add_enum(…); else {hint}"
    dry_run.report(use, UNWRITTEN_KEY, message, hint, outer_key=key)


def is_pointer(use: EntryUse) -> bool:
    """Return whether the key is in braces or comes from the port's default."""
    text = use.node.element.get(use.attribute)
    return text is None or text != use.key


def _correction(dry_run: DryRun, use: EntryUse, board: Blackboard, key: str) -> HintAndFixes | None:
    """Return how to correct the document, or None if only a caller or the program can write the entry."""
    if use.access is AccessKind.READS_AS_KEY:
        return HintAndFixes(
            f"{{{use.key}}} must hold the name of the entry to write; "
            f'to write the entry {use.key} itself, use {use.attribute}="{use.key}"',
            [SetValue(use.key)],
        )
    known = dry_run.written_in(board)
    if key.strip() in known:
        correct = f"{{{key.strip()}}}"
        hint = f"spaces inside the braces are part of the key: write {correct}"
        return HintAndFixes(hint, [SetValue(correct)])
    near = _guess(dry_run, key, known)
    if near is not None:
        return HintAndFixes.similar_name(near)
    entrance = dry_run.entrances.get(board)
    if entrance is None:
        return None
    call, draft = entrance
    document = draft.document
    called = f"{call.element.tag} of '{call.tree_id}' in line {document.line(call.element)}"
    outer = dry_run.written_in(draft.subtree.blackboard)
    passed = key if key in outer else _guess(dry_run, key, outer) or "…"
    # The <SubTree> of format 3 takes keys without braces.
    value = passed if dry_run.format == 3 and call.element.tag == "SubTree" else f"{{{passed}}}"
    hint = f'a subtree has a blackboard of its own: in the {called} write {key}="{value}"'
    if document is not use.document:
        return HintAndFixes(hint)
    index = document.source_map.index(call.element)
    return HintAndFixes(hint, [Connect(index, call.tree_id, key, value.replace("…", key))])


def _guess(dry_run: DryRun, key: str, names: Collection[str]) -> str | None:
    """Return the name in *names* that is most similar to *key*; None if none is, or not searched."""
    return nearest_name(key, names) if dry_run.collector.take_comparisons(names) else None
