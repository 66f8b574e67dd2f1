"""Generators and `async def` leaves: resumed once per tick, in the tree's time, without an event loop."""

from collections.abc import AsyncIterator, Generator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from btcore import In, NodeExecutionError, Put, SimClock, Status, Tree, action, running, sleep
from tests.btcore.conftest import TreeFactory
from tests.conformance.recorded_cases import CallLog


def statuses(tree: Tree, ticks: int) -> str:
    return "".join(tree.tick_exactly_once().name[0] for _ in range(ticks))


# --- resuming


def test_await_running_ends_the_tick_and_the_next_tick_resumes_there(make_tree: TreeFactory) -> None:
    steps: list[str] = []

    @action
    async def approach() -> bool:
        steps.append("near")
        await running()
        steps.append("nearer")
        await running()
        steps.append("there")
        return True

    tree = make_tree("<Approach/>", approach)
    assert tree.tick_exactly_once() is Status.RUNNING
    assert steps == ["near"]
    assert tree.tick_exactly_once() is Status.RUNNING
    assert tree.tick_exactly_once() is Status.SUCCESS
    assert steps == ["near", "nearer", "there"]


def test_a_generator_yields_where_a_coroutine_awaits(make_tree: TreeFactory) -> None:
    @action
    def approach() -> Generator[Status | None, None, bool]:
        yield
        yield Status.RUNNING
        return False

    assert statuses(make_tree("<Approach/>", approach), 4) == "RRFR"


def test_coroutine_without_await_completes_in_its_first_tick(make_tree: TreeFactory) -> None:
    async def at_once() -> Status:
        return Status.SUCCESS

    assert make_tree("<AtOnce/>", at_once).tick_exactly_once() is Status.SUCCESS


def test_awaited_function_may_await_too(make_tree: TreeFactory) -> None:
    async def wait(ticks: int) -> int:
        for _ in range(ticks):
            await running()
        return ticks

    @action
    async def approach() -> bool:
        return await wait(1) + await wait(2) == 3

    assert statuses(make_tree("<Approach/>", approach), 4) == "RRRS"


def test_inputs_are_read_at_the_start_and_outputs_written_on_each_call(make_tree: TreeFactory) -> None:
    @action
    async def count(limit: In[int], at: Put[int]) -> bool:
        for number in range(limit):
            at(number)
            await running()
        return True

    tree = make_tree('<Count limit="{limit}" at="{at}"/>', count)
    tree.blackboard["limit"] = 2
    tree.tick_exactly_once()
    tree.blackboard["limit"] = 100
    assert tree.blackboard["at"] == 0
    assert statuses(tree, 2) == "RS"
    assert tree.blackboard["at"] == 1


# --- time


def test_await_sleep_lasts_by_the_clock_of_the_tree(make_tree: TreeFactory, clock: SimClock) -> None:
    async def nap() -> bool:
        await sleep(0.5)
        return True

    tree = make_tree("<Nap/>", nap)
    assert tree.tick_exactly_once() is Status.RUNNING
    clock.advance(0.499_999_999)
    assert tree.tick_exactly_once() is Status.RUNNING
    clock.advance(0.000_000_001)
    assert tree.tick_exactly_once() is Status.SUCCESS


def test_sleep_wakes_tree_at_deadline_not_period_later(make_tree: TreeFactory, clock: SimClock) -> None:
    async def nap() -> bool:
        await sleep(0.25)
        return True

    tree = make_tree("<Nap/>", nap)
    assert tree.tick_while_running(period=60.0) is Status.SUCCESS
    assert clock.now() == 250_000_000
    assert tree.ticks == 2


def test_sleep_of_zero_is_running_for_one_tick(make_tree: TreeFactory, clock: SimClock) -> None:
    async def nap() -> bool:
        await sleep(0)
        return True

    assert statuses(make_tree("<Nap/>", nap), 2) == "RS"
    assert clock.now() == 0


# --- halting


def test_a_halt_runs_finally_before_the_sibling_starts(make_tree: TreeFactory, calls: CallLog) -> None:
    @action
    async def drive() -> bool:
        calls.record("drive", "start")
        try:
            while True:
                await running()
        finally:
            calls.record("drive", "stop")

    drive_or_turn = '<Drive/><Act name="turn" outcomes="S"/>'
    body = f'<WhileDoElse><Ask name="clear" outcomes="SF"/>{drive_or_turn}</WhileDoElse>'
    tree = make_tree(body, drive)
    tree.tick_exactly_once()
    tree.tick_exactly_once()
    assert calls == ["clear:tick", "drive:start", "clear:tick", "drive:stop", "turn:start"]


def test_generator_is_cancelled_by_a_halt(make_tree: TreeFactory) -> None:
    stopped: list[bool] = []

    @action
    def drive() -> Generator[None, None, bool]:
        try:
            while True:
                yield
        finally:
            stopped.append(True)

    tree = make_tree("<Drive/>", drive)
    tree.tick_exactly_once()
    tree.halt()
    assert stopped == [True]
    assert tree.root.status is Status.IDLE


