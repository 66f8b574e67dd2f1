"""Who writes and who reads each blackboard entry of a tree, across subtrees, remappings and scripts."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from btcore.blackboard import Blackboard, Entry
from btcore.registry import Registry
from btcore.xml.check import Examined
from btcore.xml.lint.rehearsal import How, Rehearsal, Use


@dataclass(frozen=True, slots=True)
class Access:
    """One place where an entry is used.

    *node* is the node's name below the path of its subtree, *attribute* the port or script, *key* the
    name that the entry has there; *where* is ``file:line``.
    """

    node: str
    attribute: str
    key: str
    where: str


@dataclass(slots=True)
class DataRow:
    """One entry: the path of the subtree that it belongs to ("" = the main tree), its key and its type.

    *writers* and *readers* come in the order of the tree; a place that does both is in both.
    """

    scope: str
    key: str
    type: str
    writers: list[Access] = field(default_factory=list)
    readers: list[Access] = field(default_factory=list)


_WRITING = (How.WRITES, How.ASSIGNS)
_READING = (How.READS, How.NAMES)


def data_rows(examined: Examined, registry: Registry) -> list[DataRow]:
    """The entries of the main tree of an *examined* document without errors, sorted by scope and key.

    An entry that only a remapping names, and no node uses, is left out.
    """
    assert examined.main is not None, "a document without a main tree has errors"
    rehearsal = Rehearsal(examined.planner, examined.main, registry)
    rehearsal.run()
    paths = {subtree.blackboard: subtree.path for subtree in reversed(rehearsal.subtrees)}
    homes = _homes(paths)
    rows: list[DataRow] = []
    for entry, uses in rehearsal.uses.items():
        scope, key = homes[entry]
        row = DataRow(scope, key, entry.declared.name if entry.declared.strong else "")
        for use in uses:
            access = _access(use, paths[use.scope])
            if use.how in _WRITING and access not in row.writers:
                row.writers.append(access)
            if use.how in _READING and access not in row.readers:
                row.readers.append(access)
        if row.writers or row.readers:
            rows.append(row)
    return sorted(rows, key=lambda row: (row.scope, row.key))


def _homes(paths: dict[Blackboard, str]) -> dict[Entry, tuple[str, str]]:
    """The outermost scope that holds each entry, and the entry's name there."""
    found: dict[Entry, tuple[str, str]] = {}
    for board, path in reversed(paths.items()):
        for key, entry in board.local().items():
            found.setdefault(entry, (path, key))
    return found


def _access(use: Use, path: str) -> Access:
    call = use.node.call
    name = use.node.name or (call.tree if call is not None else use.node.id)
    full = f"{path}/{name}" if path else name
    if call is not None and use.attribute in call.constants:
        full = path  # a constant is written into the blackboard inside, whose path is the node's
    where = f"{use.document.file or '<text>'}:{use.document.line(use.node.element)}"
    return Access(full, use.attribute, use.key, where)


def as_data(rows: Iterable[DataRow]) -> list[dict[str, object]]:
    """*rows* as plain data."""

    def access(one: Access) -> dict[str, str]:
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
