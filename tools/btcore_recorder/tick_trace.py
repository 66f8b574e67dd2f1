"""What happens in one tick: which nodes are ticked and halted, by whom, what they read and write."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Final, NamedTuple

from btcore.blackboard.blackboard import Blackboard, Entry
from btcore.blackboard.ports import SCRIPT_ROLES
from btcore.engine.node import TreeNode, tick_wrapper
from btcore.engine.observers import Observer
from btcore.errors import NodeExecutionError
from btcore.status import FAILURE, IDLE, RUNNING, SUCCESS, Status, Transition
from btcore.tree.tree import Tree, parents_of, scopes_of
from btcore.xml.plan.key_uses import READING, find_name_uses, port_uses

MAX_OBSERVATIONS: Final = 200_000
"""Maximum number of ticks of nodes, reads and writes that are observed: a tick may repeat a node often."""


class EntryName(NamedTuple):
    """An entry: the index of the scope that holds it, and its key there."""

    scope: int
    key: str


class Read(NamedTuple):
    """An entry that a node may read.

    Attributes:
        key: The key, as the node names it.
        by: The attribute that names it: a port, or a condition such as `_skipIf`.
        script: The script that names it; "" for a port.
        entry: The entry; None if there is none.
        value: Its value when the tick of the node began.
        sequence_id: The number of writes of the entry at that time.
    """

    key: str
    by: str
    script: str
    entry: EntryName | None
    value: object
    sequence_id: int


class Write(NamedTuple):
    """An entry was written or removed.

    Attributes:
        entry: The entry.
        uid: The node that wrote it; 0 = it was written before the tick, from outside of the tree.
        value: The value at the end of the write; None = it was removed.
        sequence_id: The number of writes of the entry, this one included.
    """

    entry: EntryName
    uid: int
    value: object
    sequence_id: int


@dataclass(slots=True)
class Visit:
    """A tick of a node.

    Attributes:
        uid: The UID of the node.
        before: The status of the node when the tick began.
        parent: The visit of its parent; None for the root.
        reads: What the node may read, with the values when the tick began.
        decided_by: What decided the result instead of the node: "condition", "callback", or "".
        result: The result; None if there is none, because of an exception.
        children: The ticks of its children, in order.
    """

    uid: int
    before: Status
    parent: "Visit | None"
    reads: list[Read]
    decided_by: str = "condition"
    result: Status | None = None
    children: list["Visit"] = field(default_factory=list)


class Halt(NamedTuple):
    """A RUNNING node was halted in the visit *by*; None = the whole tree was halted, between two ticks."""

    uid: int
    by: Visit | None


class TickTrace(Observer):
    """Follows a tick of *tree*, from its creation until `close`.

    Args:
        tree: The tree, between two ticks.
        limit: The maximum number of ticks of nodes, reads and writes that are observed.

    Attributes:
        size: The number of those that were observed.
        is_truncated: Whether there were more.
        visits: The ticks of nodes, in the order of their begin.
        ended: The same, in the order of their end.
        halts: The nodes that were halted, in order.
        writes: The writes of entries, in order.
        error: The exception that ended the tick, or None.
    """

    def __init__(self, tree: Tree, limit: int = MAX_OBSERVATIONS) -> None:
        self._limit = limit
        self.size = 0
        self.is_truncated = False
        self.visits: list[Visit] = []
        self.ended: list[Visit] = []
        self.halts: list[Halt] = []
        self.writes: list[Write] = []
        self.error: NodeExecutionError | None = None
        self._tree = tree
        self._unfinished: list[Visit] = []
        self._boards = scopes_of(tree)
        self._reads = readings(tree)
        self._parents = parents_of(tree)
        wrappers = [tick_wrapper(node) for node in tree.nodes]
        self._saved = [(each, each.on_tick_start, each.pre_tick, each.post_tick) for each in wrappers]
        for node, wrapper in zip(tree.nodes, wrappers, strict=True):
            wrapper.on_tick_start = partial(self._start, node)
            wrapper.pre_tick = partial(self._pre_tick, wrapper.pre_tick)
            wrapper.post_tick = partial(self._post_tick, wrapper.post_tick)
        self._known = {name: entry.sequence_id for name, entry in self._entries()}
        self._unsubscribe = tree.subscribe(self)

    def close(self) -> None:
        """Stop following the tree."""
        self._note_writes()
        self._unsubscribe()
        for wrapper, on_tick_start, pre_tick, post_tick in self._saved:
            wrapper.on_tick_start, wrapper.pre_tick, wrapper.post_tick = on_tick_start, pre_tick, post_tick

    # --- the answers

    def visits_of(self, uid: int) -> list[Visit]:
        """Return the ticks of a node."""
        return [visit for visit in self.visits if visit.uid == uid]

    def halt_of(self, uid: int) -> Halt | None:
        """Return the last halt of a node after its last tick, or None."""
        return next((halt for halt in reversed(self.halts) if halt.uid == uid), None)

    @property
    def entries(self) -> Sequence[EntryName]:
        """The entries at the end of the tick that have been written."""
        return [name for name, count in self._known.items() if count]

    def last_write(self, entry: EntryName, sequence_id: int) -> Write | None:
        """Return the write that made the number of writes of an entry *sequence_id*."""
        return next(
            (each for each in self.writes if each.entry == entry and each.sequence_id == sequence_id), None
        )

    # --- the events

    def transition(self, change: Transition) -> None:
        """Note a halt."""
        if change.previous is RUNNING and change.status is IDLE and not self.is_truncated:
            self.halts.append(Halt(change.uid, self._unfinished[-1] if self._unfinished else None))

    def raised(self, error: NodeExecutionError, stamp: int) -> None:
        """Note an exception."""
        self.error = error

    def _start(self, node: TreeNode) -> None:
        self._note_writes()
        if self.is_truncated:
            return
        uid = node.config.uid
        parent = self._parents.get(uid, 0)
        self._drop_above(parent)
        above = self._unfinished[-1] if self._unfinished else None
        reads = [self._read(*reading) for reading in self._reads.get(uid, ())]
        visit = Visit(uid, node._status, above, reads)
        if node._status in (SUCCESS, FAILURE):  # it is ticked without pre-conditions
            visit.decided_by = ""
        if above is not None:
            above.children.append(visit)
        self.visits.append(visit)
        self._unfinished.append(visit)
        self._count(1 + len(reads))

    def _count(self, observations: int) -> None:
        self.size += observations
        self.is_truncated = self.size > self._limit

    def _pre_tick(self, callback: Callable[[TreeNode], Status] | None, node: TreeNode) -> Status:
        forced = IDLE if callback is None else callback(node)
        if self.is_truncated:
            return forced
        self._unfinished[-1].decided_by = "callback" if forced in (SUCCESS, FAILURE) else ""
        return forced

    def _post_tick(
        self, callback: Callable[[TreeNode, Status], Status] | None, node: TreeNode, status: Status
    ) -> Status:
        self._note_writes()
        forced = IDLE if callback is None else callback(node, status)
        if self.is_truncated:
            return forced
        self._drop_above(node.config.uid)
        visit = self._unfinished.pop()
        visit.result = status
        if forced in (SUCCESS, FAILURE):
            visit.result, visit.decided_by = forced, "callback"
        self.ended.append(visit)
        return forced

    def _drop_above(self, uid: int) -> None:
        """Drop the visits of nodes that raised, which did not end, above that of the node *uid*.

        A node may also tick a child while it is halted, and not ticked.
        """
        if any(visit.uid == uid for visit in self._unfinished):
            while self._unfinished[-1].uid != uid:
                self._unfinished.pop()

    # --- entries

    def _entries(self) -> Iterator[tuple[EntryName, Entry]]:
        seen = set()
        for scope, board in enumerate(self._boards):
            for key, entry in board.local_entries().items():
                if id(entry) not in seen:  # scopes of format 3 share the entries of remapped keys
                    seen.add(id(entry))
                    yield EntryName(scope, key), entry

    def _note_writes(self) -> None:
        if self.is_truncated:
            return
        uid = self._unfinished[-1].uid if self._unfinished else 0
        count = len(self.writes)
        present = set()
        for name, entry in self._entries():
            present.add(name)
            if entry.sequence_id != self._known.get(name, 0):
                self._known[name] = entry.sequence_id
                self.writes.append(Write(name, uid, entry.value, entry.sequence_id))
        for name in self._known.keys() - present:
            del self._known[name]
            self.writes.append(Write(name, uid, None, 0))
        self._count(len(self.writes) - count)

    def _read(self, board: Blackboard, key: str, by: str, script: str) -> Read:
        entry = board.find(key)
        if entry is None:
            return Read(key, by, script, None, None, 0)
        return Read(key, by, script, find_name(self._boards, entry), entry.value, entry.sequence_id)


def find_name(boards: Sequence[Blackboard], entry: Entry) -> EntryName | None:
    """Return the scope that holds *entry*, and its key there."""
    for scope, board in enumerate(boards):
        for key, held in board.local_entries().items():
            if held is entry:
                return EntryName(scope, key)
    return None


def readings(tree: Tree) -> Mapping[int, list[tuple[Blackboard, str, str, str]]]:
    """Return what the nodes of *tree* may read, by UID: scopes, keys, attributes and scripts."""
    found: dict[int, list[tuple[Blackboard, str, str, str]]] = {}
    for node in tree.nodes:
        config, wrapper = node.config, node._wrapper
        own = []
        outer = node._blackboard
        if wrapper is not None and wrapper.conditions is not None:
            outer = wrapper.conditions.blackboard
        for attribute, script in scripts_of(node):
            names = {use.name for use in find_name_uses(script, config.enums) if use.access in READING}
            board = outer if attribute in config.conditions else node._blackboard
            own += [(board, name, attribute, script) for name in sorted(names)]
        for binding in config.inputs.values():
            key, accesses = port_uses(binding.port, binding.text, binding.is_explicit, config.format)
            if key is not None and any(access in READING for access in accesses):
                own.append((node._blackboard, key, binding.name, ""))
        if own:
            found[config.uid] = own
    return found


def scripts_of(node: TreeNode) -> Iterator[tuple[str, str]]:
    """Yield the scripts of *node*, with the attributes that they are in."""
    yield from node.config.conditions.items()
    for binding in node.config.inputs.values():
        if binding.key is None and binding.port.role in SCRIPT_ROLES:
            yield binding.name, binding.text
