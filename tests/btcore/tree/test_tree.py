"""Ticking, halting, waiting and inspecting a tree."""

import asyncio
import threading
import time

import pytest

import btcore
from btcore import (
    Blackboard,
    BtcoreError,
    ControlNode,
    NodeExecutionError,
    SimClock,
    StatefulAction,
    Status,
    SystemClock,
    action,
)
from btcore.clock import NS_PER_S
from btcore.nodes.sequences_and_fallbacks import Sequence
from tests.btcore.conftest import TreeFactory
from tests.conformance.recorded_cases import CallLog, RecordedAct, conformance_registry

THREE = "<AlwaysSuccess/><AlwaysSuccess/><AlwaysSuccess/>"


# --- ticking


def test_leaf_cannot_tick_its_own_tree(make_tree: TreeFactory) -> None:
    @action
    def again() -> Status:
        return tree.tick_once()

    tree = make_tree("<Sequence><Again/></Sequence>", again)
    with pytest.raises(
        NodeExecutionError, match=r"tree 'Main' is being ticked already: .*call wake\(\)"
    ) as caught:
        tree.tick_once()
    assert isinstance(caught.value.cause, BtcoreError)
    assert caught.value.path.startswith("Again")
    assert tree.ticks == 1


def test_tree_can_be_ticked_again_after_an_error_and_after_an_interrupt(make_tree: TreeFactory) -> None:
    problems: list[BaseException] = [ValueError("broken"), KeyboardInterrupt()]

    @action
    def fail() -> bool:
        if problems:
            raise problems.pop(0)
        return True

    tree = make_tree("<Fail/>", fail)
    with pytest.raises(NodeExecutionError):
        tree.tick_while_running()
    with pytest.raises(KeyboardInterrupt):
        tree.tick_while_running()
    assert tree.tick_while_running() is Status.SUCCESS


def test_second_thread_cannot_tick_a_tree_during_a_tick(make_tree: TreeFactory) -> None:
    started, release = threading.Event(), threading.Event()

    @action
    def wait() -> bool:
        started.set()
        return release.wait(100)

    tree = make_tree("<Wait/>", wait)
    results: list[Status] = []
    thread = threading.Thread(target=lambda: results.append(tree.tick_once()))
    thread.start()
    try:
        assert started.wait(100)
        for tick in (tree.tick_once, tree.tick_exactly_once, tree.tick_while_running):
            with pytest.raises(
                BtcoreError, match="tree 'Main' is being ticked already: neither a second thread"
            ):
                tick()
    finally:
        release.set()
        thread.join()
    assert results == [Status.SUCCESS]  # the tick in progress did not notice


def test_second_run_of_a_tree_is_refused_while_the_first_waits(make_tree: TreeFactory) -> None:
    async def both() -> Status:
        tree = make_tree('<Act outcomes="RRRS"/>')
        first = asyncio.create_task(tree.run())
        while tree.ticks == 0:
            await asyncio.sleep(0)
        with pytest.raises(
            BtcoreError, match=r"is being ticked already by run\(\) or tick_while_running\(\)"
        ):
            await tree.run()
        with pytest.raises(
            BtcoreError, match=r"is being ticked already by run\(\) or tick_while_running\(\)"
        ):
            tree.tick_while_running()
        result = await first
        assert await tree.run() is Status.SUCCESS  # the first has ended
        return result

    assert asyncio.run(both()) is Status.SUCCESS


def test_async_sequence_takes_a_tick_per_child_but_a_single_tick_once(make_tree: TreeFactory) -> None:
    tree = make_tree(f"<AsyncSequence>{THREE}</AsyncSequence>")
    assert tree.tick_exactly_once() is Status.RUNNING
    assert [child.status for child in tree.root.children].count(Status.SUCCESS) == 1
    tree = make_tree(f"<AsyncSequence>{THREE}</AsyncSequence>")
    assert tree.tick_once() is Status.SUCCESS
    assert tree.ticks == 3


