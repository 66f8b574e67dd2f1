"""A stroke font, so that text scales with the drawing.

rerun's labels keep their size on the screen at any zoom, so names in the tree are drawn as line strips. The
letters are made for this project from lines and elliptical arcs, on a grid where a capital is 20 units high,
a small letter 14, and a descender reaches to -6. (The Hershey fonts were considered; the package that
contains them has not been maintained since 2021 and installs a top-level package called ``tests``.)

A glyph is written as ``width strokes``. Strokes are separated by ``/``, and a stroke is a sequence of points
``x,y`` and arcs ``cx,cy,rx,ry,from,to`` (degrees, counter-clockwise if *to* is larger); y points up.
"""

import math
import unicodedata
from functools import lru_cache
from typing import Final

Stroke = list[tuple[float, float]]

CAPITAL: Final = 20.0
_SPACING: Final = 5.2
_ARC_STEP: Final = 18.0
"""Degrees between the points of an arc, a compromise between smooth letters and speed with 1,000 names."""

_GLYPHS: Final[dict[str, str]] = {
    " ": "5",
    "!": "1 0.5,20 0.5,7 / 0.5,0.7 0.5,0",
    '"': "5 0,20 0,15 / 5,20 5,15",
    "#": "13 4.5,20 2,0 / 11,20 8.5,0 / 0.5,13.5 13,13.5 / 0,6.5 12.5,6.5",
    "$": "11 5.5,15.4,5.2,4,35,270 5.5,6,5.6,5.4,90,-150 / 5.5,23 5.5,-3",
    "%": "17 15,20 2,0 / 4,15.5,4,4.5,0,360 / 13,4.5,4,4.5,0,360",
    "&": "15 14.5,0 2.6,13.2 6,16,3.8,4,215,0 6,16,3.8,4,0,-60 5.8,5.6,5.8,5.6,115,270 5.8,0 9,0 12.4,4 14,9",
    "'": "0 0,20 0,15",
    "(": "4 12,7.5,12,16,122,238",
    ")": "4 -8,7.5,12,16,58,-58",
    "*": "8 4,20 4,11 / 0,17.8 8,13.2 / 8,17.8 0,13.2",
    "+": "11 5.5,14 5.5,3 / 0,8.5 11,8.5",
    ",": "2 1.5,0.6 1.5,-0.5 0,-4",
    "-": "7 0,8 7,8",
    ".": "0 0,0.6 0,0",
    "/": "8 8,22 0,-3",
    "0": "12 6,10,6,10,90,450",
    "1": "6 0,15.6 5.5,20 5.5,0",
    "2": "11 5.6,14.4,5.4,5.6,165,-38 0,0 11.4,0",
    "3": "11 5.2,15.2,4.7,4.8,150,-90 5.2,5.2,5.8,5.2,90,-150",
    "4": "12 9,0 9,20 0,5.6 12,5.6",
    "5": "11 10,20 1.8,20 0.9,11 5.2,6.4,5.8,6.4,137,-148",
    "6": "11 8.6,20 5.8,6.2,5.8,6.2,147,507",
    "7": "11 0,20 11,20 4,0",
    "8": "12 5.8,15.3,4.7,4.7,0,360 / 5.8,5.3,5.8,5.3,0,360",
    "9": "11 3,0 5.8,13.8,5.8,6.2,-33,327",
    ":": "0 0,0.6 0,0 / 0,12 0,11.4",
    ";": "2 1.5,0.6 1.5,-0.5 0,-4 / 1.5,12 1.5,11.4",
    "<": "10 10,15 0,8.5 10,2",
    "=": "11 0,11.5 11,11.5 / 0,5.5 11,5.5",
    ">": "10 0,15 10,8.5 0,2",
    "?": "9 4.7,15.2,4.7,4.8,165,-50 4.6,9.4 4.6,6.5 / 4.6,0.7 4.6,0",
    "@": "18 9.4,7.5,3.9,4.5,0,360 / 13.3,12 13.3,5 15.6,5.4,2.3,2.6,180,340 9.2,8,9,10,-10,300",
    "A": "14 0,0 7.2,20 14.4,0 / 2.6,6.8 11.8,6.8",
    "B": "12 0,10.5 6.6,10.5 / 0,0 0,20 6.4,20 6.4,15.25,4.7,4.75,90,-90 6.8,5.25,5.4,5.25,90,-90 0,0",
    "C": "15 9,10,9,10,45,315",
    "D": "14 0,0 0,20 5.5,20 5.5,10,8.8,10,90,-90 0,0",
    "E": "10 10.5,20 0,20 0,0 10.5,0 / 0,10.4 9.4,10.4",
    "F": "10 10.2,20 0,20 0,0 / 0,10.2 9,10.2",
    "G": "17 9,10,9,10,45,342 17.6,9.2 10.5,9.2",
    "H": "13 0,20 0,0 / 13,20 13,0 / 0,10.4 13,10.4",
    "I": "0 0,20 0,0",
    "J": "8 8,20 8,5 3.8,5,4.2,5,0,-160",
    "K": "12 0,20 0,0 / 11.4,20 0,7.6 / 4.2,12.2 12.2,0",
    "L": "9 0,20 0,0 9.4,0",
    "M": "16 0,0 0,20 8,5.5 16,20 16,0",
    "N": "13 0,0 0,20 13,0 13,20",
    "O": "19 9.4,10,9.4,10,90,450",
    "P": "11 0,0 0,20 5.8,20 5.8,14.4,5.6,5.6,90,-90 0,8.8",
    "Q": "19 9.4,10,9.4,10,90,450 / 12.4,5.2 18.2,-1.4",
    "R": "12 0,0 0,20 5.8,20 5.8,14.5,5.5,5.5,90,-90 0,9 / 5.6,9 12,0",
    "S": "12 6,15.2,5.5,4.8,32,270 6,5.2,6.1,5.2,90,-150",
    "T": "13 0,20 13,20 / 6.5,20 6.5,0",
    "U": "13 0,20 0,6.5 6.5,6.5,6.5,6.5,180,360 13,20",
    "V": "14 0,20 7,0 14,20",
    "W": "20 0,20 5,0 10,17 15,0 20,20",
    "X": "13 0,20 12.6,0 / 12.6,20 0,0",
    "Y": "13 0,20 6.5,9.6 13,20 / 6.5,9.6 6.5,0",
    "Z": "12 0,20 12,20 0,0 12.4,0",
    "[": "4 4,22 0,22 0,-4 4,-4",
    "\\": "8 0,22 8,-3",
    "]": "4 0,22 4,22 4,-4 0,-4",
    "^": "9 0,13 4.5,20 9,13",
    "_": "11 0,-2.4 11,-2.4",
    "`": "3 0,20 3,16.5",
    "a": "11 11,14 11,0 / 5.5,7,5.5,7,0,360",
    "b": "11 0,21 0,0 / 5.5,7,5.5,7,180,540",
    "c": "9 5.5,7,5.5,7,48,312",
    "d": "11 11,21 11,0 / 5.5,7,5.5,7,0,360",
    "e": "11 0.2,7 11,7 5.5,7,5.5,7,0,312",
    "f": "7 2.2,0 2.2,16 6.2,16,4,5,180,75 / 0,13.6 6.4,13.6",
    "g": "11 11,14 11,-0.6 5.5,-0.6,5.5,5.4,0,-155 / 5.5,7,5.5,7,0,360",
    "h": "10 0,21 0,0 / 0,8.6 5,8.6,5,5.4,180,0 10,0",
    "i": "0 0,14 0,0 / 0,19.6 0,19",
    "j": "2 2,14 2,-2.4 -0.8,-2.4,2.8,3.6,0,-80 / 2,19.6 2,19",
    "k": "9 0,21 0,0 / 8.8,14 0,5.2 / 3.5,8.7 9.4,0",
    "l": "2 0,21 0,3 2.6,3,2.6,3,180,260",
    "m": "16 0,14 0,0 / 0,9.2 4,9.2,4,4.8,180,0 8,0 / 8,9.2 12,9.2,4,4.8,180,0 16,0",
    "n": "10 0,14 0,0 / 0,8.6 5,8.6,5,5.4,180,0 10,0",
    "o": "11 5.5,7,5.5,7,90,450",
    "p": "11 0,14 0,-6 / 5.5,7,5.5,7,180,540",
    "q": "11 11,14 11,-6 / 5.5,7,5.5,7,0,360",
    "r": "6 0,14 0,0 / 0,8.4 4.8,8.4,4.8,5.6,180,75",
    "s": "9 4.6,10.5,4,3.5,35,270 4.6,3.5,4.6,3.5,90,-148",
    "t": "7 2.4,19 2.4,4 6,4,3.6,4,180,285 / 0,13.6 6.6,13.6",
    "u": "10 0,14 0,5.4 5,5.4,5,5.4,180,360 / 10,14 10,0",
    "v": "10 0,14 5,0 10,14",
    "w": "16 0,14 4,0 8,12 12,0 16,14",
    "x": "9 0,14 9.2,0 / 9.2,14 0,0",
    "y": "10 0,14 5.2,0.4 / 10.4,14 4.4,-2.4 2.7,-5.2 0.4,-5.8",
    "z": "9 0,14 9,14 0,0 9.4,0",
    "{": "6 6,22 4.4,22 3,20.6 3,11 0,9 3,7 3,-2.6 4.4,-4 6,-4",
    "|": "0 0,22 0,-5",
    "}": "6 0,22 1.6,22 3,20.6 3,11 6,9 3,7 3,-2.6 1.6,-4 0,-4",
    "~": "12 3,8.4,3,2.6,180,0 9,8.4,3,2.6,180,360",
    "…": "12 0,0.6 0,0 / 6,0.6 6,0 / 12,0.6 12,0",
    "·": "0 0,8.4 0,7.8",
    "–": "11 0,8 11,8",
    "—": "17 0,8 17,8",
    "°": "6 3,17,3,3,0,360",
    "×": "9 0,13 9,4 / 9,13 0,4",
    "µ": "10 0,14 0,-6 / 0,5.4 5,5.4,5,5.4,180,360 / 10,14 10,0",
    "→": "16 0,8 16,8 / 10.5,13.5 16,8 10.5,2.5",
    "ß": "11 0,0 0,16 4.6,16,4.6,5,180,-60 4.6,11.4 4.6,5.6,6.2,5.8,88,-110",
    "ø": "11 5.5,7,5.5,7,90,450 / 11.5,15 -0.5,-1",
    "Ø": "19 9.4,10,9.4,10,90,450 / 17.5,22 1.3,-2",
    "ı": "0 0,14 0,0",
    "�": "11 0,0 0,20 11,20 11,0 0,0",
}

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
    """Return the width and the strokes of a drawing in the notation above; arcs become points."""
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


