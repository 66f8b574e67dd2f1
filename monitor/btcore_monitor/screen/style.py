"""Colours and sizes of the monitor's drawings."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

# Sizes of the tree's drawing in scene units. A unit is a pixel of a 12-node tree in a full-HD window.
PILL_HEIGHT: Final = 42.0
RIM: Final = 2.6
TEXT_HEIGHT: Final = 14.5
TEXT_STROKE: Final = 1.15
BADGE_RADIUS: Final = 15.0
BADGE_STROKE: Final = 1.25
EDGE_STROKE: Final = 1.6
RUNNING_STROKE: Final = 2.6
FRAME_STROKE: Final = 1.1
RING: Final = 6.0
HALO: Final = 7.0
"""Width of the ring around a node that raised, and of the halo around a node that `--find` found."""
MAX_NAME_CHARS: Final = 30
"""Characters of a name in a pill; the complete name is in the hover label."""
MAX_NOTE_CHARS: Final = 30
NOTE_HEIGHT: Final = 7.6
NOTE_STROKE: Final = 0.68
NOTE_LIFT: Final = 5.4
NOTE_DROP: Final = 13.6
"""The note, a line below the name: maximum number of characters, height of capitals, radius of strokes, how
far the name moves up to make room, and distance of the note's base line below the middle of the pill."""

Colours = NDArray[np.uint32]


@dataclass(frozen=True, slots=True)
class Palette:
    """Colours as 0xRRGGBBAA.

    *fill* is the colour of a pill and *rim* of its border, by the displayed state: a status (0 IDLE …
    4 SKIPPED), or the result of a node that was reset in the same tick (5 … 7). *busy* is the fill of a
    RUNNING node with children, so that the running leaf is more prominent. *rest* is the border of an idle
    node by its last result, so that the result stays visible. *ink*, by status, is for text on a dark
    background.
    """

    fill: Colours
    rim: Colours
    rest: Colours
    ink: Colours
    busy: int
    background: int = 0x0E1218FF
    edge: int = 0x4A5364FF
    running_edge: int = 0xFFA726FF
    frame: int = 0x4468A3FF
    text: int = 0xF5F7FAFF
    note: int = 0xD9DEE8FF
    badge: int = 0x10141BFF
    symbol: int = 0xF5F7FAFF
    faint: int = 0x8A94A6FF
    laser: int = 0x35D6EEFF
    trail: int = 0xFFA726FF
    raised: int = 0xFF5CE0FF
    highlight: int = 0xFFFFFFFF


def _colours(*values: int) -> Colours:
    return np.array(values, dtype=np.uint32)


GROOT: Final = Palette(
    fill=_colours(
        *(0x3B4352FF, 0xF08C0CFF, 0x2A8C42FF, 0xC23434FF, 0x29457FFF),
        *(0x24523AFF, 0x6E2B32FF, 0x26365CFF),
    ),
    rim=_colours(
        *(0x5A6477FF, 0xFFD48AFF, 0x5FD47AFF, 0xFF8279FF, 0x5F80CCFF),
        *(0x45B566FF, 0xE0605AFF, 0x5273BDFF),
    ),
    rest=_colours(0x5A6477FF, 0x5A6477FF, 0x2F7F47FF, 0x9A3B3BFF, 0x3D5691FF),
    ink=_colours(0x8A94A6FF, 0xFFAB33FF, 0x4FCB6DFF, 0xFF6B62FF, 0x7D9BE6FF),
    busy=0xA86208FF,
)
"""Groot's colours: RUNNING orange, SUCCESS green, FAILURE red, IDLE grey, SKIPPED dim blue."""

COLOUR_BLIND: Final = Palette(
    fill=_colours(
        *(0x3B4352FF, 0xD9A300FF, 0x1C6FB8FF, 0x8F2600FF, 0x7C828EFF),
        *(0x1D4468FF, 0x52200EFF, 0x4A4E57FF),
    ),
    rim=_colours(
        *(0x5A6477FF, 0xFFE680FF, 0x7CC4FFFF, 0xEE6420FF, 0xB4BAC6FF),
        *(0x4C9BDDFF, 0xD9622BFF, 0x8C93A1FF),
    ),
    rest=_colours(0x5A6477FF, 0x5A6477FF, 0x2F7FC4FF, 0xB0461BFF, 0x8C93A1FF),
    ink=_colours(0x7E8899FF, 0xFFD84DFF, 0x69B7FFFF, 0xF0763CFF, 0xD0D5DEFF),
    busy=0x8A6A0AFF,
    running_edge=0xFFD84DFF,
    raised=0xFFFFFFFF,
    highlight=0x7CF5FFFF,
)
"""Colours for red-green colour blindness: RUNNING yellow, SUCCESS blue, FAILURE vermilion, SKIPPED pale grey.

The colours also differ in lightness, so that they are distinct in a greyscale print.
"""

PALETTES: Final[Mapping[str, Palette]] = {"groot": GROOT, "colour-blind": COLOUR_BLIND}
"""Palettes by their names for `--palette`."""