def test_tick_once_repeats_only_while_the_root_is_running(make_tree: TreeFactory) -> None:
    tree = make_tree('<Sequence><Act outcomes="S"/></Sequence>')
    tree.wake()
    assert tree.tick_once() is Status.SUCCESS
    assert tree.ticks == 1


def test_tick_once_consumes_the_wake_up_and_tick_exactly_once_keeps_it(make_tree: TreeFactory) -> None:
    tree = make_tree('<Act outcomes="RRRR"/>')
    tree.wake()
    tree.tick_exactly_once()
    assert tree.ticks == 1
    tree.tick_once()
    assert tree.ticks == 3
    tree.tick_once()
    assert tree.ticks == 4


def test_a_completed_root_is_idle_and_the_tree_keeps_its_result(make_tree: TreeFactory) -> None:
    tree = make_tree('<Act outcomes="RF"/>')
    assert tree.status is Status.IDLE
    assert (tree.tick_once(), tree.root.status, tree.status) == (Status.RUNNING,) * 3
    assert (tree.tick_once(), tree.root.status, tree.status) == (Status.FAILURE, Status.IDLE, Status.FAILURE)


def test_skipped_ends_every_tick_method(make_tree: TreeFactory) -> None:
    tree = make_tree('<AlwaysSuccess _skipIf="true"/>')
    assert tree.tick_exactly_once() is Status.SKIPPED
    assert tree.tick_once() is Status.SKIPPED
    assert tree.tick_while_running() is Status.SKIPPED
    assert tree.root.status is Status.IDLE


# --- time


class Works:
    """The duration of each tick (s)."""

    def __init__(self, durations: list[float]) -> None:
        self.durations = list(durations)


class Moments(StatefulAction):
    """Records the time of every tick (ms), works for a while, and succeeds in the end."""

    def __init__(self, clock: SimClock, works: Works) -> None:
        self.clock = clock
        self.works = works.durations
        self.at: list[float] = []

    def on_start(self) -> Status:
        return self.on_running()

    def on_running(self) -> Status:
        self.at.append(self.clock.now() / 1e6)
        if not self.works:
            return Status.SUCCESS
        self.clock.advance(self.works.pop(0))
        return Status.RUNNING


def moments(clock: SimClock, works: list[float], period: float) -> list[float]:
    nodes = conformance_registry()
    nodes.add(Moments)
    xml = '<root BTCPP_format="4"><BehaviorTree ID="Main"><Moments/></BehaviorTree></root>'
    tree = btcore.loads(xml, nodes=nodes, resources=[clock, Works(works)])
    assert tree.tick_while_running(period) is Status.SUCCESS
    return tree.find(Moments)[0].at


def test_first_clock_resource_is_the_clock_of_the_tree(clock: SimClock) -> None:
    assert moments(clock, [0.0], 0.01) == [0.0, 10.0]
    assert clock.now() == 10_000_000


def test_ticks_come_every_period_regardless_of_their_duration(clock: SimClock) -> None:
    assert moments(clock, [0.004, 0.009, 0.0, 0.01], 0.01) == [0.0, 10.0, 20.0, 30.0, 40.0]


def test_late_tick_delays_the_following_ticks_and_none_is_made_up(clock: SimClock) -> None:
    assert moments(clock, [0.0, 0.035, 0.0, 0.0], 0.01) == [0.0, 10.0, 45.0, 55.0, 65.0]


def test_many_periods_do_not_drift(clock: SimClock) -> None:
    at = moments(clock, [0.001] * 3000, 1 / 30)
    assert at[-1] == pytest.approx(3000 * 1000 / 30, abs=0.01)


def test_simulated_clock_starts_at_its_given_time(make_tree: TreeFactory) -> None:
    assert moments(SimClock(5_000_000_000), [0.0], 0.5) == [5000.0, 5500.0]


