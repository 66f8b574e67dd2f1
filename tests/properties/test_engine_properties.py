"""Properties of every tree, tested on random trees of mock leaves."""

import threading
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import pytest
from hypothesis import assume, event, given, reject
from hypothesis import strategies as st

import btcore
from btcore import NodeExecutionError, Observer, SimClock, Status, Transition, Transitions, Tree, TreeNode
from btcore.testing import MockAction, MockLeafError, xml_documents
from btcore.testing.strategies import outcome_texts
from btcore.testing.tree_generator import SCRIPT_KEYS
from tests.conformance.recorded_cases import CallLog, conformance_registry

NODES = conformance_registry()
MANY_CALLS = 500


class EndlessWakeUpsError(Exception):
    """A tree that always wakes itself was ticked by a method that serves every wake-up."""


class LimitedCallLog(CallLog):
    """A log that makes a leaf raise *fault* after MANY_CALLS calls, so that every tree ends."""

    def __init__(self) -> None:
        super().__init__()
        self.left = MANY_CALLS
        self.fault: Exception = EndlessWakeUpsError()

    def record(self, name: str, what: str) -> None:
        super().record(name, what)
        self.left -= 1
        if self.left < 0:
            raise self.fault


class WaitLimitError(Exception):
    """The clock has reached its limit of waits."""


class ImpatientClock(SimClock):
    """A SimClock that allows only *waits* waits."""

    def __init__(self, waits: int) -> None:
        super().__init__()
        self.left = waits

    def wait_until(self, deadline: int, wake: threading.Event) -> bool:
        if not self.left:
            raise WaitLimitError
        self.left -= 1
        return super().wait_until(deadline, wake)


class TransitionRecorder(Observer):
    """Records all transitions, without their tick numbers."""

    def __init__(self) -> None:
        self.seen: list[tuple[int, int, int, Status, Status]] = []

    def transition(self, change: Transition) -> None:
        self.seen.append((change.number, change.stamp, change.uid, change.previous, change.status))


def load_with_log(xml: str, clock: SimClock | None = None) -> tuple[Tree, LimitedCallLog]:
    calls = LimitedCallLog()
    return btcore.loads(xml, nodes=NODES, resources=[calls], clock=clock or SimClock()), calls


@contextmanager
def reject_busy_trees() -> Iterator[None]:
    try:
        yield
    except NodeExecutionError as error:
        if not isinstance(error.cause, EndlessWakeUpsError):
            raise
        reject()


def statuses(tree: Tree) -> list[Status]:
    return [node.status for node in tree]


@given(
    st.one_of(
        xml_documents(timed=True, subtrees=2),
        xml_documents(timed=True, subtrees=2, conditions=True, scripts=True),
        xml_documents(timed=True, subtrees=2, format=3),
    ),
    st.integers(0, 6),
)
def test_halted_tree_is_idle_in_every_node(xml: str, ticks: int) -> None:
    tree, calls = load_with_log(xml)
    for key in SCRIPT_KEYS:
        tree.blackboard[key] = 0
    running: list[TreeNode] = []
    while tree.ticks < ticks or (not running and tree.ticks < 12):
        tree.tick_exactly_once()
        running = [node for node in tree.find(MockAction) if node.status is Status.RUNNING]
        tree.sleep(0.01)
    event(f"{min(len(running), 3)} actions halted")
    calls.take()
    tree.halt()
    assert set(statuses(tree)) == {Status.IDLE}
    assert tree.context.deadlines == {}
    assert Counter(f"{node.name}:halted" for node in running) <= Counter(calls.take())


@given(xml_documents(timed=True), st.integers(1, 12), st.integers(1, 3))
def test_halted_tree_is_idle_again_after_every_further_tick_and_halt(xml: str, ticks: int, more: int) -> None:
    tree, _ = load_with_log(xml)
    for _ in range(ticks):
        tree.tick_exactly_once()
    tree.halt()
    for _ in range(more):
        tree.tick_exactly_once()
        tree.halt()
        assert set(statuses(tree)) == {Status.IDLE}
        assert tree.context.deadlines == {}


@given(xml_documents(timed=True), st.integers(1, 12))
def test_transitions_have_no_gaps_and_add_up_to_the_statuses_of_the_nodes(xml: str, ticks: int) -> None:
    tree, _ = load_with_log(xml)
    everything = TransitionRecorder()
    tree.subscribe(everything)
    known = {node.uid: Status.IDLE for node in tree}
    for _ in range(ticks):
        tree.tick_exactly_once()
        tree.sleep(0.01)
    tree.halt()
    for expected, (number, _, uid, previous, status) in enumerate(everything.seen, start=1):
        assert number == expected
        assert known[uid] is previous
        assert status is not previous
        known[uid] = status
    assert [known[node.uid] for node in tree] == statuses(tree)


class BatchedRecorder(TransitionRecorder):
    """Records the same transitions in batches, at the end of each tick."""

    transition = Observer.transition

    def transitions(self, changes: Transitions) -> None:
        assert len(changes) == len(list(changes))
        for change in changes:
            super().transition(change)


