"""A leaf that raises while being ticked or halted: the tree is halted, and the error names the node."""

from collections.abc import Callable
from pathlib import Path

import pytest

import btcore
from btcore import (
    NodeExecutionError,
    Observer,
    Registry,
    SimClock,
    StatefulAction,
    Status,
    SyncAction,
    Tree,
    action,
)
from tests.btcore.conftest import TreeFactory
from tests.conformance.recorded_cases import CallLog


class Explode(SyncAction):
    def tick(self) -> Status:
        raise ValueError("the fuse was lit")


class Cling(StatefulAction):
    """Runs, and raises when it is halted."""

    def on_start(self) -> Status:
        return Status.RUNNING

    def on_running(self) -> Status:
        return Status.RUNNING

    def on_halted(self) -> None:
        raise OSError(f"{self.name} can't let go")


def tick_raises(tree: Tree) -> NodeExecutionError:
    with pytest.raises(NodeExecutionError) as caught:
        tree.tick_once()
    return caught.value


def halt_raises(tree: Tree) -> NodeExecutionError:
    with pytest.raises(NodeExecutionError) as caught:
        tree.halt()
    return caught.value


def idle(tree: Tree) -> bool:
    return {node.status for node in tree} == {Status.IDLE}


# --- while ticking

PARALLEL = (
    '<Parallel name="all" success_count="3">'
    '<Act name="a" outcomes="R"/><Inverter name="i"><Explode name="boom"/></Inverter>'
    '<Act name="b" outcomes="R"/></Parallel>'
)


def test_error_names_node_id_position_and_cause(tmp_path: Path) -> None:
    file = tmp_path / "mission.xml"
    file.write_text(
        '<root BTCPP_format="4">\n <BehaviorTree ID="Main">\n  <Inverter>\n   <Explode/>\n'
        "  </Inverter>\n </BehaviorTree>\n</root>\n",
        encoding="utf-8",
    )
    nodes = Registry.standard()
    nodes.add(Explode)
    error = tick_raises(btcore.load(file, nodes=nodes, clock=SimClock()))
    assert (error.path, error.node_id) == ("Explode::2", "Explode")
    assert error.where == f"{file}:4"
    assert isinstance(error.__cause__, ValueError)
    assert error.cause is error.__cause__
    assert str(error).splitlines() == [
        f"{file}:4: node 'Explode::2' <Explode> raised while ticking: ValueError: the fuse was lit",
        "      Inverter::1",
        "    →   Explode::2",
    ]


def test_backtrace_leads_from_the_root_through_subtrees(make_tree: TreeFactory) -> None:
    tree = make_tree(
        '<Sequence name="s"><SubTree ID="Sub" name="inner"/></Sequence>',
        Explode,
        others='<BehaviorTree ID="Sub"><Fallback name="f"><Explode name="boom"/></Fallback></BehaviorTree>',
    )
    assert tick_raises(tree).backtrace == ["s", "inner", "inner/f", "inner/boom"]


def test_exception_halts_the_tree_and_the_running_siblings(make_tree: TreeFactory, calls: CallLog) -> None:
    tree = make_tree(PARALLEL, Explode)
    tick_raises(tree)
    assert calls == ["a:start", "a:halted"]
    assert idle(tree)
    assert tree.status is Status.IDLE


@pytest.mark.parametrize("step", [Tree.tick_exactly_once, Tree.tick_once, Tree.tick_while_running])
def test_every_tick_method_raises_the_error(step: Callable[[Tree], Status], make_tree: TreeFactory) -> None:
    with pytest.raises(NodeExecutionError):
        step(make_tree("<Explode/>", Explode))


def test_observers_are_notified_of_an_error_before_the_tree_is_halted(make_tree: TreeFactory) -> None:
    received: list[tuple[str, int, list[str]]] = []

    class Listener(Observer):
        def raised(self, error: NodeExecutionError, stamp: int) -> None:
            received.append(
                (error.path, stamp, [node.name for node in tree if node.status is Status.RUNNING])
            )

    tree = make_tree(PARALLEL, Explode)
    tree.subscribe(Listener())
    tree.sleep(0.5)
    tick_raises(tree)
    assert received == [("boom", 500_000_000, ["all", "a", "i"])]


def test_error_of_following_halt_does_not_hide_first_error(make_tree: TreeFactory, calls: CallLog) -> None:
    tree = make_tree(
        '<Parallel success_count="4"><Cling name="c"/><Act name="a" outcomes="R"/><Cling name="d"/>'
        '<Explode name="boom"/></Parallel>',
        Explode,
        Cling,
    )
    error = tick_raises(tree)
    assert error.path == "boom"
    assert all(message in str(error) for message in ("the fuse was lit", "c can't let go", "d can't let go"))
    assert idle(tree)
    assert calls == ["a:start", "a:halted"]


