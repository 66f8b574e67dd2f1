"""W201, W209: keys that are read, or assigned to, and that nothing ever writes."""

from collections.abc import Collection, Sequence

from btcore.blackboard.blackboard import Blackboard, Entry
from btcore.blackboard.ports import SCRIPT_ROLES
from btcore.diagnostic_codes import ASSIGNMENT_TO_MISSING_ENTRY, UNWRITTEN_KEY
from btcore.suggestions import nearest_name
from btcore.xml.lint.advice import LintReporter, line_of, node_label
from btcore.xml.lint.dry_run import AccessKind, DryRun, EntryUse, has_writer

_READING = (AccessKind.READS, AccessKind.READS_AS_KEY)
MAX_COMPARISONS = 20_000
"""How often a key is compared with another one that it may have meant: each takes some 30 µs."""


class KeyIndex:
    """The entries of one rehearsed tree, each with its home: the scope that holds it, and its key there."""

    def __init__(self, dry_run: DryRun, given: Collection[str]) -> None:
        self.dry_run = dry_run
        self._given = given
        self._comparisons = MAX_COMPARISONS
        self._written: dict[Blackboard, list[str]] = {}
        self.homes: dict[Entry, tuple[Blackboard, str]] = {}
        for subtree in dry_run.subtrees:
            for key, entry in subtree.blackboard.local_entries().items():
                self.homes.setdefault(entry, (subtree.blackboard, key))

    def guess(self, key: str, names: list[str]) -> str | None:
        """The one of *names* that *key* most probably means, or None; it is not looked for for ever."""
        if self._comparisons < len(names):
            return None
        self._comparisons -= len(names)
        return nearest_name(key, names)

    def written_in(self, board: Blackboard) -> list[str]:
        """The keys that *board* holds, and that something writes."""
        known = self._written.get(board)
        if known is None:
            uses = self.dry_run.uses
            known = [key for key, entry in board.local_entries().items() if has_writer(uses.get(entry, ()))]
            known += sorted(self._given) if board is self.dry_run.root else []
            self._written[board] = known
        return known


def check_keys(dry_run: DryRun, is_main: bool, given: Collection[str], reporter: LintReporter) -> None:
    """Warn of the keys that nothing writes; those of *given* are on the blackboard before the first tick.

    Of a tree that isn't the main one, nobody knows what its own blackboard comes with.
    """
    keys = KeyIndex(dry_run, given)
    for entry, uses in dry_run.uses.items():
        home = keys.homes.get(entry)
        if home is None or entry.value is not None:
            continue
        board, key = home
        of_root = board is dry_run.root
        if (of_root and (not is_main or key in given)) or (dry_run.format == 3 and key.startswith("{")):
            continue
        if _wanted_at_load(uses, reporter, of_root) or dry_run.has_untracked_access:
            continue
        if has_writer(uses):
            _never_made(uses, reporter, key if of_root else "")
        elif not (dry_run.has_stubs and _may_be_an_enum(uses)):
            _never_written(keys, uses, board, key, reporter)


def _wanted_at_load(uses: Sequence[EntryUse], reporter: LintReporter, of_root: bool) -> bool:
    """Warn of a script that is to be taken from an entry without a value; whether there was one.

    It is compiled when the tree is made, and so must be there by then.
    """
    for use in uses:
        if use.port is None or use.port.role not in SCRIPT_ROLES:
            continue
        label = node_label(use.node)
        message = f"{label} takes its script from {{{use.key}}}, which is empty when the tree is made"
        hint = "load the tree on a blackboard that holds it: load(…, blackboard=…)"
        if not of_root:
            hint = f'give the script to the SubTree: {use.key}="…"'
        reporter.warn(UNWRITTEN_KEY, message, use.document, use.node, use.attribute, hint)
        return True
    return False


