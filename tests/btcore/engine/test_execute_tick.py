"""`execute_tick`: what it does around the ticks of every node type, including overrides."""

import asyncio
from typing import Any

import numpy as np
import pytest

from btcore import (
    Condition,
    ControlNode,
    DecoratorNode,
    NodeError,
    NodeExecutionError,
    Registry,
    StatefulAction,
    Status,
    SyncAction,
    Tree,
    TreeNode,
)
from tests.btcore.conftest import TreeFactory
from tests.conformance.recorded_cases import CallLog


class Endless(SyncAction):
    """Returns RUNNING, which no synchronous action may do."""

    def tick(self) -> Status:
        return Status.RUNNING


class Noted:
    """A mixin that records the result of every tick."""

    noted: list[Status]

    def execute_tick(self) -> Status:
        status: Status = super().execute_tick()  # type: ignore[misc]
        self.noted = [*getattr(self, "noted", []), status]
        return status


class NotedYes(Noted, SyncAction):
    def tick(self) -> bool:
        return True


class NotedEndless(Noted, Endless):
    pass


class NotedPass(Noted, DecoratorNode):
    """Ticks its child, and leaves the rest to the engine."""

    def tick(self) -> Status:
        self.set_status(Status.RUNNING)
        return self.child.execute_tick()


class NotedAll(Noted, ControlNode):
    """Ticks every child once per tick."""

    def tick(self) -> Status:
        for child in self.children:
            child.execute_tick()
        self.reset_children()
        return Status.SUCCESS


def tick_error(tree: Tree) -> NodeExecutionError:
    with pytest.raises(NodeExecutionError) as caught:
        tree.tick_once()
    assert all(node.status is Status.IDLE for node in tree)
    return caught.value


# --- overrides


def test_no_built_in_node_overrides_execute_tick(make_tree: TreeFactory) -> None:
    for format in (3, 4):
        for manifest in Registry.standard().manifests_of(format).values():
            assert manifest.cls.execute_tick is TreeNode.execute_tick


@pytest.mark.parametrize("around", ["{}", "<Inverter>{}</Inverter>", "<Sequence>{}</Sequence>"])
@pytest.mark.parametrize("guard", ["", '_skipIf="false"', '_onSuccess="x := 1"'])
def test_override_is_called_in_every_position(around: str, guard: str, make_tree: TreeFactory) -> None:
    tree = make_tree(around.format(f"<NotedYes {guard}/>"), NotedYes)
    tree.tick_once()
    tree.tick_once()
    assert tree.find(NotedYes)[0].noted == [Status.SUCCESS, Status.SUCCESS]


def test_override_in_a_decorator_resets_its_completed_child(make_tree: TreeFactory) -> None:
    tree = make_tree("<NotedPass><NotedYes/></NotedPass>", NotedPass, NotedYes)
    assert tree.tick_exactly_once() is Status.SUCCESS
    assert tree.find(NotedPass)[0].noted == tree.find(NotedYes)[0].noted == [Status.SUCCESS]
    assert tree.find(NotedYes)[0].status is Status.IDLE


def test_override_in_a_control_node_calls_the_overrides_of_its_children(make_tree: TreeFactory) -> None:
    tree = make_tree(
        "<NotedAll><NotedYes/><NotedPass><NotedYes/></NotedPass></NotedAll>", NotedAll, NotedYes, NotedPass
    )
    assert tree.tick_once() is Status.SUCCESS
    assert [node.noted for node in tree] == [[Status.SUCCESS]] * 4  # type: ignore[attr-defined]


def test_override_may_prevent_the_tick(make_tree: TreeFactory) -> None:
    class Never(SyncAction):
        def execute_tick(self) -> Status:
            return Status.SKIPPED

        def tick(self) -> Status:
            raise AssertionError

    tree = make_tree("<Fallback><Never/><AlwaysSuccess/></Fallback>", Never)
    assert tree.tick_once() is Status.SUCCESS


def test_override_that_raises_names_the_parent_node(make_tree: TreeFactory) -> None:
    class Broken(SyncAction):
        def execute_tick(self) -> Status:
            raise ValueError("out of reach")

    error = tick_error(make_tree('<Sequence name="s"><Broken name="b"/></Sequence>', Broken))
    assert (error.path, error.backtrace) == ("s", ["s"])


# --- a synchronous action that returns RUNNING


