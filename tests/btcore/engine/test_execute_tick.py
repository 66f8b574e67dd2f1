"""The wrapper of a tick: what it does around the ticks of every family, whoever overrides it."""

import asyncio
from collections.abc import Callable
from typing import Any

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
from btcore.testing.plan_leaves import CallLog

Grow = Callable[..., Tree]


class Endless(SyncAction):
    """What no synchronous action may do."""

    def tick(self) -> Status:
        return Status.RUNNING


class Noted:
    """A mixin that notes what every tick came to."""

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
    """Ticks its child, and leaves what comes after to the engine."""

    def tick(self) -> Status:
        self.set_status(Status.RUNNING)
        return self.child.execute_tick()


class NotedAll(Noted, ControlNode):
    """Ticks all children, each once a tick."""

    def tick(self) -> Status:
        for child in self.children:
            child.execute_tick()
        self.reset_children()
        return Status.SUCCESS


def raised(tree: Tree) -> NodeExecutionError:
    with pytest.raises(NodeExecutionError) as caught:
        tree.tick_once()
    assert all(node.status is Status.IDLE for node in tree)
    return caught.value


# --- overriding it


def test_the_engine_knows_who_has_one_of_its_own(make_tree: Grow) -> None:
    for format in (3, 4):
        for manifest in Registry.standard().manifests_of(format).values():
            assert manifest.cls.execute_tick is TreeNode.execute_tick


@pytest.mark.parametrize("around", ["{}", "<Inverter>{}</Inverter>", "<Sequence>{}</Sequence>"])
@pytest.mark.parametrize("guard", ["", '_skipIf="false"', '_onSuccess="x := 1"'])
def test_an_override_is_called_wherever_the_node_stands(around: str, guard: str, make_tree: Grow) -> None:
    tree = make_tree(around.format(f"<NotedYes {guard}/>"), NotedYes)
    tree.tick_once()
    tree.tick_once()
    assert tree.find(NotedYes)[0].noted == [Status.SUCCESS, Status.SUCCESS]


def test_an_override_around_a_decorator_has_its_completed_child_reset(make_tree: Grow) -> None:
    tree = make_tree("<NotedPass><NotedYes/></NotedPass>", NotedPass, NotedYes)
    assert tree.tick_exactly_once() is Status.SUCCESS
    assert tree.find(NotedPass)[0].noted == tree.find(NotedYes)[0].noted == [Status.SUCCESS]
    assert tree.find(NotedYes)[0].status is Status.IDLE


def test_an_override_around_a_control_node_ticks_its_children_by_theirs(make_tree: Grow) -> None:
    tree = make_tree(
        "<NotedAll><NotedYes/><NotedPass><NotedYes/></NotedPass></NotedAll>", NotedAll, NotedYes, NotedPass
    )
    assert tree.tick_once() is Status.SUCCESS
    assert [node.noted for node in tree] == [[Status.SUCCESS]] * 4  # type: ignore[attr-defined]


def test_an_override_may_keep_the_tick_from_happening(make_tree: Grow) -> None:
    class Never(SyncAction):
        def execute_tick(self) -> Status:
            return Status.SKIPPED

        def tick(self) -> Status:
            raise AssertionError

    tree = make_tree("<Fallback><Never/><AlwaysSuccess/></Fallback>", Never)
    assert tree.tick_once() is Status.SUCCESS


def test_an_override_that_raises_names_the_node_above_it(make_tree: Grow) -> None:
    class Broken(SyncAction):
        def execute_tick(self) -> Status:
            raise ValueError("out of reach")

    error = raised(make_tree('<Sequence name="s"><Broken name="b"/></Sequence>', Broken))
    assert (error.path, error.backtrace) == ("s", ["s"])


def test_no_attribute_of_a_users_leaf_meets_what_the_engine_asks_for(make_tree: Grow) -> None:
    class Follow(SyncAction):
        follows = "the wall"

        def tick(self) -> bool:
            return self.follows == "the wall"

    assert make_tree("<Follow/>", Follow).tick_once() is Status.SUCCESS


# --- a synchronous action that returns RUNNING