def _accent(mark: str, letter: str, width: float) -> list[Stroke]:
    """Return the strokes of *mark* above *letter*, or below it for a cedilla."""
    _, strokes = parse(_ACCENTS[mark])
    base = 0.0 if mark == _CEDILLA else (CAPITAL if letter.isupper() else 14.0) + 3.0
    return [[(x + width / 2, y + base) for x, y in stroke] for stroke in strokes]


@lru_cache(maxsize=1024)
def glyph(character: str) -> tuple[float, tuple[tuple[tuple[float, float], ...], ...]]:
    """Return the width and the strokes of a character; unknown characters are drawn as a box."""
    drawing = _GLYPHS.get(character)
    if drawing is not None:
        width, strokes = parse(drawing)
    else:
        parts = unicodedata.normalize("NFKD", character)
        letter, marks = parts[0], parts[1:]
        stem = "ı" if letter == "i" and marks else letter
        if stem not in _GLYPHS or any(mark not in _ACCENTS for mark in marks):
            width, strokes = parse(_GLYPHS["�"])
        else:
            width, strokes = parse(_GLYPHS[stem])
            for mark in marks:
                strokes = strokes + _accent(mark, letter, width)
    return width, tuple(tuple(stroke) for stroke in strokes)


def width_of(text: str, height: float) -> float:
    """Return the width of *text* if a capital letter has the height *height*."""
    if not text:
        return 0.0
    return (sum(glyph(one)[0] + _SPACING for one in text) - _SPACING) * height / CAPITAL


def strokes_of(text: str, x: float, y: float, height: float) -> list[Stroke]:
    """Return the strokes of a text, in a picture whose y points down.

    Args:
        text: The text.
        x: The left end.
        y: The base line.
        height: The height of a capital letter.
    """
    scale = height / CAPITAL
    drawn: list[Stroke] = []
    for character in text:
        width, strokes = glyph(character)
        for stroke in strokes:
            drawn.append([(x + px * scale, y - py * scale) for px, py in stroke])
        x += (width + _SPACING) * scale
    return drawn


def elide(text: str, room: int) -> str:
    """Shorten *text* to *room* characters by omitting the middle, because names often differ at the ends."""
    if len(text) <= room:
        return text
    tail = (room - 1) // 3
    return text[: room - 1 - tail] + "…" + text[len(text) - tail :]
