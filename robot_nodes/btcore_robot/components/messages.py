"""Message types of topics, in addition to the data types in `btcore_robot.robot`."""

from dataclasses import dataclass

Vector = tuple[float, float, float]
"""x, y and z (m)."""

Colour = tuple[float, float, float, float]
"""Red, green, blue and opacity, each 0–1."""

RED: Colour = (1.0, 0.0, 0.0, 1.0)
"""Red, opaque."""

GREEN: Colour = (0.0, 1.0, 0.0, 1.0)
"""Green, opaque."""

BLUE: Colour = (0.0, 0.0, 1.0, 1.0)
"""Blue, opaque."""


@dataclass(frozen=True, slots=True)
class HeadCommand:
    """A command to turn the head to *pan* (rad, positive left) and *tilt* (rad, positive up)."""

    pan: float
    tilt: float


@dataclass(frozen=True, slots=True)
class Arrow:
    """An arrow to draw, from *start* to *end* (m) in *frame*.

    *number* distinguishes arrows of the same publisher: a new arrow replaces an arrow with the same number.
    *shaft* and *head* are diameters (m). *colour* is red, green, blue and opacity (0–1). The arrow disappears
    after *lifetime* (s); 0 means never. *stamp* (ns) is the time to which the arrow belongs.
    """

    number: int
    frame: str
    stamp: int
    start: Vector
    end: Vector
    colour: Colour
    shaft: float
    head: float
    lifetime: float = 0.0


@dataclass(frozen=True, slots=True)
class Arrows:
    """Several arrows that are published together.

    Attributes:
        arrows: The arrows.
    """

    arrows: tuple[Arrow, ...]
