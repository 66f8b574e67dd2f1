"""Conversion of format 3 into format 4: rewrites, reported changes, and text that stays byte for byte."""

import gzip
import json
import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from btcore import Diagnostic, Registry, TreeError
from btcore.xml.edit.editor import apply_edits
from btcore.xml.read.read import parse_text
from btcore.xml.read.scan import scan
from btcore.xml.read.tinyxml2_compat import START_TAG
from btcore_studio.convert.convert import Conversion, convert
from tests.conformance.recorded_cases import conformance_registry, run_case
from tests.tools.btcore_studio.edit.inverse_edits import invert_edits

RECORDED = Path(__file__).parents[3] / "conformance" / "data" / "v3_full.jsonl.gz"
NODES = conformance_registry()
THREE = "<AlwaysSuccess/>" * 3


def changes_meaning(diagnostic: Diagnostic) -> bool:
    """Return whether format 4 behaves differently, or requires a manual step."""
    return diagnostic.code.startswith(("C2", "C3"))


def convert_body(body: str, *, others: str = "", nodes: Registry = NODES) -> Conversion:
    text = f'<root><BehaviorTree ID="Main">{body}</BehaviorTree>{others}</root>'
    return convert(parse_text(text), nodes)


def body_of(result: Conversion) -> str:
    found = re.search(r'<BehaviorTree ID="Main">(.*?)</BehaviorTree>', result.text, re.S)
    assert found is not None
    return found[1]


def codes(result: Conversion) -> list[str]:
    return [change.code for change in result.changes]


def recorded_cases() -> list[dict[str, Any]]:
    with gzip.open(RECORDED, "rt", encoding="utf-8") as lines:
        return [json.loads(line) for line in lines]


# --- rewrites


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (
            "<SequenceStar><AlwaysSuccess/></SequenceStar>",
            "<SequenceWithMemory><AlwaysSuccess/></SequenceWithMemory>",
        ),
        (
            '<Control ID="SequenceStar"><AlwaysSuccess/></Control>',
            '<Control ID="SequenceWithMemory"><AlwaysSuccess/></Control>',
        ),
        (
            "<RetryUntilSuccesful num_attempts='2'><AlwaysFailure/></RetryUntilSuccesful >",
            "<RetryUntilSuccessful num_attempts='2'><AlwaysFailure/></RetryUntilSuccessful >",
        ),
        (
            '<Parallel failure_threshold="1" success_threshold="2"><AlwaysSuccess/></Parallel>',
            '<Parallel failure_count="1" success_count="2"><AlwaysSuccess/></Parallel>',
        ),
        ('<Timeout msec="+500"><AlwaysSuccess/></Timeout>', '<Timeout msec="500"><AlwaysSuccess/></Timeout>'),
        (
            '<Repeat num_cycles="${n}"><AlwaysSuccess/></Repeat>',
            '<Repeat num_cycles="{n}"><AlwaysSuccess/></Repeat>',
        ),
        (
            '<Repeat num_cycles="="><AlwaysSuccess/></Repeat>',
            '<Repeat num_cycles="{=}"><AlwaysSuccess/></Repeat>',
        ),
        ('<Repeat num_cycles=""><AlwaysSuccess/></Repeat>', "<Repeat><AlwaysSuccess/></Repeat>"),
        ('<Inc in="{a}" out="b"/>', '<Inc in="{a}" out="{b}"/>'),
        ('<SetBlackboard value="1" output_key="k"/>', '<SetBlackboard value="1" output_key="k"/>'),
        (
            '<ReactiveSequence><Condition ID="PlanCondition" plan="S"/></ReactiveSequence>',
            '<ReactiveSequence><PlanCondition plan="S"/></ReactiveSequence>',
        ),
    ],
)
def test_nodes_and_ports_are_rewritten_for_format_4(old: str, new: str) -> None:
    assert body_of(convert_body(old)) == new


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('<SubTree ID="Sub" in="out"/>', '<SubTree ID="Sub" in="{out}"/>'),
        ('<SubTree in="{out}" ID="Sub"/>', '<SubTree in="{out}" ID="Sub"/>'),
        ('<SubTree ID="Sub" in=""/>', '<SubTree ID="Sub"/>'),
        ('<SubTree ID="Sub" __shared_blackboard="true" in="x"/>', '<SubTree ID="Sub" _autoremap="true"/>'),
        ('<SubTree ID="Sub" __shared_blackboard="0" in="x"/>', '<SubTree ID="Sub" in="{x}"/>'),
        (
            '<SubTreePlus ID="Sub" __autoremap="1"></SubTreePlus>',
            '<SubTree ID="Sub" _autoremap="1"></SubTree>',
        ),
        ('<SubTreePlus ID="Sub" a="${k}" b="text"/>', '<SubTree ID="Sub" a="{k}" b="text"/>'),
    ],
)
def test_subtree_calls_are_rewritten_for_format_4(old: str, new: str) -> None:
    result = convert_body(old, others='<BehaviorTree ID="Sub"><AlwaysSuccess/></BehaviorTree>')
    assert body_of(result) == new
    assert result.remaining == []


