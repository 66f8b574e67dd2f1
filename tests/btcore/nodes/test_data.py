"""UnsetBlackboard and SetBlackboard, and ports of enums."""

import enum
from collections.abc import Callable

import pytest

from btcore import In, NodeExecutionError, Registry, Status, Tree, TreeError, condition
from btcore.testing.conformance import conformance_registry

Grow = Callable[..., Tree]

S, F = Status.SUCCESS, Status.FAILURE


# --- UnsetBlackboard


def test_unset_removes_the_entry_and_succeeds_also_without_one(make_tree: Grow) -> None:
    tree = make_tree('<UnsetBlackboard key="x"/>')
    tree.blackboard["x"] = 1
    assert tree.tick_once() is S
    assert tree.blackboard.find("x") is None
    assert tree.tick_once() is S


def test_an_entry_that_was_removed_may_come_back_with_another_type(make_tree: Grow) -> None:
    tree = make_tree('<UnsetBlackboard key="x"/>')
    tree.blackboard["x"] = 1
    tree.tick_once()
    tree.blackboard["x"] = 2.5
    assert tree.blackboard["x"] == 2.5


def test_the_key_may_itself_be_a_pointer(make_tree: Grow) -> None:
    tree = make_tree('<UnsetBlackboard key="{which}"/>')
    tree.blackboard["which"] = "x"
    tree.blackboard["x"] = 1
    tree.tick_once()
    assert "x" not in tree.blackboard
    assert "which" in tree.blackboard


def test_it_removes_from_its_own_scope_only(make_tree: Grow) -> None:
    inner = '<BehaviorTree ID="Sub"><UnsetBlackboard key="x"/></BehaviorTree>'
    for attributes in ('x="{x}"', '_autoremap="true"'):
        tree = make_tree(f'<SubTree ID="Sub" {attributes}/>', others=inner)
        tree.blackboard["x"] = 1
        assert tree.tick_once() is S
        assert tree.blackboard["x"] == 1


def test_a_key_that_is_not_given_is_an_error_at_the_tick(make_tree: Grow) -> None:
    with pytest.raises(NodeExecutionError, match="key"):
        make_tree("<UnsetBlackboard/>").tick_once()


# --- SetBlackboard, where the entry has a type


def test_a_text_becomes_what_the_entry_is(make_tree: Grow) -> None:
    tree = make_tree('<SetBlackboard value="42" output_key="x"/>')
    tree.blackboard["x"] = 7
    tree.tick_once()
    assert tree.blackboard["x"] == 42


def test_a_text_that_does_not_convert_is_an_error(make_tree: Grow) -> None:
    tree = make_tree('<SetBlackboard value="many" output_key="x"/>')
    tree.blackboard["x"] = 7
    with pytest.raises(NodeExecutionError, match="many"):
        tree.tick_once()


def test_a_pointer_copies_the_value_whatever_it_is(make_tree: Grow) -> None:
    something = object()
    tree = make_tree('<SetBlackboard value="{a}" output_key="b"/>')
    tree.blackboard["a"] = something
    tree.tick_once()
    assert tree.blackboard["b"] is something


def test_an_empty_entry_can_not_be_copied(make_tree: Grow) -> None:
    assert make_tree('<SetBlackboard value="{a}" output_key="b"/>').tick_once() is F


# --- ports of enums


class Gear(enum.Enum):
    PARK = 0
    DRIVE = 3


@condition
def drives(gear: In[Gear]) -> bool:
    return gear is Gear.DRIVE


@pytest.fixture
def nodes() -> Registry:
    made = conformance_registry()
    made.add(drives)
    return made


@pytest.mark.parametrize(("text", "status"), [("DRIVE", S), ("3", S), ("PARK", F), ("0", F)])
def test_an_enum_is_written_by_name_or_by_number(
    text: str, status: Status, nodes: Registry, make_tree: Grow
) -> None:
    assert make_tree(f'<Drives gear="{text}"/>', nodes=nodes).tick_once() is status


@pytest.mark.parametrize("value", [Gear.DRIVE, 3, "DRIVE", "3"])
def test_on_the_blackboard_it_may_be_a_member_a_number_or_a_text(
    value: object, nodes: Registry, make_tree: Grow
) -> None:
    tree = make_tree('<Drives gear="{g}"/>', nodes=nodes)
    entry = tree.blackboard.find("g")
    assert entry is not None
    entry.put(value, 0)
    assert tree.tick_once() is S


def test_a_script_may_set_it_by_a_registered_name(nodes: Registry, make_tree: Grow) -> None:
    nodes.add_enum(Gear)
    tree = make_tree('<Sequence><Script code="g := DRIVE"/><Drives gear="{g}"/></Sequence>', nodes=nodes)
    assert tree.tick_once() is S


def test_a_name_registered_for_a_number_counts_in_ports_too(nodes: Registry, make_tree: Grow) -> None:
    nodes.add_enum({"FORWARD": 3})
    assert make_tree('<Drives gear="FORWARD"/>', nodes=nodes).tick_once() is S


def test_what_is_no_member_is_an_error_that_names_the_members(nodes: Registry, make_tree: Grow) -> None:
    with pytest.raises((TreeError, NodeExecutionError), match="PARK or DRIVE"):
        make_tree('<Drives gear="REVERSE"/>', nodes=nodes).tick_once()