def test_coroutine_that_is_not_running_is_not_cancelled(make_tree: TreeFactory) -> None:
    stopped: list[bool] = []

    @action
    async def once() -> bool:
        try:
            await running()
            return True
        finally:
            stopped.append(True)

    tree = make_tree("<Once/>", once)
    tree.halt()
    assert stopped == []
    statuses(tree, 2)
    tree.halt()
    assert stopped == [True]


def test_halted_sleep_cancels_its_wake_up(make_tree: TreeFactory, clock: SimClock) -> None:
    async def nap() -> bool:
        await sleep(0.1)
        return True

    tree = make_tree('<Timeout msec="50"><Nap/></Timeout>', nap)
    assert tree.tick_while_running(period=10.0) is Status.FAILURE
    assert clock.now() == 50_000_000
    assert tree.sleep(1.0) is False
    assert clock.now() == 1_050_000_000


def test_halted_coroutine_restarts_from_the_beginning(make_tree: TreeFactory) -> None:
    async def three() -> bool:
        await running()
        await running()
        return True

    tree = make_tree("<Three/>", three)
    assert statuses(tree, 2) == "RR"
    tree.halt()
    assert statuses(tree, 3) == "RRS"


def test_asynchronous_context_manager_without_await_is_exited_by_a_halt(make_tree: TreeFactory) -> None:
    left: list[bool] = []

    @asynccontextmanager
    async def motors() -> AsyncIterator[None]:
        try:
            yield
        finally:
            left.append(True)

    @action
    async def drive() -> bool:
        async with motors():
            await sleep(1.0)
        return True

    tree = make_tree("<Drive/>", drive)
    tree.tick_exactly_once()
    tree.halt()
    assert left == [True]


def halting_raises(tree: Tree) -> NodeExecutionError:
    tree.tick_exactly_once()
    with pytest.raises(NodeExecutionError) as caught:
        tree.halt()
    assert tree.root.status is Status.IDLE
    return caught.value


def test_await_while_being_halted_raises_an_error_that_names_the_leaf(make_tree: TreeFactory) -> None:
    @action
    async def clings() -> bool:
        try:
            await running()
        finally:
            await running()
        return True

    @action
    def grips() -> Generator[None, None, bool]:
        try:
            yield
        finally:
            yield
        return True

    error = halting_raises(make_tree('<Sequence><Clings name="c"/></Sequence>', clings))
    assert "node 'c' <Clings> raised while being halted" in str(error)
    assert "cannot await or yield while it is being halted" in str(error)
    assert "'Grips::1'" in str(halting_raises(make_tree("<Grips/>", grips)))


def test_exception_in_finally_raises_an_error_that_names_the_leaf(make_tree: TreeFactory) -> None:
    @action
    async def breaks() -> bool:
        try:
            await running()
        finally:
            raise OSError("the brake is gone")
        return True

    error = halting_raises(make_tree("<Breaks/>", breaks))
    assert isinstance(error.__cause__, OSError)
    assert "OSError: the brake is gone" in str(error)


# --- errors


def tick_raises(tree: Tree) -> NodeExecutionError:
    with pytest.raises(NodeExecutionError) as caught:
        tree.tick_exactly_once()
    return caught.value


class Foreign:
    def __init__(self) -> None:
        self.closed = False

    def __await__(self) -> Generator[Any, Any, None]:
        try:
            yield "a promise"
        finally:
            self.closed = True


def test_foreign_awaitable_raises_an_error_that_names_the_supported_awaitables(
    make_tree: TreeFactory,
) -> None:
    foreign = Foreign()

    @action
    async def waits() -> bool:
        await foreign
        return True

    error = tick_raises(make_tree("<Waits/>", waits))
    assert "a leaf can await btcore.running() and btcore.sleep()" in str(error)
    assert "'a promise'" in str(error)
    assert foreign.closed


@pytest.mark.parametrize("result", [None, 7, "SUCCESS"])
def test_invalid_return_value_raises(result: Any, make_tree: TreeFactory) -> None:
    async def waits() -> Any:
        await running()
        return result

    tree = make_tree("<Waits/>", waits)
    tree.tick_exactly_once()
    assert f"not {result!r}" in str(tick_raises(tree))


def test_yielding_a_result_is_refused(make_tree: TreeFactory) -> None:
    @action
    def hasty() -> Generator[Status, None, bool]:
        yield Status.SUCCESS
        return True

    assert "<Status.SUCCESS: 2>" in str(tick_raises(make_tree("<Hasty/>", hasty)))


def test_coroutine_restarts_after_an_exception(make_tree: TreeFactory) -> None:
    attempts: list[int] = []

    @action
    async def fragile() -> bool:
        attempts.append(len(attempts))
        await running()
        if len(attempts) == 1:
            raise ValueError("the first time")
        return True

    tree = make_tree("<Fragile/>", fragile)
    tree.tick_exactly_once()
    assert isinstance(tick_raises(tree).__cause__, ValueError)
    assert statuses(tree, 2) == "RS"
    assert attempts == [0, 1]
