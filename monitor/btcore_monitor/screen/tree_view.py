"""The drawing of a tree. Pills, badges and edges are drawn once; afterwards only their colours change."""

from collections.abc import Collection, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Final

import numpy as np
import rerun as rr

from btcore_drawing.layout import Box, Place, TreeLayout, lay_out
from btcore_drawing.symbols import symbol_path
from btcore_monitor.events import IDLE, RUNNING, ObservedNode, ObservedTree
from btcore_monitor.screen import style
from btcore_monitor.screen.captions import Caption, create_captions, format_ports
from btcore_monitor.screen.font import Stroke, path_strokes, place_strokes, strokes_of
from btcore_monitor.screen.legend import HEIGHT as LEGEND_HEIGHT
from btcore_monitor.screen.legend import create_legend
from btcore_monitor.screen.row_buffer import RowBuffer
from btcore_monitor.screen.subtree_drawing import (
    MAX_BRANCHES,
    PARTS,
    Strip,
    SubtreeDrawing,
    create_hover_values,
    node_entities,
    split_by_subtree,
)
from btcore_monitor.screen.tick_states import TickStates

ORIGIN: Final = "tree"
FOLDED: Final = "folded"
LINES: Final = "lines"
PILLS: Final = "pills"
LEGEND: Final = "legend"
FOLD_ABOVE_NODES: Final = 200
"""Number of nodes above which a tree also has a folded drawing."""
_MIN_SCALE: Final = 0.62
"""Scale (pixels per unit) at which a tree needs no wrapping."""
_MIN_NOTE_SCALE: Final = 0.78
"""Scale (pixels per unit) below which a tree is drawn without notes."""
_MIN_RUNNING_EDGE_RADIUS: Final = 1.2
"""Smallest radius (pixels) of the running edges."""
_MARGIN: Final = 8.0
"""Margin (pixels) around the tree."""
_MAX_SCALE: Final = 1.35
"""Largest scale (pixels per unit), so that a tree of a few nodes does not fill the window."""


