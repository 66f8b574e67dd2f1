"""Mock leaves: the grammar of their outcomes, and the leaves that follow them.

The outcomes of a leaf are separated into starts by "|": the outcomes of the ticks from one start to its end.
"""

import enum
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import pytest

import btcore
from btcore import In, NodeExecutionError, Put, Registry, SimClock, Status, Tree, action, condition
from btcore.registry.mock_leaves import GivenOutputs
from btcore.registry.outcome_grammar import Outcome, parse_outcomes
from btcore.testing import MockAction, MockCondition, MockLeafError, Outcomes, with_mock_leaves


def load_mocks(body: str) -> Tree:
    return btcore.loads(
        f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>',
        nodes=with_mock_leaves(Registry.standard()),
        clock=SimClock(),
    )


def test_leaves_take_starts_in_the_order_in_which_they_start() -> None:
    tree = load_mocks("<Parallel><Act/><Ask/><Act/></Parallel>")
    assert Outcomes("RS|S|RRF").drive(tree, ticks=3) == [Status.RUNNING, Status.RUNNING, Status.FAILURE]


def test_an_action_runs_for_every_r_and_then_ends() -> None:
    assert Outcomes("RRS").drive(load_mocks("<Act/>"), ticks=4) == [
        Status.RUNNING,
        Status.RUNNING,
        Status.SUCCESS,
        Status.RUNNING,
    ]


def test_condition_returns_the_last_letter_immediately() -> None:
    assert Outcomes("RRF").drive(load_mocks("<Ask/>"), ticks=2) == [Status.FAILURE, Status.FAILURE]


def test_a_condition_fails_where_an_action_is_skipped() -> None:
    assert Outcomes("K").drive(load_mocks("<Ask/>"), ticks=1) == [Status.FAILURE]
    assert Outcomes("K").drive(load_mocks("<Act/>"), ticks=1) == [Status.SKIPPED]


def test_starts_repeat_after_the_last_start() -> None:
    results = Outcomes("S|F|K").drive(load_mocks("<Act/>"), ticks=5)
    assert [status.name for status in results] == ["SUCCESS", "FAILURE", "SKIPPED", "SUCCESS", "FAILURE"]


def test_outcomes_may_raise() -> None:
    with pytest.raises(NodeExecutionError) as raised:
        Outcomes("RX").drive(load_mocks("<Act/>"))
    assert isinstance(raised.value.cause, MockLeafError)


def test_leaves_succeed_without_outcomes() -> None:
    assert load_mocks("<Sequence><Act/><Ask/></Sequence>").tick_once() is Status.SUCCESS


def test_drive_lets_time_pass_between_ticks() -> None:
    tree = load_mocks('<Sequence><Act/><Sleep msec="100"/></Sequence>')
    assert Outcomes("S").drive(tree, ticks=3, period=0.05)[-1] is Status.SUCCESS


def test_outcomes_restart_when_they_are_attached() -> None:
    outcomes = Outcomes("S|F")
    assert outcomes.drive(load_mocks("<Act/>"), ticks=1) == outcomes.drive(load_mocks("<Act/>"), ticks=1)


@pytest.mark.parametrize(
    ("text", "starts"),
    [
        ("RRS|F", ["RRS", "F"]),
        ("SRFRRKX", ["S", "RF", "RRK", "X"]),
        ("RR|R|S", ["RR", "R", "S"]),
        ("R(a=1)S(a=2, b='x, (y)''s')|F", ["RS", "F"]),
    ],
)
def test_outcomes_are_divided_into_starts(text: str, starts: list[str]) -> None:
    parsed = parse_outcomes(text)
    assert ["".join(outcome.letter for outcome in start) for start in parsed] == starts
    assert parse_outcomes("|".join("".join(map(str, start)) for start in parsed)) == parsed


def test_outputs_are_read_as_texts() -> None:
    ((running, end),) = parse_outcomes("RS(a=2, b='x, (y)''s', c=, d=?)")
    assert running == Outcome("R")
    assert end.outputs == (("a", "2"), ("b", "x, (y)'s"), ("c", ""), ("d", "?"))


@pytest.mark.parametrize(
    "text", ["", "|S", "S|", "S||F", "s", "RRZ", "S F", "S()", "S(a)", "S(=1)", "S(a=1", "(a=1)S", "S(a='x)"]
)
def test_invalid_outcomes_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match=f"^invalid outcomes '{re.escape(text)}': write "):
        Outcomes(text)


