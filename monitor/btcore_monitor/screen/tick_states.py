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
    last change, and *began* the times of the first statuses.
    """

    def __init__(self, tree: ObservedTree) -> None:
        self.index: Mapping[int, int] = {node.uid: at for at, node in enumerate(tree.nodes)}
        self.shown: States = np.zeros(len(tree.nodes), dtype=np.uint8)
        self.results: States = np.zeros(len(tree.nodes), dtype=np.uint8)
        self.stamp = 0
        self.wall = 0
        self.began = (0, 0)
        self._before = self.shown.copy()
        self._ended: dict[int, int] = {}
        self._touched: set[int] = set()
        self._held: set[int] = set()
        self._tick: int | None = None
        self._began = 0

    def start(self, stamp: int, wall: int, statuses: Mapping[int, int]) -> None:
        """Begin with known statuses.

        Args:
            stamp: The time of the tree (ns).
            wall: The wall-clock time (ns since the epoch).
            statuses: The nodes' statuses by uid.
        """
        self.stamp, self.wall = stamp, wall
        if self.began == (0, 0):
            self.began = stamp, wall
        for uid, status in statuses.items():
            at = self.index.get(uid)
            if at is not None:
                self.shown[at] = status
                if status not in (IDLE, RUNNING):
                    self.results[at] = status
        self._forget()
        self._held.clear()
        self._before = self.shown.copy()

    @property
    def is_open(self) -> bool:
        """Whether there are changes since the last call of `close`."""
        return self._tick is not None

    def is_over(self, event: TransitionEvent) -> bool:
        """Return whether *event* belongs to a later tick than the changes since the last call of `close`."""
        # Robots with Groot's protocols send no numbers of ticks (0). Then a pause or a long time ends a tick.
        if self._tick is None or event.tick != self._tick:
            return self._tick is not None
        return event.tick == 0 and (
            event.stamp - self.stamp >= MAX_PAUSE_IN_TICK_NS or event.stamp - self._began >= MAX_TICK_NS
        )

    def change(self, event: TransitionEvent) -> None:
        """Apply a transition."""
        if self._tick is None:
            self._began = event.stamp
        self._tick = event.tick
        self.stamp, self.wall = event.stamp, event.wall
        at = self.index.get(event.uid)
        if at is None:
            return
        self._touched.add(at)
        if event.status == IDLE:
            result = self._ended.get(at)
            self.shown[at] = IDLE if result is None else RESET_OFFSET + result
        else:
            self.shown[at] = event.status
            if event.status == RUNNING:
                self._ended.pop(at, None)
            else:
                self._ended[at] = self.results[at] = event.status

    def close(self, stamp: int, wall: int) -> list[int]:
        """End a tick. Results of the previous tick that did not occur again are forgotten.

        Args:
            stamp: The time of the tree (ns).
            wall: The wall-clock time (ns since the epoch).

        Returns:
            The indices of the nodes whose displayed state differs from the state after the last call.
        """
        if not self._touched and self._held:
            self.stamp, self.wall = stamp, wall
        # A reset node shows its result for one tick, unless it ended again.
        for at in self._held - self._touched:
            self.shown[at] = IDLE
        self._held = {at for at in self._held | self._touched if self.shown[at] >= len(STATUS_NAMES)}
        changed = np.flatnonzero(self.shown != self._before).tolist()
        self._before = self.shown.copy()
        self._forget()
        return changed

    def _forget(self) -> None:
        self._ended.clear()
        self._touched.clear()
        self._tick = None
