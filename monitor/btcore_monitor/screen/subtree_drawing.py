"""The drawing of a subtree. It has its own entity: hiding the entity in the viewer hides the subtree.

The entities are nested like the nodes. Below `tree` are the parts of the drawing (`pills`, `rims`, …)
and an entity for each node, by its path. The content of a subtree is below the entity of its SubTree node.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from btcore_monitor.events import ObservedTree
from btcore_monitor.screen.row_buffer import RowBuffer, Series, create_colour_columns, entity_part
from btcore_monitor.screen.style import EDGE_STROKE, PILL_HEIGHT, RIM, RING, RUNNING_STROKE, Colours, Palette

PARTS: Final = ("frames", "edges", "running_edges", "raised", "highlights", "rims", "pills", "badges", "ink")
"""Names of the parts from the lowest layer to the highest; only pills react to the mouse."""
MAX_BRANCHES: Final = 8
"""Greatest number of subtrees with their own entity. Each changed subtree adds three chunks to each send."""

Indices = NDArray[np.intp]
Strip = NDArray[np.float32]


class SubtreeDrawing:
    """The drawing of the nodes of a subtree, below *entity*; *indices* are their indices in the tree.

    *pills* and *edges* are the line strips of all nodes of the tree. *pills_entity* is the entity of the
    pills (default: below *entity*).
    """

    def __init__(
        self,
        rows: RowBuffer,
        palette: Palette,
        entity: str,
        indices: Indices,
        pills: Sequence[Strip],
        edges: Sequence[Strip],
        pills_entity: str | None = None,
    ) -> None:
        self.entity = entity
        self.pills_entity = pills_entity or f"{entity}/pills"
        self.indices = indices
        self._palette = palette
        self._strips = [pills[index] for index in indices]
        self._edges = [edges[index] for index in indices]
        self._joined = np.array([len(edge) > 0 for edge in self._edges], dtype=bool)
        self._rows = rows
        self._pills: Series[Any] = rows.create_series(self.pills_entity, create_colour_columns)
        self._rims: Series[Any] = rows.create_series(f"{entity}/rims", create_colour_columns)
        self._running_edges: Series[Any] = rows.create_series(f"{entity}/running_edges", create_strip_columns)
        self._rings: Series[Any] = rows.create_series(f"{entity}/raised", create_strip_columns)
        self._last_rims = self._last_pills = np.zeros(0, dtype=np.uint32)
        self._last_running: list[int] | None = None
        self._last_rings: list[int] = []

    def colour(self, pills: Colours, rims: Colours, running: NDArray[np.bool_]) -> None:
        """Add rows for changed colours.

        Args:
            pills: Fill colours of all nodes of the tree.
            rims: Border colours of all nodes of the tree.
            running: For all nodes of the tree, whether the node is RUNNING.
        """
        own = pills[self.indices]
        # Rows are sent only for changes: an unchanged subtree costs nothing.
        if not np.array_equal(own, self._last_pills):
            self._last_pills = own
            self._pills.add(own)
        own = rims[self.indices]
        if not np.array_equal(own, self._last_rims):
            self._last_rims = own
            self._rims.add(own)
        edges = np.flatnonzero(running[self.indices] & self._joined).tolist()
        if edges != self._last_running:
            self._last_running = edges
            self._running_edges.add([self._edges[index] for index in edges])

    def draw_rings(self, raised: Iterable[int]) -> None:
        """Draw rings around exactly those nodes of this subtree that are in *raised* (tree indices)."""
        inside = np.flatnonzero(np.isin(self.indices, list(raised))).tolist()
        if inside != self._last_rings:
            self._last_rings = inside
            self._rings.add([self._strips[index] for index in inside])

    def draw(self, labels: Sequence[str], hover: Mapping[str, Sequence[str]], stroke: float) -> None:
        """Draw pills and edges.

        Args:
            labels: The labels of all nodes of the tree.
            hover: Values of all nodes of the tree that the viewer displays for a selected pill, by name.
            stroke: The smallest radius of the running edges, so that they are visible in a small drawing.
        """
        palette, half = self._palette, PILL_HEIGHT / 2
        edges = [edge for edge in self._edges if len(edge)]
        self.log_strips("edges", edges, 2.0, colors=[palette.edge], radii=[EDGE_STROKE])
        self.log_style(
            "running_edges", 3.0, colors=[palette.running_edge], radii=[max(RUNNING_STROKE, stroke)]
        )
        self.log_style("raised", 3.6, colors=[palette.raised], radii=[half + RING])
        self.log_strips("rims", self._strips, 4.0, radii=[half])
        self._rows.log(
            self.pills_entity,
            rr.LineStrips2D(
                self._strips,
                radii=[half - RIM],
                labels=[labels[index] for index in self.indices],
                show_labels=False,
                draw_order=5.0,
            ),
            create_hover_values(
                {name: [column[index] for index in self.indices] for name, column in hover.items()}
            ),
            static=True,
        )

    def log_strips(self, part: str, strips: Sequence[Any], order: float, **style: Any) -> None:
        """Draw static strips, if there are any.

        Args:
            part: The part of the drawing.
            order: The drawing order; higher values cover lower values.
            style: Further fields of the archetype.
        """
        if len(strips):
            drawn = rr.LineStrips2D(strips, draw_order=order, **style)
            self._rows.log(f"{self.entity}/{part}", drawn, static=True)

    def log_style(self, part: str, order: float, **style: Any) -> None:
        """Log the appearance of strips that change over time; see `log_strips` for the parameters."""
        fields = rr.LineStrips2D.from_fields(draw_order=order, **style)
        self._rows.log(f"{self.entity}/{part}", fields, static=True)


def create_hover_values(values: Mapping[str, Any]) -> Any:
    """Return the component with the *values* that the viewer displays for a selected entity, by name."""
    return rr.AnyValues(drop_untyped_nones=True, **values)


def create_strip_columns(values: list[list[Strip]]) -> Iterable[Any]:
    """Return columns with a list of strips in each row."""
    columns = rr.LineStrips2D.columns(strips=[strip for row in values for strip in row])
    return columns.partition([len(row) for row in values])


def split_by_subtree(tree: ObservedTree, most: int = MAX_BRANCHES) -> dict[str, list[int]]:
    """Split a tree into subtrees with their own entities.

    Args:
        most: The greatest number of subtrees; the outermost subtrees come first.

    Returns:
        The indices of the nodes by the path of the subtree. Nodes of subtrees without an entity belong to the
        enclosing subtree.
    """
    above: dict[str, str] = {}
    for node in tree.nodes:
        inside = [tree.by_uid[child].subtree for child in node.children]
        if node.type == "subtree" and inside and inside[0] != node.subtree:
            above[inside[0]] = node.subtree
    level: dict[str, int] = {tree.root.subtree: 0}
    for subtree, outer in above.items():
        level[subtree] = level.get(outer, 0) + 1
    own = set(sorted(level, key=lambda subtree: level[subtree])[:most])
    indices: dict[str, list[int]] = {}
    for index, node in enumerate(tree.nodes):
        subtree = node.subtree
        while subtree not in own and subtree in above:
            subtree = above[subtree]
        indices.setdefault(subtree, []).append(index)
    return indices


def node_entities(tree: ObservedTree, origin: str) -> tuple[list[str], dict[str, str]]:
    """Return the entity of each node, in the order of the nodes, and the entity of each subtree by its path.

    The entities are below *origin*. The content of a subtree is below the entity of its SubTree node.
    """
    taken: set[str] = set()
    subtrees = {tree.root.subtree: origin}
    entities = []
    for node in tree.nodes:
        outer = subtrees.get(node.subtree)
        path = node.path if outer is None else node.path.removeprefix(f"{node.subtree}/")
        entity = "/".join([outer or origin, *map(_node_part, path.split("/"))])
        # Replaced characters may make two entities equal, or equal to a part of the drawing.
        if entity in taken or entity.rsplit("/", 1)[1] in PARTS:
            entity += f".{node.uid}"
        taken.add(entity)
        entities.append(entity)
        if node.type == "subtree" and node.children:
            subtrees.setdefault(tree.by_uid[node.children[0]].subtree, entity)
    return entities, subtrees


def _node_part(name: str) -> str:
    return entity_part(name.replace("::", "."))
