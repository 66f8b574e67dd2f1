"""A stroke font, so that text scales with the drawing.

rerun's labels keep their size on the screen at any zoom, so names in the tree are drawn as line strips. The
letters are made for this project from lines and elliptical arcs, on a grid where a capital is 20 units high,
a small letter 14, and a descender reaches to -6. (The Hershey fonts were considered; the package that
contains them has not been maintained since 2021 and installs a top-level package called `tests`.)

The viewer's own fonts, for its panels, have more letters; `legible` replaces what these fonts lack.

A glyph is written as `width strokes`. Strokes are separated by `/`, and a stroke is a sequence of points
`x,y` and arcs `cx,cy,rx,ry,from,to` (degrees, counter-clockwise if *to* is larger); y points up. A line
of font.txt is a character, a space, and its glyph.
"""

import math
import re
import unicodedata
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import Final

Point = tuple[float, float]
Stroke = list[Point]

CAPITAL: Final = 20.0
_SPACING: Final = 5.2
_ARC_STEP: Final = 18.0
"""Degrees between the points of an arc, a compromise between smooth letters and speed with 1,000 names."""
_CURVE_STEPS: Final = 5
_COMMAND: Final = re.compile("([MLC])([^MLC]*)")
_NUMBER: Final = re.compile(r"-?[0-9]*\.?[0-9]+")

_GLYPHS: Final[dict[str, str]] = {
    line[0]: line[2:]
    for line in Path(__file__).with_name("font.txt").read_text(encoding="utf-8").splitlines()
}
_UNKNOWN: Final = "\N{REPLACEMENT CHARACTER}"

_SHOWN: Final = (
    "\n -~\xa0-¬®-ňŊ-ſƠơƯưǍ-ǜȘ-țẠ-ỹ"
    "΄-ΊΌΎ-ΡΣ-ώЁ-ЌЎ-яё-ќўџҐґ"
    "–—‘-•…‰′″‹›⁰⁴-⁹₀-₉€№™ℓ←-↙⇐⇒⇔∂∆∏∑−√∞∫≈≠≤≥■□▪▲△▶▷▼▽◀◁◆◇○●⚠✓✗"
)
"""The characters of both fonts of the viewer (Inter and JetBrains Mono), as part of a regular expression.

The viewer ends with the error "No glyph" when it has to draw any other character.
"""
_LACKING: Final = re.compile(f"[^{_SHOWN}]")
_LACKING_BOX: Final = "□"

_CEDILLA: Final = "\u0327"
_ACCENTS: Final[dict[str, str]] = {
    "\u0300": "0 -3,4.5 1.5,0",
    "\u0301": "0 -1.5,0 3,4.5",
    "\u0302": "0 -4,0 0,4 4,0",
    "\u0303": "0 -2.5,2,2.5,2,180,0 2.5,2,2.5,2,180,360",
    "\u0304": "0 -4,1.5 4,1.5",
    "\u0306": "0 0,4,4,3.5,180,360",
    "\u0308": "0 -3,2.2 -3,1.6 / 3,2.2 3,1.6",
    "\u030a": "0 0,2.6,2.4,2.4,0,360",
    "\u030c": "0 -4,4 0,0 4,4",
    _CEDILLA: "0 0,0 0.6,-2.5 -1.5,-5",
}


def _arc(cx: float, cy: float, rx: float, ry: float, start: float, end: float) -> Stroke:
    steps = max(2, math.ceil(abs(end - start) / _ARC_STEP))
    points = []
    for step in range(steps + 1):
        angle = math.radians(start + (end - start) * step / steps)
        points.append((cx + rx * math.cos(angle), cy + ry * math.sin(angle)))
    return points


def parse(drawing: str) -> tuple[float, list[Stroke]]:
    """Return the width and the strokes of a drawing in the notation of this module; arcs become points."""
    head, _, rest = drawing.partition(" ")
    strokes: list[Stroke] = []
    for part in rest.split("/"):
        stroke: Stroke = []
        for token in part.split():
            numbers = [float(number) for number in token.split(",")]
            if len(numbers) == 2:
                stroke.append((numbers[0], numbers[1]))
            else:
                stroke.extend(_arc(*numbers))
        if stroke:
            strokes.append(stroke)
    return float(head), strokes


