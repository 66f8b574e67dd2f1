"""Positions of editors, in UTF-16 code units, and offsets in the text."""

from hypothesis import given
from hypothesis import strategies as st
from lsprotocol.types import Position

from btcore_studio.language.text_positions import TextPositions

TEXTS = st.text(st.sampled_from("aé€🤖𝄞\n\r\t<"), max_size=40)


def test_columns_count_utf16_code_units() -> None:
    text = 'a\r\n<Say x="🤖é"/>\nß'
    positions = TextPositions(text)
    assert positions.position(text.index("é")) == Position(1, 10)
    assert positions.offset(Position(1, 10)) == text.index("é")
    assert positions.offset(Position(1, 9)) == text.index("🤖")  # between its two code units
    assert positions.position(text.index("ß")) == Position(2, 0)
    assert positions.range(0, 1).end == Position(0, 1)


def test_positions_outside_of_the_text_are_moved_to_the_nearest_place() -> None:
    positions = TextPositions("ab\ncd")
    assert positions.offset(Position(0, 99)) == 2
    assert positions.offset(Position(7, 0)) == 5
    assert positions.position(99) == Position(1, 2)
    assert TextPositions("").position(0) == Position(0, 0)


@given(TEXTS)
def test_positions_agree_with_the_encoded_text(text: str) -> None:
    positions = TextPositions(text)
    for offset in range(len(text) + 1):
        before = text[:offset].replace("\r\n", "\n").replace("\r", "\n")
        if text[offset - 1 : offset + 1] == "\r\n":
            continue  # inside a line break
        line = before.count("\n")
        units = len(before.rsplit("\n", 1)[-1].encode("utf-16-le")) // 2
        assert positions.position(offset) == Position(line, units)
        assert positions.offset(Position(line, units)) == offset
