"""Regression tests for bugs that users of BehaviorTree.CPP reported, named after the issues there."""

from collections import deque
from typing import Any

import pytest

import btcore
from btcore import (
    DecoratorNode,
    In,
    NodeExecutionError,
    Out,
    PortError,
    Registry,
    SimClock,
    Status,
    SyncAction,
    Tree,
    TreeError,
    XmlSyntaxError,
    action,
)
from btcore.lint.validate import validate_document
from btcore.testing import load_substitution_rules
from btcore.xml.read.read import parse_text
from tests.btcore.conftest import TreeFactory

R, S, F = Status.RUNNING, Status.SUCCESS, Status.FAILURE


def named(tree: Tree, *names: str) -> list[Any]:
    nodes = {node.name: node for node in tree}
    return [nodes[name] for name in names]


def ticks(tree: Tree, count: int) -> list[Status]:
    return [tree.tick_exactly_once() for _ in range(count)]


# --- loops


def test_cpp_909_a_literal_loop_queue_starts_again(make_tree: TreeFactory) -> None:
    seen: list[int] = []

    @action
    def visit(number: In[int]) -> bool:
        seen.append(number)
        return True

    tree = make_tree('<LoopInt queue="4;5;6" value="{n}"><Visit number="{n}"/></LoopInt>', visit)
    assert tree.tick_while_running() is S
    assert tree.tick_while_running() is S
    assert seen == [4, 5, 6, 4, 5, 6]


def test_cpp_909_a_literal_queue_starts_again_after_a_halt_and_a_failure(make_tree: TreeFactory) -> None:
    tree = make_tree('<LoopInt queue="1;2;3" value="{n}"><Act name="leaf" outcomes="SSSFSSS"/></LoopInt>')
    ticks(tree, 2)
    tree.halt()
    assert ticks(tree, 2) == [R, F]
    assert tree.blackboard["n"] == 2
    assert ticks(tree, 4) == [R, R, R, S]
    assert tree.blackboard["n"] == 3


@pytest.mark.parametrize(("outcomes", "result"), [("S|RF", F), ("S|RS", S), ("S|F", F)])
def test_cpp_621_the_last_element_of_a_queue_determines_the_result(
    outcomes: str, result: Status, make_tree: TreeFactory
) -> None:
    tree = make_tree(
        f'<LoopInt queue="{{q}}" value="{{n}}"><Act name="leaf" outcomes="{outcomes}"/></LoopInt>'
    )
    tree.blackboard["q"] = deque([1, 2])
    assert tree.tick_while_running() is result
    assert tree.blackboard["n"] == 2
    assert list(tree.blackboard["q"]) == []


# --- reactive nodes


def test_cpp_586_alternating_retries_are_never_running_at_the_same_time(make_tree: TreeFactory) -> None:
    tree = make_tree(
        "<ReactiveSequence>"
        '<RetryUntilSuccessful name="first" num_attempts="-1"><Act outcomes="FFS"/></RetryUntilSuccessful>'
        '<RetryUntilSuccessful name="second" num_attempts="2"><Act name="leaf" outcomes="RF"/>'
        "</RetryUntilSuccessful></ReactiveSequence>"
    )
    running = []
    for _ in range(3):
        assert tree.tick_exactly_once() is R
        running.append([node.name for node in named(tree, "first", "second") if node.status is R])
    assert running == [["first"], ["first"], ["second"]]


class CheckSensor(DecoratorNode):
    """Returns SUCCESS while the sensor is good; otherwise ticks the child, which repairs the sensor."""

    bad: In[bool]

    def tick(self) -> Status:
        return self.children[0].execute_tick() if self.bad else S


@pytest.mark.parametrize("format", [3, 4])
def test_cpp_573_earlier_child_that_starts_halts_later_child(format: int, make_tree: TreeFactory) -> None:
    tree = make_tree(
        '<ReactiveSequence><CheckSensor name="check" bad="{bad}"><Act name="repair" outcomes="RRS"/>'
        '</CheckSensor><Act name="work" outcomes="R"/></ReactiveSequence>',
        CheckSensor,
        format=format,
    )
    calls = make_tree.calls.take
    tree.blackboard["bad"] = False
    assert (ticks(tree, 2), calls()) == ([R, R], ["work:start", "work:running"])
    tree.blackboard["bad"] = True
    assert (ticks(tree, 1), calls()) == ([R], ["repair:start", "work:halted"])
    assert [node.status for node in named(tree, "check", "work")] == [R, Status.IDLE]
    tree.blackboard["bad"] = False
    assert ticks(tree, 1) == [R]
    assert named(tree, "work")[0].status is R


