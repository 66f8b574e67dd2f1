"""Elements are read by expat where nothing in a text is unusual, always with the result of libxml2."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from btcore.xml.read.element import Element, parse_with_expat
from btcore.xml.read.libxml2 import parse_with_libxml2

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
    return element.tag, list(element.attributes.items()), [shape(child) for child in element.children]


@given(st.lists(st.sampled_from(PIECES), max_size=12), st.booleans())
def test_expat_reads_the_same_as_libxml2(pieces: list[str], whole: bool) -> None:
    text = "".join(pieces)
    data = (f"<root>{text}</root>" if whole else text).encode()
    plain = parse_with_expat(data)
    assert plain is None or shape(plain) == shape(parse_with_libxml2(data))


@pytest.mark.parametrize("piece", PIECES)
def test_each_piece_alone_is_read_the_same_as_by_libxml2(piece: str) -> None:
    for data in (piece.encode(), f"{piece}<root/>".encode(), f"<root>{piece}</root>".encode()):
        plain = parse_with_expat(data)
        assert plain is None or shape(plain) == shape(parse_with_libxml2(data))


def test_bundled_trees_are_read_by_expat() -> None:
    files = sorted((Path(__file__).parents[3] / "trees").rglob("*.xml"))
    assert files
    for file in files:
        plain = parse_with_expat(file.read_bytes())
        assert plain is not None, file
        assert shape(plain) == shape(parse_with_libxml2(file.read_bytes()))


def test_element_has_the_line_where_its_tag_begins() -> None:
    plain = parse_with_expat(
        b"<?xml version='1.0'?>\n<root\n  x='1'>\n\n  <a/><b\n/>\r\n<c>\r<d/></c></root>"
    )
    assert plain is not None
    assert {one.tag: one.line for one in plain.iter()} == {"root": 2, "a": 5, "b": 5, "c": 7, "d": 8}


def test_deep_nesting_is_left_to_libxml2() -> None:
    assert parse_with_expat(b"<a>" * 1_900 + b"</a>" * 1_900) is not None
    assert parse_with_expat(b"<a>" * 2_100 + b"</a>" * 2_100) is None


def test_elements_are_found_by_their_tags() -> None:
    plain = parse_with_expat(b"<root><a><b/></a><c/><a/></root>")
    assert plain is not None
    assert [one.tag for one in plain.iter()] == ["root", "a", "b", "c", "a"]
    assert [one.tag for one in plain.iter("a", "b")] == ["a", "b", "a"]
    assert [one.tag for one in plain.iterchildren("c", "b")] == ["c"]
