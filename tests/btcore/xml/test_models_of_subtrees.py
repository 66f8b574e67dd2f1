"""What a TreeNodesModel says of a SubTree's ports."""

from collections.abc import Callable

import pytest

from btcore import Status, Tree, TreeError

Grow = Callable[..., Tree]

INNER = '<BehaviorTree ID="Sub"><Script code="out := n"/></BehaviorTree>'


def modelled(*ports: str) -> str:
    """The tree Sub, and the model of it with *ports*."""
    return f'{INNER}<TreeNodesModel><SubTree ID="Sub">{"".join(ports)}</SubTree></TreeNodesModel>'


def test_a_port_that_is_not_given_gets_the_default(make_tree: Grow) -> None:
    tree = make_tree(
        '<SubTree ID="Sub" out="{result}"/>', others=modelled('<input_port name="n" default="7"/>')
    )
    assert tree.tick_once() is Status.SUCCESS
    assert tree.blackboard["result"] == 7


def test_the_default_may_be_an_entry(make_tree: Grow) -> None:
    models = modelled('<input_port name="n" default="{outer}"/>', '<output_port name="out" default="{=}"/>')
    tree = make_tree('<SubTree ID="Sub"/>', others=models)
    tree.blackboard["outer"] = 5
    tree.tick_once()
    assert tree.blackboard["out"] == 5


def test_what_is_given_goes_before_the_default(make_tree: Grow) -> None:
    body = '<SubTree ID="Sub" n="8" out="{result}"/>'
    tree = make_tree(body, others=modelled('<input_port name="n" default="7"/>'))
    tree.tick_once()
    assert tree.blackboard["result"] == 8


@pytest.mark.parametrize("kind", ["input_port", "output_port", "inout_port"])
def test_a_port_without_a_default_must_be_given(kind: str, make_tree: Grow) -> None:
    with pytest.raises(TreeError, match="'n'"):
        make_tree('<SubTree ID="Sub"/>', others=modelled(f'<{kind} name="n"/>'))


def test_with_autoremap_the_model_is_not_looked_at(make_tree: Grow) -> None:
    models = modelled('<input_port name="n" default="7"/>', '<input_port name="m"/>')
    tree = make_tree('<SubTree ID="Sub" _autoremap="true"/>', others=models)
    tree.blackboard["n"] = 1
    tree.tick_once()
    assert tree.blackboard["out"] == 1


def test_models_of_other_kinds_say_nothing_when_a_tree_is_made(make_tree: Grow) -> None:
    models = '<TreeNodesModel><Action ID="PlanSync"><input_port name="other"/></Action></TreeNodesModel>'
    assert make_tree('<PlanSync plan="S"/>', others=models).tick_once() is Status.SUCCESS
