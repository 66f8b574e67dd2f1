"""The tree as a drawing: pills, badges and edges drawn once, then nothing but colours."""

from collections import deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
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
FOLDED: Final = "folded"
_DRAWN_ONLY: Final = ("frames", "edges", "path", "rims", "badges", "ink", "raised", "found")
FOLDED_AT_MOST: Final = 90
"""Nodes of a folded tree: so many can be read in a window."""
BIG: Final = 200
"""Trees of more nodes are drawn folded too."""

_BADGE_ROOM: Final = 2 * style.BADGE_RADIUS + 14.0
_TEXT_GAP: Final = 20.0


class TreeView:
    """The drawing of one Picture, and the status of each of its nodes."""

    def __init__(
        self,
        rows: Rows,
        picture: Picture,
        palette: style.Palette,
        aspect: float,
        found: Collection[int] = (),
        whole: Picture | None = None,
    ) -> None:
        self.picture = picture
        self.palette = palette
        self.origin = origin = ORIGIN if whole is None else FOLDED
        whole = whole or picture
        self.names = {
            node.uid: elide(node.name, style.NAME_ROOM) + _inside(node, whole) for node in picture.nodes
        }
        self.layout = arrange(picture, self.names, aspect)
        self._recording = rows.recording
        index = {node.uid: at for at, node in enumerate(whole.nodes)}
        self._index = np.array([index[node.uid] for node in picture.nodes], dtype=np.intp)
        self._at = {node.uid: at for at, node in enumerate(picture.nodes)}
        self._nearest_of = self._nearest(whole)
        self._found = sorted({at for at in map(self._nearest_of, found) if at is not None})
        self._raised: dict[int, bool] = {}
        self._pills: Series[Any] = rows.series(f"{origin}/pills", strip_colours)
        self._rims: Series[Any] = rows.series(f"{origin}/rims", strip_colours)
        self._path: Series[Any] = rows.series(f"{origin}/path", _strips)
        self._rings: Series[Any] = rows.series(f"{origin}/raised", _strips)
        self._last_rims = self._last_pills = np.zeros(0, dtype=np.uint32)
        self._last_path: list[int] | None = None
        self._inner = np.array([bool(node.children) for node in picture.nodes])
        self._edges = [np.array(line, dtype=np.float32) for line in self.layout.edges]

    @property
    def drawn_only(self) -> tuple[str, ...]:
        """Entities that are there to be seen; hovering and clicking are for the pills."""
        return tuple(f"{self.origin}/{part}" for part in _DRAWN_ONLY)

    def bounds(self) -> tuple[float, float, float, float]:
        """x0, y0, x1, y1 of what is to be in view."""
        width, height = self.layout.size
        margin = style.PILL_HEIGHT * 0.7 + 0.01 * max(width, height)
        return -margin, -margin, width + margin, height + margin

    def colour(self, moments: Moments) -> None:
        """Rows for what *moments* shows now; nothing where nothing looks otherwise."""
        palette, t, wall = self.palette, moments.t, moments.wall
        shown = moments.shown[self._index]
        pills = np.where(self._inner & (shown == RUNNING), np.uint32(palette.busy), palette.fill[shown])
        if not np.array_equal(pills, self._last_pills):
            self._last_pills = pills
            self._pills.add(t, wall, pills)
        rims = np.where(shown == IDLE, palette.rest[moments.results[self._index]], palette.rim[shown])
        if not np.array_equal(rims, self._last_rims):
            self._last_rims = rims
            self._rims.add(t, wall, rims)
        path = [int(at) for at in np.flatnonzero(shown == RUNNING) if len(self._edges[at])]
        if path != self._last_path:
            self._last_path = path
            self._path.add(t, wall, [self._edges[at] for at in path])
        again = [at for at, rested in self._raised.items() if rested and shown[at] != IDLE]
        for at in self._raised:
            self._raised[at] = self._raised[at] or shown[at] == IDLE
        if again:
            for at in again:
                del self._raised[at]
            self._ring(t, wall)

    def raised(self, uid: int, t: int, wall: int) -> None:
        """Ring the node *uid*, or the folded subtree that it is in, until it runs again."""
        at = self._nearest_of(uid)
        if at is not None:
            self._raised[at] = False
            self._ring(t, wall)

    def _ring(self, t: int, wall: int) -> None:
        half = style.PILL_HEIGHT / 2
        self._rings.add(t, wall, [_pill(self.layout.places[at], half) for at in sorted(self._raised)])

    def _nearest(self, whole: Picture) -> Callable[[int], int | None]:
        """From a uid of *whole* to the index here of that node, or of the closest above it that is here."""

        def nearest(uid: int) -> int | None:
            above = (uid, *(node.uid for node in whole.ancestors(uid)))
            return next((self._at[one] for one in above if one in self._at), None)

        return nearest

    def draw(self) -> None:
        """Draw what never changes."""
        picture, layout, palette, origin = self.picture, self.layout, self.palette, self.origin
        half = style.PILL_HEIGHT / 2
        log = self._recording.log
        if layout.frames:
            log(
                f"{origin}/frames",
                rr.LineStrips2D(
                    [_rounded(*corners) for _, *corners in layout.frames],
                    colors=[palette.frame],
                    radii=[style.FRAME_STROKE],
                    draw_order=1.0,
                ),
                static=True,
            )
        log(
            f"{origin}/edges",
            rr.LineStrips2D(
                [one for one in self._edges if len(one)],
                colors=[palette.edge],
                radii=[style.EDGE_STROKE],
                draw_order=2.0,
            ),
            static=True,
        )
        look = rr.LineStrips2D.from_fields(colors=[palette.path], radii=[style.PATH_STROKE], draw_order=3.0)
        log(f"{origin}/path", look, static=True)
        rims = [_pill(place, half) for place in layout.places]
        ring = rr.LineStrips2D.from_fields(colors=[palette.raised], radii=[half + style.RING], draw_order=3.6)
        log(f"{origin}/raised", ring, static=True)
        if self._found:
            halo = rr.LineStrips2D(
                [rims[at] for at in self._found],
                colors=[palette.found],
                radii=[half + style.HALO],
                draw_order=3.4,
            )
            log(f"{origin}/found", halo, static=True)
        log(f"{origin}/rims", rr.LineStrips2D(rims, radii=[half], draw_order=4.0), static=True)
        log(
            f"{origin}/pills",
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
            f"{origin}/badges",
            rr.LineStrips2D(badges, colors=[palette.badge], radii=[style.BADGE_RADIUS], draw_order=6.0),
            static=True,
        )
        log(f"{origin}/ink", self._ink(), static=True)

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


