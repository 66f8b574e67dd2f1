"""Huge documents and thousands of mistakes: bounded messages in a bounded time."""

import re
import time
from pathlib import Path

import pytest

from btcore import Registry, TreeError, load, loads
from btcore.errors import XmlSyntaxError
from btcore.lint.validate import validate_document
from btcore.xml.read.read import parse_text

LIMIT_S = 20.0  # of processor time; the tests need 0.5 s, and with checks in quadratic time 100 s and more
TREE = '<BehaviorTree ID="T#"><SubTree ID="X#"/></BehaviorTree>'
CALL = '<SubTree ID="A"/>'
ATTRIBUTE = 'a#="1"'
A = '<BehaviorTree ID="A"><AlwaysSuccess/></BehaviorTree>'


def document(main: str, more: str = "") -> str:
    """Return a document with the main tree M and *more* elements."""
    tree = f'<BehaviorTree ID="M">{main}</BehaviorTree>'
    return f'<root BTCPP_format="4" main_tree_to_execute="M">{tree}{more}</root>'


def numbered(pattern: str, count: int = 20_000) -> str:
    """Return *count* copies of *pattern*, with their numbers for "#"."""
    return " ".join(pattern.replace("#", str(index)) for index in range(count))


@pytest.mark.parametrize(
    ("main", "more", "code"),
    [
        (f"<AlwaysSuccess {numbered(ATTRIBUTE)}/>", "", "E201"),
        (f'<SubTree ID="A" {numbered(ATTRIBUTE)}/>', A, "W204"),
        ("<AlwaysSuccess/>", numbered(TREE, 5_000), "E109"),
    ],
    ids=["ports", "remappings", "subtrees"],
)
def test_thousands_of_mistakes_are_found_in_seconds(main: str, more: str, code: str) -> None:
    begin = time.process_time()
    found = validate_document(parse_text(document(main, more)), nodes=Registry.standard())
    assert time.process_time() - begin < LIMIT_S
    assert sum(item.code == code for item in found) >= 5_000


def test_only_the_first_mistakes_are_compared_with_known_names() -> None:
    text = document(f"<Sequence>{numbered('<Repaet#/>', 5_000)}</Sequence>")
    found = validate_document(parse_text(text), nodes=Registry.standard())
    suggested = [item for item in found if "did you mean <Repeat>?" in item.hint]
    assert found[: len(suggested)] == suggested
    assert 100 <= len(suggested) < 2_000


def test_number_of_included_files_is_limited() -> None:
    text = document("<AlwaysSuccess/>", numbered('<include path="#.xml"/>'))
    found = validate_document(parse_text(text), nodes=Registry.standard())
    assert found[-1].message == "the document includes more than 1,000 files"
    assert len(found) == 1_001


def test_a_message_shows_the_first_hundred_errors_and_counts_the_others() -> None:
    with pytest.raises(TreeError) as caught:
        loads(document("<Sequence>" + "\n<Foo/>" * 1_234 + "</Sequence>"))
    message = str(caught.value)
    assert len(caught.value.diagnostics) == 1_234
    assert len(re.findall("E101", message)) == 100
    assert message.endswith("\n<text>: 1,134 more errors")


def test_each_file_has_its_own_hundred(tmp_path: Path) -> None:
    main, included = (f"<Sequence>{'<Foo/>' * count}</Sequence>" for count in (149, 150))
    (tmp_path / "a.xml").write_text(f'<root><BehaviorTree ID="A">{included}</BehaviorTree></root>')
    (tmp_path / "m.xml").write_text(document(main, '<include path="a.xml"/>'))
    with pytest.raises(TreeError) as caught:
        load(tmp_path / "m.xml")
    assert str(caught.value).count("E101") == 200
    assert str(caught.value).splitlines()[-2:] == [
        f"{tmp_path}/a.xml: 50 more errors",
        f"{tmp_path}/m.xml: 49 more errors",
    ]


def test_document_of_a_million_nodes_is_refused_before_it_is_parsed() -> None:
    text = document(f"<Sequence>{'<AlwaysSuccess/>' * 1_000_000}</Sequence>")
    begin = time.process_time()
    with pytest.raises(XmlSyntaxError, match="E010 the document has more than 500,000 elements"):
        parse_text(text)
    assert time.process_time() - begin < 1


def test_document_with_millions_of_attributes_is_refused() -> None:
    with pytest.raises(XmlSyntaxError, match=r"E010 the document has more than .* 5,000,000 attributes"):
        parse_text("<root " + "=" * 5_000_001)


def test_tree_with_too_many_nodes_is_a_single_error() -> None:
    text = document(f"<Sequence>{'<AlwaysSuccess/>' * 65_535}</Sequence>")
    (error,) = validate_document(parse_text(text), nodes=Registry.standard())
    assert (error.code, error.message) == ("E117", "the tree has more than 65,535 nodes")


def test_largest_tree_is_not_refused() -> None:
    text = document(f"<Sequence>{'<AlwaysSuccess/>' * 65_534}</Sequence>")
    assert loads(text).nodes[-1].uid == 65_535


def test_message_about_recursive_trees_shows_a_part_of_a_long_cycle() -> None:
    trees = [
        f'<BehaviorTree ID="T{index}"><SubTree ID="T{(index + 1) % 1_000}"/></BehaviorTree>'
        for index in range(1_000)
    ]
    with pytest.raises(TreeError) as caught:
        loads(document('<SubTree ID="T0"/>', "".join(trees)))
    (error,) = caught.value.diagnostics
    assert error.message.startswith("the trees call each other recursively: T0 → T1 → T2 → ")
    assert "T9 → … → T991" in error.message
    assert error.message.endswith("T999 → T0")


def test_ports_of_a_subtree_model_are_limited() -> None:
    ports = numbered('<input_port name="p#"/>')
    models = f'<TreeNodesModel><SubTree ID="A">{ports}</SubTree></TreeNodesModel>'
    found = validate_document(
        parse_text(document('<SubTree ID="A"/>', A + models)), nodes=Registry.standard()
    )
    assert "the model of 'A' has more than 1,000 ports" in [item.message for item in found]
    assert len(found) < 1_100


def test_warnings_about_characters_are_limited() -> None:
    text = document(f"<!--{chr(1) * 100_000}--><AlwaysSuccess/>")
    assert len(parse_text(text).warnings) == 50_000


def test_a_short_document_cannot_cause_millions_of_errors() -> None:
    ports = numbered('<input_port name="p#"/>', 900)
    models = f'<TreeNodesModel><SubTree ID="A">{ports}</SubTree></TreeNodesModel>'
    text = document(f"<Sequence>{CALL * 100}</Sequence>", A + models)
    found = validate_document(parse_text(text), nodes=Registry.standard())
    assert sum(item.code == "E204" for item in found) == 50_000
