"""The scanner finds elements in any text: as the parser in correct files, and in spite of mistakes."""

import gzip
import json
from itertools import islice
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from btcore.errors import XmlSyntaxError
from btcore.xml.read.element import Element
from btcore.xml.read.read import parse_text
from btcore.xml.read.scan import Place, Scan, ScannedElement, scan, value_offsets

ROOT = Path(__file__).parents[4]
FILES = sorted(path for folder in ("trees", "examples") for path in (ROOT / folder).rglob("*.xml"))


def place(marked: str) -> tuple[Place, Scan]:
    """Return the place of the cursor, which is written as "|"."""
    found = scan(marked.replace("|", ""))
    return found.element_at(marked.index("|")), found


def shape(element: Element | ScannedElement) -> object:
    children = [shape(child) for child in element.children]
    attributes = element.attributes
    if isinstance(attributes, dict):
        return element.tag, attributes, children
    return element.tag, {attribute.name: attribute.value for attribute in attributes}, children


def tags(element: ScannedElement) -> str:
    inside = " ".join(map(tags, element.children))
    return f"{element.tag}({inside})" if inside else element.tag


def check_spans(found: Scan) -> None:
    text = found.text
    starts = [element.start for element in found.elements]
    assert starts == sorted(starts)
    assert [each for root in found.roots for each in root.iter()] == found.elements
    for element in found.elements:
        assert text[element.start] == "<"
        assert text[element.tag_start : element.tag_end] == element.tag
        assert element.tag_end <= element.start_tag_end <= element.end <= len(text)
        assert found.element_at(element.tag_end).element is element
        for child in element.children:
            assert child.parent is element
            assert element.start_tag_end <= child.start
            assert child.end <= element.end
        for attribute in element.attributes:
            assert text[attribute.start : attribute.name_end] == attribute.name
            assert element.tag_end <= attribute.start <= attribute.value_start <= attribute.value_end
            assert attribute.value_end <= attribute.end <= element.start_tag_end
            if attribute.value is not None:
                offsets = value_offsets(text, attribute)
                assert len(offsets) == len(attribute.value) + 1
                assert found.element_at(attribute.value_end).attribute is attribute


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_scan_of_a_correct_file_has_the_elements_of_the_parser(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    found = scan(text)
    assert len(found.roots) == 1
    assert shape(found.roots[0]) == shape(parse_text(text).root)
    check_spans(found)


@pytest.mark.parametrize(
    "text",
    [
        """<?xml version="1.0"?><!-- <A> --><root a='1' b = "x &amp; &#x1F916;é"><![CDATA[<B>]]></root >""",
        '<root><A\n\tc="l\r\nm"/></root>',
        '<root><A _skipIf="a < 5 && b > 3"b="1"/></root>',
        "< root>< A/>< /root>",
    ],
)
def test_scan_has_the_elements_that_only_tinyxml2_accepts(text: str) -> None:
    assert shape(scan(text).roots[0]) == shape(parse_text(text).root)
    check_spans(scan(text))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("<r><S><F><A/></S><B/></r>", "r(S(F(A)) B)"),  # a missing end tag
        ("<r><S><A/></F></S><B/></r>", "r(S(A) B)"),  # a missing start tag
        ("<r><S><A \n<B/></S></r>", "r(S(A B))"),  # a start tag that is being typed
        ("<r><S \n<B/></S><C/></r>", "r(S(B) C)"),  # the same with an end tag
        ('<r><A x="1/>\n <B y="2"/></r>', "r(A B)"),  # a missing quote
        ('<r><A x="><B y="2"/></r>', "r(A(B))"),
        ("<r><S><A/>", "r(S(A))"),
        ("<r><", "r"),
        ("<r><!-- <A/>", "r"),
    ],
)
def test_a_mistake_stays_local(text: str, expected: str) -> None:
    found = scan(text)
    assert [tags(root) for root in found.roots] == [expected]
    check_spans(found)


def test_places_of_the_cursor() -> None:
    assert place("<r><S|eq x='1'/></r>")[0].kind == "tag"
    at, found = place("<r><S>\n<|</S></r>")
    assert (at.kind, at.element, at.parent) == ("tag", None, found.elements[1])
    assert place("<r><S |/></r>")[0].kind == "in_tag"
    at, _ = place("<r><S po|rt='1'/></r>")
    assert at.kind == "attribute"
    assert at.attribute is not None
    at, found = place("<r><S port='ab|c'/></r>")
    assert at.kind == "value"
    assert found.text[at.start : at.end] == "abc"
    assert place("<r><S port='|'/></r>")[0].kind == "value"
    assert place('<r><S port="|')[0].kind == "value"
    assert place("<r><S></S|></r>")[0].kind == "end_tag"
    assert place("<r><!-- | --></r>")[0].kind == "comment"
    at, found = place("<r><S><!-- c --> |</S></r>")
    assert (at.kind, at.parent) == ("text", found.elements[1])
    at, found = place("<r><S/>|</r>")
    assert (at.kind, at.parent) == ("text", found.elements[0])
    at, found = place("<r><S>|")
    assert (at.kind, at.parent) == ("text", found.elements[1])
    assert place("|")[0].parent is None


PIECES = [
    "<",
    "</",
    "/>",
    ">",
    '"',
    "'",
    "=",
    " ",
    "\n",
    "a",
    "Bé",
    "🤖",
    "<!--",
    "-->",
    "<?",
    "&amp;",
    '<A x="1">',
    "</A>",
]


@settings(max_examples=2 * settings().max_examples)
@example("< a")
@given(st.lists(st.sampled_from(PIECES), max_size=40).map("".join))
def test_any_text_has_consistent_spans(text: str) -> None:
    found = scan(text)
    check_spans(found)
    for offset in range(len(text) + 1):
        at = found.element_at(offset)
        assert at.start <= offset <= at.end


def test_every_beginning_of_a_file_can_be_scanned() -> None:
    text = (ROOT / "trees" / "patrolling.xml").read_text(encoding="utf-8")
    for end in range(0, len(text), 7):
        check_spans(scan(text[:end]))


def test_scan_has_the_elements_of_recorded_documents_with_mistakes() -> None:
    """Whatever tinyxml2 accepts is scanned as it reads it, also documents that other XML tools reject."""
    accepted = 0
    with gzip.open(ROOT / "tests/conformance/data/v4_mutated.jsonl.gz", "rt", encoding="utf-8") as lines:
        texts = [json.loads(line)["xml"] for line in islice(lines, 0, None, 7)]
    for text in texts:
        try:
            root = parse_text(text).root
        except XmlSyntaxError:
            scan(text)
        else:
            accepted += 1
            assert shape(scan(text).roots[0]) == shape(root), text
    assert accepted > 20
