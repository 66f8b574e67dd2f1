"""Looks: how the viewer draws furniture.

An object of a world has the shape of a box or a cylinder for contacts, laser, sonars and camera pictures. Its
`look`, for example `bed`, replaces that shape in the viewer by parts within the object's bounds. Camera
pictures keep the simple shapes: with all parts, a picture of a house takes three to five times as long.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from btcore_scene import Color

Size = tuple[float, float, float]
"""The extent along x, y and z (m)."""

_TERRACOTTA: Color = (181, 85, 47, 255)
_LEAVES: Color = (61, 122, 65, 255)
_LINEN: Color = (226, 224, 216, 255)
_METAL: Color = (90, 94, 100, 255)
_BOOKS: tuple[Color, ...] = (
    (151, 61, 54, 255),
    (63, 88, 122, 255),
    (186, 166, 120, 255),
    (70, 104, 84, 255),
    (108, 84, 118, 255),
)
_BOARD = 0.03  # m: thickness of a board
_LEG = 0.04  # m: width of a leg
_GAP = 0.008  # m: gap between two fronts


@dataclass(frozen=True, slots=True)
class LookPart:
    """A part of a look.

    Attributes:
        kind: `box`, `cylinder`, `cushion` (a box with rounded edges) or `ball` (an ellipsoid).
        size: The full extent (m) along x, y and z.
        position: The middle of the part's underside in the object's frame, whose origin is the middle of the
            object's underside (m).
        color: The colour (RGBA).
    """

    kind: str
    size: Size
    position: tuple[float, float, float]
    color: Color


def look_parts(look: str, size: Size, color: Color) -> list[LookPart]:
    """Return the parts of a look.

    Args:
        look: The name of the look, one of those in `LOOKS`.
        size: The extent of the object (m).
        color: The colour of the object.
    """
    return (_BOXES | _CYLINDERS)[look](size, color)


def _shade(color: Color, light: float) -> Color:
    red, green, blue, alpha = color
    return min(255, round(red * light)), min(255, round(green * light)), min(255, round(blue * light)), alpha


def _box(size: Size, x: float, y: float, z: float, color: Color, kind: str = "box") -> LookPart:
    return LookPart(kind, size, (x, y, z), color)


def _lengthwise(build: Callable[[Size, Color], list[LookPart]]) -> Callable[[Size, Color], list[LookPart]]:
    """Return a function that builds a look along the longer of the two horizontal sides."""

    def turned(size: Size, color: Color) -> list[LookPart]:
        if size[0] >= size[1]:
            return build(size, color)
        parts = build((size[1], size[0], size[2]), color)
        return [
            replace(
                part,
                size=(part.size[1], part.size[0], part.size[2]),
                position=(-part.position[1], part.position[0], part.position[2]),
            )
            for part in parts
        ]

    return turned


def _seat(size: Size, color: Color) -> list[LookPart]:
    """A base with feet, and cushions on it."""
    long, wide, high = size
    foot, base = 0.12 * high, 0.5 * high
    parts = [_box((long - 0.04, wide - 0.04, foot), 0, 0, 0, _shade(color, 0.4))]
    parts.append(_box((long, wide, base - foot), 0, 0, foot, _shade(color, 0.8), "cushion"))
    count = max(1, round(long / 0.75))
    for k in range(count):
        x = ((k + 0.5) / count - 0.5) * long
        cushion = (long / count - 0.01, wide - 0.01, high - base)
        parts.append(_box(cushion, x, 0, base, color, "cushion"))
    return parts


def _backrest(size: Size, color: Color) -> list[LookPart]:
    long, wide, high = size
    count = max(1, round(long / 0.75))
    parts = [_box((long, wide, 0.45 * high), 0, 0, 0, _shade(color, 0.8), "cushion")]
    for k in range(count):
        x = ((k + 0.5) / count - 0.5) * long
        parts.append(_box((long / count - 0.01, wide, 0.56 * high), x, 0, 0.44 * high, color, "cushion"))
    return parts


def _chair(size: Size, color: Color) -> list[LookPart]:
    long, wide, high = size
    parts = _legs(size, high - _BOARD, color)
    parts.append(_box((long, wide, _BOARD), 0, 0, high - _BOARD, _shade(color, 1.1), "cushion"))
    return parts


def _legs(size: Size, high: float, color: Color) -> list[LookPart]:
    x, y = (size[0] - _LEG) / 2, (size[1] - _LEG) / 2
    corners = ((x, y), (-x, y), (-x, -y), (x, -y))
    return [_box((_LEG, _LEG, high), *corner, 0, _shade(color, 0.85)) for corner in corners]


def _chair_back(size: Size, color: Color) -> list[LookPart]:
    long, wide, high = size
    post = (long - _LEG) / 2
    parts = [_box((_LEG, wide, high), x, 0, 0, _shade(color, 0.85)) for x in (-post, post)]
    for low, tall in ((0.58, 0.12), (0.78, 0.2)):
        parts.append(_box((long - 2 * _LEG, 0.5 * wide, tall * high), 0, 0, low * high, color))
    return parts


def _bed(size: Size, color: Color) -> list[LookPart]:
    """A bed whose head is at the greatest y."""
    long, wide, high = size
    frame, top = 0.5 * high, 0.88 * high
    parts = [
        _box((long - 0.1, wide - 0.1, 0.12), 0, 0, 0, _shade(color, 0.35)),
        _box((long, wide, frame - 0.1), 0, 0, 0.1, (140, 105, 70, 255)),
        _box((long - 0.04, wide - 0.04, top - frame), 0, 0, frame, _LINEN, "cushion"),
        _box((long, 0.66 * wide, 0.55 * high), 0, -0.16 * wide, 0.4 * high, color, "cushion"),
    ]
    count = 2 if long > 1.2 else 1
    for k in range(count):
        x = ((k + 0.5) / count - 0.5) * long
        pillow = (0.8 * long / count, 0.2 * wide, 0.2 * high)
        parts.append(_box(pillow, x, 0.36 * wide, 0.8 * high, _shade(_LINEN, 1.08), "cushion"))
    return parts


def _desk(size: Size, color: Color) -> list[LookPart]:
    long, wide, high = size
    under = high - _BOARD
    block = min(0.45, 0.4 * long)
    parts = [_box((long, wide, _BOARD), 0, 0, under, _shade(color, 1.1))]
    parts.append(_box((_BOARD, wide, under), -(long - _BOARD) / 2, 0, 0, _shade(color, 0.9)))
    drawers = _fronts((block, wide, under), _shade(color, 0.95), 1, 3)
    aside = (long - block) / 2
    return parts + [
        replace(part, position=(part.position[0] + aside, *part.position[1:])) for part in drawers
    ]


def _bench(size: Size, color: Color) -> list[LookPart]:
    long, wide, high = size
    parts = [_box((long, wide, 0.05), 0, 0, high - 0.05, _shade(color, 1.1), "cushion")]
    x = (long - 0.05) / 2
    return parts + [_box((0.05, wide, high - 0.05), side, 0, 0, _shade(color, 0.8)) for side in (-x, x)]


def _shelf(size: Size, color: Color) -> list[LookPart]:
    """Sides and boards, with books; open on both sides."""
    long, wide, high = size
    x = (long - _BOARD) / 2
    parts = [_box((_BOARD, wide, high), side, 0, 0, _shade(color, 0.85)) for side in (-x, x)]
    count = max(2, round(high / 0.36))
    step = (high - _BOARD) / count
    inner = long - 2 * _BOARD
    for level in range(count + 1):
        parts.append(_box((inner, wide, _BOARD), 0, 0, level * step, color))
    for level in range(count):
        at, book = -inner / 2 + 0.01, level
        # Each board has books up to another place, so that the shelf does not look like a pattern.
        full = inner * (0.55 + 0.4 * math.sin(2.4 * level + 0.7) ** 2) - inner / 2
        while at < full - 0.05:
            thick = 0.035 + 0.015 * (book % 3)
            tall = (step - _BOARD) * (0.7 + 0.08 * (book % 4))
            place = at + thick / 2
            color_of_book = _BOOKS[book % len(_BOOKS)]
            parts.append(_box((thick, 0.7 * wide, tall), place, 0, level * step + _BOARD, color_of_book))
            at, book = at + thick + 0.004, book + 1
    return parts


def _fronts(size: Size, color: Color, columns: int, rows: int) -> list[LookPart]:
    """Return a body with a plinth, and fronts with handles on both long sides."""
    long, wide, high = size
    plinth, deep, top = 0.06, 0.018, 0.02
    parts = [
        _box((long, wide - 2 * deep, high - top), 0, 0, 0, _shade(color, 0.62)),
        _box((long, wide, top), 0, 0, high - top, _shade(color, 1.1)),
    ]
    width, height = (long - _GAP) / columns - _GAP, (high - top - plinth - _GAP) / rows - _GAP
    for side in (-1, 1):
        for column in range(columns):
            for row in range(rows):
                x = -long / 2 + _GAP + width / 2 + column * (width + _GAP)
                z = plinth + row * (height + _GAP)
                parts.append(_box((width, deep, height), x, side * (wide - deep) / 2, z, color))
                handle = (min(0.12, 0.4 * width), 0.012, 0.012)
                parts.append(_box(handle, x, side * (wide + 0.01) / 2, z + 0.8 * height, _METAL))
    return parts


def _cabinet(size: Size, color: Color) -> list[LookPart]:
    return _fronts(size, color, max(1, round(size[0] / 0.5)), 1)


def _drawers(size: Size, color: Color) -> list[LookPart]:
    return _fronts(size, color, max(1, round(size[0] / 0.8)), max(2, round(size[2] / 0.28)))


def _counter(size: Size, color: Color) -> list[LookPart]:
    long, wide, high = size
    body = _fronts((long - 0.02, wide - 0.02, high - 0.04), color, max(1, round(long / 0.55)), 1)
    return [*body, _box((long, wide, 0.04), 0, 0, high - 0.04, (92, 96, 102, 255))]


def _crate(size: Size, color: Color) -> list[LookPart]:
    """Planks within a frame of beams."""
    long, wide, high = size
    beam = 0.1 * min(size)
    parts = [_box((long - beam / 2, wide - beam / 2, high - beam / 2), 0, 0, beam / 4, _shade(color, 0.8))]
    x, y = (long - beam) / 2, (wide - beam) / 2
    parts += [_box((beam, beam, high), a * x, b * y, 0, color) for a in (-1, 1) for b in (-1, 1)]
    for z in (0.0, high - beam):
        parts += [_box((long - 2 * beam, beam, beam), 0, b * y, z, _shade(color, 1.1)) for b in (-1, 1)]
        parts += [_box((beam, wide - 2 * beam, beam), a * x, 0, z, _shade(color, 1.1)) for a in (-1, 1)]
    return parts


def _round(across: float, high: float, z: float, color: Color) -> LookPart:
    return LookPart("cylinder", (across, across, high), (0.0, 0.0, z), color)


def _drum(size: Size, color: Color) -> list[LookPart]:
    across, _, high = size
    parts = [_round(0.95 * across, high, 0, color)]
    rings = (0.0, 0.33 * high, 0.64 * high, high - 0.03)
    return parts + [_round(across, 0.03, z, _shade(color, 0.75)) for z in rings]


def _stool(size: Size, color: Color) -> list[LookPart]:
    across, _, high = size
    return [
        _round(0.9 * across, 0.03, 0, _METAL),
        _round(0.14 * across, high - 0.09, 0.02, _METAL),
        _round(across, 0.08, high - 0.08, color),
    ]


def _lamp(size: Size, color: Color) -> list[LookPart]:
    across, _, high = size
    return [
        _round(across, 0.03, 0, _METAL),
        _round(0.25 * across, 0.8 * high, 0.03, _METAL),
        _round(across, 0.2 * high, 0.8 * high, color),
    ]


def _plant(size: Size, color: Color) -> list[LookPart]:
    return _potted(size, _TERRACOTTA, color)


def _pot(size: Size, color: Color) -> list[LookPart]:
    return _potted(size, color, _LEAVES)


def _potted(size: Size, pot: Color, leaves: Color) -> list[LookPart]:
    across, _, high = size
    rim = min(0.45 * high, 0.4)
    parts = [_round(0.8 * across, rim, 0, pot), _round(0.9 * across, 0.04, rim - 0.04, _shade(pot, 1.1))]
    leaf, tall = 0.55 * across, 0.5 * (high - rim) + 0.05
    for k in range(5):
        turn, away = 2.4 * k, 0.21 * across
        place = (away * math.cos(turn), away * math.sin(turn), rim - 0.03 + 0.04 * (k % 2))
        parts.append(LookPart("ball", (leaf, leaf, tall), place, _shade(leaves, 0.85 + 0.08 * k)))
    top = high - tall
    parts.append(LookPart("ball", (1.1 * leaf, 1.1 * leaf, tall), (0.0, 0.0, top), _shade(leaves, 1.15)))
    return parts


_BOXES: dict[str, Callable[[Size, Color], list[LookPart]]] = {
    "backrest": _lengthwise(_backrest),
    "bed": _bed,
    "bench": _lengthwise(_bench),
    "cabinet": _lengthwise(_cabinet),
    "chair": _chair,
    "chair_back": _lengthwise(_chair_back),
    "counter": _lengthwise(_counter),
    "crate": _crate,
    "desk": _lengthwise(_desk),
    "drawers": _lengthwise(_drawers),
    "seat": _lengthwise(_seat),
    "shelf": _lengthwise(_shelf),
}
_CYLINDERS: dict[str, Callable[[Size, Color], list[LookPart]]] = {
    "drum": _drum,
    "lamp": _lamp,
    "plant": _plant,
    "pot": _pot,
    "stool": _stool,
}
LOOKS = {"box": tuple(_BOXES), "cylinder": tuple(_CYLINDERS)}
"""The names of the looks for each kind of object."""
