"""A plan for all leaves of a tree."""

import enum
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import pytest

import btcore
from btcore import In, NodeExecutionError, Put, Registry, SimClock, Status, Tree, action, condition
from btcore.testing import Harness, LeafPlanError, MockAction, MockCondition, Outcomes, with_mock_leaves
from btcore.testing.mock_leaves import GivenOutputs

Patrol = Callable[..., Harness]


def load_planned(body: str) -> Tree:
    return btcore.loads(
        f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>',
        nodes=with_mock_leaves(Registry.standard()),
        clock=SimClock(),
    )


def test_leaves_take_entries_in_the_order_in_which_they_start() -> None:
    tree = load_planned("<Parallel><Act/><Ask/><Act/></Parallel>")
    plan = Outcomes("RS", "S", "RRF")
    assert plan.drive(tree, ticks=3) == [Status.RUNNING, Status.RUNNING, Status.FAILURE]


def test_an_action_runs_for_every_r_and_then_ends() -> None:
    assert Outcomes("RRS").drive(load_planned("<Act/>"), ticks=4) == [
        Status.RUNNING,
        Status.RUNNING,
        Status.SUCCESS,
        Status.RUNNING,
    ]


def test_condition_returns_the_last_letter_immediately() -> None:
    assert Outcomes("RRF").drive(load_planned("<Ask/>"), ticks=2) == [Status.FAILURE, Status.FAILURE]


def test_a_condition_fails_where_an_action_is_skipped() -> None:
    assert Outcomes("K").drive(load_planned("<Ask/>"), ticks=1) == [Status.FAILURE]
    assert Outcomes("K").drive(load_planned("<Act/>"), ticks=1) == [Status.SKIPPED]


def test_entries_repeat_after_the_last_entry() -> None:
    results = Outcomes("S", "F", "K").drive(load_planned("<Act/>"), ticks=5)
    assert [status.name for status in results] == ["SUCCESS", "FAILURE", "SKIPPED", "SUCCESS", "FAILURE"]


def test_a_plan_may_raise() -> None:
    with pytest.raises(NodeExecutionError) as raised:
        Outcomes("RX").drive(load_planned("<Act/>"))
    assert isinstance(raised.value.cause, LeafPlanError)


def test_leaves_succeed_without_a_plan() -> None:
    assert load_planned("<Sequence><Act/><Ask/></Sequence>").tick_once() is Status.SUCCESS


def test_drive_lets_time_pass_between_ticks() -> None:
    tree = load_planned('<Sequence><Act/><Sleep msec="100"/></Sequence>')
    assert Outcomes("S").drive(tree, ticks=3, period=0.05)[-1] is Status.SUCCESS


def test_plan_restarts_when_it_is_attached() -> None:
    plan = Outcomes("S", "F")
    assert plan.drive(load_planned("<Act/>"), ticks=1) == plan.drive(load_planned("<Act/>"), ticks=1)


@pytest.mark.parametrize("entries", [(), ("",), ("R",), ("SS",), ("S", "RSF"), ("s",), ("RRZ",)])
def test_invalid_plan_is_refused(entries: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match="a plan has entries such as"):
        Outcomes(*entries)


def test_plans_are_compared_and_shown_by_their_entries() -> None:
    assert Outcomes("S", "RF") == Outcomes("S", "RF") != Outcomes("S")
    assert repr(Outcomes("S", "RF")) == "Outcomes('S', 'RF')"
    assert len({Outcomes("S"), Outcomes("S")}) == 1


# --- leaves of a registry


class Arm:
    """A resource that a leaf requires and that the test does not provide."""


@action
def grasp(force: In[float], arm: Arm) -> bool:
    raise AssertionError("the real leaf is ticked")


@condition
def holding(arm: Arm) -> bool:
    raise AssertionError("the real leaf is ticked")


