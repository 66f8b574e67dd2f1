"""The ports of a SubTree that a TreeNodesModel declares."""

import pytest

from btcore import Status, TreeError
from tests.btcore.conftest import TreeFactory

INNER = '<BehaviorTree ID="Sub"><Script code="out := n"/></BehaviorTree>'


def with_model(*ports: str) -> str:
    """Return the tree Sub and its model with *ports*."""
    return f'{INNER}<TreeNodesModel><SubTree ID="Sub">{"".join(ports)}</SubTree></TreeNodesModel>'


@pytest.mark.parametrize(("attribute", "value"), [("", 7), ('n="8"', 8)])
def test_missing_port_gets_the_default(attribute: str, value: int, make_tree: TreeFactory) -> None:
    models = with_model('<input_port name="n" default="7"/>')
    tree = make_tree(f'<SubTree ID="Sub" {attribute} out="{{result}}"/>', others=models)
    assert tree.tick_once() is Status.SUCCESS
    assert tree.blackboard["result"] == value


def test_the_default_may_be_an_entry(make_tree: TreeFactory) -> None:
    models = with_model(
        '<input_port name="n" default="{outer}"/>', '<output_port name="out" default="{out}"/>'
    )
    tree = make_tree('<SubTree ID="Sub"/>', others=models)
    tree.blackboard["outer"] = 5
    tree.tick_once()
    assert tree.blackboard["out"] == 5


def test_equals_sign_in_braces_is_a_key_in_a_default_but_not_in_an_attribute(make_tree: TreeFactory) -> None:
    models = with_model('<input_port name="n" default="{=}"/>', '<output_port name="out" default="{=}"/>')
    tree = make_tree('<SubTree ID="Sub" out="{=}"/>', others=models)
    tree.blackboard["="] = 5
    tree.tick_once()
    assert tree.blackboard["out"] == 5


@pytest.mark.parametrize("kind", ["input_port", "output_port", "inout_port"])
def test_port_without_a_default_is_required(kind: str, make_tree: TreeFactory) -> None:
    with pytest.raises(TreeError, match="'n'"):
        make_tree('<SubTree ID="Sub"/>', others=with_model(f'<{kind} name="n"/>'))


def test_autoremap_ignores_the_model(make_tree: TreeFactory) -> None:
    models = with_model('<input_port name="n" default="7"/>', '<input_port name="m"/>')
    tree = make_tree('<SubTree ID="Sub" _autoremap="true"/>', others=models)
    tree.blackboard["n"] = 1
    tree.tick_once()
    assert tree.blackboard["out"] == 1


def test_models_of_other_node_types_are_ignored_by_the_loader(make_tree: TreeFactory) -> None:
    models = '<TreeNodesModel><Action ID="Act"><input_port name="other"/></Action></TreeNodesModel>'
    assert make_tree('<Act outcomes="F"/>', others=models).tick_once() is Status.FAILURE