def test_leaf_with_outcomes_of_its_own_does_not_take_those_of_the_tree() -> None:
    tree = load_mocks('<Sequence><Ask/><Act name="a"/><Act/><Act outcomes="S|RF"/></Sequence>')
    outcomes = Outcomes("S", {"a": "S|RS", "Ask": "SRF"})
    # A condition uses a letter in each tick.
    assert [status.name for status in outcomes.drive(tree, ticks=4)] == [
        "SUCCESS", "RUNNING", "FAILURE", "RUNNING"
    ]  # fmt: skip


def test_outcomes_are_compared_and_shown_by_their_texts() -> None:
    assert Outcomes("S|RF") == Outcomes("S|RF") != Outcomes("S|RF", {"a": "S"})
    assert repr(Outcomes("S|RF")) == "Outcomes('S|RF')"
    assert repr(Outcomes("S", {"a": "F"})) == "Outcomes('S', {'a': 'F'})"
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


def test_leaves_of_a_registry_follow_the_outcomes_and_need_no_resources() -> None:
    nodes = Registry.standard()
    nodes.add(grasp, holding)
    text = (
        '<root BTCPP_format="4"><BehaviorTree ID="Main">'
        '<Fallback><Holding/><Grasp force="3"/><AlwaysFailure/></Fallback></BehaviorTree></root>'
    )
    tree = btcore.loads(text, nodes=with_mock_leaves(nodes), clock=SimClock())
    assert isinstance(tree.nodes[1], MockCondition)
    assert isinstance(tree.nodes[2], MockAction)
    assert tree.nodes[2].get_input("force") == 3
    assert Outcomes("F|RS").drive(tree, ticks=2) == [Status.RUNNING, Status.SUCCESS]
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


def detected(
    outputs: GivenOutputs | None = None, outcomes: str = "S", leaves: Mapping[str, str] | None = None
) -> dict[str, object]:
    """Return the blackboard after two mock leaves have succeeded."""
    nodes = Registry.standard()
    nodes.add(detect)
    tree = btcore.loads(
        f"""<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>
        <Detect name="first" {PORTS}/><Detect count="{{again}}"/></Sequence></BehaviorTree></root>""",
        nodes=with_mock_leaves(nodes, outputs),
        clock=SimClock(),
    )
    Outcomes(outcomes, leaves).drive(tree, ticks=1)
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
    assert len({detected(None, "S" * (1 + repeats))["count"] for repeats in range(9)}) > 1
    assert detected(None, "F") == {}
    assert detected(None, "RS") == {}


def test_given_outputs_are_written_and_a_name_takes_precedence_over_an_id() -> None:
    arm = Arm()
    board = detected({"Detect": {"count": 7, "arm": arm}, "first": {"count": 8}})
    assert (board["count"], board["again"], board["arm"]) == (8, 7, arm)


@pytest.mark.parametrize(
    ("outputs", "message"),
    [
        ({"Detekt": {}}, "the tree has no mock leaf 'Detekt'; did you mean 'Detect'?"),
        ({"Detect": {"coutn": 1}}, "outputs: 'Detect' has no output port 'coutn'; did you mean 'count'?"),
        ({"first": {"zzz": 1}}, "outputs: 'first' has no output port 'zzz'"),
    ],
)
def test_unknown_names_in_given_outputs_are_refused(outputs: GivenOutputs, message: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        detected(outputs)


def test_outcomes_write_outputs_as_texts_of_the_types_of_their_ports() -> None:
    given: GivenOutputs = {"Detect": {"count": 7}}
    board = detected(given, "S", {"first": "S(count=3, text='a, b', ok=true)", "Detect": "R(count=4)S"})
    assert (board["count"], board["text"], board["ok"]) == (3, "a, b", True)
    # The second leaf is RUNNING.
    assert board["again"] == 4


@pytest.mark.parametrize(
    ("leaves", "message"),
    [
        ({"Detekt": "S"}, "the tree has no mock leaf 'Detekt'; did you mean 'Detect'?"),
        ({"first": "S|S(coutn=1)"}, "outputs: 'first' has no output port 'coutn'; did you mean 'count'?"),
    ],
)
def test_unknown_names_in_outcomes_are_refused(leaves: dict[str, str], message: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        detected(None, "S", leaves)


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
