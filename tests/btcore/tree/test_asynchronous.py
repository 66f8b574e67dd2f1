"""Leaves in threads and under asyncio; both end when the tree is halted."""

import asyncio
import threading

import pytest

import btcore
from btcore import NodeExecutionError, Registry, SimClock, Status, ThreadedAction, action, running, sleep


def tree_of(xml: str, *leaves: object, clock: btcore.Clock | None = None) -> btcore.Tree:
    nodes = Registry.standard()
    nodes.add(*leaves)
    return btcore.loads(
        f'<root BTCPP_format="4"><BehaviorTree ID="Main">{xml}</BehaviorTree></root>',
        nodes=nodes,
        clock=clock,
    )


def test_leaf_can_await_asyncio_functions() -> None:
    done = []

    @action
    async def fetch() -> bool:
        done.append(await asyncio.wait_for(asyncio.sleep(0.01, "page"), 60))
        return True

    assert asyncio.run(tree_of("<Fetch/>", fetch).run()) is Status.SUCCESS
    assert done == ["page"]


def test_event_loop_continues_while_the_tree_waits() -> None:
    turns = 0

    @action
    async def wait() -> bool:
        for _ in range(100):  # on a busy machine, a pause may take as long as a turn
            await sleep(0.05)
            if turns > 3:
                return True
        return False

    async def both() -> Status:
        nonlocal turns
        run = asyncio.ensure_future(tree_of("<Wait/>", wait).run(period=10))
        while not run.done():
            turns += 1
            await asyncio.sleep(0.001)
        return run.result()

    assert asyncio.run(both()) is Status.SUCCESS


def test_completed_awaitable_wakes_the_tree() -> None:
    """Without the wake-up the test would time out, since the period is an hour."""

    @action
    async def fetch() -> bool:
        await asyncio.sleep(0)
        await asyncio.get_running_loop().run_in_executor(None, lambda: None)
        return True

    assert asyncio.run(asyncio.wait_for(tree_of("<Fetch/>", fetch).run(period=3600), 100)) is Status.SUCCESS


def test_awaiting_asyncio_without_an_event_loop_raises_an_error_with_advice() -> None:
    @action
    async def fetch() -> bool:
        await asyncio.sleep(1)
        return True

    tree = tree_of('<Fetch name="page"/>', fetch)
    with pytest.raises(NodeExecutionError, match=r"node 'page' <Fetch> .* with `await tree.run\(\)`"):
        tree.tick_once()
    assert tree.root.status is Status.IDLE


def test_halting_cancels_the_awaited_call_and_runs_finally() -> None:
    trace = []

    @action
    async def fetch() -> bool:
        try:
            await asyncio.sleep(3600)
        finally:
            trace.append("cleaned up")
        return True

    async def cancel() -> None:
        tree = tree_of("<Fetch/>", fetch)
        run = asyncio.ensure_future(tree.run())
        await asyncio.sleep(0.02)
        run.cancel()
        with pytest.raises(asyncio.CancelledError):
            await run
        assert all(node.status is Status.IDLE for node in tree)

    asyncio.run(cancel())
    assert trace == ["cleaned up"]


@pytest.mark.parametrize("passes", range(6))
def test_a_cancellation_is_not_lost_when_a_wake_up_ends_the_wait_in_the_same_pass(passes: int) -> None:
    """asyncio.wait_for() of Python 3.11 returns its result in this case, and drops the cancellation."""

    @action
    async def never_ends() -> bool:
        while True:
            await running()

    async def cancel() -> None:
        tree = tree_of("<NeverEnds/>", never_ends)
        run = asyncio.ensure_future(tree.run(period=3600))
        await asyncio.sleep(0)
        tree.wake()
        for _ in range(passes):
            await asyncio.sleep(0)
        run.cancel()
        await asyncio.wait({run}, timeout=100)
        assert run.cancelled()
        assert tree.status is Status.IDLE

    asyncio.run(cancel())


def test_a_simulated_clock_jumps_under_asyncio_too() -> None:
    @action
    async def wait() -> bool:
        await running()
        await sleep(3600)
        return True

    clock = SimClock()
    assert asyncio.run(tree_of("<Wait/>", wait, clock=clock).run(period=60)) is Status.SUCCESS
    assert clock.now() == 3_660_000_000_000


def test_threaded_action_runs_beside_the_tree_and_wakes_it() -> None:
    here = threading.current_thread()

    class Work(ThreadedAction):
        def work(self) -> bool:
            return threading.current_thread() is not here

    tree = tree_of("<Work/>", Work)
    assert tree.tick_once() in (Status.RUNNING, Status.SUCCESS)
    assert tree.tick_while_running(period=3600) is Status.SUCCESS


def test_halting_a_threaded_action_waits_for_its_thread() -> None:
    trace = []
    begun = threading.Event()

    class Work(ThreadedAction):
        def work(self) -> bool:
            begun.set()
            trace.append(self.pause(3600))
            return True

    tree = tree_of("<Work/>", Work)
    tree.tick_exactly_once()
    assert begun.wait(100)
    tree.halt()
    assert trace == [True]
    assert tree.root.status is Status.IDLE


def test_exception_in_a_thread_is_raised_by_the_next_tick() -> None:
    class Work(ThreadedAction):
        def work(self) -> bool:
            raise ValueError("no arm")

    tree = tree_of('<Work name="arm"/>', Work)
    with pytest.raises(
        NodeExecutionError, match="node 'arm' <Work> raised while ticking: ValueError: no arm"
    ):
        tree.tick_while_running(period=3600)


def test_tick_woken_by_a_thread_finds_its_result_before_the_thread_ends() -> None:
    reported, release = threading.Event(), threading.Event()

    class Held(ThreadedAction):
        def work(self) -> bool:
            return True

        def wake_up(self) -> None:
            super().wake_up()
            reported.set()
            release.wait(100)

    tree = tree_of("<Held/>", Held)
    try:
        assert tree.tick_exactly_once() is Status.RUNNING
        assert reported.wait(100)
        assert tree.tick_exactly_once() is Status.SUCCESS
    finally:
        release.set()
