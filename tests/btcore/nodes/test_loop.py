"""LoopInt, LoopBool, LoopDouble, LoopString and loops of a user's type: one element per tick."""

from collections import deque
from dataclasses import dataclass
from typing import Any

import pytest

from btcore import In, LoopNode, NodeExecutionError, Out, Registry, Status, Tree, TreeError, action, loads
from tests.btcore.conftest import TreeFactory
from tests.conformance.recorded_cases import CallLog

R, S, F, K = Status.RUNNING, Status.SUCCESS, Status.FAILURE, Status.SKIPPED


class Sink:
    def __init__(self) -> None:
        self.got: list[object] = []


@action
def take(value: In[Any], sink: Sink) -> bool:
    sink.got.append(value)
    return True


@pytest.fixture
def sink() -> Sink:
    return Sink()


def ticks(tree: Tree, count: int) -> list[Status]:
    return [tree.tick_once() for _ in range(count)]


@pytest.mark.parametrize(
    ("tag", "text", "elements"),
    [
        ("LoopInt", "1;2;3", [1, 2, 3]),
        ("LoopDouble", "1;2.5", [1.0, 2.5]),
        ("LoopBool", "true;0;", [True, False]),
        ("LoopString", "a;b c", ["a", "b c"]),
    ],
)
def test_loop_takes_one_element_per_tick_and_one_tick_to_end(
    tag: str, text: str, elements: list[object], make_tree: TreeFactory, sink: Sink
) -> None:
    tree = make_tree(
        f'<{tag} queue="{text}" value="{{v}}"><Take value="{{v}}"/></{tag}>', take, resources=[sink]
    )
    assert ticks(tree, len(elements) + 1) == [R] * len(elements) + [S]
    assert sink.got == elements
    assert [type(one) for one in sink.got] == [type(one) for one in elements]


def test_loop_emits_no_wake_up(make_tree: TreeFactory, sink: Sink) -> None:
    tree = make_tree('<LoopInt queue="1;2" value="{v}"><Take value="{v}"/></LoopInt>', take, resources=[sink])
    tree.tick_once()
    assert tree.ticks == 1


@pytest.mark.parametrize("written", ["SUCCESS", "FAILURE", "SKIPPED"])
def test_empty_queue_returns_if_empty(written: str, make_tree: TreeFactory) -> None:
    tree = make_tree(f'<LoopInt queue="" if_empty="{written}" value="{{v}}"><AlwaysSuccess/></LoopInt>')
    assert tree.tick_once() is Status[written]


def test_halt_halts_the_child_and_restarts_a_literal_list(make_tree: TreeFactory, calls: CallLog) -> None:
    tree = make_tree('<LoopInt queue="1;2" value="{v}"><Act name="a" outcomes="S|RR|S"/></LoopInt>')
    ticks(tree, 2)
    assert tree.blackboard["v"] == 2
    tree.halt()
    assert calls[-1] == "a:halted"
    ticks(tree, 1)
    assert tree.blackboard["v"] == 1


def test_a_deque_on_the_blackboard_is_consumed_in_place(make_tree: TreeFactory, sink: Sink) -> None:
    tree = make_tree('<LoopInt queue="{q}" value="{v}"><Take value="{v}"/></LoopInt>', take, resources=[sink])
    queue: deque[int] = deque([1, 2])
    tree.blackboard["q"] = queue
    ticks(tree, 1)
    assert list(queue) == [2]
    queue.append(3)
    assert ticks(tree, 3) == [R, R, S]
    assert sink.got == [1, 2, 3]


def test_failure_leaves_the_rest_in_a_deque(make_tree: TreeFactory) -> None:
    tree = make_tree('<LoopInt queue="{q}" value="{v}"><AlwaysFailure/></LoopInt>')
    queue: deque[int] = deque([1, 2, 3])
    tree.blackboard["q"] = queue
    assert ticks(tree, 2) == [F, F]
    assert list(queue) == [3]


