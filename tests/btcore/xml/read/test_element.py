"""Expat reads plain texts, always with the result of tinyxml2's rules."""

from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from btcore.errors import XmlSyntaxError
from btcore.xml.read.element import Element, parse_with_expat
from btcore.xml.read.read import parse_text
from btcore.xml.read.tinyxml2_parser import parse_as_tinyxml2

PIECES = (
    "<a>",
    "</a>",
    "<a/>",
    "<b x='1'>",
    "</b>",
    '<b x="1" y="2"/>',
    '<b y="" x=""/>',
    "<é/>",
    "<a:b/>",
    "<a.b-c/>",
    '<a xmlns="u"/>',
    '<a xmlns:p="u"><p:b p:x="1"/></a>',
    '<a xml:lang="en"/>',
    '<a x="1" x="2"/>',
    '<a x="1"y="2"/>',
    '<a x="&lt;&amp;&#65;&#x42;&#10;"/>',
    '<a x="&#0;"/>',
    '<a x="&nbsp;"/>',
    '<a x="\n\t "/>',
    "<a x='\"'/>",
    '<a x="\x01"/>',
    '<a x="\ufffe"/>',
    '<a x="😀"/>',
    '<a x="<"/>',
    '<a x=">"/>',
    "<a x/>",
    "<a\n  x = '1'\r\n/>",
    "<!-- x -->",
    "<!-- -- -->",
    "<!-- <a x='1'> -->",
    "<![CDATA[<a>]]>",
    "]]>",
    "text",
    "&amp;",
    "&nope;",
    "&#xD800;",
    '<?xml version="1.0"?>',
    '<?xml version="1.0" encoding="UTF-8"?>',
    '<?xml version="1.1"?>',
    "<?pi x?>",
    "<?XML x?>",
    '<?xml version="1.0" encoding="latin-1" standalone="yes"?>',
    "<!DOCTYPE a>",
    "<!doctype a>",
    " ",
    "\n",
    "\r",
    "\x7f",
)


def shape(element: Element) -> Any:
    children = [shape(child) for child in element.children]
    return element.tag, list(element.attributes.items()), element.line, children


def check_equal_results(text: str) -> None:
    with suppress(XmlSyntaxError):
        document = parse_text(text)
        root, warnings = parse_as_tinyxml2(text, "")
        assert shape(document.root) == shape(root)
        assert document.warnings == warnings


@given(st.lists(st.sampled_from(PIECES), max_size=12), st.booleans())
def test_expat_reads_the_same_as_tinyxml2(pieces: list[str], whole: bool) -> None:
    text = "".join(pieces)
    check_equal_results(f"<root>{text}</root>" if whole else text)


@pytest.mark.parametrize("piece", PIECES)
def test_each_piece_alone_is_read_the_same_as_by_tinyxml2(piece: str) -> None:
    for text in (piece, f"{piece}<root/>", f"<root>{piece}</root>"):
        check_equal_results(text)


def test_bundled_trees_are_read_by_expat() -> None:
    files = sorted((Path(__file__).parents[4] / "trees").rglob("*.xml"))
    assert files
    for file in files:
        assert parse_with_expat(file.read_bytes()) is not None, file
        check_equal_results(file.read_text())


def test_element_has_the_line_where_its_tag_begins() -> None:
    plain = parse_with_expat(
        b"<?xml version='1.0'?>\n<root\n  x='1'>\n\n  <a/><b\n/>\r\n<c>\r<d/></c></root>"
    )
    assert plain is not None
    assert {one.tag: one.line for one in plain.iter()} == {"root": 2, "a": 5, "b": 5, "c": 7, "d": 8}


def test_deep_nesting_is_not_read_by_expat() -> None:
    assert parse_with_expat(b"<a>" * 1_900 + b"</a>" * 1_900) is not None
    assert parse_with_expat(b"<a>" * 2_100 + b"</a>" * 2_100) is None


def test_elements_are_found_by_their_tags() -> None:
    plain = parse_with_expat(b"<root><a><b/></a><c/><a/></root>")
    assert plain is not None
    assert [one.tag for one in plain.iter()] == ["root", "a", "b", "c", "a"]
    assert [one.tag for one in plain.iter("a", "b")] == ["a", "b", "a"]
    assert [one.tag for one in plain.iterchildren("c", "b")] == ["c"]