def folded(picture: Picture, most: int = FOLDED_AT_MOST) -> Picture:
    """*picture* with subtrees folded into their SubTree nodes, the outermost unfolded up to *most* nodes."""
    content: dict[str, list[PictureNode]] = {}
    for node in picture.nodes:
        content.setdefault(node.subtree, []).append(node)
    root = picture.root.subtree
    unfolded, count = {root}, len(content[root])
    waiting = deque(content[root])
    while waiting:
        node = waiting.popleft()
        inside = (
            picture.by_uid[node.children[0]].subtree if node.kind == "subtree" and node.children else None
        )
        if inside is None or inside in unfolded:
            continue
        if count + len(content[inside]) <= most:
            unfolded.add(inside)
            count += len(content[inside])
            waiting.extend(content[inside])
    kept = {node.uid for node in picture.nodes if node.subtree in unfolded}
    nodes = [
        replace(node, children=tuple(child for child in node.children if child in kept))
        for node in picture.nodes
        if node.uid in kept
    ]
    return Picture(picture.tree_id, picture.name, tuple(nodes), picture.subtrees)


def _inside(node: PictureNode, whole: Picture) -> str:
    """How many nodes are folded into *node*: `` +12``."""
    if node.children or not whole.by_uid[node.uid].children:
        return ""
    count, waiting = 0, list(whole.by_uid[node.uid].children)
    while waiting:
        count += 1
        waiting += whole.by_uid[waiting.pop()].children
    return f" +{count}"


def arrange(picture: Picture, names: Mapping[int, str], aspect: float) -> Layout:
    """Where the nodes of *picture* go, with pills wide enough for their *names*."""
    index = {node.uid: at for at, node in enumerate(picture.nodes)}
    boxes = [
        Box(
            width=pill_width(names[node.uid]),
            children=tuple(index[child] for child in node.children),
            framed=node.kind == "subtree" and bool(node.children),
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


def matching(picture: Picture, pattern: str) -> list[int]:
    """uids of the nodes whose name, ID or path is like *pattern* (``*`` and ``?``), in any case of letters.

    A pattern without ``*``, ``?`` and ``[`` is a part of the name or path.
    """
    wanted = pattern.casefold()
    if not any(sign in wanted for sign in "*?["):
        wanted = f"*{wanted}*"
    return [
        node.uid
        for node in picture.nodes
        if any(fnmatchcase(one.casefold(), wanted) for one in (node.name, node.id, node.path))
    ]