@pytest.mark.parametrize("guard", ["", '_while="true"', '_onFailure="x := 1"'])
@pytest.mark.parametrize("leaf", [Endless, NotedEndless])
def test_synchronous_action_that_returns_running_is_named_with_its_ancestors(
    leaf: type[SyncAction], guard: str, make_tree: TreeFactory
) -> None:
    body = f'<Sequence name="s"><Inverter name="i"><{leaf.__name__} name="e" {guard}/></Inverter></Sequence>'
    error = tick_error(make_tree(body, leaf))
    assert (error.path, error.node_id, error.doing) == ("e", leaf.__name__, "ticking")
    assert error.backtrace == ["s", "i", "e"]
    assert isinstance(error.__cause__, NodeError)
    assert "for an action of several ticks use StatefulAction, a generator or async def" in str(error)


def test_running_synchronous_action_is_named_with_counts_and_a_callback(make_tree: TreeFactory) -> None:
    tree = make_tree('<Endless name="e"/>', Endless)
    tree.start_tick_counts()
    tree.root.set_post_tick_function(lambda node, status: status)
    assert tick_error(tree).path == "e"


def test_callback_may_replace_the_running_result(make_tree: TreeFactory) -> None:
    tree = make_tree('<Endless name="e"/>', Endless)
    tree.root.set_post_tick_function(lambda node, status: Status.FAILURE)
    assert tree.tick_once() is Status.FAILURE


# --- exceptions and return values of a tick


@pytest.mark.parametrize("guard", ["", '_skipIf="false"'])
@pytest.mark.parametrize("message", [None, 1, 0, "SUCCESS", Status.IDLE, 2.0, 7, np.int64(1)])
def test_only_a_status_or_a_bool_ends_a_tick(message: Any, guard: str, make_tree: TreeFactory) -> None:
    class Odd(Condition):
        def tick(self) -> Any:
            return message

    error = tick_error(make_tree(f'<Sequence><Odd name="o" {guard}/></Sequence>', Odd))
    assert error.path == "o"
    assert "a tick must return RUNNING, SUCCESS" in str(error)
    assert f"not {'IDLE' if message is Status.IDLE else repr(message)}" in str(error)


@pytest.mark.parametrize("body", ["<Stop/>", "<Inverter><Stop/></Inverter>", '<Stop _skipIf="false"/>'])
def test_interrupted_tree_continues_where_it_was(body: str, make_tree: TreeFactory) -> None:
    class Stop(SyncAction):
        calls = 0

        def tick(self) -> bool:
            self.calls += 1
            if self.calls == 1:
                raise KeyboardInterrupt
            return True

    tree = make_tree(f'<SequenceWithMemory><Act name="a" outcomes="S"/>{body}</SequenceWithMemory>', Stop)
    with pytest.raises(KeyboardInterrupt):
        tree.tick_once()
    tree.tick_once()
    assert tree.find(Stop)[0].calls == 2


@pytest.mark.parametrize("kind", ["Sequence", "SequenceWithMemory", "Fallback"])
def test_after_an_error_only_a_sequence_with_memory_resumes_at_the_raising_child(
    kind: str, make_tree: TreeFactory, calls: CallLog
) -> None:
    outcomes = "F" if kind == "Fallback" else "S"
    tree = make_tree(
        f'<{kind}><Act name="a" outcomes="{outcomes}"/><Act name="x" outcomes="X{outcomes}"/></{kind}>'
    )
    tick_error(tree)
    calls.take()
    tree.tick_once()
    assert calls.take() == (["x:start"] if kind == "SequenceWithMemory" else ["a:start", "x:start"])


def test_node_that_halts_its_own_tree_in_a_tick_keeps_its_result(make_tree: TreeFactory) -> None:
    class Reckless(SyncAction):
        tree: Tree

        def tick(self) -> bool:
            self.tree.halt()
            return True

    tree = make_tree('<Sequence><Act outcomes="S"/><Reckless/></Sequence>', Reckless)
    tree.find(Reckless)[0].tree = tree
    assert tree.tick_once() is Status.SUCCESS
    assert all(node.status is Status.IDLE for node in tree)
    assert tree.tick_once() is Status.SUCCESS


# --- in an event loop


def test_run_raises_an_error_with_the_same_backtrace(make_tree: TreeFactory) -> None:
    class Late(StatefulAction):
        def on_start(self) -> Status:
            return Status.RUNNING

        def on_running(self) -> Status:
            raise OSError("the wire is cut")

    tree = make_tree(
        '<Sequence name="s"><NotedPass name="p"><Late name="l"/></NotedPass></Sequence>', NotedPass, Late
    )
    with pytest.raises(NodeExecutionError) as caught:
        asyncio.run(tree.run())
    assert caught.value.backtrace == ["s", "p", "l"]
    assert all(node.status is Status.IDLE for node in tree)
    assert tree.find(NotedPass)[0].noted == [Status.RUNNING]