@pytest.mark.parametrize(
    ("check", "precondition"),
    [
        ('Int value_A="{n}" value_B="3"', 'if="n == 3"'),
        ('Double value_A="{n}" value_B="2.50"', 'if="n == 2.5"'),
        ('Bool value_B="TRUE" value_A="{n}"', 'if="n == true"'),
        ('String value_A="{s}" value_B="go" return_on_mismatch="SUCCESS"', 'if="s == \'go\'" else="SUCCESS"'),
    ],
)
def test_a_blackboard_check_becomes_a_precondition(check: str, precondition: str) -> None:
    name = "BlackboardCheck" + check.split()[0]
    result = convert_body(f"<BlackboardCheck{check}><AlwaysSuccess/></{name}>")
    assert body_of(result) == f"<Precondition {precondition}><AlwaysSuccess/></Precondition>"
    assert "C211" in codes(result)


@pytest.mark.parametrize("key", ["a.b", "@a", "two words"])
def test_comparison_that_no_script_can_express_is_kept_and_reported(key: str) -> None:
    body = f'<BlackboardCheckInt value_A="{{{key}}}" value_B="1"><AlwaysSuccess/></BlackboardCheckInt>'
    result = convert_body(body)
    assert body_of(result) == body
    assert "C301" in codes(result)
    assert [diagnostic.code for diagnostic in result.remaining] == ["E101"]


# --- reported changes


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ('<Repeat num_cycles="3"><AlwaysSuccess/></Repeat>', "C201"),
        ('<SubTreePlus ID="Main2" x="2.5"/>', "C210"),
        ('<PlanSync plan=" {x} "/>', "C212"),
        ('<Repeat num_cycles=""><AlwaysSuccess/></Repeat>', "C214"),
    ],
)
def test_new_meaning_is_reported_with_its_position(body: str, code: str) -> None:
    result = convert_body(body, others='<BehaviorTree ID="Main2"><AlwaysSuccess/></BehaviorTree>')
    reported_values = [change for change in result.changes if change.code == code]
    assert len(reported_values) >= 1
    assert all(
        changes_meaning(change) and change.line == 1 and change.column > 1 and change.source
        for change in reported_values
    )


@pytest.mark.parametrize(
    "body",
    [
        '<Repeat num_cycles="1"><AlwaysSuccess/></Repeat>',
        "<SequenceStar><AlwaysSuccess/></SequenceStar>",
        f'<Switch2 variable="{{v}}" case_1="a" case_2="b">{THREE}</Switch2>',
        '<Sequence><Inc in="{a}" out="b"/></Sequence>',
        '<SubTreePlus ID="Main2" x="text" y="{z}"/>',
    ],
)
def test_same_meaning_is_not_reported_as_a_change_of_meaning(body: str) -> None:
    result = convert_body(body, others='<BehaviorTree ID="Main2"><AlwaysSuccess/></BehaviorTree>')
    assert [change for change in result.changes if changes_meaning(change)] == []


def test_second_of_two_calls_with_the_same_name_loses_its_name() -> None:
    result = convert_body(
        '<Sequence><SubTree ID="S" name="n"/><SubTree ID="S" name="n"/></Sequence>',
        others='<BehaviorTree ID="S"><AlwaysSuccess/></BehaviorTree>',
    )
    assert body_of(result) == '<Sequence><SubTree ID="S" name="n"/><SubTree ID="S"/></Sequence>'


def test_use_of_the_later_tree_with_the_same_id_is_reported() -> None:
    others = '<BehaviorTree ID="S"><AlwaysSuccess/></BehaviorTree>' * 2
    assert "C213" in codes(convert_body('<SubTree ID="S"/>', others=others))


def test_constructs_refused_by_format_4_are_reported_as_errors() -> None:
    result = convert_body("<ReactiveSequence/>")
    assert [diagnostic.code for diagnostic in result.remaining] == ["E104"]


def test_unknown_node_is_converted_as_far_as_possible() -> None:
    result = convert_body('<Sequence><Action ID="Move" goal="${g}" speed=""/></Sequence>')
    assert body_of(result) == '<Sequence><Action ID="Move" goal="{g}" speed=""/></Sequence>'
    assert [diagnostic.code for diagnostic in result.remaining] == ["E101"]


def test_user_node_named_like_a_format_4_node_is_reported() -> None:
    assert "C301" in codes(convert_body('<Action ID="Sleep" msec="5"/>'))