def test_leaves_of_a_registry_follow_the_plan_and_need_no_resources() -> None:
    nodes = Registry.standard()
    nodes.add(grasp, holding)
    text = (
        '<root BTCPP_format="4"><BehaviorTree ID="Main">'
        '<Fallback><Holding/><Grasp force="3"/><AlwaysFailure/></Fallback></BehaviorTree></root>'
    )
    tree = btcore.loads(text, nodes=with_mock_leaves(nodes), clock=SimClock())
    assert [type(node) for node in tree][1:3] == [MockCondition, MockAction]
    assert tree.nodes[2].get_input("force") == 3
    assert Outcomes("F", "RS").drive(tree, ticks=2) == [Status.RUNNING, Status.SUCCESS]
    assert "Act" not in nodes
    assert nodes.substitutions == {}


class Colour(enum.Enum):
    RED = 1
    GREEN = 2


@dataclass
class Position:
    x: float
    colour: Colour = Colour.RED


class Found(NamedTuple):
    at: Position
    ids: list[int]


@action
def detect(
    count: Put[int], text: Put[str], ok: Put[bool], found: Put[Found], arm: Put[Arm], unused: Put[float]
) -> bool:
    raise AssertionError("the real leaf is ticked")


PORTS = 'count="{count}" text="{text}" ok="{ok}" found="{found}" arm="{arm}"'


def detected(outputs: GivenOutputs | None = None, *entries: str) -> dict[str, object]:
    """Return the blackboard after two mock leaves have succeeded."""
    nodes = Registry.standard()
    nodes.add(detect)
    tree = btcore.loads(
        f"""<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>
        <Detect name="first" {PORTS}/><Detect count="{{again}}"/></Sequence></BehaviorTree></root>""",
        nodes=with_mock_leaves(nodes, outputs),
        clock=SimClock(),
    )
    Outcomes(*entries or "S").drive(tree, ticks=1)
    return dict(tree.blackboard.items())


def test_leaves_that_succeed_write_values_of_the_types_of_their_outputs() -> None:
    board = detected()
    assert {key: type(value) for key, value in board.items()} == {
        "count": int, "text": str, "ok": bool, "found": Found, "again": int
    }  # fmt: skip
    found = board["found"]
    assert isinstance(found, Found)
    assert isinstance(found.at, Position)
    assert isinstance(found.at.colour, Colour)
    assert all(type(id) is int for id in found.ids)
    assert detected() == board
    assert len({detected(None, "S", *"S" * repeats)["count"] for repeats in range(9)}) > 1
    assert detected(None, "F") == {}
    assert detected(None, "RS") == {}


def test_given_outputs_are_written_and_a_name_takes_precedence_over_an_id() -> None:
    arm = Arm()
    board = detected({"Detect": {"count": 7, "arm": arm}, "first": {"count": 8}})
    assert (board["count"], board["again"], board["arm"]) == (8, 7, arm)


@pytest.mark.parametrize(
    ("outputs", "message"),
    [
        ({"Detekt": {}}, "outputs: the tree has no mock leaf 'Detekt'; did you mean 'Detect'?"),
        ({"Detect": {"coutn": 1}}, "outputs: 'Detect' has no output port 'coutn'; did you mean 'count'?"),
        ({"first": {"zzz": 1}}, "outputs: 'first' has no output port 'zzz'"),
    ],
)
def test_unknown_names_in_given_outputs_are_refused(outputs: GivenOutputs, message: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        detected(outputs)


def test_existing_substitution_rule_is_kept() -> None:
    nodes = Registry.standard()
    nodes.add(holding)
    nodes.substitute("Holding", "AlwaysFailure")
    text = '<root BTCPP_format="4"><BehaviorTree ID="Main"><Holding/></BehaviorTree></root>'
    tree = btcore.loads(text, nodes=with_mock_leaves(nodes), clock=SimClock())
    assert tree.tick_once() is Status.FAILURE


def test_tree_without_mock_leaves_is_refused_with_advice() -> None:
    nodes = Registry.standard()
    nodes.add(holding)
    text = (
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><Inverter><Holding/></Inverter></BehaviorTree></root>'
    )
    tree = btcore.loads(text, nodes=nodes, resources=[Arm()], clock=SimClock())
    with pytest.raises(
        ValueError, match=r"'Holding::2' is an ordinary leaf\); load it with nodes=with_mock_leaves"
    ):
        Outcomes("S").drive(tree)
