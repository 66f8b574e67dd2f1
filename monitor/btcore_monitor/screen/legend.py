"""The legend of the tree's colours: a line below the tree."""

from typing import Any, Final

import numpy as np
import rerun as rr

from btcore_monitor.events import FAILURE, IDLE, RUNNING, SKIPPED, STATUS_NAMES, SUCCESS
from btcore_monitor.screen.font import Stroke, strokes_of, width_of
from btcore_monitor.screen.style import Palette

HEIGHT: Final = 30.0
"""Height (pixels) of the legend below the tree."""
_MARGIN: Final = 12.0
_TEXT: Final = 8.6
_STROKE: Final = 0.75
_DOT: Final = 6.5
_DOT_LENGTH: Final = 9.0
_GAP: Final = 18.0


def create_legend(palette: Palette, left: float, bottom: float, pixel: float, has_highlights: bool) -> Any:
    """Return the drawing of the legend.

    Args:
        palette: The colours.
        left: The x of the lower left corner (units of the drawing).
        bottom: The y of the lower left corner.
        pixel: The size of a pixel (units of the drawing).
        has_highlights: Whether the legend has an entry for highlighted nodes.
    """
    statuses = (RUNNING, SUCCESS, FAILURE, SKIPPED)
    entries = [(int(palette.fill[status]), STATUS_NAMES[status]) for status in statuses]
    entries.append((int(palette.fill[IDLE]), "IDLE (border: last result)"))
    entries.append((palette.raised, "raised"))
    if has_highlights:
        entries.append((palette.highlight, "found"))
    lines: list[Stroke] = []
    colours: list[int] = []
    radii: list[float] = []
    x, y = left + _MARGIN * pixel, bottom - (_MARGIN + _DOT) * pixel
    for colour, label in entries:
        start = x + _DOT * pixel
        x = start + _DOT_LENGTH * pixel
        lines.append([(start, y), (x, y)])
        colours.append(colour)
        radii.append(_DOT * pixel)
        x += (_DOT + 6.0) * pixel
        words = strokes_of(label, x, y + _TEXT * 0.48 * pixel, _TEXT * pixel)
        lines += words
        colours += [palette.faint] * len(words)
        radii += [_STROKE * pixel] * len(words)
        x += width_of(label, _TEXT * pixel) + _GAP * pixel
    return rr.LineStrips2D(
        [np.array(line, dtype=np.float32) for line in lines],
        colors=np.array(colours, dtype=np.uint32),
        radii=radii,
        draw_order=1.0,
    )