def _never_made(uses: Sequence[EntryUse], reporter: LintReporter, root_key: str) -> None:
    """Warn of the first ``x = …`` if neither a ``:=`` nor a port makes the entry.

    *root_key* is its key on the main tree's blackboard, if it is there.
    """
    assigning = [use for use in uses if use.access is AccessKind.ASSIGNS]
    if not assigning or any(_makes(use) for use in uses):
        return
    use = assigning[0]
    script = f"the script in '{use.attribute}' of {node_label(use.node)}"
    hint = f"to make it, write {use.key} := …"
    if root_key:
        hint += f"; or fill the blackboard before the first tick: {fill_example(root_key)}"
    reporter.warn(
        ASSIGNMENT_TO_MISSING_ENTRY,
        f"{script} assigns to '{use.key}', an entry that nothing makes",
        use.document,
        use.node,
        use.attribute,
        hint,
        within=use.within,
        width=len(use.key),
    )


def _makes(use: EntryUse) -> bool:
    """Whether the entry exists because of *use*: what writes makes it, and a port that points to it."""
    if use.access is AccessKind.WRITES:
        return True
    return use.port is not None and use.node.element.get(use.attribute) is not None and is_pointer(use)


def fill_example(key: str) -> str:
    """How a program fills the entry *key*."""
    return f'tree.blackboard["{key}"] = …'


def _may_be_an_enum(uses: Sequence[EntryUse]) -> bool:
    return all(use.within and use.key.isupper() for use in uses)


def _never_written(
    keys: KeyIndex, uses: Sequence[EntryUse], board: Blackboard, key: str, reporter: LintReporter
) -> None:
    reading = [use for use in uses if use.access in _READING]
    if not reading:
        return
    use = reading[0]
    places = {(one.document.file, one.node.element, one.attribute) for one in reading}
    others = len(places) - 1
    more = f" ({others} more {'place reads' if others == 1 else 'places read'} it)" if others else ""
    if use.port is None:
        what = f"the script in '{use.attribute}' of {node_label(use.node)} reads '{use.key}'"
    elif is_pointer(use):
        what = f"the port '{use.attribute}' of {node_label(use.node)} reads {{{use.key}}}"
    else:
        what = f"the port '{use.attribute}' of {node_label(use.node)} looks at '{use.key}'"
    reporter.warn(
        UNWRITTEN_KEY,
        f"{what}, which nothing writes{more}",
        use.document,
        use.node,
        use.attribute,
        _cure(keys, use, board, key),
        within=use.within,
        width=len(use.key) if use.within else 0,
    )


def is_pointer(use: EntryUse) -> bool:
    """Whether the key stands in braces (or is the default of the port)."""
    text = use.node.element.get(use.attribute)
    return text is None or str(text) != use.key


def _cure(keys: KeyIndex, use: EntryUse, board: Blackboard, key: str) -> str:
    if use.access is AccessKind.READS_AS_KEY:
        return (
            f'it would name the entry to write; to write {use.key} itself, write {use.attribute}="{use.key}"'
        )
    known = keys.written_in(board)
    if key.strip() in known:
        return f"spaces between the braces are a part of the key: write {{{key.strip()}}}"
    near = keys.guess(key, known)
    if near is not None:
        return f"did you mean '{near}'?"
    entrance = keys.dry_run.entrances.get(board)
    if entrance is None:
        enum = (
            ""
            if not (use.within and use.key.isupper())
            else "if it is an enum's, register that: nodes.add_enum(…); else "
        )
        return f"{enum}write it before, or fill the blackboard before the first tick: {fill_example(key)}"
    called = f"{entrance.node.id} of '{entrance.key}' in {line_of(entrance.document, entrance.node)}"
    outer = keys.written_in(entrance.scope)
    handed = key if key in outer else keys.guess(key, outer) or "…"
    bare = keys.dry_run.format == 3 and entrance.node.id == "SubTree"
    value = handed if bare else f"{{{handed}}}"
    return f'a subtree has keys of its own: in the {called} write {key}="{value}"'
