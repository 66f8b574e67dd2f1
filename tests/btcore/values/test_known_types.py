"""Ports whose type is an enum."""

import enum

import pytest

from btcore import In, NodeExecutionError, Registry, Status, condition
from tests.btcore.conftest import TreeFactory
from tests.conformance.recorded_cases import conformance_registry

F, S = Status.FAILURE, Status.SUCCESS


class Gear(enum.Enum):
    PARK = 0
    DRIVE = 3


@condition
def drives(gear: In[Gear]) -> bool:
    return gear is Gear.DRIVE


@pytest.fixture
def nodes() -> Registry:
    nodes = conformance_registry()
    nodes.add(drives)
    return nodes


@pytest.mark.parametrize(("text", "status"), [("DRIVE", S), ("3", S), ("PARK", F), ("0", F)])
def test_enum_is_name_or_number(text: str, status: Status, nodes: Registry, make_tree: TreeFactory) -> None:
    assert make_tree(f'<Drives gear="{text}"/>', nodes=nodes).tick_once() is status


@pytest.mark.parametrize("value", [Gear.DRIVE, 3, "DRIVE", "3"])
def test_enum_entry_may_be_member_number_or_text(
    value: object, nodes: Registry, make_tree: TreeFactory
) -> None:
    tree = make_tree('<Drives gear="{g}"/>', nodes=nodes)
    entry = tree.blackboard.find("g")
    assert entry is not None
    entry.put(value, 0)
    assert tree.tick_once() is S


def test_script_may_set_an_enum_by_a_registered_name(nodes: Registry, make_tree: TreeFactory) -> None:
    nodes.add_enum(Gear)
    tree = make_tree('<Sequence><Script code="g := DRIVE"/><Drives gear="{g}"/></Sequence>', nodes=nodes)
    assert tree.tick_once() is S


@pytest.mark.parametrize("value", ["7", 7])
def test_number_without_member_is_error(value: object, nodes: Registry, make_tree: TreeFactory) -> None:
    tree = make_tree('<Drives gear="{g}"/>', nodes=nodes)
    entry = tree.blackboard.find("g")
    assert entry is not None
    entry.put(value, 0)
    with pytest.raises(NodeExecutionError, match=r"port \[gear\] reads \{g\} as Gear"):
        tree.tick_once()


@condition
def succeeded(last: In[Status]) -> bool:
    return last is S


@pytest.mark.parametrize(
    ("leaf", "name", "text", "number"),
    [
        ('<Drives gear="{k}"/>', "Gear", "DRIVE", 3),
        ('<Succeeded last="{k}"/>', "BT::NodeStatus", "SUCCESS", 2),
    ],
)
def test_set_blackboard_and_scripts_convert_no_text_to_an_enum(
    leaf: str, name: str, text: str, number: int, nodes: Registry, make_tree: TreeFactory
) -> None:
    nodes.add(succeeded)
    for write in (f'<SetBlackboard value="{text}" output_key="k"/>', f"<Script code=\"k = '{text}'\"/>"):
        tree = make_tree(f"<Sequence>{write}{leaf}</Sequence>", nodes=nodes)
        with pytest.raises(NodeExecutionError, match=f"the type {name}, to which .* convert"):
            tree.tick_once()
    tree = make_tree(f'<Sequence><Script code="k = {number}"/>{leaf}</Sequence>', nodes=nodes)
    assert tree.tick_once() is S
