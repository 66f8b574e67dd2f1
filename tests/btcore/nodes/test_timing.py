"""Sleep, Delay and Timeout: they follow the tree's clock, which the tree reads when a tick begins."""

import pytest

from btcore import NodeExecutionError, SimClock, Status, Tree, TreeError, action, sleep
from tests.btcore.conftest import TreeFactory
from tests.conformance.recorded_cases import CallLog

MS = 1_000_000

R, S, F, K = Status.RUNNING, Status.SUCCESS, Status.FAILURE, Status.SKIPPED


def after(tree: Tree, clock: SimClock, *milliseconds: float) -> list[Status]:
    """Return the results of ticks, each after a pause of the given length."""
    statuses = []
    for pause in milliseconds:
        clock.advance(pause / 1000)
        statuses.append(tree.tick_exactly_once())
    return statuses


# --- Sleep


def test_sleep_runs_until_its_time_is_over_and_succeeds(make_tree: TreeFactory, clock: SimClock) -> None:
    assert after(make_tree('<Sleep msec="100"/>'), clock, 0, 50, 49.999999, 0.000001) == [R, R, R, S]


def test_sleep_of_zero_succeeds_immediately(make_tree: TreeFactory, clock: SimClock) -> None:
    assert after(make_tree('<Sleep msec="0"/>'), clock, 0) == [S]


def test_sleep_wakes_the_tree_at_its_end(make_tree: TreeFactory, clock: SimClock) -> None:
    tree = make_tree('<Sleep msec="100"/>')
    assert tree.tick_while_running(period=60.0) is S
    assert clock.now() == 100 * MS


def test_halted_sleep_causes_no_wake_up_and_restarts(make_tree: TreeFactory, clock: SimClock) -> None:
    tree = make_tree('<Sleep msec="100"/>')
    after(tree, clock, 0, 60)
    tree.halt()
    assert tree.sleep(0.06) is False
    assert after(tree, clock, 0, 60, 40) == [R, R, S]


def test_sleep_reads_its_duration_at_the_start(make_tree: TreeFactory, clock: SimClock) -> None:
    tree = make_tree('<Sleep msec="{t}"/>')
    tree.blackboard["t"] = 50
    after(tree, clock, 0)
    tree.blackboard["t"] = 1000
    assert after(tree, clock, 50) == [S]


def test_negative_or_missing_duration_is_refused(make_tree: TreeFactory) -> None:
    with pytest.raises(TreeError, match="-5"):
        make_tree('<Sleep msec="-5"/>')
    with pytest.raises(NodeExecutionError, match="msec"):
        make_tree("<Sleep/>").tick_once()


# --- Delay


def test_delay_ticks_child_only_after_time(make_tree: TreeFactory, clock: SimClock, calls: CallLog) -> None:
    tree = make_tree('<Delay delay_msec="100"><Act name="a" outcomes="RS"/></Delay>')
    assert after(tree, clock, 0, 99) == [R, R]
    assert calls == []
    assert after(tree, clock, 1, 0) == [R, S]
    assert calls == ["a:start", "a:running"]


def test_running_child_is_not_delayed_again_but_ended_child_is(
    make_tree: TreeFactory, clock: SimClock
) -> None:
    tree = make_tree('<Delay delay_msec="100"><Act name="a" outcomes="RS|F"/></Delay>')
    assert after(tree, clock, 0, 100, 0, 0, 99, 1) == [R, R, S, R, R, F]


def test_delay_of_zero_takes_a_tick(make_tree: TreeFactory, clock: SimClock, calls: CallLog) -> None:
    tree = make_tree('<Delay delay_msec="0"><Act name="a" outcomes="S"/></Delay>')
    assert after(tree, clock, 0, 0) == [R, S]
    assert calls == ["a:start"]


def test_delay_wakes_the_tree_when_the_child_is_due(make_tree: TreeFactory, clock: SimClock) -> None:
    assert make_tree('<Delay delay_msec="70"><AlwaysFailure/></Delay>').tick_while_running(period=60.0) is F
    assert clock.now() == 70 * MS


def test_a_halt_ends_the_delay_and_the_child(make_tree: TreeFactory, clock: SimClock, calls: CallLog) -> None:
    tree = make_tree('<Delay delay_msec="100"><Act name="a" outcomes="RRR"/></Delay>')
    after(tree, clock, 0, 60)
    tree.halt()
    assert tree.sleep(0.06) is False
    assert after(tree, clock, 0, 60, 40) == [R, R, R]
    assert calls.take() == ["a:start"]
    tree.halt()
    assert calls.take() == ["a:halted"]


def test_a_skipped_child_is_ticked_again_without_a_new_delay(make_tree: TreeFactory, clock: SimClock) -> None:
    tree = make_tree('<Delay delay_msec="100"><Act name="a" outcomes="K|S"/></Delay>')
    assert after(tree, clock, 0, 100, 0) == [R, K, S]


# --- Timeout


def test_child_that_completes_in_time_returns_its_own_result(make_tree: TreeFactory, clock: SimClock) -> None:
    tree = make_tree('<Timeout msec="100"><Act name="a" outcomes="RS|RF"/></Timeout>')
    assert after(tree, clock, 0, 99, 0, 99) == [R, S, R, F]


def test_child_running_at_the_limit_is_halted_and_timeout_fails(
    make_tree: TreeFactory, clock: SimClock, calls: CallLog
) -> None:
    tree = make_tree('<Timeout msec="100"><Act name="a" outcomes="RRRRR"/></Timeout>')
    assert after(tree, clock, 0, 99.999999, 0.000001) == [R, R, F]
    assert calls == ["a:start", "a:running", "a:halted"]
    assert {node.status for node in tree} == {Status.IDLE}


