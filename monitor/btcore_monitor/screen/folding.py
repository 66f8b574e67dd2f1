"""The folded drawing of a big tree, in which the part that runs is always unfolded.

Each set of visible nodes has its own drawing, which is drawn once. Over time, only the active drawing is
moved into the view. A movement takes some bytes of the recording, a drawing many kilobytes.
"""

from collections.abc import Collection, Iterable
from dataclasses import replace
from typing import Any, Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from btcore_drawing.folding import fold as hidden_below
from btcore_monitor.events import RUNNING, ObservedTree
from btcore_monitor.screen import style
from btcore_monitor.screen.legend import create_legend
from btcore_monitor.screen.row_buffer import RowBuffer, Series
from btcore_monitor.screen.tick_states import TickStates
from btcore_monitor.screen.tree_view import FOLDED, LEGEND, LINES, PILLS, TreeView

MAX_FOLDED_NODES: Final = 90
"""Greatest number of nodes of a folded tree; more nodes would not be readable in a window."""
MAX_DRAWINGS: Final = 32
"""Greatest number of drawings of a tree. Later, the drawing is used that shows most of what runs."""
_OUTSIDE: Final = -1e5
"""Coordinate of the drawings that are not active, outside of the view."""


def fold(tree: ObservedTree, running: Collection[int] = (), most: int = MAX_FOLDED_NODES) -> ObservedTree:
    """Return *tree* without the nodes that are folded into their parents.

    The children of running nodes are always in the result, and without running nodes the whole main tree.

    Args:
        running: The uids of the running nodes.
        most: The greatest number of nodes in the result.
    """
    children = {node.uid: node.children for node in tree.nodes}
    calls = {node.uid for node in tree.nodes if node.type == "subtree"}
    main = {node.uid for node in tree.nodes if node.subtree == tree.root.subtree} - calls
    hidden = hidden_below(children, calls, most, unfolded=running or main)
    visible = {tree.root.uid}
    for node in tree.nodes:
        if node.uid in visible and node.uid not in hidden:
            visible.update(node.children)
    nodes = [
        replace(node, children=()) if node.uid in hidden else node
        for node in tree.nodes
        if node.uid in visible
    ]
    return ObservedTree(tree.tree_id, tree.name, tuple(nodes), tree.subtrees)


class FoldedTreeView:
    """The drawing of a folded tree with the statuses of its nodes.

    The methods and the parameters are the same as in `TreeView`.
    """

    origin = FOLDED
    passive_entities = (f"{FOLDED}/{LINES}", f"{FOLDED}/{LEGEND}")
    """The entities that, with all entities below, do not react to the mouse."""

    def __init__(
        self,
        rows: RowBuffer,
        tree: ObservedTree,
        palette: style.Palette,
        view_size: tuple[float, float],
        highlighted: Collection[int] = (),
    ) -> None:
        self.full_tree = tree
        self._rows = rows
        self._palette = palette
        self._view_size = view_size
        self._highlighted = highlighted
        self._exceptions: dict[int, bool] = {}
        self._drawings: dict[frozenset[int], _Drawing] = {}
        self._active: _Drawing | None = None
        self._uids = np.array([node.uid for node in tree.nodes])

    @property
    def tree(self) -> ObservedTree:
        """The visible part of the tree."""
        return self._active.view.tree if self._active is not None else fold(self.full_tree)

    def bounds(self) -> tuple[float, float, float, float]:
        """Return x0, y0, x1, y1 of the visible area; its unit is a pixel."""
        return 0.0, 0.0, *self._view_size

    def draw(self) -> None:
        """Draw the parts that never change."""
        line = create_legend(self._palette, 0.0, self._view_size[1], 1.0, bool(self._highlighted))
        self._rows.log(f"{FOLDED}/{LEGEND}", line, static=True)

    def colour(self, states: TickStates) -> None:
        """Show *states*, and unfold the nodes that run."""
        running = states.shown == RUNNING
        active = self._active
        if active is None or (running & ~active.visible).any():
            chosen = self._drawing(running, states)
            if chosen is not active:
                if active is not None:
                    active.move(is_active=False)
                chosen.move(is_active=True)
                self._active = active = chosen
        active.view.colour(states)

    def mark_exception(self, uid: int) -> None:
        """Draw a ring around a node that raised an exception; see TreeView.mark_exception."""
        if self._active is not None:
            self._active.view.mark_exception(uid)

    def _drawing(self, running: NDArray[np.bool_], states: TickStates) -> "_Drawing":
        """Return the drawing that shows the *running* nodes, which may be a new one."""
        tree = fold(self.full_tree, set(self._uids[running].tolist()))
        key = frozenset(node.uid for node in tree.nodes)
        drawing = self._drawings.get(key)
        if drawing is not None:
            return drawing
        if len(self._drawings) >= MAX_DRAWINGS:
            return max(self._drawings.values(), key=lambda drawing: int((running & drawing.visible).sum()))
        number = len(self._drawings)
        view = TreeView(
            self._rows,
            tree,
            self._palette,
            self._view_size,
            self._highlighted,
            self.full_tree,
            number,
            self._exceptions,
        )
        view.draw()
        drawing = _Drawing(self._rows, view, np.isin(self._uids, list(key)), number)
        # It is outside of the view from the beginning on, until it is active.
        with self._rows.at(*states.start_times):
            drawing.move(is_active=False)
        self._drawings[key] = drawing
        return drawing


class _Drawing:
    """The drawing *view* of the nodes that are *visible*; it is in the window while it is active."""

    def __init__(self, rows: RowBuffer, view: TreeView, visible: NDArray[np.bool_], number: int) -> None:
        self.view = view
        self.visible = visible
        left, top, right, _ = view.bounds()
        self._scale = view.view_size[0] / (right - left)
        self._place = (-left * self._scale, -top * self._scale, 0.0)
        self._series: list[Series[Any]] = [
            rows.create_series(f"{FOLDED}/{layer}/{number}", _create_transform_columns)
            for layer in (LINES, PILLS)
        ]

    def move(self, is_active: bool) -> None:
        place = self._place if is_active else (_OUTSIDE, _OUTSIDE, 0.0)
        for series in self._series:
            series.add((place, self._scale))


def _create_transform_columns(values: list[tuple[tuple[float, float, float], float]]) -> Iterable[Any]:
    places, scales = zip(*values, strict=True)
    return rr.Transform3D.columns(translation=list(places), scale=[[scale] * 3 for scale in scales])