class TreeView:
    """The drawing of a tree with the statuses of its nodes.

    Args:
        tree: The tree to draw, which may be a folded version of *full_tree*.
        palette: The colours.
        view_size: Width and height of the view (pixels).
        highlighted: The uids of the nodes to highlight.
        full_tree: The complete tree, if *tree* is folded.
        number: The number of the drawing of a folded tree.
        exceptions: Whether a node was IDLE after it raised, by the uid of each node with a ring. Drawings
            of the same tree share it.
    """

    def __init__(
        self,
        rows: RowBuffer,
        tree: ObservedTree,
        palette: style.Palette,
        view_size: tuple[float, float],
        highlighted: Collection[int] = (),
        full_tree: ObservedTree | None = None,
        number: int = 0,
        exceptions: dict[int, bool] | None = None,
    ) -> None:
        self.tree = tree
        self.palette = palette
        self.view_size = view_size
        self._is_folded = full_tree is not None
        self.origin = f"{FOLDED}/{LINES}/{number}" if self._is_folded else ORIGIN
        full_tree = full_tree or tree
        self.captions, self.layout = _arrange_readable(tree, full_tree, view_size)
        self._rows = rows
        index_of_uid = {node.uid: index for index, node in enumerate(full_tree.nodes)}
        self._whole_indices = np.array([index_of_uid[node.uid] for node in tree.nodes], dtype=np.intp)
        self._index_of_uid = {node.uid: index for index, node in enumerate(tree.nodes)}
        self._full_tree = full_tree
        self._highlighted = {index for uid in highlighted if (index := self._nearest(uid)) is not None}
        self._exceptions: dict[int, bool] = {} if exceptions is None else exceptions
        self._inner = np.array([bool(node.children) for node in tree.nodes])
        self._pill_strips = [_pill(place, style.PILL_HEIGHT / 2) for place in self.layout.places]
        edges = [np.array(line, dtype=np.float32) for line in self.layout.edges]
        self._entities, inside = node_entities(tree, self.origin)
        branches = split_by_subtree(tree, most=1 if self._is_folded else MAX_BRANCHES)
        self.subtrees = [
            SubtreeDrawing(
                rows,
                palette,
                inside[path],
                np.array(indices, dtype=np.intp),
                self._pill_strips,
                edges,
                f"{FOLDED}/{PILLS}/{number}" if self._is_folded else None,
            )
            for path, indices in branches.items()
        ]
        self._frames: dict[int, list[Stroke]] = {}
        for index, *corners in self.layout.frames:
            content = self._index_of_uid[tree.nodes[index].children[0]]
            self._frames.setdefault(content, []).append(_rounded(*corners))

    @property
    def passive_entities(self) -> tuple[str, ...]:
        """The entities that do not react to the mouse; only pills do."""
        parts = [f"{subtree.entity}/{part}" for subtree in self.subtrees for part in PARTS if part != "pills"]
        return (*parts, f"{self.origin}/{LEGEND}")

    def bounds(self) -> tuple[float, float, float, float]:
        """Return x0, y0, x1, y1 of the visible area: the tree, and the legend at the lower left."""
        (width, height), (across, down) = self.layout.size, self.view_size
        pixel = _pixel(self.layout, self.view_size)
        left, top = (width - across * pixel) / 2, (height - (down - LEGEND_HEIGHT) * pixel) / 2
        return left, top, left + across * pixel, top + down * pixel

    def colour(self, states: TickStates) -> None:
        """Add rows for the nodes whose colours change with *states*."""
        palette = self.palette
        shown = states.shown[self._whole_indices]
        running = shown == RUNNING
        pills = np.where(self._inner & running, np.uint32(palette.busy), palette.fill[shown])
        rims = np.where(shown == IDLE, palette.rest[states.results[self._whole_indices]], palette.rim[shown])
        for subtree in self.subtrees:
            subtree.colour(pills, rims, running)
        rings = dict(self._exceptions)
        self._exceptions.clear()
        for uid, was_idle in rings.items():
            index = self._nearest(uid)
            is_idle = index is None or bool(shown[index] == IDLE)
            if not was_idle or is_idle:
                self._exceptions[uid] = was_idle or is_idle
        if self._exceptions or rings:
            self._draw_rings()

    def mark_exception(self, uid: int) -> None:
        """Draw a ring around a node that raised an exception, or around the folded subtree that contains it.

        The ring disappears when the node with this *uid* becomes active again after it was IDLE.
        """
        self._exceptions[uid] = False
        self._draw_rings()

    def _draw_rings(self) -> None:
        rings = {index for uid in self._exceptions if (index := self._nearest(uid)) is not None}
        for subtree in self.subtrees:
            subtree.draw_rings(rings)

    def _nearest(self, uid: int) -> int | None:
        """Return the index of the node *uid* of the complete tree, or of its nearest drawn ancestor."""
        uids = (uid, *(node.uid for node in self._full_tree.ancestors(uid)))
        return next((self._index_of_uid[uid] for uid in uids if uid in self._index_of_uid), None)

    def draw(self) -> None:
        """Draw the parts that never change."""
        tree, palette = self.tree, self.palette
        half = style.PILL_HEIGHT / 2
        labels = [node.name for node in tree.nodes]
        hover = {
            "path": [node.path for node in tree.nodes],
            "ID": [node.id for node in tree.nodes],
            "ports": [format_ports(node) for node in tree.nodes],
        }
        stroke = min(half / 2, _MIN_RUNNING_EDGE_RADIUS * _pixel(self.layout, self.view_size))
        # Drawing orders, from the lowest to the highest: legend and frames 1, edges 2, running edges 3, halos
        # 3.4, rings 3.6, selected nodes 3.8, rims 4, pills 5, badges 6, text and symbols 7.
        for subtree in self.subtrees:
            subtree.draw(labels, hover, stroke)
            places = [self.layout.places[index] for index in subtree.indices]
            frames = [frame for index in subtree.indices for frame in self._frames.get(int(index), ())]
            subtree.log_strips("frames", frames, 1.0, colors=[palette.frame], radii=[style.FRAME_STROKE])
            marked = self._highlighted.intersection(subtree.indices.tolist())
            highlighted = [self._pill_strips[index] for index in sorted(marked)]
            subtree.log_strips(
                "highlights", highlighted, 3.4, colors=[palette.highlight], radii=[half + style.HALO]
            )
            # A strip needs a length; its round ends make it a disc.
            badges = [((place.x + half, place.y), (place.x + half + 0.01, place.y)) for place in places]
            subtree.log_strips("badges", badges, 6.0, colors=[palette.badge], radii=[style.BADGE_RADIUS])
            strokes, colours, radii = self._strokes(subtree.indices.tolist())
            subtree.log_strips("ink", strokes, 7.0, colors=np.array(colours, dtype=np.uint32), radii=radii)
        if not self._is_folded:
            x0, _, _, y1 = self.bounds()
            line = create_legend(
                palette, x0, y1, _pixel(self.layout, self.view_size), bool(self._highlighted)
            )
            self._rows.log(f"{self.origin}/{LEGEND}", line, static=True)
            self._name_nodes()

    def _name_nodes(self) -> None:
        """Log an entity with values for each node, so that nodes are in the viewer's list of entities.

        In trees that are not big the entity has the pill's shape, below the pill, so that the viewer marks a
        selected node.
        """
        has_shape = len(self.tree.nodes) <= FOLD_ABOVE_NODES
        for node, pill, entity in zip(self.tree.nodes, self._pill_strips, self._entities, strict=True):
            # A single component, because each component takes a kilobyte of the file.
            components = [
                create_hover_values({"node": f"{node.id}  {node.path}  {format_ports(node)}".rstrip()})
            ]
            if has_shape:
                radius = style.PILL_HEIGHT / 2 - style.RIM
                components.append(
                    rr.LineStrips2D([pill], colors=[self.palette.badge], radii=[radius], draw_order=3.8)
                )
            self._rows.log(entity, *components, static=True)

    def _strokes(self, indices: Sequence[int]) -> tuple[list[Strip], list[int], list[float]]:
        """Return the strokes, colours and radii of names, notes and symbols of the nodes at *indices*."""
        strokes: list[Stroke] = []
        colours: list[int] = []
        radii: list[float] = []
        for index in indices:
            node, place = self.tree.nodes[index], self.layout.places[index]
            caption = self.captions[node.uid]
            centre = place.x + style.PILL_HEIGHT / 2
            left = centre + style.BADGE_RADIUS + 7.0
            symbol = path_strokes(symbol_path(node.id, node.type))
            sign = place_strokes(symbol, centre, place.y, style.BADGE_RADIUS / 10)
            raise_by = style.NOTE_LIFT if caption.note else 0.0
            name = strokes_of(
                caption.name, left, place.y + style.TEXT_HEIGHT * 0.46 - raise_by, style.TEXT_HEIGHT
            )
            note = strokes_of(caption.note, left, place.y + style.NOTE_DROP, style.NOTE_HEIGHT)
            strokes += [*sign, *name, *note]
            colours += [self.palette.text] * (len(sign) + len(name)) + [self.palette.note] * len(note)
            radii += [style.BADGE_STROKE] * len(sign) + [style.TEXT_STROKE] * len(name)
            radii += [style.NOTE_STROKE] * len(note)
        return [np.array(stroke, dtype=np.float32) for stroke in strokes], colours, radii


