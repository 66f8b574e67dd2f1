"""The state of a tree between two ticks: capture it, and restore it in a tree of the same document.

External nodes have no state here: in a replay they do what was recorded.
"""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from btcore.blackboard.blackboard import Blackboard, Entry
from btcore.engine.recorded_events import RecordedEntry, recorded_entry
from btcore.logs.files import LogError
from btcore.status import IDLE
from btcore.tree.tree import Tree
from btcore_recorder.inputs import NodeState, TreeState, is_external


def capture(tree: Tree, boards: Sequence[Blackboard], encode: Callable[[object], Any]) -> TreeState:
    """Return the state of *tree*, whose scopes are *boards*; *encode* encodes a value."""
    entries: list[RecordedEntry] = []
    indices: dict[int, int] = {}
    queues: dict[int, int] = {}
    scopes: list[dict[str, int]] = []
    for board in boards:
        keys = {}
        for key, entry in board.local_entries().items():
            # Scopes of format 3 share the entries of remapped keys.
            if id(entry) not in indices:
                indices[id(entry)] = len(entries)
                if issubclass(type(entry.value), deque):  # isinstance() may call code of the value
                    queues[id(entry.value)] = len(entries)
                entries.append(recorded_entry(entry, encode(entry.value)))
            keys[key] = indices[id(entry)]
        scopes.append(keys)
    states = []
    for uid, node in enumerate(tree.nodes, start=1):
        names = () if is_external(type(node)) else node.spec.state_fields or ()
        fields: dict[str, Any] = {}
        for name in names:
            value = getattr(node, name)
            # A loop takes the items from the queue of an entry.
            queue = queues.get(id(value))
            fields[name] = encode(value) if queue is None else {"__entry": queue}
        if fields or node._status is not IDLE or node._status_before_reset is not IDLE:
            states.append(NodeState(uid, node._status, node._status_before_reset, fields))
    return TreeState(tuple(entries), tuple(scopes), tuple(states), tree.ticks)


def restore_entries(
    state: TreeState, boards: Sequence[Blackboard], decode_entry: Callable[[RecordedEntry], Entry]
) -> list[Entry]:
    """Set the entries of *boards*, the first scopes of the tree, and return all entries of *state*."""
    entries = [decode_entry(recorded) for recorded in state.entries]
    for keys, board in zip(state.scopes, boards, strict=False):
        held = board.local_entries()
        held.clear()
        held.update((key, entries[index]) for key, index in keys.items())
    return entries


def restore_nodes(
    state: TreeState, tree: Tree, entries: Sequence[Entry], decode: Callable[[Any], object]
) -> None:
    """Set the statuses and state fields of the nodes, and the number of ticks. Observers are not notified.

    Raises:
        LogError: *state* is not a state of this tree.
    """
    tree.ticks = state.ticks
    if tree.context.observers is not None:
        tree.context.observers.begin_tick(state.ticks)
    nodes = tree.nodes
    for node in nodes:
        node._status = node._status_before_reset = IDLE
    for uid, status, before, fields in state.nodes:
        node = nodes[uid - 1]
        node._status, node._status_before_reset = status, before
        for name, value in fields.items():
            if name not in (node.spec.state_fields or ()):
                raise LogError(f"the recorded state of '{node.path}' <{node.config.id}> has a field '{name}'")
            try:
                match value:
                    case {"__entry": int(index)}:
                        decoded = entries[index].value
                    case _:
                        decoded = decode(value)
                setattr(node, name, decoded)
            except (ValueError, TypeError, IndexError) as error:
                raise LogError(f"the recorded state of '{node.path}' is invalid: {error}") from None


def describe_difference(recorded: TreeState, now: TreeState) -> tuple[str, str, int]:
    """Return the first difference between two states of one tree.

    Returns:
        The recorded and the present value, and the UID of the node; 0 = it is not the state of a node.
    """
    for number, (keys, keys_now) in enumerate(zip(recorded.scopes, now.scopes, strict=True)):
        for key in {**keys, **keys_now}:
            entries = [
                state.entries[index] if (index := scope.get(key)) is not None else None
                for state, scope in ((recorded, keys), (now, keys_now))
            ]
            if entries[0] != entries[1]:
                texts = ["is not there" if entry is None else f"is {tuple(entry)}" for entry in entries]
                return f"the entry '{key}' of scope {number} {texts[0]}", f"it {texts[1]}", 0
    nodes, nodes_now = ({node.uid: node for node in state.nodes} for state in (recorded, now))
    for uid in sorted({*nodes, *nodes_now}):
        if nodes.get(uid) != nodes_now.get(uid):
            return f"the state of node {uid}: {nodes.get(uid)}", f"{nodes_now.get(uid)}", uid
    return f"{recorded.ticks} ticks", f"{now.ticks} ticks", 0
