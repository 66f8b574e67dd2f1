"""Conditions and scripts of asynchronous leaves: coroutines, generators, threads.

In BehaviorTree.CPP a threaded action has none, and a coroutine evaluates them once. Here all leaves are
alike.
"""

from collections.abc import Callable, Generator
from typing import Any

import pytest

from btcore import NodeExecutionError, StatefulAction, Status, ThreadedAction, Tree, action, running
from tests.btcore.conftest import TreeFactory

R, S, F, K = Status.RUNNING, Status.SUCCESS, Status.FAILURE, Status.SKIPPED


@action(ID="Work")
async def coroutine() -> bool:
    await running()
    return True


@action(ID="Work")
def generator() -> Generator[None, None, bool]:
    yield
    return True


class Threaded(ThreadedAction):
    def work(self) -> bool:
        return True


class Stateful(StatefulAction):
    def on_start(self) -> Status:
        return R

    def on_running(self) -> Status:
        return S


LEAVES = [coroutine, generator, Threaded, Stateful]


@pytest.fixture(params=LEAVES, ids=["coroutine", "generator", "threaded", "stateful"])
def work(request: pytest.FixtureRequest, make_tree: TreeFactory) -> Callable[[str], Tree]:
    """Return a function that builds a tree of the leaf with the given attributes."""

    def make(attributes: str) -> Tree:
        nodes = make_tree("<AlwaysSuccess/>").registry.copy()
        nodes.add(request.param, ID="Work")
        return make_tree(f"<Work {attributes}/>", nodes=nodes)

    return make


@pytest.mark.parametrize(("attribute", "status"), [("_failureIf", F), ("_successIf", S), ("_skipIf", K)])
def test_early_condition_decides_result(attribute: str, status: Status, work: Callable[[str], Tree]) -> None:
    tree = work(f'{attribute}="busy" _onSuccess="s := 1" _onFailure="f := 1" _post="p := 1"')
    tree.blackboard["busy"] = True
    assert tree.tick_once() is status
    written = {key for key in ("s", "f", "p") if key in tree.blackboard}
    assert written == {S: {"s", "p"}, F: {"f", "p"}, K: set()}[status]


def test_while_condition_that_turns_false_halts_the_leaf(work: Callable[[str], Tree]) -> None:
    tree = work('_while="go" _onHalted="halted := 1" _post="p := 1"')
    tree.blackboard["go"] = True
    assert tree.tick_exactly_once() is R
    tree.blackboard["go"] = False
    assert tree.tick_exactly_once() is K
    assert tree.root.status is Status.IDLE
    assert "halted" in tree.blackboard
    assert "p" not in tree.blackboard


def test_start_conditions_are_not_evaluated_while_the_leaf_runs(work: Callable[[str], Tree]) -> None:
    tree = work('_failureIf="busy" _skipIf="busy" _onSuccess="s := 1"')
    tree.blackboard["busy"] = False
    assert tree.tick_exactly_once() is R
    tree.blackboard["busy"] = True
    assert tree.tick_while_running(period=3600) is S
    assert "s" in tree.blackboard


class Wrong(StatefulAction):
    def on_start(self) -> Any:
        return R

    def on_running(self) -> Any:
        return Status.IDLE


def test_idle_is_refused_as_the_result_of_an_action(make_tree: TreeFactory) -> None:
    tree = make_tree("<Wrong/>", Wrong)
    assert tree.tick_once() is R
    with pytest.raises(NodeExecutionError, match="not IDLE"):
        tree.tick_once()
