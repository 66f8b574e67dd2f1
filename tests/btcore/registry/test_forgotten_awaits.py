"""A leaf that does not await sleep() or running() is refused, with the place of the call."""

import time
from collections.abc import Generator
from typing import Any

import pytest

import btcore
from btcore import NodeExecutionError, RegistrationError, Registry, Status, running, sleep
from btcore.engine.coroutine import CoroutineAction
from tests.btcore.conftest import TreeFactory


async def discards_sleep() -> bool:
    sleep(1)
    return True


async def discards_running_in_a_branch() -> bool:
    for index in range(3):
        if index:
            running()
    return True


async def calls_by_the_module() -> bool:
    btcore.sleep(1)
    return True


def is_not_async() -> bool:
    running()
    return True


def is_a_generator() -> Generator[None, None, bool]:
    yield
    sleep(1)
    return True


class OwnBody(CoroutineAction):
    def create_body(self) -> Any:
        return self.body()

    async def body(self) -> bool:
        sleep(1)
        return True


ASYNC = "write `await sleep(…)`"

FORGOTTEN: dict[Any, tuple[str, int, str]] = {
    discards_sleep: ("discards_sleep calls sleep()", 1, ASYNC),
    discards_running_in_a_branch: (
        "discards_running_in_a_branch calls running()",
        3,
        "write `await running()`",
    ),
    calls_by_the_module: ("calls_by_the_module calls sleep()", 1, ASYNC),
    is_not_async: ("is_not_async calls running()", 1, "make the function an `async def`"),
    is_a_generator: ("is_a_generator calls sleep()", 2, "write `yield sleep(…)`"),
    OwnBody.body: ("OwnBody.body calls sleep()", 1, ASYNC),
}


@pytest.mark.parametrize("function", FORGOTTEN, ids=lambda function: function.__name__)
def test_forgotten_await_is_refused_with_the_line(function: Any) -> None:
    what, lines_below, remedy = FORGOTTEN[function]
    leaf = OwnBody if function is OwnBody.body else function
    with pytest.raises(RegistrationError) as caught:
        Registry.standard().add(leaf, ID="Blink")
    line = function.__code__.co_firstlineno + lines_below
    assert str(caught.value).startswith(f"<Blink>: {what} in {__file__}:{line} without await")
    assert remedy in str(caught.value)


def awaited_leaves() -> list[Any]:
    async def awaits() -> bool:
        await sleep(0)
        return True

    async def awaits_a_variable() -> bool:
        step = running()
        await step
        await step
        return True

    async def awaits_in_an_inner_function() -> bool:
        step = sleep(0)

        async def inner() -> None:
            await step

        await inner()
        return True

    async def awaits_elements() -> bool:
        for step in [sleep(0), running()]:
            await step
        return True

    def yields() -> Generator[Any, None, bool]:
        yield sleep(0)
        return True

    def sleeps_otherwise() -> bool:
        time.sleep(0)
        return True

    async def has_another_sleep() -> bool:
        def sleep(seconds: float) -> None: ...

        sleep(1)
        return True

    return [
        awaits, awaits_a_variable, awaits_in_an_inner_function, awaits_elements, yields, sleeps_otherwise,
        has_another_sleep,
    ]  # fmt: skip


@pytest.mark.parametrize("leaf", awaited_leaves(), ids=lambda leaf: leaf.__name__)
def test_used_results_are_accepted(leaf: Any, make_tree: TreeFactory) -> None:
    nodes = Registry.standard()
    nodes.add(leaf, ID="Leaf")
    tree = make_tree("<Leaf/>", nodes=nodes)
    assert tree.tick_while_running(period=0.1) is Status.SUCCESS


def test_returned_pause_is_named_in_the_error(make_tree: TreeFactory) -> None:
    async def ends_with_a_pause() -> object:
        return sleep(1.5)

    with pytest.raises(NodeExecutionError, match=r"FAILURE \(False\) or SKIPPED, not sleep\(1\.5\)"):
        make_tree("<EndsWithAPause/>", ends_with_a_pause).tick_once()