@pytest.mark.parametrize("guard", ["", '_while="true"', '_onFailure="x := 1"'])
@pytest.mark.parametrize("leaf", [Endless, NotedEndless])
def test_a_synchronous_action_that_runs_is_named_with_those_around_it(
    leaf: type[SyncAction], guard: str, make_tree: Grow
) -> None:
    body = f'<Sequence name="s"><Inverter name="i"><{leaf.__name__} name="e" {guard}/></Inverter></Sequence>'
    error = raised(make_tree(body, leaf))
    assert (error.path, error.node_id, error.doing) == ("e", leaf.__name__, "ticking")
    assert error.backtrace == ["s", "i", "e"]
    assert isinstance(error.__cause__, NodeError)
    assert "use StatefulAction" in str(error)


def test_it_is_named_under_a_count_and_a_callback_too(make_tree: Grow) -> None:
    tree = make_tree('<Endless name="e"/>', Endless)
    tree.count_ticks()
    tree.root.set_post_tick_function(lambda node, status: status)
    assert raised(tree).path == "e"


def test_a_callback_may_end_it_before_that_counts(make_tree: Grow) -> None:
    tree = make_tree('<Endless name="e"/>', Endless)
    tree.root.set_post_tick_function(lambda node, status: Status.FAILURE)
    assert tree.tick_once() is Status.FAILURE


# --- what a tick may raise and return


@pytest.mark.parametrize("guard", ["", '_skipIf="false"'])
@pytest.mark.parametrize("said", [None, 1, 0, "SUCCESS", Status.IDLE, 2.0, 7])
def test_only_a_status_or_a_bool_ends_a_tick(said: Any, guard: str, make_tree: Grow) -> None:
    class Odd(Condition):
        def tick(self) -> Any:
            return said

    error = raised(make_tree(f'<Sequence><Odd name="o" {guard}/></Sequence>', Odd))
    assert error.path == "o"
    assert "not IDLE" in str(error) if said is Status.IDLE else repr(said) in str(error)


@pytest.mark.parametrize("body", ["<Stop/>", "<Inverter><Stop/></Inverter>", '<Stop _skipIf="false"/>'])
def test_an_interruption_leaves_a_tree_that_goes_on_where_it_was(body: str, make_tree: Grow) -> None:
    class Stop(SyncAction):
        calls = 0

        def tick(self) -> bool:
            self.calls += 1
            if self.calls == 1:
                raise KeyboardInterrupt
            return True

    tree = make_tree(f'<SequenceWithMemory><PlanSync name="a" plan="S"/>{body}</SequenceWithMemory>', Stop)
    with pytest.raises(KeyboardInterrupt):
        tree.tick_once()
    tree.tick_once()
    assert tree.find(Stop)[0].calls == 2


@pytest.mark.parametrize("kind", ["Sequence", "SequenceWithMemory", "Fallback"])
def test_after_an_error_only_the_sequence_with_memory_goes_on_at_the_child_that_raised(
    kind: str, make_tree: Grow, journal: CallLog
) -> None:
    plan = "F" if kind == "Fallback" else "S"
    tree = make_tree(
        f'<{kind}><PlanSync name="a" plan="{plan}"/><PlanSync name="x" plan="X{plan}"/></{kind}>'
    )
    raised(tree)
    journal.take()
    tree.tick_once()
    assert journal.take() == (["x:tick"] if kind == "SequenceWithMemory" else ["a:tick", "x:tick"])


def test_one_that_halts_its_own_tree_within_a_tick_stays_with_its_result(make_tree: Grow) -> None:
    class Reckless(SyncAction):
        tree: Tree

        def tick(self) -> bool:
            self.tree.halt()
            return True

    tree = make_tree('<Sequence><PlanSync plan="S"/><Reckless/></Sequence>', Reckless)
    tree.find(Reckless)[0].tree = tree
    assert tree.tick_once() is Status.SUCCESS
    assert all(node.status is Status.IDLE for node in tree)
    assert tree.tick_once() is Status.SUCCESS


# --- in an event loop


def test_run_raises_the_same_and_names_the_same(make_tree: Grow) -> None:
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
