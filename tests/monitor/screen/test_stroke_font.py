"""Letters and symbols as strokes."""

import string

import pytest
from hypothesis import given
from hypothesis import strategies as st

from btcore_monitor.screen.font import elide, glyph, legible, place_strokes, spell, strokes_of, width_of
from btcore_monitor.screen.symbols import symbol_strokes

BOX = glyph("漢")
"""The glyph of a character that the font does not have."""


def test_every_printable_character_of_ascii_has_its_own_glyph():
    seen = set()
    for character in string.printable.strip():
        letter = glyph(character)
        assert letter != BOX
        seen.add(letter[1])
    assert len(seen) == len(string.printable.strip())


def test_accented_letters_have_the_width_of_their_plain_letters():
    for accented, plain in (("é", "e"), ("Å", "A"), ("ü", "u"), ("ç", "c"), ("ñ", "n"), ("ï", "i")):
        assert glyph(accented) != BOX
        assert glyph(accented)[0] == glyph(plain)[0]
        assert len(glyph(accented)[1]) >= len(glyph(plain)[1])


@given(st.text(max_size=30), st.floats(1, 100))
def test_text_stays_between_its_start_and_its_width(text, height):
    width = width_of(text, height)
    for stroke in strokes_of(text, 5.0, 7.0, height):
        for x, y in stroke:
            assert 5.0 - 0.3 * height <= x <= 5.0 + width + 0.3 * height
            assert 7.0 - 1.6 * height <= y <= 7.0 + 0.5 * height


@given(st.text(max_size=60), st.integers(6, 40))
def test_an_elided_name_fits_and_keeps_both_ends(text, room):
    short = elide(text, room)
    assert len(short) <= room
    if len(text) <= room:
        assert short == text
    else:
        head, tail = short.split("…", 1) if "…" not in text else (short[:2], short[-1:])
        assert text.startswith(head)
        assert text.endswith(tail)


@pytest.mark.parametrize(
    "pair",
    [
        ("Sequence", "Fallback"),
        ("Sequence", "ReactiveSequence"),
        ("Sequence", "Parallel"),
        ("Fallback", "ReactiveFallback"),
        ("Fallback", "Inverter"),
        ("Repeat", "RetryUntilSuccessful"),
        ("ForceSuccess", "ForceFailure"),
    ],
)
def test_similar_kinds_have_different_symbols(pair):
    one, other = pair
    assert symbol_strokes(one, "control") != symbol_strokes(other, "control")


def test_symbols_fit_the_badge_and_unknown_nodes_are_drawn_by_their_kind():
    kinds = ("action", "condition", "control", "decorator", "subtree")
    for kind in kinds:
        for stroke in place_strokes(symbol_strokes("SomethingOfYourOwn", kind), 100.0, 50.0, 1.0):
            for x, y in stroke:
                assert abs(x - 100.0) <= 11.0
                assert abs(y - 50.0) <= 11.0
    assert len({str(symbol_strokes("SomethingOfYourOwn", kind)) for kind in kinds}) == len(kinds)


@pytest.mark.parametrize(
    ("text", "drawn"),
    [
        ("Drive → 90° ✓", "Drive → 90° ✓"),
        ("Δρόμος Ход", "Δρόμος Ход"),
        ("充电🔋", "□□□"),
        ("عربي", "□□□□"),
        ("cafe\u0301 ⚠\ufe0f\u2003\x07", "café ⚠ □"),
    ],
)
def test_characters_that_the_viewer_lacks_are_replaced(text, drawn):
    assert legible(text) == drawn


@given(st.text(), st.text())
def test_spelled_names_can_be_drawn_and_stay_different(one, other):
    assert legible(spell(one)) == spell(one)
    assert one == other or spell(one) != spell(other) or "u" in one + other
