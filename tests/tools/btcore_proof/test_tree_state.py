"""The state of a tree as a value: it is restored completely, and equal for equal futures only."""

import dataclasses
from collections import OrderedDict, deque
from collections.abc import Iterator
from itertools import islice
from math import copysign
from threading import Lock

import pytest
from hypothesis import given
from hypothesis import strategies as st

from btcore import Blackboard, Registry, SimClock, Status, loads
from btcore.blackboard.ports import PortRole
from btcore.engine.node import TreeNode, start_tick_counts
from btcore.registry.manifest import Manifest
from btcore.status import NodeType
from btcore.testing.strategies import xml_documents
from btcore.tree.tree import Tree
from btcore_proof.interrupts import OpaqueStateError
from btcore_proof.state_graph import StateTable
from btcore_proof.timer_order import NO_TIMERS, Advance
from btcore_proof.tree_state import TICK_START_NS, StateKeeper, TreeState, state_fields_of
from tests.conformance.recorded_cases import CallLog, conformance_registry

NODES = conformance_registry()
SAME_TIME = Advance((), NO_TIMERS)


def grown(xml: str, format: int = 4) -> Tree:
    """Return the tree of *xml* on a clock that shows the time of a search."""
    clock = SimClock(TICK_START_NS)
    board = Blackboard(clock=clock)
    if format == 4:
        for key in ("a", "b", "c"):
            board[key] = 0
    resources = [CallLog()]
    if format == 3:
        return loads(xml, nodes=NODES, resources=resources, clock=clock)
    return loads(xml, nodes=NODES, resources=resources, blackboard=board, clock=clock)


def tree_of(body: str, format: int = 4) -> Tree:
    return grown(f'<root BTCPP_format="{format}"><BehaviorTree ID="T">{body}</BehaviorTree></root>', format)


def copied(tree: Tree, xml: str) -> tuple[Tree, TreeState]:
    """Return another tree of *xml* in the state of *tree*, and this state."""
    state = StateKeeper(tree).capture()
    other = grown(xml)
    StateKeeper(other).restore(state, Advance((), state.timers))
    return other, state


@given(xml_documents(max_nodes=14, timed=True, conditions=True, scripts=True, subtrees=1), st.integers(1, 3))
def test_a_restored_tree_continues_as_the_tree_itself(xml: str, ticks: int) -> None:
    tree = grown(xml)
    for _ in range(ticks):
        tree.tick_exactly_once()
    other, before = copied(tree, xml)
    assert StateKeeper(other).capture(before.timers) == before
    for _ in range(4):
        assert other.tick_exactly_once() is tree.tick_exactly_once()
        # The timers of the copy are those of the search; all other parts are compared.
        expected, found = StateKeeper(tree).capture(), StateKeeper(other).capture(before.timers)
        assert found[:4] == expected[:4]


_TEXTS = {PortRole.DURATION: "60", PortRole.REPETITIONS: "2", PortRole.SUCCESSES: "1", PortRole.FAILURES: "1"}
_BY_NAME = {"queue": "1;0", "if": "true", "variable": "1", "code": "true"}


def _nodes_with_state() -> Iterator[tuple[int, Manifest]]:
    for format in (3, 4):
        for manifest in Registry.standard().manifests_of(format).values():
            if manifest.type is not NodeType.SUBTREE and state_fields_of(manifest.cls):
                yield format, manifest


def _other_value(node: TreeNode, field: str) -> object:
    """Return another value that the field may have."""
    value = getattr(node, field)
    if field in node.spec.time_fields:
        return TICK_START_NS + 1_000_000
    if isinstance(value, Status):
        return Status.SUCCESS
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value + 1
    if isinstance(value, set):
        return {0}
    assert value is None
    return deque([1, 2])


@pytest.mark.parametrize(
    ("format", "manifest"),
    [pytest.param(format, found, id=f"{found.id}-{format}") for format, found in _nodes_with_state()],
)
def test_every_state_field_is_part_of_the_state(format: int, manifest: Manifest) -> None:
    ports = {
        port.name: _TEXTS.get(port.role) or _BY_NAME.get(port.name, "{m}")
        for port in manifest.ports.values()
        if port.default is None and not port.optional
    }
    texts = "".join(f' {name}="{text}"' for name, text in ports.items())
    children = "<AlwaysSuccess/>" * manifest.spec.child_count[0]
    body = f"<{manifest.id}{texts}>{children}</{manifest.id}>"
    for field in state_fields_of(manifest.cls):
        tree = tree_of(body, format)
        keeper = StateKeeper(tree)
        before = keeper.capture()
        value = _other_value(tree.root, field)
        setattr(tree.root, field, value)
        after = keeper.capture()
        assert after != before, field
        keeper.restore(before, SAME_TIME)
        assert keeper.capture() == before, field
        keeper.restore(after, Advance((), after.timers))
        assert keeper.capture(after.timers) == after, field
        if field not in tree.root.spec.time_fields:
            assert getattr(tree.root, field) == value, field
            assert type(getattr(tree.root, field)) is type(value)


def test_only_unseen_writes_count() -> None:
    def after_writes(seen: int, unseen: int) -> TreeState:
        """Return the state after writes to an entry that a node watches, and a tick after *seen* writes."""
        tree = tree_of('<WaitValueUpdate entry="{a}"><Act outcomes="RRS"/></WaitValueUpdate>')
        for _ in range(seen):
            tree.blackboard["a"] = 1
        tree.tick_exactly_once()
        for _ in range(unseen):
            tree.blackboard["a"] = 1
        return StateKeeper(tree).capture()

    assert after_writes(1, 0) == after_writes(3, 0)
    assert after_writes(1, 1) == after_writes(3, 2) != after_writes(1, 0)