def test_timeout_wakes_the_tree_at_the_limit(make_tree: TreeFactory, clock: SimClock) -> None:
    assert make_tree('<Timeout msec="70"><Act outcomes="R"/></Timeout>').tick_while_running(period=60.0) is F
    assert clock.now() == 70 * MS


def test_timeout_of_zero_is_no_limit(make_tree: TreeFactory, clock: SimClock) -> None:
    tree = make_tree('<Timeout msec="0"><Act outcomes="RRRS"/></Timeout>')
    assert after(tree, clock, 0, 1e6, 1e6, 1e6) == [R, R, R, S]


def test_limit_restarts_after_a_result_and_after_a_halt(make_tree: TreeFactory, clock: SimClock) -> None:
    tree = make_tree('<Timeout msec="100"><Act outcomes="RS|RRR|RRR"/></Timeout>')
    assert after(tree, clock, 0, 80) == [R, S]
    assert after(tree, clock, 0, 80) == [R, R]
    tree.halt()
    assert tree.sleep(0.08) is False
    assert after(tree, clock, 0, 80, 20) == [R, R, F]


def test_child_that_completes_in_time_leaves_no_wake_up(make_tree: TreeFactory, clock: SimClock) -> None:
    tree = make_tree('<Timeout msec="100"><Act outcomes="RS"/></Timeout>')
    assert after(tree, clock, 0, 10) == [R, S]
    assert tree.sleep(1.0) is False
    assert clock.now() == 1010 * MS


@pytest.mark.parametrize(
    "waiting",
    [
        '<Sleep msec="100"/>',
        '<Delay delay_msec="100"><AlwaysSuccess/></Delay>',
        '<Timeout msec="100"><Act outcomes="R"/></Timeout>',
    ],
)
def test_node_halted_by_its_parent_while_waiting_causes_no_wake_up(
    waiting: str, make_tree: TreeFactory, clock: SimClock
) -> None:
    tree = make_tree(
        f'<WhileDoElse><Ask outcomes="SF"/>{waiting}<Act name="b" outcomes="RRR"/></WhileDoElse>'
    )
    assert after(tree, clock, 0, 10) == [R, R]
    assert tree.sleep(1.0) is False
    assert clock.now() == 1010 * MS


def test_child_not_running_at_the_limit_is_not_halted_and_has_no_limit(
    make_tree: TreeFactory, clock: SimClock, calls: CallLog
) -> None:
    tree = make_tree('<Timeout msec="100"><Act name="a" outcomes="K|RRS"/></Timeout>')
    assert after(tree, clock, 0, 100, 1e6, 1e6) == [K, R, R, S]
    assert "a:halted" not in calls


def test_in_format_3_halt_does_not_stop_time(make_tree: TreeFactory, clock: SimClock, calls: CallLog) -> None:
    tree = make_tree('<Timeout msec="100"><Act name="a" outcomes="R"/></Timeout>', format=3)
    after(tree, clock, 0, 60)
    tree.halt()
    assert after(tree, clock, 0, 39, 1) == [R, R, F]
    assert calls[-1] == "a:halted"
    assert after(tree, clock, 0, 99, 1) == [R, R, F]


def test_in_format_3_a_limit_between_two_starts_is_ignored(make_tree: TreeFactory, clock: SimClock) -> None:
    tree = make_tree('<Timeout msec="100"><Act name="a" outcomes="R|RRS"/></Timeout>', format=3)
    after(tree, clock, 0)
    tree.halt()
    assert after(tree, clock, 100, 1e6, 1e6) == [R, R, S]


def test_inner_limit_ends_first(make_tree: TreeFactory, clock: SimClock, calls: CallLog) -> None:
    tree = make_tree(
        '<Timeout msec="200"><Fallback><Timeout msec="50"><Act name="a" outcomes="R"/></Timeout>'
        '<Act name="b" outcomes="R"/></Fallback></Timeout>'
    )
    assert tree.tick_while_running(period=60.0) is F
    assert clock.now() == 200 * MS
    assert calls == ["a:start", "a:halted", "b:start", "b:halted"]


@pytest.mark.parametrize("format", [3, 4])
def test_both_formats_have_delay_and_timeout(format: int, make_tree: TreeFactory, clock: SimClock) -> None:
    body = '<Timeout msec="100"><Delay delay_msec="30"><Act outcomes="RRRR"/></Delay></Timeout>'
    tree = make_tree(body, format=format)
    assert after(tree, clock, 0, 30, 69, 1) == [R, R, R, F]


# --- leaves that take time


@pytest.mark.parametrize(
    ("timer", "result"),
    [
        ('<Sleep msec="1000"/>', S),
        ("<Wait/>", S),
        ('<Delay delay_msec="1000"><AlwaysSuccess/></Delay>', S),
        ('<Timeout msec="1000"><Act outcomes="R"/></Timeout>', F),
    ],
)
def test_a_timer_counts_from_its_start_and_is_judged_by_the_time_at_the_start_of_a_tick(
    make_tree: TreeFactory, clock: SimClock, timer: str, result: Status
) -> None:
    @action
    def slow() -> bool:
        clock.advance(0.3)
        return True

    @action
    async def wait() -> bool:
        await sleep(1.0)
        return True

    tree = make_tree(f"<ReactiveSequence><Slow/>{timer}</ReactiveSequence>", slow, wait)
    assert tree.tick_exactly_once() is R  # the timer starts at 0.3 s
    assert clock.now() == 300 * MS
    assert after(tree, clock, 999.999999) == [R]  # it begins at 1.299999999 s, and the leaf takes 0.3 s
    assert after(tree, clock, 0) == [result]