def test_period_of_zero_never_sleeps(clock: SimClock) -> None:
    assert moments(clock, [0.0, 0.0, 0.0], 0.0) == [0.0] * 4


@pytest.mark.parametrize("period", [-0.1, float("nan"), float("inf")])
def test_negative_or_nan_period_is_refused_before_the_first_tick(
    make_tree: TreeFactory, period: float
) -> None:
    tree = make_tree("<AlwaysSuccess/>")
    with pytest.raises(ValueError, match=rf"invalid period {period}: use a number of seconds"):
        tree.tick_while_running(period=period)
    with pytest.raises(ValueError, match=rf"invalid period {period}: use a number of seconds"):
        asyncio.run(tree.run(period=period))
    assert tree.ticks == 0


class World:
    """A clock that advances only by waiting, as SimClock, but has no common base with it."""

    def __init__(self) -> None:
        self.time = 0

    def now(self) -> int:
        return self.time

    def wait_until(self, deadline: int, wake: threading.Event) -> bool:
        self.time = max(self.time, deadline)
        return wake.is_set()


@pytest.mark.parametrize("in_event_loop", [False, True])
@pytest.mark.parametrize("clock_type", [SimClock, World])
def test_period_of_zero_advances_a_clock_that_stands_still_to_the_next_deadline(
    clock_type: type[SimClock | World], in_event_loop: bool
) -> None:
    clock = clock_type()
    body = '<Parallel><Sleep msec="2500"/><Sleep msec="60000"/></Parallel>'
    tree = btcore.loads(
        f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>',
        nodes=conformance_registry(),
        clock=clock,
    )
    if in_event_loop:
        asyncio.run(asyncio.wait_for(tree.run(period=0), 30))
    else:
        tree.tick_while_running(period=0)
    assert clock.now() == 60 * NS_PER_S
    assert tree.ticks == 3


