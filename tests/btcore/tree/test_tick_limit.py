"""Ticks that repeat synchronous nodes: a limit stops them with an error, and an interruption without."""

import math
import threading
import time

import pytest

import btcore
from btcore import NodeExecutionError, Registry, SimClock, StatefulAction, Status, Tree
from btcore.tree.hooks import Hook

LIMIT = 0.05  # s
SOON = 100.0  # s, long enough for a busy machine

ENDLESS = {
    "repeat": '<Repeat name="loop" num_cycles="-1"><AlwaysSuccess/></Repeat>',
    "retry": '<RetryUntilSuccessful name="loop" num_attempts="-1"><AlwaysFailure/></RetryUntilSuccessful>',
    "nested": '<Sequence><Repeat name="loop" num_cycles="-1"><Repeat num_cycles="2"><AlwaysSuccess/></Repeat>'
    "</Repeat></Sequence>",
    "limited": '<Inverter><Repeat name="loop" num_cycles="2000000000"><AlwaysSuccess/></Repeat></Inverter>',
    "beside another branch": '<WhileDoElse><AlwaysSuccess/><Repeat name="loop" num_cycles="-1">'
    "<AlwaysSuccess/></Repeat><KeepRunningUntilFailure><AlwaysSuccess/></KeepRunningUntilFailure></WhileDoElse>",
}


class Impatient(StatefulAction):
    """Requests another tick in every tick."""

    def on_start(self) -> Status:
        return self.on_running()

    def on_running(self) -> Status:
        self.wake_up()
        return Status.RUNNING


def limited(body: str, format: int = 4, limit: float | None = LIMIT) -> Tree:
    nodes = Registry.standard()
    nodes.add(Impatient)
    return btcore.loads(
        f'<root BTCPP_format="{format}"><BehaviorTree ID="T">{body}</BehaviorTree></root>',
        nodes=nodes,
        clock=SimClock(),
        tick_limit=limit,
    )


@pytest.mark.parametrize("format", [3, 4])
@pytest.mark.parametrize("body", ENDLESS.values(), ids=ENDLESS)
def test_tick_limit_stops_an_endless_tick_and_names_the_loop(body: str, format: int) -> None:
    tree = limited(body, format)
    with pytest.raises(NodeExecutionError, match=r"stopped after 0\.05 s \(tick limit\)") as caught:
        tree.tick_once()
    assert caught.value.path == "loop"
    assert caught.value.backtrace[0] == tree.root.path
    assert caught.value.backtrace[-1] == "loop"
    assert {tree.status, *(node.status for node in tree)} == {Status.IDLE}


def test_tick_limit_names_a_leaf_that_always_requests_another_tick() -> None:
    tree = limited('<Parallel success_count="2"><Impatient name="hasty"/><Sleep msec="1000"/></Parallel>')
    with pytest.raises(NodeExecutionError, match="tick limit") as caught:
        tree.tick_while_running()
    assert caught.value.path == "hasty"


def test_tick_limit_does_not_stop_ticks_that_pause() -> None:
    tree = limited(
        '<Repeat num_cycles="50"><Sequence><Sleep msec="100"/><AlwaysSuccess/></Sequence></Repeat>',
        limit=2.0,  # less than the five seconds of the pauses, and more than a busy machine may take
    )
    assert tree.tick_while_running(0.1) is Status.SUCCESS
    assert limited('<Repeat num_cycles="50"><AlwaysSuccess/></Repeat>', 3, 60).tick_once() is Status.SUCCESS


def test_time_at_a_breakpoint_does_not_count_for_the_tick_limit() -> None:
    tree = limited('<Repeat num_cycles="3"><AlwaysSuccess name="stop"/></Repeat>', limit=1.0)
    uid = tree.node("stop").uid
    tree.hooks.insert(Hook(uid))
    reached = threading.Semaphore(0)
    tree.hooks.subscribe(lambda hook: reached.release())

    def release() -> None:
        for _ in range(3):
            assert reached.acquire(timeout=SOON)
            time.sleep(0.4)
            tree.hooks.unlock(uid)

    thread = threading.Thread(target=release)
    thread.start()
    assert tree.tick_once() is Status.SUCCESS
    thread.join()


@pytest.mark.parametrize("format", [3, 4])
def test_interruption_ends_an_endless_tick_between_two_nodes(format: int) -> None:
    tree = limited(ENDLESS["nested"], format, limit=None)
    timer = threading.Timer(LIMIT, tree.interrupt)
    timer.start()
    assert tree.tick_once() is Status.RUNNING
    assert tree.node("loop").status is Status.RUNNING
    tree.halt()


def test_tick_limit_can_be_lifted_after_an_error() -> None:
    tree = limited('<Repeat name="loop" num_cycles="200000000"><AlwaysSuccess/></Repeat>', 3)
    with pytest.raises(NodeExecutionError, match="tick limit"):
        tree.tick_once()
    tree.tick_limit = None
    timer = threading.Timer(4 * LIMIT, tree.interrupt)
    began = time.monotonic()
    timer.start()
    assert tree.tick_once() is Status.RUNNING
    assert time.monotonic() - began > LIMIT


@pytest.mark.parametrize("limit", [0, -1.0, math.inf, math.nan])
def test_tick_limit_must_be_a_positive_number(limit: float) -> None:
    with pytest.raises(ValueError, match="invalid tick_limit"):
        limited("<AlwaysSuccess/>", limit=limit)