@lru_cache(maxsize=256)
def path_strokes(path: str) -> list[Stroke]:
    """Return the strokes of an SVG path of the commands `M`, `L` and `C` (absolute); y points up."""
    strokes: list[Stroke] = []
    for command, numbers in _COMMAND.findall(path):
        values = [float(number) for number in _NUMBER.findall(numbers)]
        points = [(x, -y) for x, y in zip(values[::2], values[1::2], strict=True)]
        if command == "M":
            strokes.append(points)
        elif command == "L":
            strokes[-1] += points
        else:
            strokes[-1] += _curve(strokes[-1][-1], *points)
    return strokes


def _curve(start: Point, first: Point, second: Point, end: Point) -> Stroke:
    """Return the points of a cubic Bézier curve after its start."""

    def at(axis: int, t: float) -> float:
        s = 1 - t
        return s**3 * start[axis] + 3 * s * t * (s * first[axis] + t * second[axis]) + t**3 * end[axis]

    return [(at(0, step / _CURVE_STEPS), at(1, step / _CURVE_STEPS)) for step in range(1, _CURVE_STEPS + 1)]


def _accent(mark: str, letter: str, width: float) -> list[Stroke]:
    """Return the strokes of *mark* above *letter*, or below it for a cedilla."""
    _, strokes = parse(_ACCENTS[mark])
    base = 0.0 if mark == _CEDILLA else (CAPITAL if letter.isupper() else 14.0) + 3.0
    return [[(x + width / 2, y + base) for x, y in stroke] for stroke in strokes]


@lru_cache(maxsize=1024)
def glyph(character: str) -> tuple[float, tuple[tuple[Point, ...], ...]]:
    """Return the width and the strokes of a character; unknown characters are drawn as a box."""
    letter, marks = character, ""
    if character not in _GLYPHS:
        # The decomposition of an accented letter is the letter, then its combining marks.
        decomposed = unicodedata.normalize("NFKD", character)
        letter, marks = decomposed[0], decomposed[1:]
    stem = "ı" if letter == "i" and marks else letter
    if stem not in _GLYPHS or not _ACCENTS.keys() >= set(marks):
        stem, marks = _UNKNOWN, ""
    width, strokes = parse(_GLYPHS[stem])
    for mark in marks:
        strokes = strokes + _accent(mark, letter, width)
    return width, tuple(map(tuple, strokes))


def width_of(text: str, height: float) -> float:
    """Return the width of *text* if a capital letter has the height *height*."""
    if not text:
        return 0.0
    return (sum(glyph(character)[0] + _SPACING for character in text) - _SPACING) * height / CAPITAL


def strokes_of(text: str, x: float, y: float, height: float) -> list[Stroke]:
    """Return the strokes of a text, in a picture whose y points down.

    Args:
        text: The text to draw.
        x: The x of the text's left end.
        y: The y of the text's base line.
        height: The height of a capital letter.
    """
    scale = height / CAPITAL
    drawn: list[Stroke] = []
    for character in text:
        width, strokes = glyph(character)
        drawn += place_strokes(strokes, x, y, scale)
        x += (width + _SPACING) * scale
    return drawn


def place_strokes(strokes: Iterable[Iterable[Point]], x: float, y: float, scale: float) -> list[Stroke]:
    """Return *strokes*, scaled, with their origin at (x, y) of a picture whose y points down."""
    return [[(x + px * scale, y - py * scale) for px, py in stroke] for stroke in strokes]


def legible(text: str) -> str:
    """Return *text* with the characters replaced that the viewer's fonts lack.

    White space becomes a space, a combining mark is omitted, and every other character becomes `□`.
    """
    if _LACKING.search(text) is None:
        return text
    return _LACKING.sub(_replacement, unicodedata.normalize("NFC", text))


def spell(text: str) -> str:
    """Return *text* with the hexadecimal numbers of the characters that the viewer's fonts lack.

    Unlike `legible`, different texts stay different: `"左"` becomes `u5de6`.
    """
    return _LACKING.sub(lambda match: f"u{ord(match.group()):x}", text)


def _replacement(match: re.Match[str]) -> str:
    character = match.group()
    if character.isspace():
        return " "
    return "" if unicodedata.category(character).startswith("M") else _LACKING_BOX


def elide(text: str, max_chars: int) -> str:
    """Shorten *text* to *max_chars* characters by omitting the middle: names often differ at the ends."""
    if len(text) <= max_chars:
        return text
    tail = (max_chars - 1) // 3
    return text[: max_chars - 1 - tail] + "…" + text[len(text) - tail :]
