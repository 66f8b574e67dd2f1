"""The displayed states of a tree's nodes, tick by tick, for pills and lanes.

A parent often resets a finished node within the same tick. A condition below an Inverter, for example, would
always be displayed as IDLE. Therefore this module also keeps each node's result in the current tick, and its
last result.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from btcore_monitor.events import IDLE, RUNNING, STATUS_NAMES, ObservedTree, TransitionEvent

RESET_OFFSET: Final = 3
"""Added to a result (SUCCESS 2, FAILURE 3, SKIPPED 4) of a node that was reset in the same tick."""
SHOWN_NAMES: Final = (*STATUS_NAMES, *STATUS_NAMES[2:])

MAX_PAUSE_IN_TICK_NS: Final = 1_000_000
MAX_TICK_NS: Final = 20_000_000
"""Grouping of changes without tick numbers (ns): a tick has pauses of up to 1 ms and lasts up to 20 ms."""

States = NDArray[np.uint8]


class TickStates:
    """The states of a tree's nodes, by their index in the tree.

    *shown* has each node's stored status, or `RESET_OFFSET + result` if the node ended and was reset within
    the tick. *results* has each node's last result (0 for none). *stamp* and *wall* (ns) are the times of the
    last change, and *start_times* the times of the first statuses.
    """

    def __init__(self, tree: ObservedTree) -> None:
        self.index_of_uid: Mapping[int, int] = {node.uid: index for index, node in enumerate(tree.nodes)}
        self.shown: States = np.zeros(len(tree.nodes), dtype=np.uint8)
        self.results: States = np.zeros(len(tree.nodes), dtype=np.uint8)
        self.stamp = 0
        self.wall = 0
        self.start_times = (0, 0)
        self._shown_before = self.shown.copy()
        self._tick_results: dict[int, int] = {}
        self._tick_nodes: set[int] = set()
        self._reset_nodes: set[int] = set()
        self._tick: int | None = None
        self._tick_start = 0

    def begin(self, stamp: int, wall: int, statuses: Mapping[int, int]) -> None:
        """Begin with known statuses.

        Args:
            stamp: The time of the tree (ns).
            wall: The wall-clock time (ns since the epoch).
            statuses: The nodes' statuses by uid.
        """
        self.stamp, self.wall = stamp, wall
        if self.start_times == (0, 0):
            self.start_times = stamp, wall
        for uid, status in statuses.items():
            index = self.index_of_uid.get(uid)
            if index is not None:
                self.shown[index] = status
                if status not in (IDLE, RUNNING):
                    self.results[index] = status
        self._clear_tick()
        self._reset_nodes.clear()
        self._shown_before = self.shown.copy()

    @property
    def has_open_tick(self) -> bool:
        """Whether there are changes since the last call of `end_tick`."""
        return self._tick is not None

    def is_of_later_tick(self, event: TransitionEvent) -> bool:
        """Return whether *event* is of a later tick than the changes since the last call of `end_tick`."""
        # Robots with Groot's protocols send no numbers of ticks (0). Then a pause or a long time ends a tick.
        if self._tick is None or event.tick != self._tick:
            return self._tick is not None
        return event.tick == 0 and (
            event.stamp - self.stamp >= MAX_PAUSE_IN_TICK_NS or event.stamp - self._tick_start >= MAX_TICK_NS
        )

    def apply_transition(self, event: TransitionEvent) -> None:
        """Apply a transition."""
        if self._tick is None:
            self._tick_start = event.stamp
        self._tick = event.tick
        self.stamp, self.wall = event.stamp, event.wall
        index = self.index_of_uid.get(event.uid)
        if index is None:
            return
        self._tick_nodes.add(index)
        if event.status == IDLE:
            result = self._tick_results.get(index)
            self.shown[index] = IDLE if result is None else RESET_OFFSET + result
        else:
            self.shown[index] = event.status
            if event.status == RUNNING:
                self._tick_results.pop(index, None)
            else:
                self._tick_results[index] = self.results[index] = event.status

    def end_tick(self, stamp: int, wall: int) -> list[int]:
        """End a tick. Results of the previous tick that did not occur again are forgotten.

        Args:
            stamp: The time of the tree (ns).
            wall: The wall-clock time (ns since the epoch).

        Returns:
            The indices of the nodes whose displayed state differs from the state after the last call.
        """
        if not self._tick_nodes and self._reset_nodes:
            self.stamp, self.wall = stamp, wall
        # A reset node shows its result for one tick, unless it ended again.
        for index in self._reset_nodes - self._tick_nodes:
            self.shown[index] = IDLE
        self._reset_nodes = {
            index for index in self._reset_nodes | self._tick_nodes if self.shown[index] >= len(STATUS_NAMES)
        }
        changed = np.flatnonzero(self.shown != self._shown_before).tolist()
        self._shown_before = self.shown.copy()
        self._clear_tick()
        return changed

    def _clear_tick(self) -> None:
        self._tick_results.clear()
        self._tick_nodes.clear()
        self._tick = None
