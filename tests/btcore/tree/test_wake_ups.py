"""Wake-ups: from any thread, consumed once, and never lost."""

import asyncio
import threading
import time

import pytest

import btcore
from btcore import SimClock, StatefulAction, Status
from btcore.clock import NS_PER_S
from btcore.engine.context import TreeContext
from tests.btcore.conftest import TreeFactory

SOON = 100.0  # s, long enough for a busy machine


class Lasting(StatefulAction):
    """Runs until its tick number *ticks*, which the test sets."""

    ticks = 10**9
    seen = 0

    def on_start(self) -> Status:
        return self.on_running()

    def on_running(self) -> Status:
        self.seen += 1
        return Status.RUNNING if self.seen < self.ticks else Status.SUCCESS


def test_wake_up_before_a_wait_ends_it_immediately_and_counts_once(clock: SimClock) -> None:
    context = TreeContext(clock)
    context.wake_up()
    context.wake_up()
    assert context.wait_until(NS_PER_S) is True
    assert clock.now() == 0
    assert context.wait_until(NS_PER_S) is False
    assert clock.now() == NS_PER_S


def test_consumed_wake_up_ends_no_wait(clock: SimClock) -> None:
    context = TreeContext(clock)
    context.wake_up()
    assert context.consume_wake_up() is True
    assert context.consume_wake_up() is False
    assert context.wait_until(7) is False
    assert clock.now() == 7


def test_wake_up_during_a_wait_of_another_clock_is_reported() -> None:
    class Stepping(SimClock):
        def wait_until(self, deadline: int, wake: threading.Event) -> bool:
            self.advance(1.0)
            context.wake_up()
            return False  # too late for the clock to notice

    context = TreeContext(Stepping())
    assert context.wait_until(NS_PER_S) is True
    assert context.consume_wake_up() is False


def test_passed_deadline_is_a_single_wake_up(clock: SimClock) -> None:
    context = TreeContext(clock)
    context.deadlines[3] = NS_PER_S
    assert context.consume_wake_up() is False
    assert context.wait_until(2 * NS_PER_S) is True
    assert (clock.now(), context.deadlines) == (NS_PER_S, {})
    assert context.wait_until(2 * NS_PER_S) is False


def test_waiting_in_real_time_ends_immediately_after_a_wake_up_with_any_clock(clock: SimClock) -> None:
    context = TreeContext(clock)
    context.wake_up()
    started = time.monotonic()
    context.wait_real_time(SOON)
    assert time.monotonic() - started < SOON
    assert (context.consume_wake_up(), clock.now()) == (False, 0)


def test_no_wake_up_of_another_thread_is_lost() -> None:
    tree = btcore.loads(
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><Lasting/></BehaviorTree></root>',
        nodes=_registry_with_lasting(),
    )
    leaf = tree.find(Lasting)[0]
    leaf.ticks = 2000
    driver = threading.Thread(target=lambda: tree.tick_while_running(period=SOON * 100), daemon=True)
    driver.start()
    # Each wake-up is sent after the previous answer: a lost wake-up would leave both threads waiting.
    end = time.monotonic() + SOON
    while driver.is_alive() and time.monotonic() < end:
        seen = leaf.seen
        tree.wake()
        while leaf.seen == seen and driver.is_alive() and time.monotonic() < end:
            time.sleep(0)
    driver.join(timeout=SOON)
    assert leaf.seen == 2000


def test_a_leaf_that_wakes_its_tree_is_ticked_again_in_the_same_step(make_tree: TreeFactory) -> None:
    class Eager(Lasting):
        ticks = 3

        def on_running(self) -> Status:
            self.wake_up()
            return super().on_running()

    tree = make_tree("<Eager/>", Eager)
    assert tree.tick_once() is Status.SUCCESS
    assert tree.ticks == 3


@pytest.mark.parametrize("simulated", [True, False])
def test_another_thread_wakes_a_tree_in_an_event_loop(simulated: bool) -> None:
    tree = btcore.loads(
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><Lasting/></BehaviorTree></root>',
        nodes=_registry_with_lasting(),
        clock=SimClock() if simulated else None,
    )
    leaf = tree.find(Lasting)[0]
    leaf.ticks = 50
    done = threading.Event()

    def wake() -> None:
        while not done.wait(0.001):
            tree.wake()

    waker = threading.Thread(target=wake)
    waker.start()
    try:
        status = asyncio.run(asyncio.wait_for(tree.run(period=0.01 if simulated else 100.0), SOON))
    finally:
        done.set()
        waker.join()
    assert (status, leaf.seen) == (Status.SUCCESS, 50)
    tree.wake()  # no event loop is running: no error


def _registry_with_lasting() -> btcore.Registry:
    nodes = btcore.Registry.standard()
    nodes.add(Lasting)
    return nodes