BACKCHAINED = (
    '<ReactiveFallback><Act name="a" outcomes="F|R"/><Act name="b" outcomes="R"/></ReactiveFallback>'
)


@pytest.mark.parametrize("format", [3, 4])
def test_cpp_1031_halt_order_is_the_originals_and_one_child_runs_after_the_tick(
    format: int, make_tree: TreeFactory
) -> None:
    tree = make_tree(BACKCHAINED, format=format)
    ticks(tree, 1)
    assert make_tree.calls.take() == ["a:start", "b:start"]
    ticks(tree, 1)
    assert make_tree.calls.take() == ["a:start", "b:halted"]
    assert [node.status for node in named(tree, "a", "b")] == [R, Status.IDLE]


def test_cpp_1031_two_asynchronous_children_of_a_reactive_node_are_reported() -> None:
    text = (
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><ReactiveFallback>\n'
        '<Delay delay_msec="5"><AlwaysFailure/></Delay>\n<Sleep msec="7"/>\n'
        "</ReactiveFallback></BehaviorTree></root>"
    )
    found = validate_document(parse_text(text, "t.xml"), nodes=Registry.standard())
    assert [(diagnostic.code, diagnostic.line) for diagnostic in found] == [("W106", 3)]


# --- ports and blackboards


def test_cpp_605_a_subtrees_write_reaches_the_outer_entry_and_keeps_its_type(make_tree: TreeFactory) -> None:
    @action
    def look(flag: In[bool]) -> bool:
        return flag

    tree = make_tree(
        '<Sequence><Script code="mine := true"/><Look flag="{mine}"/>'
        '<SubTree ID="Inner" theirs=" {mine}  "/><Inverter><Look flag="{mine}"/></Inverter></Sequence>',
        look,
        others='<BehaviorTree ID="Inner"><Script code="theirs := false"/></BehaviorTree>',
    )
    assert tree.blackboard.find("mine").declared.name == "bool"
    assert tree.tick_once() is S
    assert not tree.blackboard["mine"]
    assert tree.blackboard.find("mine").declared.name == "bool"
    assert list(tree.blackboard) == ["mine"]


class Measure(SyncAction):
    length: Out[float]

    def tick(self) -> Status:
        self.length = 1.5
        return S


class Say(SyncAction):
    answer: Out[bool]

    def tick(self) -> Status:
        self.answer = True
        return S


EMPTY_OUTPUTS = '<Sequence>\n<Measure length=""/>\n<Say answer=""/></Sequence>'


def test_cpp_716_empty_output_ports_are_refused_at_load_with_name_and_place(make_tree: TreeFactory) -> None:
    with pytest.raises(PortError) as refused:
        make_tree(EMPTY_OUTPUTS, Measure, Say)
    places = [(diagnostic.line, diagnostic.column) for diagnostic in refused.value.diagnostics]
    assert places == [(2, 17), (3, 13)]
    assert "the port 'length' of <Measure>" in str(refused.value)
    assert "the port 'answer' of <Say>" in str(refused.value)


def test_cpp_716_in_format_3_writing_an_empty_port_raises_with_its_name(make_tree: TreeFactory) -> None:
    tree = make_tree(EMPTY_OUTPUTS, Measure, Say, format=3)
    with pytest.raises(NodeExecutionError, match=r"<Measure>.*port \[length\].*not a blackboard entry"):
        tree.tick_once()
    assert list(tree.blackboard) == []


@pytest.mark.parametrize(
    ("variable", "same"),
    [
        ("3", True),
        ("3.0", True),
        ("3e0", True),
        ("3rd", False),
        ("3.0m", False),
        ("3;4", False),
        ("3 ", False),
        ("0x3", False),
        ("three", False),
    ],
)
def test_cpp_pr_1178_trailing_characters_in_switch(variable: str, same: bool, make_tree: TreeFactory) -> None:
    tree = make_tree(
        f'<Switch2 variable="{variable}" case_1="1" case_2="3"><Act name="one" outcomes="S"/>'
        '<Act name="three" outcomes="S"/><Act name="other" outcomes="S"/></Switch2>'
    )
    assert tree.tick_once() is S
    assert make_tree.calls == ["three:start" if same else "other:start"]