def test_waiting_node_is_ticked_on_time_and_period_continues(make_tree: TreeFactory, clock: SimClock) -> None:
    ticked: list[int] = []

    class Watch(btcore.Observer):
        def ticked(self, tick: int, stamp: int, duration_ns: int, status: Status) -> None:
            ticked.append(stamp // 1_000_000)

    tree = make_tree('<Sequence><Sleep msec="25"/><Sleep msec="20"/></Sequence>')
    tree.subscribe(Watch())
    assert tree.tick_while_running(period=0.01) is Status.SUCCESS
    assert ticked == [0, 10, 20, 25, 30, 40, 45]


def test_sleep_lets_time_pass_and_returns_whether_it_was_woken(
    make_tree: TreeFactory, clock: SimClock
) -> None:
    tree = make_tree("<AlwaysSuccess/>")
    assert tree.sleep(2.5) is False
    assert clock.now() == 2_500_000_000
    tree.wake()
    assert tree.sleep(2.5) is True
    assert clock.now() == 2_500_000_000
    assert tree.sleep(2.5) is False


def test_another_thread_wakes_a_sleeping_tree() -> None:
    xml = '<root BTCPP_format="4"><BehaviorTree ID="Main"><AlwaysSuccess/></BehaviorTree></root>'
    tree = btcore.loads(xml)
    woken: list[bool] = []
    sleeper = threading.Thread(target=lambda: woken.append(tree.sleep(200.0)))
    started = time.monotonic()
    sleeper.start()
    tree.wake()
    sleeper.join(timeout=100.0)
    assert woken == [True]
    assert time.monotonic() - started < 200.0


def test_another_thread_ends_the_wait_between_two_ticks() -> None:
    xml = '<root BTCPP_format="4"><BehaviorTree ID="Main"><Act outcomes="RS"/></BehaviorTree></root>'
    calls = CallLog()
    tree = btcore.loads(xml, nodes=conformance_registry(), resources=[calls])
    result: list[Status] = []
    driver = threading.Thread(target=lambda: result.append(tree.tick_while_running(period=200.0)))
    driver.start()
    tree.wake()
    driver.join(timeout=100.0)
    assert result == [Status.SUCCESS]


def test_system_clock_waits_until_the_deadline() -> None:
    xml = '<root BTCPP_format="4"><BehaviorTree ID="Main"><Sleep msec="30"/></BehaviorTree></root>'
    tree = btcore.loads(xml)
    before = time.monotonic()
    assert tree.tick_while_running(period=200.0) is Status.SUCCESS
    assert 0.03 <= time.monotonic() - before < 100.0


# --- halting

COUNTS = (
    '<Sequence _onHalted="n += 1">'
    '<Act outcomes="RS" _onHalted="n += 10"/><Act outcomes="RS" _onHalted="n += 100"/>'
    "</Sequence>"
)


@pytest.mark.parametrize("ticks", [0, 1, 2])
def test_halt_runs_on_halted_of_every_node_and_twice_for_the_root(ticks: int, make_tree: TreeFactory) -> None:
    tree = make_tree(COUNTS, blackboard=counter())
    for _ in range(ticks):
        tree.tick_exactly_once()
    already = tree.blackboard["n"]
    tree.halt()
    counted = int(str(tree.blackboard["n"])) - int(str(already))
    running = {0: 0, 1: 10, 2: 100}[ticks]
    assert counted == 112 + running


def counter() -> Blackboard:
    board = Blackboard()
    board["n"] = 0
    return board


def test_a_halt_leaves_every_node_idle_and_ends_only_what_runs(
    make_tree: TreeFactory, calls: CallLog
) -> None:
    tree = make_tree(
        '<Parallel><Act name="a" outcomes="RR"/><Act name="b" outcomes="S"/>'
        '<Inverter><Act name="c" outcomes="RR"/></Inverter></Parallel>'
    )
    tree.tick_once()
    calls.take()
    tree.halt()
    assert calls.take() == ["a:halted", "c:halted"]
    assert {node.status for node in tree} == {Status.IDLE}
    assert tree.status is Status.IDLE


@pytest.mark.parametrize(("value", "handled"), [("true", True), ("{missing}", False), ("{empty}", False)])
def test_a_halt_ticks_the_handler_of_a_try_catch_if_its_port_is_true(
    value: str, handled: bool, make_tree: TreeFactory, calls: CallLog
) -> None:
    body = '<Act name="a" outcomes="R"/><Act name="handler" outcomes="S"/>'
    tree = make_tree(f'<TryCatch catch_on_halt="{value}">{body}</TryCatch>')
    tree.tick_once()
    tree.halt()
    assert calls == ["a:start", "a:halted", *(["handler:start"] if handled else [])]


def test_tree_is_a_context_manager_that_halts_it(make_tree: TreeFactory, calls: CallLog) -> None:
    with make_tree('<Act name="a" outcomes="R"/>') as tree:
        tree.tick_once()
    assert calls == ["a:start", "a:halted"]


# --- inspecting

SUBTREES = '<BehaviorTree ID="Sub"><Sequence name="again"><Act outcomes="S"/></Sequence></BehaviorTree>'


def test_node_is_found_by_its_path_or_by_a_unique_name(make_tree: TreeFactory) -> None:
    tree = make_tree(
        '<Sequence><SubTree ID="Sub" name="inst"/><AlwaysSuccess name="nm"/></Sequence>', others=SUBTREES
    )
    assert tree.node("inst/again") is tree.nodes[2]
    assert tree.node("again") is tree.nodes[2]
    assert tree.node("Sequence::1") is tree.root


@pytest.mark.parametrize("path", ["Deep/wave", "Main/Deep/wave", "Deep::9/wave", "elsewhere/wave"])
def test_path_without_number_of_subtree_gets_full_path_as_suggestion(
    make_tree: TreeFactory, path: str
) -> None:
    deep = '<BehaviorTree ID="Deep"><Sequence><AlwaysSuccess name="wave"/></Sequence></BehaviorTree>'
    tree = make_tree('<Sequence><Inverter><SubTree ID="Deep"/></Inverter></Sequence>', others=deep)
    with pytest.raises(BtcoreError, match="did you mean 'Deep::3/wave'"):
        tree.node(path)


def test_unknown_path_raises_an_error_with_a_suggestion(make_tree: TreeFactory) -> None:
    tree = make_tree('<Sequence><AlwaysSuccess name="wave"/></Sequence>')
    with pytest.raises(BtcoreError, match=r"the tree has no node 'wawe'; did you mean 'wave'\?"):
        tree.node("wawe")


def test_nodes_with_the_same_path_are_distinguished_by_number(make_tree: TreeFactory) -> None:
    tree = make_tree('<Sequence><Act name="p" outcomes="S"/><Act name="p" outcomes="S"/></Sequence>')
    assert list(tree.nodes_by_path()) == ["Sequence::1", "p#1", "p#2"]
    assert tree.node("p#2") is tree.nodes[2]
    with pytest.raises(BtcoreError, match="'p' is the name of 2 nodes: p#1, p#2"):
        tree.node("p")
    tree = make_tree(
        "<Sequence>" + "".join(f'<Act name="{name}"/>' for name in ("p#1", "p", "p")) + "</Sequence>"
    )
    assert list(tree.nodes_by_path()) == ["Sequence::1", "p#1", "p#2", "p#3"]


def test_nodes_are_found_by_their_type_in_pre_order(make_tree: TreeFactory) -> None:
    inner = '<Sequence><Act name="b" outcomes="S"/></Sequence>'
    tree = make_tree(f'<Sequence><Act name="a" outcomes="S"/>{inner}</Sequence>')
    assert [node.name for node in tree.find(RecordedAct)] == ["a", "b"]
    assert [node.uid for node in tree.find(Sequence)] == [1, 3]
    assert len(tree.find(ControlNode)) == 2
    assert tree.find(SystemClock) == []  # type: ignore[type-var]


def test_tick_counts_begin_with_the_first_call(make_tree: TreeFactory) -> None:
    tree = make_tree(
        '<ReactiveSequence name="r"><Ask name="c" outcomes="SSF"/><Act name="a" outcomes="RR"/>'
        '<Act name="k" outcomes="K"/></ReactiveSequence>'
    )
    counts = tree.start_tick_counts()
    for _ in range(3):
        tree.tick_once()
    c, a, k = counts["c"], counts["a"], counts["k"]
    assert (c.ticks, c.success, c.failure, c.skipped, c.halted) == (3, 2, 1, 0, 0)
    assert (a.ticks, a.success, a.failure, a.halted) == (2, 0, 0, 1)
    assert k.ticks == 0
    assert tree.ticks == 3


def test_tick_decided_by_a_condition_counts_with_its_result(make_tree: TreeFactory) -> None:
    tree = make_tree('<AlwaysSuccess name="a" _skipIf="true"/>')
    count = tree.start_tick_counts()["a"]
    tree.tick_once()
    assert (count.ticks, count.skipped) == (1, 1)


# --- two trees


def test_two_trees_share_nothing(make_tree: TreeFactory) -> None:
    body = '<Sequence><Script code="x := 1"/><Act outcomes="RS"/></Sequence>'
    one, other = make_tree(body), make_tree(body)
    one.tick_once()
    assert "x" in one.blackboard
    assert "x" not in other.blackboard
    assert {node.status for node in other} == {Status.IDLE}
    one.wake()
    other.tick_once()
    assert other.ticks == 1


def test_two_trees_may_share_a_blackboard(make_tree: TreeFactory) -> None:
    shared = Blackboard()
    writer = make_tree('<Script code="x := 41"/>', blackboard=shared)
    reader = make_tree('<Script code="x += 1"/>', blackboard=shared)
    writer.tick_once()
    reader.tick_once()
    assert writer.blackboard["x"] == 42