@pytest.mark.parametrize("given", [[1, 2], "1;2"])
def test_list_or_text_is_read_at_activation_and_kept(
    given: object, make_tree: TreeFactory, sink: Sink
) -> None:
    tree = make_tree('<LoopInt queue="{q}" value="{v}"><Take value="{v}"/></LoopInt>', take, resources=[sink])
    tree.blackboard["q"] = given
    ticks(tree, 1)
    tree.blackboard["q"] = [7, 8] if isinstance(given, list) else "7;8"
    assert ticks(tree, 5) == [R, S, R, R, S]
    assert sink.got == [1, 2, 7, 8]


@pytest.mark.parametrize("removed", [False, True])
def test_queue_without_a_value_raises(removed: bool, make_tree: TreeFactory) -> None:
    tree = make_tree('<LoopInt queue="{q}" value="{v}"><AlwaysFailure/></LoopInt>')
    if removed:
        tree.blackboard.unset("q")
    with pytest.raises(NodeExecutionError, match=r"\{q\}, which has no value"):
        tree.tick_once()


def test_literal_value_is_ignored(make_tree: TreeFactory) -> None:
    for loop in ('LoopInt queue="1" value="7"', 'LoopString queue="a" value="x"'):
        tree = make_tree(f"<{loop}><AlwaysSuccess/></{loop.split()[0]}>")
        assert ticks(tree, 2) == [R, S]


@pytest.mark.parametrize(
    ("queue", "message"), [("", "queue"), ('queue="="', "queue"), ('queue="1;two"', "two")]
)
def test_missing_or_invalid_queue_is_a_tree_error(queue: str, message: str, make_tree: TreeFactory) -> None:
    with pytest.raises(TreeError, match=message):
        make_tree(f'<LoopInt {queue} value="{{v}}"><AlwaysSuccess/></LoopInt>')


def test_equals_sign_is_a_list_and_not_the_entry_of_the_port(make_tree: TreeFactory, sink: Sink) -> None:
    loop = '<LoopString queue="=" value="{v}"><Take value="{v}"/></LoopString>'
    assert ticks(make_tree(loop, take, resources=[sink]), 2) == [R, S]
    assert sink.got == ["="]


def test_value_port_is_optional(make_tree: TreeFactory) -> None:
    assert ticks(make_tree('<LoopInt queue="1"><AlwaysSuccess/></LoopInt>'), 2) == [R, S]


@dataclass
class Pose:
    x: float
    y: float


class LoopPose(LoopNode):
    value: Out[Pose]


def tree_of_poses(queue: str, sink: Sink) -> Tree:
    nodes = Registry.standard()
    nodes.add_type(Pose, lambda text: Pose(*map(float, text.split(","))))
    nodes.add(LoopPose, take)
    element = f'<LoopPose queue="{queue}" value="{{pose}}"><Take value="{{pose}}"/></LoopPose>'
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{element}</BehaviorTree></root>'
    return loads(text, nodes=nodes, resources=[sink])


def test_loop_of_a_users_type_converts_the_elements_of_a_text(sink: Sink) -> None:
    tree = tree_of_poses("1,2;3,4", sink)
    assert ticks(tree, 3) == [R, R, S]
    assert sink.got == [Pose(1, 2), Pose(3, 4)]
    entry = tree.blackboard.find("pose")
    assert entry is not None
    assert entry.declared.name == "Pose"


def test_loop_of_a_users_type_takes_its_values_from_an_entry(sink: Sink) -> None:
    tree = tree_of_poses("{poses}", sink)
    tree.blackboard["poses"] = deque([Pose(1, 2), Pose(3, 4)])
    assert ticks(tree, 3) == [R, R, S]
    assert sink.got == [Pose(1, 2), Pose(3, 4)]
    tree.blackboard["poses"] = deque([Pose(1, 2), 3])
    assert tree.tick_once() is R
    with pytest.raises(NodeExecutionError, match=r"port \[value\] takes Pose: 3 is not a valid Pose"):
        tree.tick_once()


def test_port_of_a_users_loop_stays_optional() -> None:
    nodes = Registry.standard()
    nodes.add(LoopPose)
    manifest = nodes.get("LoopPose")
    assert manifest is not None
    assert list(manifest.ports) == ["queue", "if_empty", "value"]
    port = manifest.ports["value"]
    assert (port.type.name, port.optional, port.description) == ("Pose", True, "the current element")