# --- substitution, time


def test_cpp_930_substitution_rules_without_configurations(make_tree: TreeFactory) -> None:
    nodes = Registry.standard()
    nodes.add(Measure)
    load_substitution_rules(nodes, '{"SubstitutionRules": {"Measure": "AlwaysFailure"}}')
    assert make_tree("<Measure/>", nodes=nodes).tick_while_running() is F


def test_cpp_888_sleep_returns_at_once_before_a_synchronous_retry(make_tree: TreeFactory) -> None:
    tree = make_tree('<RetryUntilSuccessful num_attempts="3"><Act outcomes="F"/></RetryUntilSuccessful>')
    message = [(tree.tick_exactly_once(), tree.sleep(1.0)) for _ in range(3)]
    assert message == [(R, True), (R, True), (F, False)]
    assert tree.clock.now() == 1_000_000_000
    assert tree.tick_once() is F
    assert tree.ticks == 6


def test_cpp_888_a_retry_of_a_running_leaf_waits_for_the_period(make_tree: TreeFactory) -> None:
    tree = make_tree('<RetryUntilSuccessful num_attempts="3"><Act outcomes="RF"/></RetryUntilSuccessful>')
    assert tree.tick_while_running(period=0.5) is F
    assert tree.clock.now() == 1_500_000_000


# --- hostile XML


def nested(levels: int, format: int = 4) -> str:
    opened, closed = "<Inverter>" * (levels - 1), "</Inverter>" * (levels - 1)
    body = f'<BehaviorTree ID="Main">{opened}<AlwaysSuccess/>{closed}</BehaviorTree>'
    return f'<root BTCPP_format="{format}" main_tree_to_execute="Main">{body}</root>'


@pytest.mark.parametrize("format", [3, 4])
@pytest.mark.parametrize("levels", [257, 5_000, 50_000])
def test_cpp_672_hostile_xml_nesting_is_refused(levels: int, format: int) -> None:
    with pytest.raises(XmlSyntaxError, match=r"nested more than (256|2048) deep"):
        btcore.loads(nested(levels, format))


def test_cpp_672_nesting_within_the_limit_loads_and_ticks() -> None:
    tree = btcore.loads(nested(256), clock=SimClock())
    assert len(tree.nodes) == 256
    assert tree.tick_once() is F


@pytest.mark.parametrize(
    ("trees", "circle"),
    [
        ({"Main": "Main"}, "Main → Main"),
        ({"Main": "Left", "Left": "Right", "Right": "Main"}, "Main → Left → Right → Main"),
        ({"Main": "Left", "Left": "Right", "Right": "Left"}, "Left → Right → Left"),
    ],
)
def test_cpp_672_trees_that_contain_themselves_are_refused(trees: dict[str, str], circle: str) -> None:
    text = "".join(
        f'<BehaviorTree ID="{id}"><Inverter><SubTree ID="{called}"/></Inverter></BehaviorTree>'
        for id, called in trees.items()
    )
    with pytest.raises(TreeError, match=f"call each other recursively: {circle}"):
        btcore.loads(f'<root BTCPP_format="4" main_tree_to_execute="Main">{text}</root>')


def test_cpp_672_exponentially_many_nodes_are_refused_before_any_is_created() -> None:
    doubling = "".join(
        f'<BehaviorTree ID="T{level}"><Sequence><SubTree ID="T{level + 1}"/><SubTree ID="T{level + 1}"/>'
        "</Sequence></BehaviorTree>"
        for level in range(40)
    )
    last = '<BehaviorTree ID="T40"><AlwaysSuccess/></BehaviorTree>'
    with pytest.raises(TreeError, match=r"1:\d+: E117 with all its subtrees the tree has more than 65,535"):
        btcore.loads(f'<root BTCPP_format="4" main_tree_to_execute="T0">{doubling}{last}</root>')