def arrange(tree: ObservedTree, written: Mapping[int, Caption], view_size: tuple[float, float]) -> TreeLayout:
    """Return the layout of a tree.

    Args:
        written: The nodes' captions by uid, which determine the widths of the pills.
        view_size: Width and height of the view (pixels).
    """
    index_of_uid = {node.uid: index for index, node in enumerate(tree.nodes)}
    boxes = [
        Box(
            width=written[node.uid].width,
            height=style.PILL_HEIGHT,
            children=tuple(index_of_uid[child] for child in node.children),
            has_frame=node.type == "subtree" and bool(node.children),
        )
        for node in tree.nodes
    ]
    across, down = view_size
    return lay_out(boxes, across / (down - LEGEND_HEIGHT), across / _MIN_SCALE)


def _arrange_readable(
    tree: ObservedTree, full_tree: ObservedTree, view_size: tuple[float, float]
) -> tuple[Mapping[int, Caption], TreeLayout]:
    """Return captions and layout, with notes if these are readable without zooming in."""
    if len(tree.nodes) <= FOLD_ABOVE_NODES:
        noted = create_captions(tree, full_tree, with_notes=True)
        layout = arrange(tree, noted, view_size)
        # _pixel is the reciprocal of the scale.
        if _pixel(layout, view_size) * _MIN_NOTE_SCALE <= 1.0:
            return noted, layout
    plain = create_captions(tree, full_tree, with_notes=False)
    return plain, arrange(tree, plain, view_size)


def _pixel(layout: TreeLayout, view_size: tuple[float, float]) -> float:
    """Return the size of a pixel (units of the drawing) if the view shows all of *layout*."""
    (width, height), (across, down) = layout.size, view_size
    margin = style.PILL_HEIGHT * 0.7
    wide = (width + margin) / (across - 2 * _MARGIN)
    high = (height + margin) / (down - LEGEND_HEIGHT - 2 * _MARGIN)
    return max(wide, high, 1 / _MAX_SCALE)


def _pill(place: Place, half: float) -> Strip:
    # A pill is a thick line: rerun draws the ends of lines round.
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


def list_leaves(nodes: Sequence[ObservedNode]) -> list[ObservedNode]:
    """Return the actions and conditions without children, in tree order."""
    return [node for node in nodes if not node.children and node.type in ("action", "condition")]


def match_nodes(tree: ObservedTree, pattern: str) -> list[int]:
    """Return the uids of the nodes whose name, ID or path matches *pattern* (`*`, `?`), ignoring case.

    A pattern without `*`, `?` and `[` matches every name, ID or path that contains it.
    """
    # Not fnmatch(), which ignores case on Windows only.
    glob = pattern.casefold()
    if not any(sign in glob for sign in "*?["):
        glob = f"*{glob}*"
    return [
        node.uid
        for node in tree.nodes
        if any(fnmatchcase(text.casefold(), glob) for text in (node.name, node.id, node.path))
    ]
