"""Find the writers and readers of each blackboard entry, across subtrees, remappings and scripts."""

from dataclasses import dataclass, field

from btcore.lint.dry_run import DryRun, EntryUse
from btcore.xml.plan.key_uses import READING, WRITING
from btcore.xml.plan.plan import Plans


@dataclass(frozen=True, slots=True)
class DataflowAccess:
    """One place where an entry is used.

    Attributes:
        node: Path of the subtree and name of the node.
        attribute: Name of the port or of the script attribute.
        key: Name of the entry in the blackboard of that subtree.
        where: `file:line` of the node.
    """

    node: str
    attribute: str
    key: str
    where: str


@dataclass(slots=True)
class DataflowRow:
    """One blackboard entry with its writers and readers.

    Attributes:
        scope: Path of the subtree whose blackboard holds the entry; "" for the main tree.
        key: Name of the entry in that blackboard.
        type: Name of the declared type, or "".
        writers: Places that write the entry, in the order of the tree.
        readers: Places that read the entry, in the order of the tree. A place can be in both lists.
    """

    scope: str
    key: str
    type: str
    writers: list[DataflowAccess] = field(default_factory=list)
    readers: list[DataflowAccess] = field(default_factory=list)


def trace_dataflow(plans: Plans) -> list[DataflowRow]:
    """Return the entries of the main tree, sorted by scope and key.

    Entries that only a remapping names, and that no node uses, are left out.

    Args:
        plans: The plans of a document without errors.
    """
    assert plans.main_tree is not None, "a document without a main tree has errors"
    dry_run = DryRun(plans, plans.main_tree)
    paths = {draft.subtree.blackboard: draft.subtree.path for draft in reversed(dry_run.drafts)}
    rows: list[DataflowRow] = []
    for entry, uses in dry_run.uses.items():
        board, key = dry_run.homes[entry]
        row = DataflowRow(paths[board], key, entry.declared.name if entry.declared.strong else "")
        for use in uses:
            access = _access(use, paths[use.scope])
            if use.access in WRITING and access not in row.writers:
                row.writers.append(access)
            if use.access in READING and access not in row.readers:
                row.readers.append(access)
        if row.writers or row.readers:
            rows.append(row)
    return sorted(rows, key=lambda row: (row.scope, row.key))


def _access(use: EntryUse, path: str) -> DataflowAccess:
    call = use.node.subtree_call
    name = use.node.name or (call.tree_id if call is not None else use.node.id)
    full = f"{path}/{name}" if path else name
    if call is not None and use.attribute in call.constants:
        full = path  # a constant is written to the inner blackboard, whose path is that of the SubTree node
    where = f"{use.document.file or '<text>'}:{use.document.line(use.node.element)}"
    return DataflowAccess(full, use.attribute, use.key, where)
