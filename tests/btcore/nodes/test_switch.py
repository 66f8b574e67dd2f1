"""Switch2 to Switch6, in both formats."""

import enum

import pytest

from btcore import NodeExecutionError, Status, TreeError
from tests.btcore.conftest import TreeFactory
from tests.conformance.recorded_cases import CallLog, conformance_registry

R, S, F, K = Status.RUNNING, Status.SUCCESS, Status.FAILURE, Status.SKIPPED

SIZES = [2, 3, 4, 5, 6]
FORMATS = [3, 4]


def switch(cases: int, *outcomes: str, variable: str = "{v}") -> str:
    """Return a switch with cases "1", "2" …, and children c1, c2 … and `other`."""
    ports = " ".join(f'case_{number}="{number}"' for number in range(1, cases + 1))
    names = [f"c{number}" for number in range(1, cases + 1)] + ["other"]
    given = [*outcomes, *["S"] * (cases + 1 - len(outcomes))]
    children = "".join(
        f'<Act name="{name}" outcomes="{own}"/>' for name, own in zip(names, given, strict=True)
    )
    return f'<Switch{cases} variable="{variable}" {ports}>{children}</Switch{cases}>'


@pytest.mark.parametrize("format", FORMATS)
@pytest.mark.parametrize("cases", SIZES)
def test_matching_case_is_ticked_and_otherwise_the_last_child(
    cases: int, format: int, make_tree: TreeFactory, calls: CallLog
) -> None:
    tree = make_tree(switch(cases), format=format)
    for number in range(1, cases + 1):
        tree.blackboard["v"] = str(number)
        assert tree.tick_once() is S
        assert calls.take() == [f"c{number}:start"]
    tree.blackboard["v"] = str(cases + 1)
    assert tree.tick_once() is S
    assert calls.take() == ["other:start"]


@pytest.mark.parametrize("format", FORMATS)
def test_unreadable_variable_matches_no_case(format: int, make_tree: TreeFactory, calls: CallLog) -> None:
    assert make_tree(switch(4), format=format).tick_once() is S
    assert calls == ["other:start"]


@pytest.mark.parametrize("format", FORMATS)
def test_changed_choice_halts_the_running_child(format: int, make_tree: TreeFactory, calls: CallLog) -> None:
    tree = make_tree(switch(4, "R", "RS"), format=format)
    tree.blackboard["v"] = "1"
    assert tree.tick_once() is R
    tree.blackboard["v"] = "2"
    assert [tree.tick_once(), tree.tick_once()] == [R, S]
    assert calls == ["c1:start", "c1:halted", "c2:start", "c2:running"]
    assert {node.status for node in tree} == {Status.IDLE}


def test_switch_is_skipped_with_its_child(make_tree: TreeFactory) -> None:
    tree = make_tree(switch(4, "K"))
    tree.blackboard["v"] = "1"
    assert tree.tick_once() is K
    assert tree.root.status is Status.IDLE  # not RUNNING before a child has been ticked


@pytest.mark.parametrize("format", FORMATS)
@pytest.mark.parametrize("cases", [4, 6])
def test_number_of_children_must_be_cases_plus_one(cases: int, format: int, make_tree: TreeFactory) -> None:
    children = "<AlwaysSuccess/>" * cases
    with pytest.raises((NodeExecutionError, TreeError), match=f"Switch{cases}"):
        make_tree(
            f'<Switch{cases} variable="1" case_1="1">{children}</Switch{cases}>', format=format
        ).tick_once()


def test_missing_case_is_ignored(make_tree: TreeFactory, calls: CallLog) -> None:
    tree = make_tree(
        '<Switch4 variable="b" case_3="b"><Act name="a" outcomes="S"/><Act name="b" outcomes="S"/>'
        '<Act name="c" outcomes="S"/><Act name="d" outcomes="S"/><Act name="e" outcomes="S"/></Switch4>'
    )
    tree.tick_once()
    assert calls == ["c:start"]


class Colour(enum.Enum):
    RED = 1
    GREEN = 2


@pytest.mark.parametrize(
    ("variable", "case", "matches", "in_format_3"),
    [
        ("abc", "abc", True, True),
        ("abc", "abd", False, False),
        ("1", "01", True, False),
        ("RED", "1", True, False),
        ("2", "GREEN", True, False),
        ("RED", "GREEN", False, False),
        ("1", "1.0", True, False),
        ("1.00000001", "1", True, False),
        ("1.001", "1", False, False),
        ("1e3", "1000", True, False),
        ("1 ", "1", False, False),
        ("1x", "1", False, False),
        ("", "0", False, False),
        ("9007199254740993", "9007199254740992", True, False),
        ("inf", "INF", False, False),
        ("nan", "NAN", False, False),
    ],
)
def test_format_3_compares_texts_and_format_4_compares_values(
    variable: str, case: str, matches: bool, in_format_3: bool, make_tree: TreeFactory
) -> None:
    nodes = conformance_registry()
    nodes.add_enum(Colour)
    children = "<AlwaysSuccess/><AlwaysFailure/><AlwaysFailure/>"
    body = f'<Switch2 variable="{variable}" case_1="{case}">{children}</Switch2>'
    assert make_tree(body, nodes=nodes).tick_once() is (S if matches else F)
    assert make_tree(body, nodes=nodes, format=3).tick_once() is (S if in_format_3 else F)


def test_number_written_by_a_script_is_compared_by_value(make_tree: TreeFactory, calls: CallLog) -> None:
    tree = make_tree(f'<Sequence><Script code="v := 2"/>{switch(4)}</Sequence>')
    tree.tick_once()
    assert calls == ["c2:start"]
