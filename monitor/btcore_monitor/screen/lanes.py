"""Lanes: horizontal bars that show the statuses of nodes over time.

There is a lane for each leaf. A tree with too many leaves has lanes for the running subtrees of each depth,
and for the running leaves.
"""

from collections.abc import Collection, Iterable, Sequence
from typing import Any, Final

import numpy as np
import rerun as rr

from btcore_monitor.events import IDLE, RUNNING, STATUS_NAMES, ObservedNode, ObservedTree
from btcore_monitor.screen.captions import distinct_names
from btcore_monitor.screen.row_buffer import RowBuffer, entity_part
from btcore_monitor.screen.style import Palette
from btcore_monitor.screen.tick_states import SHOWN_NAMES, TickStates
from btcore_monitor.screen.tree_view import list_leaves

MAX_LANES: Final = 48
"""Greatest number of lanes. A lane is about 40 pixels high, so that more lanes would not be readable."""
SUBTREES_DEEP: Final = 4
LEAVES_AT_ONCE: Final = 4
"""Maximum numbers of lanes in a big tree: for levels of subtrees, and for leaves that run simultaneously."""
NOTHING: Final = "–"


def choose_nodes(tree: ObservedTree, highlighted: Collection[int]) -> list[ObservedNode]:
    """Return the nodes that get their own lane.

    These are the nodes whose uids are in *highlighted*. Without any they are all
    leaves, or no nodes if there are more than MAX_LANES leaves.
    """
    if highlighted:
        return [node for node in tree.nodes if node.uid in highlighted][:MAX_LANES]
    all_leaves = list_leaves(tree.nodes)
    return all_leaves if len(all_leaves) <= MAX_LANES else []


def lane_entities(names: Sequence[str]) -> list[str]:
    """Return an entity for each lane in *names*. It begins with a number, because rerun sorts by name."""
    digits = len(str(len(names)))
    return [f"{number:0{digits}d}_{entity_part(name)}" for number, name in enumerate(names, start=1)]


class Lanes:
    """The lanes of a tree: the statuses of chosen nodes, and in a big tree the names of running nodes."""

    def __init__(
        self, rows: RowBuffer, tree: ObservedTree, palette: Palette, highlighted: Collection[int] = ()
    ) -> None:
        self._palette = palette
        self._rows = rows
        nodes = choose_nodes(tree, highlighted)
        depths = _group_by_depth(tree) if len(list_leaves(tree.nodes)) > MAX_LANES else {}
        slots = [f"leaf {slot}" if slot > 1 else "leaf" for slot in range(1, LEAVES_AT_ONCE + 1)]
        over = [*depths, *slots] if depths else []
        self.entities = lane_entities([*over, *distinct_names(nodes)])
        self._running_lanes = [
            rows.create_series(entity, _create_state_columns) for entity in self.entities[: len(over)]
        ]
        index_of_uid = {node.uid: index for index, node in enumerate(tree.nodes)}
        self._series = {
            index_of_uid[node.uid]: rows.create_series(entity, _create_state_columns)
            for node, entity in zip(nodes, self.entities[len(over) :], strict=True)
        }
        self._names = distinct_names(tree.nodes)
        self._depths = [[index_of_uid[node.uid] for node in level] for level in depths.values()]
        self._leaf = np.array([not node.children for node in tree.nodes])
        self._slots: list[int | None] = [None] * (len(slots) if over else 0)
        # The lanes of further leaves appear when several leaves run at the same time.
        self._shown: list[str | None] = [None] * (len(depths) + 1) + [NOTHING] * (LEAVES_AT_ONCE - 1)
        content = "Running nodes" if over else "Found nodes" if highlighted else "Leaves"
        self.title = f"{content} over time"

    def draw(self) -> None:
        """Log the colours of the lanes."""
        palette, log = self._palette, self._rows.log
        colours = palette.fill[: len(STATUS_NAMES)]
        style = rr.StateConfiguration(values=list(STATUS_NAMES), labels=list(STATUS_NAMES), colors=colours)
        for entity in self.entities[len(self._running_lanes) :]:
            log(entity, style, static=True)
        if self._running_lanes:
            # Two alternating shades distinguish neighbours.
            shades = palette.busy, int(palette.fill[RUNNING])
            names = sorted(set(self._names))
            shown = [int(palette.fill[IDLE]), *(shades[index % 2] for index in range(len(names)))]
            # An array of uint32, because rerun would warn that a list of three numbers is ambiguous.
            style = rr.StateConfiguration(
                values=[NOTHING, *names], labels=[NOTHING, *names], colors=np.array(shown, dtype=np.uint32)
            )
            for entity in self.entities[: len(self._running_lanes)]:
                log(entity, style, static=True)

    def show_states(self, states: TickStates, changed: Iterable[int]) -> None:
        """Add a state to the lane of each node in *changed* (indices of nodes)."""
        for index in changed:
            series = self._series.get(index)
            if series is not None:
                series.add(SHOWN_NAMES[states.shown[index]])
        if not self._running_lanes:
            return
        running = states.shown == RUNNING
        active = [next((index for index in level if running[index]), None) for level in self._depths]
        active += self._assign_slots(np.flatnonzero(running & self._leaf).tolist())
        for lane, leaf in enumerate(active):
            name = NOTHING if leaf is None else self._names[leaf]
            if name != self._shown[lane]:
                self._shown[lane] = name
                self._running_lanes[lane].add(name)

    def _assign_slots(self, running: list[int]) -> list[int | None]:
        """Return the index of the running leaf of each lane, or None.

        A leaf keeps its lane while it runs; a new leaf takes a free lane.
        """
        self._slots = [leaf if leaf in running else None for leaf in self._slots]
        for leaf in running:
            if leaf not in self._slots and None in self._slots:
                self._slots[self._slots.index(None)] = leaf
        return self._slots


def _group_by_depth(tree: ObservedTree) -> dict[str, list[ObservedNode]]:
    """Return the nodes of each lane of a big tree, by the lane's name.

    A lane has the SubTree nodes of a depth. In a tree without subtrees, a lane has the root's children.
    """
    by_depth: dict[int, list[ObservedNode]] = {}
    depth: dict[int, int] = {0: 0}
    for node in tree.nodes:
        # The number of SubTree nodes from the root to the node; parents precede their children.
        depth[node.uid] = depth[node.parent] + (node.type == "subtree")
        if node.type == "subtree" and depth[node.uid] <= SUBTREES_DEEP:
            by_depth.setdefault(depth[node.uid], []).append(node)
    if not by_depth:
        return {"branch": [tree.by_uid[uid] for uid in tree.root.children]}
    return {"subtree" if level == 1 else f"subtree {level}": nodes for level, nodes in by_depth.items()}


def _create_state_columns(values: list[str]) -> Iterable[Any]:
    return rr.StateChange.columns(state=values)
