"""The harness, which ticks a tree on a simulated clock, and its trace."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import btcore
from btcore import Blackboard, NodeExecutionError, Registry, Status, action, sleep
from btcore.testing import Harness, MockLeafError, StatusChange, Trace

Patrol = Callable[..., Harness]


def document(body: str) -> str:
    return f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'


# --- driving


def test_providers_are_open_until_the_harness_is_closed() -> None:
    log: list[str] = []

    class Lamp:
        pass

    @btcore.provider
    def lamp() -> Iterator[Lamp]:
        yield Lamp()
        log.append("closed")

    @action
    def shine(lamp: Lamp) -> Status:
        log.append(type(lamp).__name__)
        return Status.SUCCESS

    nodes = Registry.standard()
    nodes.add(shine)
    harness = Harness.loads(
        document('<Sequence><Sleep msec="300"/><Shine/></Sequence>'), nodes=nodes, providers=[lamp]
    )
    assert harness.run() is Status.SUCCESS
    assert log == ["Lamp"]
    harness.close()
    harness.close()
    assert log == ["Lamp", "closed"]


def test_tick_ticks_once_and_takes_no_time(patrol: Patrol) -> None:
    harness = patrol("S|RRRRS")
    assert harness.tick() is Status.RUNNING
    assert harness.tick() is Status.RUNNING
    assert harness.tick(2) is Status.RUNNING
    assert (harness.tree.ticks, harness.tree.clock.now()) == (4, 0)


def test_wait_advances_the_clock_without_ticking() -> None:
    harness = Harness.loads(document('<Sequence><Sleep msec="300"/><AlwaysSuccess/></Sequence>'))
    harness.tick()
    harness.wait(0.299)
    assert harness.tick() is Status.RUNNING
    harness.wait(5)
    assert harness.tree.ticks == 2
    assert harness.tick() is Status.SUCCESS
    assert harness.tree.clock.now() == 5_299_000_000


def test_run_does_the_same_as_tick_while_running() -> None:
    text = document('<Sequence><Sleep msec="25"/><Delay delay_msec="7"><AlwaysSuccess/></Delay></Sequence>')
    harness = Harness.loads(text)
    other = btcore.loads(text, clock=btcore.SimClock())
    assert harness.run() is other.tick_while_running()
    assert harness.tree.clock.now() == other.clock.now() == 32_000_000
    assert harness.tree.ticks == other.ticks


def test_run_that_does_not_end_fails_and_shows_the_tree() -> None:
    harness = Harness.loads(document('<Inverter><Sleep name="night" msec="90000"/></Inverter>'))
    with pytest.raises(AssertionError, match="still RUNNING after 60 s") as failed:
        harness.run(period=10)
    assert "¬ Inverter  ▶ RUNNING" in str(failed.value)
    assert "└── ◷ night  Sleep  ▶ RUNNING  returned RUNNING" in str(failed.value)
    assert harness.tree.clock.now() == 60_000_000_000


def test_tree_that_wakes_itself_forever_fails_too() -> None:
    harness = Harness.loads(document('<Repeat num_cycles="-1"><AlwaysSuccess/></Repeat>'))
    with pytest.raises(AssertionError, match="still RUNNING"):
        harness.run()
    assert harness.tree.clock.now() == 0


def test_run_until_continues_after_the_end_of_the_tree() -> None:
    harness = Harness.loads(document('<Script code="n := n + 1"/>'))
    harness.blackboard["n"] = 0
    harness.run_until(lambda: harness.blackboard["n"] == 5)
    assert harness.tree.ticks == 5
    with pytest.raises(AssertionError, match="the condition is not met within 2 s"):
        harness.run_until(lambda: False, limit=2)


def test_run_for_takes_the_given_time() -> None:
    harness = Harness.loads(document("<AlwaysFailure/>"))
    assert harness.run_for(1.0, period=0.25) is Status.FAILURE
    assert (harness.tree.ticks, harness.tree.clock.now()) == (5, 1_000_000_000)


def test_a_coroutine_sleeps_by_the_simulated_clock() -> None:
    @action
    async def nap() -> bool:
        await sleep(120)
        return True

    nodes = Registry.standard()
    nodes.add(nap)
    harness = Harness.loads(document("<Nap/>"), nodes=nodes)
    assert harness.run(limit=150) is Status.SUCCESS
    assert harness.tree.clock.now() == 120_000_000_000


def test_harness_loads_a_file(tmp_path: Path) -> None:
    file = tmp_path / "tree.xml"
    file.write_text(document("<AlwaysSuccess/>"), encoding="utf-8")
    assert Harness.load(file).run() is Status.SUCCESS


def test_tree_on_the_system_clock_is_refused() -> None:
    with pytest.raises(ValueError, match=r"load it with clock=SimClock\(\)"):
        Harness(btcore.loads(document("<AlwaysSuccess/>")))


# --- reading


def test_result_stays_readable_when_the_node_is_idle_again(patrol: Patrol) -> None:
    harness = patrol("S")
    harness.tick()
    assert harness.status("back") is Status.IDLE
    assert harness.result("back") is Status.SUCCESS
    harness = patrol("F")
    harness.tick()
    assert harness.result("BatteryOk") is Status.FAILURE
    assert harness.result("back") is None


def test_step_contains_changes_results_written_entries_and_statuses(patrol: Patrol) -> None:
    harness = patrol("S|S|RF")
    harness.tick()
    step = harness.last
    assert (step.tick, step.stamp, step.status) == (1, 0, Status.RUNNING)
    assert step.changes[:2] == (
        StatusChange("patrol", Status.IDLE, Status.RUNNING),
        StatusChange("BatteryOk::2", Status.IDLE, Status.SUCCESS),
    )
    assert step.results["round/out"] == (Status.SUCCESS,)
    assert step.results["round/back"] == (Status.RUNNING,)
    assert step.written == {"round/turns": 1.0}
    assert step.statuses["round/note"] is Status.SUCCESS
    assert step.statuses["round/back"] is Status.RUNNING
    assert str(step) == "tick 1, at 0 s: RUNNING"


def test_node_that_stays_running_is_ticked_without_a_change(patrol: Patrol) -> None:
    harness = patrol("S|RRRS|S|S")
    harness.tick(2)
    assert "round/out" in harness.last.results
    assert "round/out" not in [change.path for change in harness.last.changes]
    assert harness.trace.results("out") == [Status.RUNNING, Status.RUNNING]


def test_halt_between_ticks_is_a_separate_step(patrol: Patrol) -> None:
    harness = patrol("S|RRS")
    harness.wait(0.5)
    harness.tick()
    harness.halt()
    step = harness.last
    assert (step.tick, step.status, step.results) == (0, Status.IDLE, {})
    assert set(step.halted) == {"patrol", "round", "round/way", "round/out"}
    assert str(step) == "after a tick, at 0.5 s"


def test_node_that_raises_ends_the_step_without_a_result(patrol: Patrol) -> None:
    harness = patrol("S|X")
    with pytest.raises(NodeExecutionError) as raised:
        harness.tick()
    assert isinstance(raised.value.cause, MockLeafError)
    step = harness.last
    assert step.error is raised.value
    assert step.results["BatteryOk::2"] == (Status.SUCCESS,)
    assert step.results["round/out"] == ()
    assert str(step) == "tick 1, at 0 s: raised round/out"


def test_removed_entry_is_shown_as_none() -> None:
    board = Blackboard()
    board["b"] = 2
    text = document('<Sequence><Script code="a := 1"/><UnsetBlackboard key="b"/></Sequence>')
    harness = Harness.loads(text, blackboard=board)
    harness.tick()
    assert harness.last.written == {"a": 1, "b": None}


def test_nodes_with_the_same_path_are_distinguished_by_number() -> None:
    harness = Harness.loads(
        document('<Sequence><AlwaysSuccess name="x"/><AlwaysSuccess name="x"/></Sequence>')
    )
    harness.tick()
    assert list(harness.last.results) == ["Sequence::1", "x#1", "x#2"]
    assert harness.result("x#2") is Status.SUCCESS


def test_unsubscribed_trace_records_nothing_more(patrol: Patrol) -> None:
    tree = patrol("S").tree
    trace = Trace(tree)
    tree.tick_once()
    trace.unsubscribe()
    tree.tick_once()
    assert len(trace) == 1
