"""Positions in messages refer to the text as written: line and column from 1, in characters."""

import pytest

from btcore.xml.read.document import Document
from btcore.xml.read.element import ElementPart
from btcore.xml.read.positions import LineIndex
from btcore.xml.read.read import parse_text

TEXT = """<?xml version="1.0"?>
<!-- <A/> is a comment -->
<root BTCPP_format="4">
  <BehaviorTree ID="Größe">
    <A  x = "1"
        name='ä'
\ty="a < b &amp;&amp; c"/><B/>
    <!-- <C/>--><C z=""></C>
  </BehaviorTree>
</root>
"""


@pytest.fixture
def document() -> Document:
    return parse_text(TEXT, "t.xml")


@pytest.mark.parametrize(
    ("tag", "attribute", "part", "place"),
    [
        ("root", "", "value", (3, 1, "<root")),
        ("BehaviorTree", "ID", "value", (4, 21, "Größe")),
        ("BehaviorTree", "ID", "name", (4, 17, "ID")),
        ("A", "", "value", (5, 5, "<A")),
        ("A", "x", "name", (5, 9, "x")),
        ("A", "x", "value", (5, 14, "1")),
        ("A", "name", "value", (6, 15, "ä")),
        ("A", "y", "value", (7, 5, "a < b &amp;&amp; c")),
        ("B", "", "value", (7, 26, "<B")),
        ("C", "", "value", (8, 17, "<C")),
        ("C", "z", "value", (8, 22, '""')),
        ("C", "missing", "value", (8, 17, "<C")),
    ],
)
def test_elements_attributes_and_values_are_found(
    document: Document, tag: str, attribute: str, part: ElementPart, place: tuple[int, int, str]
) -> None:
    element = next(document.root.iter(tag))
    found = document.source_map.span(element, attribute, part)
    assert found is not None
    meant = found.source[found.column - 1 : found.column - 1 + found.width]
    assert (found.line, found.column, meant) == place


def test_character_of_a_value_is_found_after_entity_references(document: Document) -> None:
    value = "a < b && c"
    element = next(document.root.iter("A"))
    for number, char in enumerate(value, 1):
        found = document.source_map.span(element, "y", "value", number)
        assert found is not None
        marked = found.source[found.column - 1 : found.column - 1 + found.width]
        assert marked == ("&amp;" if char == "&" else char)


def test_elements_are_numbered_in_document_order(document: Document) -> None:
    for number, element in enumerate(document.root.iter()):
        assert document.source_map.index(element) == number


def test_the_line_of_an_element_is_where_its_tag_begins(document: Document) -> None:
    lines = {str(element.tag): document.line(element) for element in document.root.iter()}
    assert lines == {"root": 3, "BehaviorTree": 4, "A": 5, "B": 7, "C": 8}


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_lines_may_end_with_any_line_ending(end: str) -> None:
    text = end.join(["<root>", "  <A/>", "  <B x='1'/>", "</root>"])
    document = parse_text(text)
    found = document.source_map.span(next(document.root.iter("B")), "x")
    assert found is not None
    assert (found.line, found.column, found.source) == (3, 9, "  <B x='1'/>")


def test_end_of_a_text_is_a_valid_position() -> None:
    assert LineIndex("ab\n").span(3) == (2, 1, 1, "")
