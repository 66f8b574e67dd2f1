"""Furniture for random worlds: pieces of realistic size, each of one or several objects of a world file.

A piece has its own frame: x along the wall at which it stands, y away from the wall, the origin in the middle
of its side at the wall. Lengths are in metres.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Vector = tuple[float, float, float]

_WOODS = ("#bf8f4c", "#96703c", "#cca463", "#8a6a45")
_CLOTHS = ("#4a6285", "#5b7f66", "#3f6f7a", "#a34a3f", "#7d5a86")
_WHITE, _GREY, _DARK, _GREEN = "#e4e6e4", "#6b6f74", "#3c4046", "#3d7a41"

_SEAT, _BACK = 0.45, 0.9  # m: heights of a chair's seat and back
_TOP, _LEG = 0.04, 0.06  # m: the thickness of a table's top, and the width of its legs


@dataclass(frozen=True, slots=True)
class Part:
    """An object of a piece of furniture.

    Attributes:
        name: The name.
        kind: The kind of the object in world files: `box`, `cylinder` or `table`.
        size: The extent along x, y and z; a cylinder's first two values are its diameter.
        position: The middle of the underside.
        color: The colour, `#rrggbb`.
        look: The name of a look in world files, or empty.
    """

    name: str
    kind: str
    size: Vector
    position: Vector
    color: str
    look: str = ""


@dataclass(frozen=True, slots=True)
class Furniture:
    """A piece of furniture.

    Attributes:
        width: The extent along the wall.
        depth: The extent away from the wall.
        parts: The objects.
        central: Whether the piece stands in the middle of a room, and not at a wall.
    """

    width: float
    depth: float
    parts: tuple[Part, ...]
    central: bool = False


Draw = Callable[[np.random.Generator], Furniture]
"""Draws a piece of furniture with random measures and colours."""


def _length(random: np.random.Generator, least: float, most: float) -> float:
    """Return a random length in steps of 5 cm."""
    return round(0.05 * round(random.uniform(least, most) / 0.05), 2)


def _one_of(random: np.random.Generator, values: tuple[str, ...]) -> str:
    return values[random.integers(len(values))]


def _block(name: str, size: Vector, color: str, look: str = "") -> Furniture:
    """Return a piece of a single box."""
    width, depth, _ = size
    return Furniture(width, depth, (Part(name, "box", size, (0.0, depth / 2, 0.0), color, look),))


def _chair(name: str, x: float, y: float, back: int, color: str) -> list[Part]:
    """Return a chair with its middle at x, y, and its back on the side +y (*back* 1) or -y (-1)."""
    return [
        Part(name, "box", (0.42, 0.42, _SEAT), (x, y, 0.0), color, "chair"),
        Part(f"{name}_back", "box", (0.42, 0.05, _BACK), (x, y + back * 0.235, 0.0), color, "chair_back"),
    ]


def desk(random: np.random.Generator) -> Furniture:
    """Return a desk with a screen and a swivel chair."""
    width, depth, wood = _length(random, 1.2, 1.6), 0.7, _one_of(random, _WOODS)
    aside, cloth = random.uniform(-0.15, 0.15), _one_of(random, (*_CLOTHS, _DARK))
    parts = (
        Part("desk", "table", (width, depth, 0.74), (0.0, depth / 2, 0.0), wood),
        Part("screen", "box", (0.55, 0.06, 0.4), (round(aside, 3), 0.25, 0.74), _DARK),
        Part("chair", "cylinder", (0.5, 0.5, 0.48), (round(aside, 3), depth + 0.1, 0.0), cloth),
        Part("chair_back", "box", (0.42, 0.06, 1.0), (round(aside, 3), depth + 0.32, 0.0), cloth),
    )
    return Furniture(width, depth + 0.35, parts)


def drawers(random: np.random.Generator) -> Furniture:
    """Return a chest of drawers."""
    return _block("drawers", (_length(random, 0.6, 1.1), 0.45, 0.85), _one_of(random, _WOODS), "drawers")


def shelf(random: np.random.Generator) -> Furniture:
    """Return a bookshelf."""
    return _block("shelf", (_length(random, 0.8, 1.6), 0.35, 1.9), _one_of(random, _WOODS), "shelf")


def rack(random: np.random.Generator) -> Furniture:
    """Return a metal rack for a store room."""
    return _block("rack", (_length(random, 1.2, 2.0), 0.5, 2.0), _GREY, "shelf")


def cabinet(random: np.random.Generator) -> Furniture:
    """Return a filing cabinet."""
    return _block(
        "cabinet", (_length(random, 0.8, 1.2), 0.45, 1.2), _one_of(random, (_WHITE, _GREY)), "cabinet"
    )


def printer(random: np.random.Generator) -> Furniture:
    """Return a printer that stands on the floor."""
    return _block("printer", (0.6, 0.55, 1.05), _WHITE)


def plant(random: np.random.Generator) -> Furniture:
    """Return a plant in a pot."""
    side, height = _length(random, 0.3, 0.45), _length(random, 0.8, 1.4)
    part = Part("plant", "cylinder", (side, side, height), (0.0, side / 2, 0.0), _GREEN, "plant")
    return Furniture(side, side, (part,))


def sofa(random: np.random.Generator) -> Furniture:
    """Return a sofa with a back and arms."""
    width, depth, cloth = _length(random, 1.6, 2.2), 0.85, _one_of(random, _CLOTHS)
    arm = (width - 0.15) / 2
    parts = (
        Part("sofa", "box", (width, depth, 0.42), (0.0, depth / 2, 0.0), cloth, "seat"),
        Part("sofa_back", "box", (width, 0.2, 0.8), (0.0, 0.1, 0.0), cloth, "backrest"),
        Part("sofa_arm_left", "box", (0.15, depth, 0.6), (-arm, depth / 2, 0.0), cloth),
        Part("sofa_arm_right", "box", (0.15, depth, 0.6), (arm, depth / 2, 0.0), cloth),
    )
    return Furniture(width, depth, parts)


def armchair(random: np.random.Generator) -> Furniture:
    """Return an armchair."""
    cloth = _one_of(random, _CLOTHS)
    parts = (
        Part("armchair", "box", (0.8, 0.8, 0.42), (0.0, 0.4, 0.0), cloth, "seat"),
        Part("armchair_back", "box", (0.8, 0.2, 0.85), (0.0, 0.1, 0.0), cloth, "backrest"),
    )
    return Furniture(0.8, 0.8, parts)


def sideboard(random: np.random.Generator) -> Furniture:
    """Return a sideboard with a television."""
    width, wood = _length(random, 1.2, 1.8), _one_of(random, _WOODS)
    parts = (
        Part("sideboard", "box", (width, 0.4, 0.5), (0.0, 0.2, 0.0), wood, "drawers"),
        Part("television", "box", (1.1, 0.08, 0.65), (0.0, 0.15, 0.5), _DARK),
    )
    return Furniture(width, 0.4, parts)


def coffee_table(random: np.random.Generator) -> Furniture:
    """Return a coffee table."""
    width, depth = _length(random, 0.9, 1.2), _length(random, 0.5, 0.7)
    size = (width, depth, 0.42)
    top = Part("coffee_table", "table", size, (0.0, depth / 2, 0.0), _one_of(random, _WOODS))
    return Furniture(width, depth, (top,), central=True)


def bed(random: np.random.Generator) -> Furniture:
    """Return a bed with its head at the wall, and a night stand on none, one or both of its sides."""
    width, wood, cloth = _length(random, 1.0, 1.8), _one_of(random, _WOODS), _one_of(random, _CLOTHS)
    stands = int(random.integers(3))
    beside = width / 2 + 0.25
    parts = [
        Part("bed", "box", (width, 2.0, 0.5), (0.0, 1.05, 0.0), cloth),
        Part("bed_head", "box", (width, 0.1, 1.0), (0.0, 0.05, 0.0), wood),
        Part("pillow", "box", (width - 0.2, 0.4, 0.12), (0.0, 0.35, 0.5), _WHITE),
    ]
    parts += [
        Part(f"night_stand_{side}", "box", (0.45, 0.4, 0.55), (x, 0.2, 0.0), wood, "drawers")
        for side, x in (("left", -beside), ("right", beside))[:stands]
    ]
    return Furniture(width + (1.0 if stands else 0.0), 2.05, tuple(parts))


def wardrobe(random: np.random.Generator) -> Furniture:
    """Return a wardrobe."""
    return _block(
        "wardrobe", (_length(random, 1.2, 2.0), 0.6, 2.0), _one_of(random, (*_WOODS, _WHITE)), "cabinet"
    )


def kitchen_unit(random: np.random.Generator) -> Furniture:
    """Return a kitchen unit: a counter with a sink, and a fridge at its end."""
    width, wood = _length(random, 1.6, 2.6), _one_of(random, _WOODS)
    parts = (
        Part("counter", "box", (width, 0.6, 0.88), (-0.3, 0.3, 0.0), wood),
        Part("worktop", "box", (width, 0.62, 0.04), (-0.3, 0.31, 0.88), _GREY),
        Part("fridge", "box", (0.6, 0.62, 1.8), (width / 2, 0.31, 0.0), _WHITE, "cabinet"),
    )
    return Furniture(width + 0.6, 0.62, parts)


def bathtub(random: np.random.Generator) -> Furniture:
    """Return a bathtub."""
    return _block("bathtub", (1.7, 0.75, 0.55), _WHITE)


def toilet(random: np.random.Generator) -> Furniture:
    """Return a toilet with its cistern."""
    parts = (
        Part("toilet", "box", (0.38, 0.65, 0.42), (0.0, 0.325, 0.0), _WHITE),
        Part("cistern", "box", (0.4, 0.18, 0.85), (0.0, 0.09, 0.0), _WHITE),
    )
    return Furniture(0.4, 0.65, parts)


def basin(random: np.random.Generator) -> Furniture:
    """Return a wash basin on a cabinet."""
    return _block("basin", (0.6, 0.45, 0.85), _WHITE, "cabinet")


def dining_table(random: np.random.Generator) -> Furniture:
    """Return a table with chairs on both long sides."""
    return _table_with_chairs(random, "table", _length(random, 1.2, 1.6), 0.85)


def meeting_table(random: np.random.Generator) -> Furniture:
    """Return a meeting table with chairs on both long sides."""
    return _table_with_chairs(random, "meeting_table", _length(random, 1.8, 2.6), 1.0)


def _table_with_chairs(random: np.random.Generator, name: str, width: float, depth: float) -> Furniture:
    wood, cloth = _one_of(random, _WOODS), _one_of(random, (*_CLOTHS, *_WOODS))
    out = 0.42  # m that a chair sticks out of the table's side at most
    parts = [Part(name, "table", (width, depth, 0.74), (0.0, out + depth / 2, 0.0), wood)]
    count = int(width / 0.6)
    for number in range(count):
        x = round((number - (count - 1) / 2) * width / count, 3)
        pulled = random.uniform(0.0, 0.08)
        parts += _chair(f"chair_{2 * number + 1}", x, round(out - 0.08 - pulled, 3), -1, cloth)
        parts += _chair(f"chair_{2 * number + 2}", x, round(out + depth + 0.08 + pulled, 3), 1, cloth)
    return Furniture(width, depth + 2 * out, tuple(parts), central=True)
