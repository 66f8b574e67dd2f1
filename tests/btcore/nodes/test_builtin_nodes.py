"""The declarations of the built-in node classes."""

from itertools import product

import pytest

from btcore import DecoratorNode, NodeSpec, Status, TreeNode
from btcore.engine.control import results_in_order
from btcore.lint.possible_results import behaviour_of
from btcore.nodes.builtin_nodes import BUILTIN_NODES, node_classes
from btcore.nodes.format3 import SequenceStar
from btcore.nodes.result_decorators import ForceSuccess, Inverter
from btcore.nodes.sequences_and_fallbacks import Fallback, OrderedNode, SequenceWithMemory
from btcore.status import FAILURE, SKIPPED, SUCCESS, UNKNOWN_RESULTS, PossibleResults


@pytest.mark.parametrize("cls", [*node_classes()], ids=lambda cls: cls.__name__)
def test_every_class_is_a_node_of_some_format_or_a_base_class(cls: type[TreeNode]) -> None:
    # So that the declaration of a new node is not forgotten.
    assert cls.spec.formats or any(cls in other.__bases__ for other in node_classes())


def test_a_class_has_one_id_in_its_formats() -> None:
    for format, nodes in BUILTIN_NODES.items():
        for id, cls in nodes.items():
            assert format in cls.spec.formats
            assert cls.__name__ in (id, f"{id}3")


def test_declared_results_do_not_apply_to_user_subclasses() -> None:
    class Own(ForceSuccess):
        pass

    class Declared(ForceSuccess):
        spec = NodeSpec(results=frozenset({Status.FAILURE}))

    assert behaviour_of(ForceSuccess) is ForceSuccess
    assert behaviour_of(Own) is DecoratorNode
    assert behaviour_of(Declared) is Declared
    assert behaviour_of(Fallback).possible_results([UNKNOWN_RESULTS], {}).may_run
    assert behaviour_of(Inverter) is Inverter


@pytest.mark.parametrize("cls", [SequenceWithMemory, SequenceStar], ids=lambda cls: cls.__name__)
def test_results_of_a_sequence_with_memory_are_those_of_a_start_at_any_child(cls: type[OrderedNode]) -> None:
    sets = [frozenset({SUCCESS}), frozenset({FAILURE}), frozenset({SKIPPED, SUCCESS}), frozenset({SKIPPED})]
    kinds = [PossibleResults(*both) for both in product(sets, sets)]
    for children in map(list, product(kinds, repeat=3)):
        starts = [results_in_order(children[first:], SUCCESS, cls.is_async) for first in range(3)]
        found = cls.possible_results(children, {})
        assert found.in_first_tick == frozenset().union(*(start.in_first_tick for start in starts))
        assert found[1:] == starts[0][1:]