@pytest.mark.parametrize("script", ['_skipIf="missing == 1"', '_onSuccess="missing += 1"'])
def test_script_that_cannot_be_run_names_its_own_node(script: str, make_tree: TreeFactory) -> None:
    error = tick_raises(make_tree(f'<Sequence><AlwaysSuccess name="a" {script}/></Sequence>'))
    assert error.path == "a"
    assert "missing" in str(error)


def test_interruption_is_not_wrapped(make_tree: TreeFactory) -> None:
    class Interrupted(SyncAction):
        def tick(self) -> Status:
            raise KeyboardInterrupt

    tree = make_tree('<Parallel><Act name="a" outcomes="R"/><Interrupted/></Parallel>', Interrupted)
    with pytest.raises(KeyboardInterrupt):
        tree.tick_once()
    tree.halt()
    assert idle(tree)


# --- while halting


def test_leaf_that_raises_when_halted_is_named_and_becomes_idle(make_tree: TreeFactory) -> None:
    tree = make_tree('<Sequence name="s"><Cling name="c"/></Sequence>', Cling)
    tree.tick_once()
    error = halt_raises(tree)
    assert (error.path, error.node_id, error.doing) == ("c", "Cling", "being halted")
    assert "node 'c' <Cling> raised while being halted: OSError: c can't let go" in str(error)
    assert isinstance(error.__cause__, OSError)
    assert idle(tree)
    assert tree.status is Status.IDLE


def test_other_leaves_are_halted_too_and_first_error_is_raised(
    make_tree: TreeFactory, calls: CallLog
) -> None:
    tree = make_tree(
        '<Parallel><Act name="a" outcomes="R"/><Cling name="c1"/><Act name="b" outcomes="R"/>'
        '<Inverter><Cling name="c2"/></Inverter><Act name="d" outcomes="R"/></Parallel>',
        Cling,
    )
    tree.tick_once()
    calls.take()
    assert halt_raises(tree).path == "c1"
    assert calls.take() == ["a:halted", "b:halted", "d:halted"]
    assert idle(tree)


def test_leaf_halted_by_parent_in_tick_raises_error_of_tick(make_tree: TreeFactory, calls: CallLog) -> None:
    tree = make_tree(
        '<ReactiveSequence><Ask name="q" outcomes="SF"/><Cling name="c"/></ReactiveSequence>', Cling
    )
    tree.tick_once()
    error = tick_raises(tree)
    assert (error.path, error.doing) == ("c", "being halted")
    assert idle(tree)


@pytest.mark.parametrize(
    "around",
    [
        "<Inverter>{}</Inverter>",
        '<Timeout msec="100">{}</Timeout>',
        '<Repeat num_cycles="3">{}</Repeat>',
        "<IfThenElse><AlwaysSuccess/>{}</IfThenElse>",
        '<Switch2 variable="1" case_1="1" case_2="2">{}<AlwaysSuccess/><AlwaysSuccess/></Switch2>',
        "<TryCatch>{}<AlwaysSuccess/></TryCatch>",
        '<SequenceWithMemory><Act name="x" outcomes="S"/>{}</SequenceWithMemory>',
    ],
)
def test_nothing_stays_running_under_any_parent(around: str, make_tree: TreeFactory) -> None:
    tree = make_tree(around.format('<Cling name="c"/>'), Cling)
    assert tree.tick_exactly_once() is Status.RUNNING
    if tree.find(Cling)[0].status is Status.IDLE:
        tree.tick_exactly_once()
    assert tree.find(Cling)[0].status is Status.RUNNING
    assert halt_raises(tree).path == "c"
    assert idle(tree)


def test_script_that_cannot_be_run_on_a_halt_names_its_node(make_tree: TreeFactory) -> None:
    tree = make_tree('<Sequence><Act name="a" outcomes="R" _onHalted="x += 1"/></Sequence>')
    tree.tick_once()
    assert halt_raises(tree).path == "a"
    assert idle(tree)


def test_observers_are_notified_of_an_error_while_halting(make_tree: TreeFactory) -> None:
    received: list[str] = []

    class Listener(Observer):
        def raised(self, error: NodeExecutionError, stamp: int) -> None:
            received.append(error.path)

    tree = make_tree('<Cling name="c"/>', Cling)
    tree.subscribe(Listener())
    tree.tick_once()
    halt_raises(tree)
    assert received == ["c"]


class Leaving(BaseException):
    """A BaseException, which no leaf should raise."""


@pytest.mark.parametrize("fault", [SystemExit(7), Leaving("gone")])
def test_any_base_exception_of_a_leaf_names_the_leaf(fault: BaseException, make_tree: TreeFactory) -> None:
    @action
    def leave() -> bool:
        raise fault

    tree = make_tree('<Leave name="door"/>', leave)
    with pytest.raises(NodeExecutionError, match="node 'door' <Leave> raised while ticking") as caught:
        tree.tick_once()
    assert caught.value.__cause__ is fault
    assert tree.root.status is Status.IDLE
