"""Who writes and who reads each blackboard entry of a tree, across subtrees, remappings and scripts."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from btcore.blackboard.blackboard import Blackboard, Entry
from btcore.registry.registry import Registry
from btcore.xml.lint.dry_run import AccessKind, DryRun, EntryUse
from btcore.xml.plan.document_checks import DocumentAnalysis


@dataclass(frozen=True, slots=True)
class DataflowAccess:
    """One place where an entry is used.

    *node* is the node's name below the path of its subtree, *attribute* the port or script, *key* the
    name that the entry has there; *where* is ``file:line``.
    """

    node: str
    attribute: str
    key: str
    where: str


@dataclass(slots=True)
class DataflowRow:
    """One entry: the path of the subtree that it belongs to ("" = the main tree), its key and its type.

    *writers* and *readers* come in the order of the tree; a place that does both is in both.
    """

    scope: str
    key: str
    type: str
    writers: list[DataflowAccess] = field(default_factory=list)
    readers: list[DataflowAccess] = field(default_factory=list)


_WRITING = (AccessKind.WRITES, AccessKind.ASSIGNS)
_READING = (AccessKind.READS, AccessKind.READS_AS_KEY)


def trace_dataflow(analysis: DocumentAnalysis, registry: Registry) -> list[DataflowRow]:
    """The entries of the main tree of the document in *analysis*, which has no errors, sorted by scope and key.

    An entry that only a remapping names, and no node uses, is left out.
    """
    assert analysis.main is not None, "a document without a main tree has errors"
    dry_run = DryRun(analysis.planner, analysis.main, registry)
    dry_run.run()
    paths = {subtree.blackboard: subtree.path for subtree in reversed(dry_run.subtrees)}
    homes = _homes(paths)
    rows: list[DataflowRow] = []
    for entry, uses in dry_run.uses.items():
        scope, key = homes[entry]
        row = DataflowRow(scope, key, entry.declared.name if entry.declared.strong else "")
        for use in uses:
            access = _access(use, paths[use.scope])
            if use.access in _WRITING and access not in row.writers:
                row.writers.append(access)
            if use.access in _READING and access not in row.readers:
                row.readers.append(access)
        if row.writers or row.readers:
            rows.append(row)
    return sorted(rows, key=lambda row: (row.scope, row.key))


def _homes(paths: dict[Blackboard, str]) -> dict[Entry, tuple[str, str]]:
    """The outermost scope that holds each entry, and the entry's name there."""
    found: dict[Entry, tuple[str, str]] = {}
    for board, path in reversed(paths.items()):
        for key, entry in board.local_entries().items():
            found.setdefault(entry, (path, key))
    return found


def _access(use: EntryUse, path: str) -> DataflowAccess:
    call = use.node.call
    name = use.node.name or (call.tree if call is not None else use.node.id)
    full = f"{path}/{name}" if path else name
    if call is not None and use.attribute in call.constants:
        full = path  # a constant is written into the blackboard inside, whose path is the node's
    where = f"{use.document.file or '<text>'}:{use.document.line(use.node.element)}"
    return DataflowAccess(full, use.attribute, use.key, where)


def dataflow_to_dicts(rows: Iterable[DataflowRow]) -> list[dict[str, object]]:
    """*rows* as plain data."""

    def access(one: DataflowAccess) -> dict[str, str]:
        return {"node": one.node, "attribute": one.attribute, "key": one.key, "where": one.where}

    return [
        {
            "scope": row.scope,
            "key": row.key,
            "type": row.type,
            "writers": [access(one) for one in row.writers],
            "readers": [access(one) for one in row.readers],
        }
        for row in rows
    ]
