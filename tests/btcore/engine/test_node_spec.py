"""The spec of a node class: a class declares fields, and inherits the others."""

import pytest

from btcore import (
    DecoratorNode,
    In,
    NodeSpec,
    NodeType,
    RegistrationError,
    Registry,
    StatefulAction,
    Status,
    TreeNode,
)
from btcore.engine.node_spec import declared_fields
from btcore.nodes.sequences_and_fallbacks import AsyncSequence, OrderedNode, Sequence


class Drive(StatefulAction):
    spec = NodeSpec(state_fields=("goal",), uses=frozenset({"base"}), symbol="→")

    def on_start(self) -> Status:
        return Status.SUCCESS

    def on_running(self) -> Status:
        return Status.SUCCESS


class Turn(Drive):
    spec = NodeSpec(state_fields=("angle", "end"), time_fields=("end",))


class Plain(Turn):
    pass


def test_a_class_inherits_the_fields_that_it_does_not_declare() -> None:
    assert (Turn.spec.uses, Turn.spec.symbol) == (frozenset({"base"}), "→")
    assert Turn.spec.node_type is NodeType.ACTION
    assert Plain.spec.time_fields == ("end",)
    assert DecoratorNode.spec.child_count == (1, 1)


def test_state_fields_are_added_to_those_of_the_base_classes() -> None:
    assert Turn.spec.state_fields == ("angle", "end", "goal")
    assert Drive.spec.state_fields == ("goal",)


def test_a_class_whose_state_cannot_be_saved_can_have_a_subclass_whose_state_can() -> None:
    class Threaded(Drive):
        spec = NodeSpec(state_fields=None)

    class Saved(Threaded):
        spec = NodeSpec(state_fields=())

    assert Threaded.spec.state_fields is None
    assert Saved.spec.state_fields == ("goal",)


def test_formats_of_a_built_in_node_are_not_inherited() -> None:
    class Own(AsyncSequence):
        pass

    assert AsyncSequence.spec.formats == (4,)
    assert Own.spec.formats == OrderedNode.spec.formats == ()
    assert (Own.spec.symbol, Own.spec.continue_on) == (Sequence.spec.symbol, Status.SUCCESS)


def test_the_nearest_class_in_the_method_resolution_order_takes_precedence() -> None:
    class Mixin:
        spec = NodeSpec(symbol="↑", never_pauses=True)

    class Mixed(Mixin, Drive):
        pass

    assert (Mixed.spec.symbol, Mixed.spec.never_pauses, Mixed.spec.uses) == ("↑", True, frozenset({"base"}))


def test_a_node_has_the_spec_of_its_class() -> None:
    registry = Registry.standard()
    registry.add(Turn)
    assert registry.manifests["Turn"].spec == registry.manifests["Turn"].cls.spec == Turn.spec
    assert registry.manifests["Turn"].type is NodeType.ACTION


def test_only_declared_fields_count_as_declared() -> None:
    assert declared_fields(Turn).keys() == {"state_fields", "time_fields"}
    assert declared_fields(Plain) == {}
    assert declared_fields(TreeNode) == {}


def test_a_port_cannot_be_called_spec() -> None:
    class Described(Drive):
        spec: In[str]  # type: ignore[assignment]

    with pytest.raises(RegistrationError, match="would hide the attribute 'spec'"):
        Registry.standard().add(Described)
