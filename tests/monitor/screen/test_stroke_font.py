"""Letters and symbols as strokes."""

import string

import pytest
from hypothesis import given
from hypothesis import strategies as st

from btcore_drawing.symbols import symbol_path
from btcore_monitor.screen.font import elide, glyph, legible, path_strokes, spell, strokes_of, width_of

BOX = glyph("漢")
"""The glyph of a character that the font does not have."""


def test_every_printable_character_of_ascii_has_its_own_glyph() -> None:
    seen = set()
    for character in string.printable.strip():
        letter = glyph(character)
        assert letter != BOX
        seen.add(letter[1])
    assert len(seen) == len(string.printable.strip())


def test_accented_letters_have_the_width_of_their_plain_letters() -> None:
    for accented, plain in (("é", "e"), ("Å", "A"), ("ü", "u"), ("ç", "c"), ("ñ", "n"), ("ï", "i")):
        assert glyph(accented) != BOX
        assert glyph(accented)[0] == glyph(plain)[0]
        assert len(glyph(accented)[1]) >= len(glyph(plain)[1])


@given(st.text(max_size=30), st.floats(1, 100))
def test_text_stays_between_its_start_and_its_width(text: str, height: float) -> None:
    width = width_of(text, height)
    for stroke in strokes_of(text, 5.0, 7.0, height):
        for x, y in stroke:
            assert 5.0 - 0.3 * height <= x <= 5.0 + width + 0.3 * height
            assert 7.0 - 1.6 * height <= y <= 7.0 + 0.5 * height


@given(st.text(max_size=60), st.integers(6, 40))
def test_an_elided_name_fits_and_keeps_both_ends(text: str, room: int) -> None:
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
def test_similar_kinds_have_different_symbols(pair: tuple[str, str]) -> None:
    first, second = pair
    assert symbol_path(first, "control") != symbol_path(second, "control")


def test_symbols_fit_the_badge_and_unknown_nodes_are_drawn_by_their_kind() -> None:
    kinds = ("action", "condition", "control", "decorator", "subtree")
    for name in (*kinds, "Sequence", "ReactiveFallback", "RecoveryNode", "Timeout"):
        for stroke in path_strokes(symbol_path(name, name)):
            assert all(x**2 + y**2 <= 8.7**2 for x, y in stroke)
    paths = {symbol_path("SomethingOfYourOwn", kind) for kind in kinds}
    assert len(paths) == len(kinds)
    assert symbol_path("SomethingOfYourOwn", "alien") not in paths


def test_a_declared_symbol_is_drawn_and_of_two_characters_the_second() -> None:
    assert symbol_path("Hold", "action", "◷") == symbol_path("Timeout", "decorator")
    assert symbol_path("Hold", "action", "⌖◷") == symbol_path("Timeout", "decorator")
    assert symbol_path("Hold", "action", "⌖") == symbol_path("Hold", "action")


def test_a_path_becomes_strokes_with_y_up() -> None:
    assert path_strokes("M-1.5-.5L0 2L.5 0M1 1L2 2") == [[(-1.5, 0.5), (0, -2), (0.5, 0)], [(1, -1), (2, -2)]]
    (curve,) = path_strokes("M0 0C0 4 4 4 4 0")
    assert curve[-1] == (4, 0)
    assert min(y for _, y in curve) == pytest.approx(-3, abs=0.2)


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
def test_characters_that_the_viewer_lacks_are_replaced(text: str, drawn: str) -> None:
    assert legible(text) == drawn


@given(st.text(), st.text())
def test_spelled_names_can_be_drawn_and_stay_different(first: str, second: str) -> None:
    assert legible(spell(first)) == spell(first)
    assert first == second or spell(first) != spell(second) or "u" in first + second
