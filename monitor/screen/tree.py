"""The tree as a drawing: pills, badges and edges drawn once, then nothing but colours."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from ..picture import IDLE, RUNNING, Picture, PictureNode
from . import style
from .font import Stroke, elide, strokes_of, width_of
from .layout import Box, Layout, Place, lay_out
from .moments import Moments
from .rows import Rows, Series, strip_colours
from .symbols import placed, symbol

ORIGIN: Final = "tree"
PILLS: Final = f"{ORIGIN}/pills"
RIMS: Final = f"{ORIGIN}/rims"
PATH: Final = f"{ORIGIN}/path"
DRAWN_ONLY: Final = (f"{ORIGIN}/frames", f"{ORIGIN}/edges", PATH, RIMS, f"{ORIGIN}/badges", f"{ORIGIN}/ink")
"""What is there to be seen; hovering and clicking are for the pills."""

_BADGE_ROOM: Final = 2 * style.BADGE_RADIUS + 14.0
_TEXT_GAP: Final = 20.0


class TreeView:
    """The drawing of one Picture, and the status of each of its nodes."""

    def __init__(self, rows: Rows, picture: Picture, palette: style.Palette, aspect: float) -> None:
        self.picture = picture
        self.palette = palette
        self.names = {node.uid: elide(node.name, style.NAME_ROOM) for node in picture.nodes}
        self.layout = arrange(picture, self.names, aspect)
        self._recording = rows.recording
        self._pills: Series[Any] = rows.series(PILLS, strip_colours)
        self._rims: Series[Any] = rows.series(RIMS, strip_colours)
        self._path: Series[Any] = rows.series(PATH, _strips)
        self._last_rims = self._last_pills = np.zeros(0, dtype=np.uint32)
        self._last_path: list[int] | None = None
        self._inner = np.array([bool(node.children) for node in picture.nodes])
        self._edges = [np.array(line, dtype=np.float32) for line in self.layout.edges]

    def bounds(self) -> tuple[float, float, float, float]:
        """x0, y0, x1, y1 of what is to be in view."""
        width, height = self.layout.size
        margin = style.PILL_HEIGHT * 0.7 + 0.01 * max(width, height)
        return -margin, -margin, width + margin, height + margin

    def colour(self, moments: Moments) -> None:
        """Rows for what *moments* shows now; nothing where nothing looks otherwise."""
        palette, shown, t, wall = self.palette, moments.shown, moments.t, moments.wall
        pills = np.where(self._inner & (shown == RUNNING), np.uint32(palette.busy), palette.fill[shown])
        if not np.array_equal(pills, self._last_pills):
            self._last_pills = pills
            self._pills.add(t, wall, pills)
        rims = np.where(shown == IDLE, palette.rest[moments.results], palette.rim[shown])
        if not np.array_equal(rims, self._last_rims):
            self._last_rims = rims
            self._rims.add(t, wall, rims)
        path = [int(at) for at in np.flatnonzero(shown == RUNNING) if len(self._edges[at])]
        if path != self._last_path:
            self._last_path = path
            self._path.add(t, wall, [self._edges[at] for at in path])

    def draw(self) -> None:
        """Draw what never changes."""
        picture, layout, palette = self.picture, self.layout, self.palette
        half = style.PILL_HEIGHT / 2
        log = self._recording.log
        if layout.frames:
            log(
                f"{ORIGIN}/frames",
                rr.LineStrips2D(
                    [_rounded(*corners) for _, *corners in layout.frames],
                    colors=[palette.frame],
                    radii=[style.FRAME_STROKE],
                    draw_order=1.0,
                ),
                static=True,
            )
        log(
            f"{ORIGIN}/edges",
            rr.LineStrips2D(
                [one for one in self._edges if len(one)],
                colors=[palette.edge],
                radii=[style.EDGE_STROKE],
                draw_order=2.0,
            ),
            static=True,
        )
        look = rr.LineStrips2D.from_fields(colors=[palette.path], radii=[style.PATH_STROKE], draw_order=3.0)
        log(PATH, look, static=True)
        rims = [_pill(place, half) for place in layout.places]
        log(RIMS, rr.LineStrips2D(rims, radii=[half], draw_order=4.0), static=True)
        log(
            PILLS,
            rr.LineStrips2D(
                rims,
                radii=[half - style.RIM],
                labels=[node.name for node in picture.nodes],
                show_labels=False,
                draw_order=5.0,
            ),
            rr.AnyValues(
                path=[node.path for node in picture.nodes],
                ID=[node.id for node in picture.nodes],
                ports=[_ports(node) for node in picture.nodes],
            ),
            static=True,
        )
        badges = [((place.x + half, place.y), (place.x + half + 0.01, place.y)) for place in layout.places]
        log(
            f"{ORIGIN}/badges",
            rr.LineStrips2D(badges, colors=[palette.badge], radii=[style.BADGE_RADIUS], draw_order=6.0),
            static=True,
        )
        log(f"{ORIGIN}/ink", self._ink(), static=True)

    def _ink(self) -> rr.LineStrips2D:
        """Names and symbols: all strokes of the tree in one batch."""
        strokes: list[Stroke] = []
        radii: list[float] = []
        for node, place in zip(self.picture.nodes, self.layout.places, strict=True):
            centre = place.x + style.PILL_HEIGHT / 2
            sign = placed(symbol(node.id, node.kind), centre, place.y, style.BADGE_RADIUS * 0.66)
            name = strokes_of(
                self.names[node.uid],
                place.x + style.PILL_HEIGHT / 2 + style.BADGE_RADIUS + 7.0,
                place.y + style.TEXT_HEIGHT * 0.46,
                style.TEXT_HEIGHT,
            )
            strokes += sign + name
            radii += [style.BADGE_STROKE] * len(sign) + [style.TEXT_STROKE] * len(name)
        return rr.LineStrips2D(
            [np.array(stroke, dtype=np.float32) for stroke in strokes],
            colors=[self.palette.text],
            radii=radii,
            draw_order=7.0,
        )


def arrange(picture: Picture, names: Mapping[int, str], aspect: float) -> Layout:
    """Where the nodes of *picture* go, with pills wide enough for their *names*."""
    index = {node.uid: at for at, node in enumerate(picture.nodes)}
    boxes = [
        Box(
            width=pill_width(names[node.uid]),
            children=tuple(index[child] for child in node.children),
            framed=node.kind == "subtree",
        )
        for node in picture.nodes
    ]
    return lay_out(boxes, style.PILL_HEIGHT, aspect)


def pill_width(name: str) -> float:
    """Length of the pill that holds a badge and *name*."""
    return _BADGE_ROOM + width_of(name, style.TEXT_HEIGHT) + _TEXT_GAP


def _pill(place: Place, half: float) -> NDArray[np.float32]:
    return np.array([(place.x + half, place.y), (place.x + place.width - half, place.y)], dtype=np.float32)


def _rounded(x0: float, y0: float, x1: float, y1: float, radius: float = 12.0) -> Stroke:
    points: Stroke = []
    corners = ((x1, y0, -90), (x1, y1, 0), (x0, y1, 90), (x0, y0, 180))
    for x, y, start in corners:
        cx = x - radius if x == x1 else x + radius
        cy = y - radius if y == y1 else y + radius
        for step in range(5):
            angle = np.radians(start + 22.5 * step)
            points.append((cx + radius * float(np.cos(angle)), cy + radius * float(np.sin(angle))))
    return [*points, points[0]]


def _ports(node: PictureNode) -> str:
    return "  ".join(f'{port}="{text}"' for port, text in node.ports.items())


def _strips(values: list[list[NDArray[np.float32]]]) -> Iterable[Any]:
    columns = rr.LineStrips2D.columns(strips=[strip for row in values for strip in row])
    return columns.partition([len(row) for row in values])


def leaves(nodes: Sequence[PictureNode]) -> list[PictureNode]:
    """The nodes that do the work, in tree order."""
    return [node for node in nodes if not node.children and node.kind in ("action", "condition")]
