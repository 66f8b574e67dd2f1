"""Messages that no reading of a robot has a type for already."""

from dataclasses import dataclass

Vector = tuple[float, float, float]
Colour = tuple[float, float, float, float]

RED: Colour = (1.0, 0.0, 0.0, 1.0)
GREEN: Colour = (0.0, 1.0, 0.0, 1.0)
BLUE: Colour = (0.0, 0.0, 1.0, 1.0)


@dataclass(frozen=True, slots=True)
class HeadCommand:
    """Turn the head to *pan* (+ left) and *tilt* (+ up), in rad."""

    pan: float
    tilt: float


@dataclass(frozen=True, slots=True)
class Arrow:
    """An arrow to be drawn, from *start* to *end* (m) in *frame*.

    *number* tells it from others, *shaft* and *head* are diameters (m), *colour* is red, green, blue and
    opacity (0–1). After *lifetime* (s) it fades; 0 stands for never.
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
    """Several arrows of one moment."""

    arrows: tuple[Arrow, ...]