def test_included_file_is_not_changed_but_reported() -> None:
    text = '<root><include path="other.xml"/><BehaviorTree ID="A"><AlwaysSuccess/></BehaviorTree></root>'
    assert "C301" in codes(convert(parse_text(text), NODES))


@pytest.mark.parametrize("text", ["<roots/>", '<root BTCPP_format="5"/>'])
def test_document_of_neither_format_is_refused(text: str) -> None:
    with pytest.raises(TreeError):
        convert(parse_text(text), NODES)


# --- unchanged text


def test_comments_layout_order_and_quotes_are_kept() -> None:
    text = (
        "<?xml version='1.0'?>\r\n<!-- <SequenceStar> by Groot -->\r\n"
        "<root  main_tree_to_execute='Main'>\r\n\t<BehaviorTree ID=\"Main\" >\r\n"
        "\t\t<SequenceStar\r\n\t\t\tname = 'a < b &amp; c'   >\r\n\t\t\t<!-- <SubTreePlus/> -->"
        "<AlwaysSuccess />\r\n"
        "\t\t</SequenceStar>\r\n\t</BehaviorTree>\r\n</root>\r\n\r\n<!-- end -->"
    )
    assert convert(parse_text(text), NODES).text == text.replace(
        "<root  main", '<root BTCPP_format="4"  main'
    ).replace("\t<SequenceStar", "\t<SequenceWithMemory").replace("</SequenceStar", "</SequenceWithMemory")


def test_model_of_a_subtree_plus_becomes_a_model_of_a_subtree() -> None:
    text = (
        '<root><BehaviorTree ID="A"><SubTreePlus ID="B" x="{y}"/></BehaviorTree>'
        '<BehaviorTree ID="B"><AlwaysSuccess/></BehaviorTree>'
        '<TreeNodesModel><SubTreePlus ID="B"><input_port name="x"/></SubTreePlus></TreeNodesModel></root>'
    )
    found = convert(parse_text(text), NODES)
    assert found.text == text.replace("<root>", '<root BTCPP_format="4">').replace("SubTreePlus", "SubTree")
    assert [(change.code, change.message) for change in found.changes[2:]] == [
        ("C102", "the model of a <SubTreePlus> becomes one of a <SubTree>")
    ]


def test_format_4_is_returned_unchanged() -> None:
    text = '<root BTCPP_format="4"><BehaviorTree ID="A"><SequenceStar/></BehaviorTree></root>'
    result = convert(parse_text(text), NODES)
    assert result[:3] == (text, (), [])
    assert [diagnostic.code for diagnostic in result.remaining] == ["E101"]


GAPS = st.sampled_from([" ", "  ", "\n    ", "\t", "\r\n"])
BETWEEN = st.sampled_from(["", "\n", "<!-- <Repeat> é -->", "  ", "<![CDATA[<SubTree>]]>", "\n\n\t"])
CASES = recorded_cases()


@settings(max_examples=2 * settings().max_examples)
@given(case=st.sampled_from(CASES), data=st.data())
def test_only_tags_are_changed_and_only_once(case: dict[str, Any], data: st.DataObject) -> None:
    def spread(tag: re.Match[str]) -> str:
        return re.sub(r" (?=[\w]+=)", lambda _: data.draw(GAPS), tag[0]) + data.draw(BETWEEN)

    text = START_TAG.sub(spread, case["xml"])
    result = convert(parse_text(text), NODES)
    assert re.split(r"<[^<>!?]*>", result.text) == re.split(r"<[^<>!?]*>", text)
    reported_values = {(change.line, change.source) for change in result.changes}
    for before, after in zip(scan(text).elements, scan(result.text).elements, strict=True):
        old = text[before.start : before.start_tag_end]
        if old != result.text[after.start : after.start_tag_end]:
            line = text.count("\n", 0, before.start) + 1
            assert any(line <= at <= line + old.count("\n") for at, _ in reported_values)
    assert convert(parse_text(result.text), NODES).text == result.text
    assert apply_edits(result.text, invert_edits(text, result.edits)) == text


# --- behaviour


def test_recorded_trees_tick_the_same_in_format_4_unless_a_change_is_reported() -> None:
    alike = 0
    for case in CASES:
        # Format 3 calls a SubTree node by its tree's ID, whatever its name.
        old = {**case, "xml": re.sub(r'<SubTree name="[^"]*"', "<SubTree", case["xml"])}
        result = convert(parse_text(old["xml"]), NODES)
        assert result.remaining == []
        found = run_case({**old, "xml": result.text, "format": 4}, NODES)
        assert "load_error" not in found, case["id"]
        if not any(changes_meaning(change) for change in result.changes):
            alike += 1
            assert found == run_case(old, NODES), case["id"]
    assert alike >= 300
