"""The state of a tree between two ticks, saved and restored into another tree of the same XML.

A restored tree continues as the saved tree would have continued: this is what the declared state of the nodes
(`spec.state_fields`) must achieve. The state consists of the statuses, the state fields, the blackboards, a
pending wake-up, and the times for which nodes have requested a tick. It does not contain the clock, the
resources and the observers. Restore it into a tree whose clock shows the same time.
"""

import copy
from typing import NamedTuple

from btcore.blackboard.blackboard import Entry
from btcore.errors import BtcoreError, NodeError
from btcore.status import RUNNING, Status
from btcore.tree.tree import Tree, scopes_of
from btcore.values import ValueType
from btcore_proof.tree_state import check_state_declaration, state_fields_of


class SavedEntry(NamedTuple):
    """The properties of a blackboard entry, without its value. *stamp* is the time of the last write (ns)."""

    declared: ValueType
    inferred: bool
    value_type: ValueType | None
    sequence_id: int
    stamp: int


class SavedState(NamedTuple):
    """The state of a tree, as returned by `save_state`.

    *nodes* holds the path and the ID of each node. *statuses* holds the status of each node, and its status
    before the last reset. *values* holds the state fields of each node, then the value of each entry, in a
    single list, so that a shared object is copied once. *boards* holds a dictionary for each blackboard
    scope, from keys to indices in *entries*. *deadlines* holds the time (ns) for which a node requested a
    tick, by UID.
    """

    nodes: list[tuple[str, str]]
    statuses: list[tuple[Status, Status]]
    values: list[object]
    entries: list[SavedEntry]
    boards: list[dict[str, int]]
    deadlines: dict[int, int]
    is_woken: bool
    ticks: int
    status: Status


def save_state(tree: Tree) -> SavedState:
    """Return a copy of the state of *tree*, which must not be in a tick.

    Raises:
        NodeError: A RUNNING node has state that cannot be saved, such as a coroutine, or a node has
            attributes although its class does not declare `spec.state_fields`.
        TypeError: A value cannot be copied.
    """
    values: list[object] = []
    for node in tree.nodes:
        check_state_declaration(node)
        if node.spec.state_fields is None and node._status is RUNNING:
            raise NodeError(
                f"the state of '{node.config.path}' <{node.config.id}> cannot be saved while it is RUNNING"
            )
        values.append({name: getattr(node, name) for name in state_fields_of(type(node))})
    boards: list[dict[str, int]] = []
    entries: list[SavedEntry] = []
    indices: dict[int, int] = {}
    for board in scopes_of(tree):
        keys: dict[str, int] = {}
        for key, entry in board.local_entries().items():
            # Scopes of format 3 share the entries of remapped keys.
            if id(entry) not in indices:
                indices[id(entry)] = len(entries)
                properties = entry.declared, entry.inferred, entry.value_type, entry.sequence_id, entry.stamp
                entries.append(SavedEntry(*properties))
                values.append(entry.value)
            keys[key] = indices[id(entry)]
        boards.append(keys)
    return SavedState(
        _paths_and_ids(tree),
        [(node._status, node._status_before_reset) for node in tree.nodes],
        copy.deepcopy(values),
        entries,
        boards,
        dict(tree.context.deadlines),
        tree.context.is_woken,
        tree.ticks,
        tree.status,
    )


def restore_state(tree: Tree, saved: SavedState) -> None:
    """Restore a saved state. Observers are not notified.

    Args:
        tree: A tree loaded from the same XML.
        saved: The state, as returned by `save_state`.
    """
    boards = scopes_of(tree)
    if _paths_and_ids(tree) != saved.nodes or len(boards) != len(saved.boards):
        raise BtcoreError(f"the saved state is of another tree than '{tree.id}'")
    values = copy.deepcopy(saved.values)
    for node, (status, before), fields in zip(tree.nodes, saved.statuses, values, strict=False):
        node._status = status
        node._status_before_reset = before
        assert isinstance(fields, dict)
        for name, value in fields.items():
            setattr(node, name, value)
    entries = []
    for description, value in zip(saved.entries, values[len(saved.nodes) :], strict=True):
        entry = Entry(description.declared, description.inferred)
        entry.value_type = description.value_type
        entry.value, entry.sequence_id, entry.stamp = value, description.sequence_id, description.stamp
        entries.append(entry)
    for board, keys in zip(boards, saved.boards, strict=True):
        held = board.local_entries()
        held.clear()
        held.update((key, entries[index]) for key, index in keys.items())
    tree.context.uses_time = True  # the restored deadlines count from the next tick on
    tree.context.deadlines.clear()
    tree.context.consume_wake_up()
    tree.context.deadlines.update(saved.deadlines)
    if saved.is_woken:
        tree.context.wake_up()
    tree.ticks = saved.ticks
    tree.status = saved.status


def _paths_and_ids(tree: Tree) -> list[tuple[str, str]]:
    return [(node.config.path, node.config.id) for node in tree.nodes]
