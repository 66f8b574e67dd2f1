"""Control characters are escaped: they cannot change a terminal or reorder a line."""

import json
import unicodedata

import pytest

from btcore.diagnostics import excerpt
from btcore.escaping import escape_controls, escape_xml, to_json


@pytest.mark.parametrize(
    ("text", "escaped"),
    [
        ("Move/left [1] → ok 机器人 עברית 🤖\u200d", "Move/left [1] → ok 机器人 עברית 🤖\u200d"),
        ("\x1b]0;title\x07", r"\x1b]0;title\x07"),
        ("\x9b31mred", r"\x9b31mred"),
        ("a\u202eb\u2066c", r"a\u202eb\u2066c"),
        ("a\rb\x08\x7f", r"a\x0db\x08\x7f"),
        ("two\n\tlines", "two\n\tlines"),
        ("\udc9b\u2028", r"\udc9b\u2028"),
        ("", ""),
    ],
)
def test_control_characters_are_escaped_and_other_characters_are_not(text: str, escaped: str) -> None:
    assert escape_controls(text) == escaped
    assert escape_controls(escaped) == escaped


def test_every_control_character_is_escaped() -> None:
    for code in range(0x110000):
        character = chr(code)
        controls = unicodedata.category(character) in ("Cc", "Cs", "Zl", "Zp")
        bidirectional = unicodedata.bidirectional(character) in ("LRE", "RLE", "PDF", "LRO", "RLO") or (
            unicodedata.bidirectional(character) in ("LRI", "RLI", "FSI", "PDI")
        )
        marks = character in "\u061c\u200e\u200f"
        expected = controls or bidirectional or marks
        assert (escape_controls(character, one_line=True) != character) is expected, hex(code)


def test_json_is_the_same_data_without_control_characters() -> None:
    data = {"a\x1b\x9b": ["\u202e\x7f\n", "ä机\udc9b"]}
    for indent in (None, 2):
        text = to_json(data, indent)
        assert json.loads(text) == data
        assert escape_controls(text) == text
        assert "ä机" in text


def test_xml_is_the_same_document_without_control_characters() -> None:
    assert escape_xml('<a b="\x9b\u202eä"/>\n') == '<a b="&#x9b;&#x202e;ä"/>\n'


def test_carets_are_below_the_marked_characters_of_an_escaped_line() -> None:
    assert excerpt("\u202e\u202eab\x9b", 3, 3, 2) == "   3 |  \\u202e\\u202eab\\x9b\n     |              ^^"
    assert excerpt("a\x9bb", 3, 2) == "   3 |  a\\x9bb\n     |   ^^^^"