@pytest.mark.parametrize("is_written", [False, True])
def test_a_restored_node_knows_the_writes_that_it_has_seen(is_written: bool) -> None:
    tree = tree_of(
        '<KeepRunningUntilFailure><SkipUnlessUpdated entry="{a}"><Act outcomes="S"/>'
        "</SkipUnlessUpdated></KeepRunningUntilFailure>"
    )
    for _ in range(3):
        tree.blackboard["a"] = 1
    tree.tick_exactly_once()
    if is_written:
        tree.blackboard["a"] = 1
    keeper = StateKeeper(tree)
    keeper.restore(keeper.capture(), SAME_TIME)
    counts = start_tick_counts(tree.nodes[-1])
    tree.tick_exactly_once()
    assert counts.ticks == is_written


def test_entries_that_were_created_later_are_removed() -> None:
    tree = tree_of("<AlwaysSuccess/>")
    keeper = StateKeeper(tree)
    state = keeper.capture()
    tree.blackboard["later"] = 1
    assert keeper.capture() != state
    keeper.restore(state, SAME_TIME)
    assert "later" not in tree.blackboard


@dataclasses.dataclass
class Note:
    """A value with a field that its equality ignores."""

    text: str
    count: int = dataclasses.field(default=0, compare=False)
    others: list[object] = dataclasses.field(default_factory=list)


_CYCLE: list[object] = []
_CYCLE.append((1, _CYCLE))


def test_values_that_code_can_tell_apart_are_different_states() -> None:
    states = []
    values = [
        *(1, True, 1.0, "1", 0.0, -0.0, float("nan"), -float("nan"), 0j, complex(0.0, -0.0)),
        *([1], [True], [1.0], deque([1]), deque([1], maxlen=1), deque([1], maxlen=2), OrderedDict({1: 2})),
        *((1,), (True,), (1.0,), (0.0,), (-0.0,), ([1],), ([1, 2],), ((0.0, [1]),)),
        *({1}, {True}, {-0.0}, {0.0}, frozenset({1}), {1: 2}, {True: 2}, {1.0: 2}, {-0.0: 2}, {0.0: 2}),
        *(Note("a"), Note("a", 1), Note("a", others=[1]), Note("a", others=[1.0]), [Note("a")]),
        *(iter([1, 2]), islice(iter([1, 2]), 1, None)),
    ]
    for value in values:
        tree = tree_of("<AlwaysSuccess/>")
        tree.blackboard.declare("x").put(value, 0)
        states.append(StateKeeper(tree).capture())
        StateKeeper(tree).restore(states[-1], SAME_TIME)
        restored = tree.blackboard["x"]
        if not hasattr(value, "__next__"):
            assert repr(restored) == repr(value)
        # The sign of a NaN is not shown.
        assert not isinstance(value, float) or copysign(1, restored) == copysign(1, value)
        # The next capture finds the same state, and restoring has copied what may change.
        assert StateKeeper(tree).capture() == states[-1]
        if isinstance(value, (list, dict, set, deque, Note, Iterator)):
            assert restored is not value
    assert len(set(states)) == len(states)


def test_a_value_that_contains_itself_is_restored() -> None:
    tree = tree_of("<AlwaysSuccess/>")
    tree.blackboard.declare("x").put(_CYCLE, 0)
    keeper = StateKeeper(tree)
    keeper.restore(keeper.capture(), SAME_TIME)
    restored = tree.blackboard["x"]
    assert restored is not _CYCLE
    assert restored[0][1] is restored


@pytest.mark.parametrize("value", [(each for each in [1]), [Lock()], {"a": (memoryview(b""),)}])
def test_a_value_that_cannot_be_copied_is_an_error_that_names_it(value: object) -> None:
    tree = tree_of("<AlwaysSuccess/>")
    tree.blackboard.declare("x").put(value, 0)
    text = "the entry {x} holds a (generator|lock|memoryview), which cannot be copied and compared"
    with pytest.raises(OpaqueStateError, match=text):
        StateKeeper(tree).capture()


def test_a_timer_and_the_bounds_of_no_timers_are_different_parts_of_a_state() -> None:
    tree = tree_of('<Timeout msec="9"><Sleep msec="5"/></Timeout>')
    keeper, table = StateKeeper(tree), StateTable()
    table.number_of(keeper.capture())
    tree.tick_exactly_once()
    state = keeper.capture()
    stored = table.state(table.number_of(state)[0])
    assert [list(map(type, row)) for row in stored.fields] == [list(map(type, row)) for row in state.fields]


def test_shared_values_remain_shared() -> None:
    tree = tree_of("<AlwaysSuccess/>")
    shared = deque([1])
    for key in ("x", "y"):
        tree.blackboard.declare(key).put(shared, 0)
    keeper = StateKeeper(tree)
    state = keeper.capture()
    keeper.restore(state, SAME_TIME)
    tree.blackboard["x"].append(2)
    assert list(tree.blackboard["y"]) == [1, 2]
    assert list(shared) == [1]
    tree.blackboard.declare("y").put(deque([1, 2]), 0)
    assert keeper.capture() != state
