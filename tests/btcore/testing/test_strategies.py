"""Random trees, outcomes and blackboards: their content, and how they shrink."""

import re
from collections.abc import Callable
from random import Random
from typing import Any
from xml.etree import ElementTree

import pytest
from hypothesis import HealthCheck, Phase, find, given, settings
from hypothesis import strategies as st
from hypothesis.errors import InvalidArgument

import btcore
from btcore import (
    Blackboard,
    ControlNode,
    DecoratorNode,
    In,
    Out,
    Registry,
    SimClock,
    Status,
    SyncAction,
    Tree,
    condition,
)
from btcore.registry.outcome_grammar import parse_outcomes
from btcore.testing import Outcomes, blackboards, outcomes, trees, xml_documents
from tests.conformance.recorded_cases import CallLog, conformance_registry

SMALLEST = settings(
    derandomize=True, database=None, max_examples=5000, suppress_health_check=list(HealthCheck)
)
UNSHRUNK = settings(SMALLEST, phases=[Phase.generate])


def smallest(
    strategy: st.SearchStrategy[str], condition: Callable[[str], object], seed: int = 0
) -> list[str]:
    """Return the tags of the smallest document that meets *condition*."""
    text = find(strategy, lambda text: bool(condition(text)), settings=SMALLEST, random=Random(seed))
    return [element.tag for element in ElementTree.fromstring(text).iter()][2:]


def levels(text: str) -> int:
    def below(element: ElementTree.Element) -> int:
        return 1 + max((below(child) for child in element), default=0)

    return max(below(tree) - 1 for tree in ElementTree.fromstring(text))


def tags(text: str) -> set[str]:
    found = {element.tag for element in ElementTree.fromstring(text).iter()}
    return found - {"root", "BehaviorTree"}


# --- trees


def test_smallest_tree_is_a_single_leaf() -> None:
    (leaf,) = smallest(xml_documents(), lambda _: True)
    assert leaf in ("Act", "Ask")


@pytest.mark.parametrize("tag", ["Inverter", "ReactiveFallback", "TryCatch"])
def test_tree_shrinks_to_the_required_node(tag: str) -> None:
    children = 2 if tag == "TryCatch" else 1
    for seed in range(4):
        # Among all tags, the search for a rare tag takes up to a minute.
        documents = xml_documents(max_nodes=15, tags=(tag, "Fallback", "Inverter", "Sequence"))
        found = smallest(documents, lambda text: f"<{tag} " in text, seed)
        if len(found) == 1 + children:
            break  # about one search in twenty stops at a slightly larger tree
    assert found[0] == tag
    assert len(found) == 1 + children
    assert set(found[1:]) <= {"Act", "Ask"}


def test_subtree_shrinks_away_unless_it_is_required() -> None:
    documents = xml_documents(max_nodes=10, subtrees=2)
    assert "SubTree" not in smallest(documents, lambda text: "<Inverter" in text)
    found = smallest(documents, lambda text: "<SubTree" in text)
    assert found[-3:] == ["SubTree", "BehaviorTree", found[-1]]
    assert found[-1] in ("Act", "Ask")


@given(xml_documents(max_nodes=12, max_depth=3))
def test_tree_respects_its_size_and_depth_limits(text: str) -> None:
    assert text.count(" name=") <= 12
    assert levels(text) <= 3


@given(xml_documents(tags=["Sequence", "Inverter", "AlwaysSuccess"]))
def test_only_chosen_tags_occur(text: str) -> None:
    assert tags(text) <= {"Sequence", "Inverter", "AlwaysSuccess"}


@given(xml_documents(tags=["Fallback", "Sequence"]))
def test_leaves_are_mock_leaves_if_no_leaf_is_chosen(text: str) -> None:
    assert tags(text) <= {"Fallback", "Sequence", "Act", "Ask"}


@pytest.mark.parametrize(
    ("options", "tag"),
    [
        ({}, "SequenceWithMemory"),
        ({}, "WhileDoElse"),
        ({"timed": True}, "Timeout"),
        ({"timed": True}, "Sleep"),
        ({"scripts": True}, "Script"),
        ({"subtrees": 1}, "SubTree"),
        ({"format": 3}, "SequenceStar"),
        ({"format": 3, "timed": True}, "Delay"),
    ],
)
def test_every_allowed_tag_occurs(options: dict[str, Any], tag: str) -> None:
    documents = xml_documents(max_nodes=40, **options)
    find(documents, lambda text: f"<{tag} " in text, settings=UNSHRUNK, random=Random(0))


@pytest.mark.parametrize("key", ["_while", "_failureIf", "_onHalted"])
def test_conditions_of_every_kind_occur(key: str) -> None:
    assert len(smallest(xml_documents(conditions=True), lambda text: f" {key}=" in text)) == 1


@given(xml_documents(skipped=False, conditions=True))
def test_skipped_false_generates_no_skips(text: str) -> None:
    assert not re.search(r'_skipIf|_while|RunOnce|outcomes="[^"]*K', text)


