"""Importing a log of statuses as a recording: what leaves returned, as far as the transitions determine it.

A log has neither the ticks nor what leaves read and wrote. The engine is run on it: a leaf that is ticked
returns the status of the next transition if it is its own, otherwise its present status. Control nodes and
decorators whose results depend on their children alone are run by the engine. All others are external nodes,
which tick and halt the children whose transitions follow. A SubTree node is always run by the engine, and the
result that its pre-condition has decided is forced. This is not possible for SKIPPED: if its parent is a
SubTree node, too, and `_skipIf` or `_while` has skipped it, its replay has more transitions than the log.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import Final

from lxml import etree

import btcore
from btcore.engine.node import TreeNode, execute_tick, halt_node, reset_status
from btcore.engine.observers import Observer
from btcore.engine.recorded_events import (
    ChildHalted,
    ChildTicked,
    ExternalHaltBegan,
    ExternalHaltEnded,
    Raised,
    RecordedError,
    StatusForced,
    StatusSet,
)
from btcore.engine.transition_records import Transitions
from btcore.errors import BtcoreError, TickInterrupt
from btcore.logs import LoggedTransition, Recording
from btcore.logs.files import LogError
from btcore.logs.recording import RecordedNode
from btcore.registry.registry import Registry
from btcore.status import IDLE, RUNNING, SKIPPED, NodeType, Status, Transition
from btcore_recorder.files import RECONSTRUCTED
from btcore_recorder.inputs import (
    Head,
    Input,
    NodeState,
    RecordedClass,
    Result,
    RunRecording,
    Step,
    TreeState,
)
from btcore_recorder.recorded_tree import RecordedTree
from btcore_recorder.tree_state import capture
from btcore_recorder.values import Encoder

_ENGINE_NODES: Final = frozenset(
    {
        "AsyncFallback",
        "AsyncSequence",
        "Fallback",
        "ForceFailure",
        "ForceSuccess",
        "IfThenElse",
        "Inverter",
        "KeepRunningUntilFailure",
        "Parallel",
        "ParallelAll",
        "ReactiveFallback",
        "ReactiveSequence",
        "Repeat",
        "RetryUntilSuccesful",
        "RetryUntilSuccessful",
        "Sequence",
        "SequenceStar",
        "SequenceWithMemory",
        "WhileDoElse",
    }
)
"""Nodes whose results depend on their children alone, without conditions and keys in their ports."""
_MAX_PAUSE_NS: Final = 1_000_000
"""Maximum time (ns) between transitions of a tick. After a longer one, running nodes wait for the next."""
_MAX_ATTEMPTS: Final = 20
"""Maximum number of attempts with nodes that the engine runs. They are fewer after each."""


class _ContradictionError(Exception):
    """The engine does what is not in the log; *uids* are the nodes of its and of the logged transition."""

    def __init__(self, uids: Iterable[int]) -> None:
        super().__init__()
        self.uids = tuple(uids)


def import_log(log: Recording) -> RunRecording:
    """Return a recording whose replay makes the transitions of *log*.

    Raises:
        LogError: The log does not contain the tree, or the tree cannot be loaded.
    """
    shape = _Shape(log)
    by_engine = shape.engine_nodes()
    for attempt in range(_MAX_ATTEMPTS + 1):
        is_last = not by_engine or attempt == _MAX_ATTEMPTS
        try:
            return _run(log, shape, frozenset(() if is_last else by_engine), must_succeed=is_last)
        except _ContradictionError as contradiction:
            by_engine -= {shape.nearest(uid, by_engine) for uid in contradiction.uids}
        except BtcoreError as error:
            raise LogError(f"{log.path}: the tree of this log cannot be run: {error}") from None
    raise AssertionError("the last attempt succeeds")


class _Shape:
    """The nodes of a log, numbered in pre-order like the nodes of a tree."""

    def __init__(self, log: Recording) -> None:
        self.registry = Registry.standard()
        self._xml = log.xml
        self.main_id = _tree_ids(log.xml).get("", "Main")
        self.nodes: list[RecordedNode] = []
        self.parents: dict[int, int] = {}
        self.numbers: dict[int, int] = {}
        below = {uid for node in log.nodes.values() for uid in node.children}
        roots = [uid for uid in log.nodes if uid not in below]
        if len(roots) != 1:
            raise LogError(
                f"{log.path}: this log contains the names of {len(log.nodes)} nodes, but not their tree, so "
                "that it cannot be run again; save the XML of the tree beside it"
            )
        waiting = [(roots[0], 0)]
        while waiting:
            uid, parent = waiting.pop()
            self.nodes.append(log.nodes[uid])
            number = self.numbers[uid] = len(self.nodes)
            self.parents[number] = parent
            waiting += [(child, number) for child in reversed(log.nodes[uid].children)]
        self.begin: dict[int, Status] = {}
        for change in log.transitions:
            # A .btlog does not contain the previous status.
            is_unknown = change.previous is change.status
            self.begin.setdefault(self.numbers[change.uid], RUNNING if is_unknown else change.previous)
        is_3 = any(self._fits(node, 3) and not self._fits(node, 4) for node in self.nodes)
        self.format = 3 if is_3 or not log.xml else 4

    def is_built_in(self, node: RecordedNode) -> bool:
        return self.registry.get(node.id, self.format) is not None

    def _fits(self, node: RecordedNode, format: int) -> bool:
        manifest = self.registry.get(node.id, format)
        return manifest is not None and _ports(node).keys() <= manifest.ports.keys()

    def engine_nodes(self) -> set[int]:
        """Return the nodes that the engine can run."""
        return {
            number
            for number, node in enumerate(self.nodes, 1)
            if node.id in _ENGINE_NODES
            and self._fits(node, self.format)
            and self.begin.get(number, IDLE) is IDLE
            and not any(name.startswith("_") or "{" in text for name, text in node.ports.items())
        }

    def nearest(self, number: int, among: set[int]) -> int:
        """Return the node of *among* that is nearest to a node on the way to the root."""
        while number and number not in among:
            number = self.parents[number]
        return number or min(among)

    def child_with(self, number: int, inner: int) -> int:
        """Return the child of a node that contains the node *inner*, or 0."""
        while inner and self.parents[inner] != number:
            inner = self.parents[inner]
        return inner

    def document(self) -> str:
        """Return the tree as XML, without conditions. Each call of a tree has its own copy."""
        ids = _tree_ids(self._xml)
        root = etree.Element("root", BTCPP_format=str(self.format), main_tree_to_execute=self.main_id)
        trees = {0: etree.SubElement(root, "BehaviorTree", ID=self.main_id)}
        taken = {self.main_id}
        elements: dict[int, etree._Element] = {}
        for number, node in enumerate(self.nodes, 1):
            parent = self.parents[number]
            parent_element = trees[parent] if parent in trees else elements[parent]
            # The XML of Nav2's bags is the user's, where a call has the ID of the called tree.
            is_by_id = node.type is NodeType.SUBTREE and not self.is_built_in(node)
            element = elements[number] = etree.SubElement(parent_element, "SubTree" if is_by_id else node.id)
            if node.type is NodeType.SUBTREE:
                id = ids.get(node.path, node.id if is_by_id else "Tree")
                id = f"{id}#{number}" if id in taken else id
                taken.add(id)
                element.set("ID", id)
                trees[number] = etree.SubElement(root, "BehaviorTree", ID=id)
            name = node.path.rpartition("/")[2] if node.type is NodeType.SUBTREE else node.name
            if name != f"{element.get('ID')}::{number}" and not node.path.endswith(f"{node.id}::{node.uid}"):
                element.set("name", name)
            if node.type is not NodeType.SUBTREE:
                for port, text in _ports(node).items():
                    element.set(port, text)
        return etree.tostring(root, pretty_print=True, encoding="unicode")


def _tree_ids(xml: str) -> dict[str, str]:
    """Return the IDs of the trees in a log by the paths of their SubTree nodes."""
    if not xml:
        return {}
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=True)
    root = etree.fromstring(xml.encode("utf-8", "replace"), parser)
    ids = [(tree.get("_fullpath"), tree.get("ID", "Tree")) for tree in root.iterchildren("BehaviorTree")]
    if ids and all(path is None for path, _ in ids):  # the XML from which the robot loaded its tree
        return {"": root.get("main_tree_to_execute") or ids[0][1]}
    return {path or "": id for path, id in ids}


def _ports(node: RecordedNode) -> Mapping[str, str]:
    return {name: text for name, text in node.ports.items() if not name.startswith("_")}


def _run(log: Recording, shape: _Shape, by_engine: frozenset[int], must_succeed: bool) -> RunRecording:
    """Return the recording of an attempt, in which the engine runs the nodes *by_engine*, by their numbers.

    With *must_succeed*, there is no contradiction: transitions that do not follow from the log's are kept.

    Raises:
        _ContradictionError: The engine does what is not in the log.
    """
    classes: dict[str, RecordedClass] = {}
    replaced: dict[int, RecordedClass] = {}
    for number, node in enumerate(shape.nodes, 1):
        if number in by_engine or node.type is NodeType.SUBTREE:
            continue
        if shape.is_built_in(node):
            replaced[number] = _class(node, ())
        else:
            classes[node.id] = _class(node, classes[node.id].ports if node.id in classes else ())
    head = Head(
        shape.main_id,
        shape.format,
        ((log.path.name, shape.document(), False),),
        {},
        {},
        tuple(classes.values()),
        replaced,
        ((False, {}),),
        TreeState((), ({},), (), 0),
        0,
        log.start,
        {"btcore": btcore.__version__, RECONSTRUCTED: log.path.name},
    )
    logged = _LoggedTree(head, log, shape, must_succeed)
    state = capture(logged.tree, logged.boards, Encoder(lambda name, description: None).encode)
    begin = [NodeState(uid, status, IDLE, {}) for uid, status in sorted(shape.begin.items()) if status]
    state = state._replace(nodes=(*state.nodes, *begin))
    logged.restore(state)
    numbered = enumerate(shape.nodes, 1)
    logged.add_callbacks(uid for uid, node in numbered if node.type is NodeType.SUBTREE and uid > 1)
    head = head._replace(state=state, paths=tuple(node.path for node in logged.tree.nodes))
    return RunRecording(head, tuple(_steps(logged, log)), (), log.damage)


def _steps(logged: "_LoggedTree", log: Recording) -> Iterator[Step]:
    tree, follower = logged.tree, _Follower(logged)
    tree.subscribe(follower)
    before: list[Input] = []
    while (first := logged.next) is not None or before:
        logged.begin_step()
        if first is not None and logged.is_decided_subtree(1, first):
            logged.force(first)
            before += logged.events
            continue
        is_halt = tree.root._status is not IDLE and logged.resets(1)
        status = IDLE
        try:
            if is_halt:
                tree.halt()
            else:
                status = tree.tick_exactly_once()
        except TickInterrupt:
            pass
        is_unexplained = first is not None and logged.next is first
        logged.check(first if is_unexplained else None)
        stamp = log.end if first is None else first.stamp
        number, time = (0, -1) if is_halt else (tree.ticks, stamp - log.start)
        yield Step(number, time, tuple(before), tuple(logged.events), status, follower.checksum)
        before.clear()
        if first is not None and is_unexplained:
            logged.begin_step()
            logged.force(first)
            before += logged.events


class _Follower(Observer):
    """Follows the transitions of the engine in the log."""

    def __init__(self, logged: "_LoggedTree") -> None:
        self._logged = logged
        self.checksum = 0

    def transition(self, change: Transition) -> None:
        self._logged.follow(change)

    def transitions(self, changes: Transitions) -> None:
        self.checksum = changes.checksum(self.checksum)


class _LoggedTree(RecordedTree):
    """External nodes do what they must have done, so that the transitions of a log follow."""

    def __init__(self, head: Head, log: Recording, shape: _Shape, must_succeed: bool) -> None:
        super().__init__(head)
        self._transitions = log.transitions
        self._shape = shape
        self._must_succeed = must_succeed
        self._position = 0  # of the next transition
        self._stamp: int | None = None  # of the last transition in this step
        self.events: list[Input] = []
        self.contradiction: _ContradictionError | None = None

    def begin_step(self) -> None:
        self.events = []
        self._stamp = None

    @property
    def next(self) -> LoggedTransition | None:
        """The next transition, or None."""
        return self._transitions[self._position] if self._position < len(self._transitions) else None

    def _number(self, change: LoggedTransition) -> int:
        return self._shape.numbers[change.uid]

    def follow(self, change: Transition) -> None:
        """Follow a transition of the engine."""
        expected = self.next
        if expected is None:
            return  # the log ends within a tick, which the engine completes
        if (self._number(expected), expected.status) == (change.uid, change.status):
            self._position += 1
            self._stamp = expected.stamp
        elif not self._must_succeed and self.contradiction is None:
            self.contradiction = _ContradictionError((change.uid, self._number(expected)))

    def _is_in_tick(self, change: LoggedTransition) -> bool:
        return self._stamp is None or change.stamp - self._stamp <= _MAX_PAUSE_NS

    def resets(self, uid: int) -> bool:
        """Return whether the next transitions are resets of nodes in the branch *uid*, and of its root."""
        for index in range(self._position, len(self._transitions)):
            change = self._transitions[index]
            number = self._number(change)
            if change.status is not IDLE:
                return False
            if number == uid:
                return True
            if not self._shape.child_with(uid, number):
                return False
        return False

    def check(self, unexplained: LoggedTransition | None) -> None:
        """Raise the contradiction in this step, which should have begun with the transition *unexplained*."""
        if unexplained is not None and not self._must_succeed and self.contradiction is None:
            self.contradiction = _ContradictionError((self._number(unexplained),))
        if self.contradiction is not None:
            raise self.contradiction

    def force(self, change: LoggedTransition) -> None:
        """Set a status that nothing else explains."""
        position = self._position
        if change.status is not SKIPPED:  # it cannot be stored
            self._set(self._number(change), change.status)
        self._position = max(self._position, position + 1)

    def _set(self, uid: int, status: Status) -> None:
        self.events.append(StatusSet(uid, status))
        if status is IDLE:
            reset_status(self.tree.nodes[uid - 1])
        else:
            self.tree.nodes[uid - 1].set_status(status)

    def _tick_external(self, node: TreeNode) -> Status:
        uid = node.config.uid
        self._stop_at_contradiction()
        status = self._tick_children(node) if node.children else self._leaf_result(node)
        if status is IDLE and self.next is None:
            self.events.append(Raised(uid, RecordedError("TickInterrupt", "")))
            raise TickInterrupt
        result = SKIPPED if status is IDLE else status
        self.events.append(Result(uid, result))
        return result

    def _stop_at_contradiction(self) -> None:
        if self.contradiction is not None:
            raise TickInterrupt

    def _leaf_result(self, node: TreeNode) -> Status:
        change, status = self.next, node._status
        if change is None or self._number(change) != node.config.uid:
            return status
        if change.status is IDLE:  # it is halted by a condition
            self._set(node.config.uid, IDLE)
            return IDLE
        return change.status if status is IDLE or self._is_in_tick(change) else status

    def _tick_children(self, node: TreeNode) -> Status:
        uid = node.config.uid
        ticked: set[int] = set()
        while (change := self.next) is not None:
            self._stop_at_contradiction()
            number, position = self._number(change), self._position
            if node._status is RUNNING and not self._is_in_tick(change):
                break
            child = self._shape.child_with(uid, number)
            if number == uid:
                if change.status not in (IDLE, RUNNING):
                    return change.status
                self._set(uid, change.status)
            elif not child:
                break
            elif change.status is IDLE and (number == child or self.resets(child)):
                self._reset(child, number)
            elif self.is_decided_subtree(child, change):
                self._set(child, change.status)
            elif child in ticked and self.tree.nodes[child - 1]._status is RUNNING:
                break
            else:
                ticked.add(child)
                self.events.append(ChildTicked(child))
                execute_tick(self.tree.nodes[child - 1])
            self._check_progress(change, position)
        return node._status

    def is_decided_subtree(self, uid: int, change: LoggedTransition) -> bool:
        """Return whether *uid* is a SubTree node that is not ticked, because its pre-condition decides."""
        node = self.tree.nodes[uid - 1]
        is_result = self._number(change) == uid and change.status not in (IDLE, RUNNING)
        return is_result and node.type is NodeType.SUBTREE and node._status is IDLE

    def _pre_tick(self, node: TreeNode) -> Status:
        change = self.next
        if change is None or not self.is_decided_subtree(node.config.uid, change):
            return SKIPPED
        self.events.append(StatusForced(node.config.uid, True, change.status))
        return change.status

    def _halt_external(self, node: TreeNode) -> None:
        uid = node.config.uid
        if not node.children:
            reset_status(node)
            return
        self.events.append(ExternalHaltBegan(uid))
        while (change := self.next) is not None and change.status is IDLE:
            self._stop_at_contradiction()
            number, position = self._number(change), self._position
            child = self._shape.child_with(uid, number)
            if not child:
                break
            self._reset(child, number)
            self._check_progress(change, position)
        self._set(uid, IDLE)
        self.events.append(ExternalHaltEnded(uid, None))

    def _reset(self, child: int, number: int) -> None:
        """Halt *child* if it is running and is reset now; otherwise reset the node *number* in it."""
        if self.tree.nodes[child - 1]._status is RUNNING and self.resets(child):
            self.events.append(ChildHalted(child))
            halt_node(self.tree.nodes[child - 1])
        else:
            self._set(number, IDLE)

    def _check_progress(self, change: LoggedTransition, position: int) -> None:
        self._stop_at_contradiction()
        if self._position != position:
            return
        if not self._must_succeed:
            self.contradiction = _ContradictionError((self._number(change),))
            raise TickInterrupt
        self.force(change)


def _class(node: RecordedNode, ports: Iterable[tuple[str, str, str, str | None]]) -> RecordedClass:
    kind, others = "leaf", NodeType.ACTION
    if node.children:
        is_decorator = node.type is NodeType.DECORATOR and len(node.children) == 1
        kind, others = "decorator" if is_decorator else "control", NodeType.CONTROL
    is_leaf_type = node.type in (NodeType.ACTION, NodeType.CONDITION)
    node_type = node.type if is_leaf_type is (kind == "leaf") else others
    known = {port[0]: port for port in ports}
    known.update({name: (name, "IN", "std::string", None) for name in _ports(node)})
    return RecordedClass(node.id, kind, node_type.name, False, tuple(known.values()))