def broad(control: str, outcomes: list[str]) -> str:
    """Return a tree of *control* with a leaf for each of *outcomes*, and a leaf that ends it now and then."""
    leaves = "".join(f'<Act name="n{place}" outcomes="{text}"/>' for place, text in enumerate(outcomes))
    many = f"<{control}>{leaves}</{control.split()[0]}>"
    both = f'<Parallel success_count="1" failure_count="1">{many}<Act outcomes="RS|RRF|RRRS"/></Parallel>'
    return f'<root BTCPP_format="4"><BehaviorTree ID="Main">{both}</BehaviorTree></root>'


BROAD = st.builds(
    broad,
    st.sampled_from(
        [
            "Sequence",
            "AsyncFallback",
            "ReactiveSequence",
            "ReactiveFallback",
            'Parallel success_count="3" failure_count="5"',
            'Parallel success_count="-1" failure_count="-1"',
            'ParallelAll max_failures="4"',
        ]
    ),
    st.lists(outcome_texts(), min_size=6, max_size=12),
)


@given(st.one_of(xml_documents(timed=True), BROAD, BROAD), st.integers(1, 12))
def test_batched_and_immediate_observers_receive_the_same_transitions(xml: str, ticks: int) -> None:
    seen = []
    for kind in (TransitionRecorder, BatchedRecorder):
        tree, _ = load_with_log(xml)
        observer = kind()
        tree.subscribe(observer)
        for _ in range(ticks):
            tree.tick_exactly_once()
            tree.sleep(0.01)
        tree.halt()
        seen.append(observer.seen)
    assert seen[0] == seen[1]


@given(xml_documents(), st.integers(1, 12))
def test_tick_once_does_the_same_as_repeated_exact_ticks(xml: str, steps: int) -> None:
    together, calls = load_with_log(xml)
    one_by_one, same_calls = load_with_log(xml)
    status = Status.IDLE
    with reject_busy_trees():
        for _ in range(steps):
            status = together.tick_once()
    last = [one_by_one.tick_exactly_once() for _ in range(together.ticks)][-1]
    event(f"{'more' if together.ticks > steps else 'as many'} ticks than steps")
    assert last is status
    assert same_calls == calls
    assert statuses(one_by_one) == statuses(together)


@given(xml_documents(timed=True), st.integers(0, 12), st.sampled_from([0.005, 0.01, 0.1]))
def test_tick_while_running_does_the_same_as_a_loop_of_tick_once(xml: str, waits: int, period: float) -> None:
    def run(tree: Tree) -> Status:
        return tree.tick_while_running(period)

    def step(tree: Tree) -> Status:
        due = 0
        while (status := tree.tick_once()) is Status.RUNNING:
            if tree.clock.now() >= due:
                due += round(period * 1e9)
            tree.context.wait_until(due)
        return status

    def outcome(drive: Callable[[Tree], Status]) -> tuple[object, ...]:
        tree, calls = load_with_log(xml, ImpatientClock(waits))
        everything = TransitionRecorder()
        tree.subscribe(everything)
        end = "still running"
        with reject_busy_trees(), suppress(WaitLimitError):
            end = drive(tree).name
        event(end)
        return end, tree.ticks, tree.clock.now(), calls, statuses(tree), everything.seen

    assert outcome(run) == outcome(step)


@given(xml_documents(), st.integers(1, 12), st.integers(0, 1000))
def test_raising_leaf_leaves_the_tree_idle_and_is_named(xml: str, ticks: int, which: int) -> None:
    tree, calls = load_with_log(xml)
    for _ in range(ticks):
        tree.tick_exactly_once()
    assume(calls)
    which %= len(calls)
    name, _, what = calls[which].partition(":")
    event(what)

    tree, calls = load_with_log(xml)
    calls.left = which
    calls.fault = MockLeafError("now")
    with pytest.raises(NodeExecutionError) as raised:  # noqa: PT012
        for _ in range(ticks):
            tree.tick_exactly_once()
    error = raised.value
    assert error.__cause__ is calls.fault
    guilty = tree.node(error.path)
    assert guilty.name == name
    assert error.backtrace[0] == tree.root.path
    assert error.backtrace[-1] == guilty.path
    assert set(statuses(tree)) == {Status.IDLE}
    assert tree.status is Status.IDLE


@given(xml_documents(timed=True), st.integers(1, 6))
def test_trees_of_the_same_document_are_independent(xml: str, ticks: int) -> None:
    alone, calls = load_with_log(xml)
    for _ in range(ticks):
        alone.tick_exactly_once()
    first, first_calls = load_with_log(xml)
    second, _ = load_with_log(xml)
    for _ in range(ticks):
        first.tick_exactly_once()
        second.tick_exactly_once()
        second.halt()
    assert statuses(first) == statuses(alone)
    assert first_calls == calls


@given(xml_documents())
def test_a_random_tree_names_its_nodes_in_pre_order(xml: str) -> None:
    tree, _ = load_with_log(xml)
    assert [node.name for node in tree] == [f"n{number}" for number in range(1, len(tree.nodes) + 1)]
    assert [node.uid for node in tree] == list(range(1, len(tree.nodes) + 1))