@given(xml_documents(max_nodes=40, format=3, timed=True, subtrees=2))
def test_documents_of_format_3_can_be_loaded(text: str) -> None:
    tree = btcore.loads(text, nodes=conformance_registry(), resources=[CallLog()], clock=SimClock())
    assert tree.format == 3


@given(xml_documents(tags=("Parallel", "AlwaysSuccess"), max_nodes=5, format=3))
def test_thresholds_of_format_3_are_positive(text: str) -> None:
    assert all(int(count) > 0 for count in re.findall(r'_threshold="(.*?)"', text))


@given(trees(max_nodes=40, conditions=True, scripts=True, timed=True, subtrees=2), outcomes())
def test_a_tree_with_everything_can_be_driven(tree: Tree, plan: Outcomes) -> None:
    results = plan.drive(tree, ticks=6)
    assert len(results) == 6
    assert Status.IDLE not in results
    assert set(tree.blackboard) == {"a", "b", "c"}


def test_a_failing_property_prints_the_smallest_tree_as_xml() -> None:
    @settings(SMALLEST, max_examples=500, print_blob=False)
    @given(trees(max_nodes=15), outcomes())
    def no_tree_repeats(tree: Tree, plan: Outcomes) -> None:
        assert "Repeat" not in {node.id for node in tree}

    with pytest.raises(AssertionError) as failed:
        no_tree_repeats()
    notes = "\n".join(failed.value.__notes__)
    assert '  <BehaviorTree ID="Main">\n    <Repeat name="n1" num_cycles="0">\n      <A' in notes
    assert "plan=Outcomes('" in notes


# --- trees of user-defined nodes


class Guarded(DecoratorNode):
    limit: In[int]
    mode: In[str] = "soft"

    def tick(self) -> Status:
        assert self.limit < 200
        return self.child.execute_tick()


class Last(ControlNode):
    def tick(self) -> Status:
        return self.children[-1].execute_tick()


class Grab(SyncAction):
    force: In[float]
    got: Out[bool]

    def tick(self) -> bool:
        raise AssertionError("the real leaf is ticked")


@condition
def held(where: In[complex]) -> bool:
    raise AssertionError("the real leaf is ticked")


def own() -> Registry:
    nodes = Registry.standard()
    nodes.add_type(complex, complex)
    nodes.add(Guarded, Last, Grab, held)
    return nodes


OWN = own()


@given(trees(nodes=OWN, tags=["Guarded", "Last", "Grab", "Sequence"]), outcomes())
def test_user_nodes_get_texts_for_their_ports(tree: Tree, plan: Outcomes) -> None:
    plan.drive(tree, ticks=2)
    assert {node.id for node in tree} <= {"Guarded", "Last", "Grab", "Sequence"}
    for node in tree.find(Guarded):
        assert node.mode == "soft"


@given(
    trees(
        nodes=OWN,
        tags=["Held", "Guarded"],
        ports={"Held": {"where": st.just("1+2j")}, "Guarded": {"mode": st.sampled_from(["hard", "soft"])}},
    )
)
def test_port_texts_may_be_given(tree: Tree) -> None:
    assert [node.get_input("where") for node in tree if node.id == "Held"] == [1 + 2j]


def test_port_of_an_unknown_type_requires_a_text() -> None:
    with pytest.raises(InvalidArgument, match="the port 'where' of <Held>"):
        find(xml_documents(nodes=OWN, tags=["Held"]), lambda _: True)


@pytest.mark.parametrize(
    ("tag", "message"),
    [
        ("Sequense", "did you mean 'Sequence'"),
        ("Grip", "did you mean 'Grab'|registry"),
        ("Switch2", "cannot contain"),
    ],
)
def test_tag_that_cannot_be_generated_is_refused(tag: str, message: str) -> None:
    with pytest.raises(InvalidArgument, match=message):
        find(xml_documents(nodes=OWN, tags=[tag]), lambda _: True)


# --- outcomes and blackboards


@given(outcomes())
def test_outcomes_neither_skip_nor_raise_by_default(plan: Outcomes) -> None:
    assert 1 <= len(parse_outcomes(plan.shared)) <= 12
    assert set(plan.shared) <= set("RSF|")


def test_outcomes_shrink_to_a_single_success() -> None:
    assert find(outcomes(skipped=True, raising=True), lambda _: True, settings=SMALLEST) == Outcomes("S")


def test_outcomes_may_skip_and_raise() -> None:
    assert find(outcomes(skipped=True), lambda plan: "K" in plan.shared, settings=SMALLEST) == Outcomes("K")
    assert find(outcomes(raising=True), lambda plan: "X" in plan.shared, settings=SMALLEST) == Outcomes("X")


@given(blackboards({"battery": st.floats(0, 1), "goal": str, "tries": int, "armed": bool, "gain": float}))
def test_blackboard_contains_the_requested_entries(board: Blackboard) -> None:
    assert set(board) == {"battery", "goal", "tries", "armed", "gain"}
    assert {type(board[key]) for key in ("battery", "gain")} <= {float}
    assert board["armed"] in (True, False)
