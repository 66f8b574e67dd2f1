"""UnsetBlackboard and SetBlackboard."""

import pytest

from btcore import NodeExecutionError, Status, Tree
from btcore.values import INT64
from tests.btcore.conftest import TreeFactory
from tests.saved_state import restore_state, save_state

S, F = Status.SUCCESS, Status.FAILURE


# --- UnsetBlackboard


def test_unset_removes_the_entry_and_succeeds_without_an_entry_too(make_tree: TreeFactory) -> None:
    tree = make_tree('<UnsetBlackboard key="x"/>')
    tree.blackboard["x"] = 1
    assert tree.tick_once() is S
    assert tree.blackboard.find("x") is None
    assert tree.tick_once() is S


def test_removed_entry_may_return_with_another_type(make_tree: TreeFactory) -> None:
    tree = make_tree('<UnsetBlackboard key="x"/>')
    tree.blackboard["x"] = 1
    tree.tick_once()
    tree.blackboard["x"] = 2.5
    assert tree.blackboard["x"] == 2.5


def test_the_key_may_itself_be_a_pointer(make_tree: TreeFactory) -> None:
    tree = make_tree('<UnsetBlackboard key="{which}"/>')
    tree.blackboard["which"] = "x"
    tree.blackboard["x"] = 1
    tree.tick_once()
    assert "x" not in tree.blackboard
    assert "which" in tree.blackboard


def test_unset_removes_only_from_its_own_scope(make_tree: TreeFactory) -> None:
    inner = '<BehaviorTree ID="Sub"><UnsetBlackboard key="x"/></BehaviorTree>'
    for attributes in ('x="{x}"', '_autoremap="true"'):
        tree = make_tree(f'<SubTree ID="Sub" {attributes}/>', others=inner)
        tree.blackboard["x"] = 1
        assert tree.tick_once() is S
        assert tree.blackboard["x"] == 1


def test_missing_key_raises_at_the_tick(make_tree: TreeFactory) -> None:
    with pytest.raises(NodeExecutionError, match="key"):
        make_tree("<UnsetBlackboard/>").tick_once()


# --- SetBlackboard with a typed entry


def test_remapping_to_a_key_of_the_root_scope_reads_one_entry_and_writes_another(
    make_tree: TreeFactory,
) -> None:
    inner = '<BehaviorTree ID="Sub"><SetBlackboard value="42" output_key="x"/></BehaviorTree>'
    tree = make_tree('<SubTree ID="Sub" x="{@y}"/>', others=inner)
    tree.blackboard["y"] = 7
    tree.tick_once()
    entries = {key: entry.value for key, entry in tree.blackboard.local_entries().items()}
    assert entries == {"y": 7, "@y": 42}


def test_pointer_copies_any_value(make_tree: TreeFactory) -> None:
    something = object()
    tree = make_tree('<SetBlackboard value="{a}" output_key="b"/>')
    tree.blackboard["a"] = something
    tree.tick_once()
    assert tree.blackboard["b"] is something


def test_copy_to_an_entry_of_another_type_raises(make_tree: TreeFactory) -> None:
    tree = make_tree('<SetBlackboard value="{a}" output_key="b"/>')
    tree.blackboard["a"] = 1
    tree.blackboard["b"] = 2.5
    with pytest.raises(NodeExecutionError, match="'b' cannot change from double to int: copy to another"):
        tree.tick_once()


@pytest.mark.parametrize(("target", "name"), [(1, "int"), (0.5, "double")])
def test_integer_of_a_script_cannot_be_copied_to_an_entry_of_another_type(
    target: object, name: str, make_tree: TreeFactory
) -> None:
    copy = '<SetBlackboard value="{e}" output_key="b"/>'
    tree = make_tree(f'<Sequence><Script code="e := 1"/>{copy}</Sequence>')
    tree.blackboard["b"] = target
    with pytest.raises(NodeExecutionError, match=f"'b' cannot change from {name} to long: copy to another"):
        tree.tick_once()
    for written in (2, 2.5):  # by user code: the type is that of C++'s literal
        tree = make_tree(copy)
        tree.blackboard["b"] = type(written)(0)
        tree.blackboard["e"] = written
        assert tree.tick_once() is S
        assert tree.blackboard["b"] == written


def test_number_that_a_script_reads_from_a_text_is_copied_as_a_double(make_tree: TreeFactory) -> None:
    scripts = '<Script code="e := 1"/><Script code="e = \'2\'"/>'
    tree = make_tree(f'<Sequence>{scripts}<SetBlackboard value="{{e}}" output_key="b"/></Sequence>')
    tree.blackboard["b"] = 0.5
    assert tree.tick_once() is S
    assert tree.blackboard["b"] == 2.0


def test_type_of_a_value_is_part_of_a_saved_state(make_tree: TreeFactory) -> None:
    def new() -> Tree:
        body = '<Sequence><Script code="e := 1"/><Sleep msec="1"/><SetBlackboard value="{e}" output_key="b"/>'
        tree = make_tree(f"{body}</Sequence>")
        tree.blackboard["b"] = 0
        return tree

    tree = new()
    tree.tick_once()
    copied = new()
    restore_state(copied, save_state(tree))
    entry = copied.blackboard.find("e")
    assert entry is not None
    assert entry.type_of_value() is INT64


def test_text_leaves_an_untyped_entry_untyped(make_tree: TreeFactory) -> None:
    tree = make_tree('<SetBlackboard value="x" output_key="s"/>')
    tree.blackboard["s"] = "y"
    assert tree.tick_once() is S
    assert tree.blackboard["s"] == "x"
    tree.blackboard["s"] = 7
    assert tree.blackboard["s"] == 7


def test_equals_sign_in_braces_copies_the_entry_with_this_name(make_tree: TreeFactory) -> None:
    tree = make_tree('<SetBlackboard value="{=}" output_key="b"/>')
    tree.blackboard["="] = 7
    assert tree.tick_once() is S
    assert tree.blackboard["b"] == 7


def test_number_as_output_key_is_converted_to_text_as_in_cpp(make_tree: TreeFactory) -> None:
    tree = make_tree('<SetBlackboard value="x" output_key="{d}"/>')
    tree.blackboard["d"] = 2.5
    assert tree.tick_once() is S
    assert tree.blackboard["2.500000"] == "x"
