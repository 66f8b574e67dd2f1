"""The tick thread's part of publishing: it only appends items to a queue.

There is no lock, no socket and no serialization here: appending to a `deque` is atomic under the
interpreter's lock. The queue is bounded. If the publisher is too slow, no new scenes and blackboards are
queued. If the queue is full, the oldest items are dropped; clients notice dropped transitions by a gap in
their numbers.
"""

import time
from collections import ChainMap, deque
from collections.abc import Mapping, Sequence
from dataclasses import fields
from itertools import chain
from typing import Any, Final, NamedTuple, TypeVar, get_args, get_origin

from btcore.engine.observers import Observer
from btcore.errors import NodeExecutionError
from btcore.status import Status, Transition
from btcore_monitor.serve.blackboards import BlackboardTracker
from btcore_monitor.wire.msgpack_values import Boards
from btcore_scene import MovingScene, SceneSource, StaticScene

MAX_QUEUE_ITEMS: Final = 200_000
"""Maximum items that wait for the publisher."""

_MAX_QUEUED_WEIGHT: Final = 500
"""Maximum total weight of waiting scenes and blackboards, which are large; more are skipped."""

_BYTES_PER_WEIGHT: Final = 1 << 16
"""Number of bytes of grids and pictures that adds 1 to the weight of a scene."""

SCENE_INTERVAL_NS: Final = 30_000_000
"""Minimum time (ns, tree clock) between two scenes."""

_SEQUENCE_FIELDS: Final = {
    field.name
    for scene_class in (StaticScene, MovingScene)
    for field in fields(scene_class)
    if any(get_origin(part) is Sequence for part in (field.type, *get_args(field.type)))
}
"""Fields of a scene that are sequences of messages."""

S = TypeVar("S", StaticScene, MovingScene)


def merge_scenes(scene_class: type[S], scenes: Sequence[S]) -> S:
    """Merge *scenes* into a scene of *scene_class*.

    Sequences and maps are joined. For every other field, the first value that is not None is kept.
    """
    merged: dict[str, Any] = {}
    for name in (field.name for field in fields(scene_class)):
        values = [value for scene in scenes if (value := getattr(scene, name)) is not None]
        if name in _SEQUENCE_FIELDS and values:
            merged[name] = tuple(chain.from_iterable(values))
        elif values:
            merged[name] = dict(ChainMap(*values)) if isinstance(values[0], Mapping) else values[0]
    return scene_class(**merged)


def compute_weight(scene: MovingScene) -> int:
    """Return the weight of *scene*: 1 + the bytes of its grids and pictures / _BYTES_PER_WEIGHT."""
    buffers = [grid.cells for grid in scene.grids] + [picture.data for picture in scene.pictures]
    return 1 + sum(map(len, buffers)) // _BYTES_PER_WEIGHT


class TransitionItem(NamedTuple):
    """A transition, and its wall-clock time (ns since the epoch)."""

    transition: Transition
    wall: int


class TickItem(NamedTuple):
    """The end of a tick of the root.

    *stamp* is ns of the tree's clock, *wall* ns since the epoch, and *duration_ns* of wall time.
    """

    tick: int
    stamp: int
    wall: int
    duration_ns: int
    status: Status


class BlackboardItem(NamedTuple):
    """All blackboards, frozen, after a tick that wrote an entry."""

    stamp: int
    wall: int
    boards: Boards


class MovingSceneItem(NamedTuple):
    """The moving part of the scene after a tick."""

    stamp: int
    wall: int
    data: MovingScene
    weight: int


class ExceptionItem(NamedTuple):
    """An exception of the node at *path*."""

    stamp: int
    wall: int
    path: str
    message: str


class EndItem(NamedTuple):
    """The end of the run; no item follows."""

    stamp: int
    wall: int
    status: Status


QueueItem = TransitionItem | TickItem | BlackboardItem | MovingSceneItem | ExceptionItem | EndItem


class QueueingObserver(Observer):
    """Observes one tree and queues its events for the publisher."""

    def __init__(
        self, blackboard_tracker: BlackboardTracker | None, scene_sources: Sequence[SceneSource]
    ) -> None:
        self.queue: deque[QueueItem] = deque(maxlen=MAX_QUEUE_ITEMS)
        self.weight_taken = 0
        """The total weight of the scenes and blackboards that the publisher's thread took.

        Only that thread writes it, and only the tick thread writes `_weight_queued`, so no lock is needed.
        """
        self._weight_queued = 0
        self.boards_checked_at = 0
        """The monotonic time (ns) of the last tick whose changes of blackboards were queued."""
        self._blackboard_tracker = blackboard_tracker
        self._scene_sources = scene_sources
        self._next_scene_stamp: int | None = None

    # Not `transitions`, which is called after a tick: clients see a tick that waits at a breakpoint.
    def transition(self, change: Transition) -> None:
        """Queue *change* at once, with the wall time."""
        self.queue.append(TransitionItem(change, time.time_ns()))

    def ticked(self, tick: int, stamp: int, duration_ns: int, status: Status) -> None:
        """Queue the tick's end, the blackboards if they changed, and the scene if it is due."""
        wall = time.time_ns()
        queue = self.queue
        queue.append(TickItem(tick, stamp, wall, duration_ns, status))
        # Transitions are small and must not be lost, so only scenes and blackboards are skipped.
        if self._weight_queued - self.weight_taken > _MAX_QUEUED_WEIGHT:
            return
        self.queue_boards(stamp, wall)
        if self._scene_sources:
            self.queue_scene(stamp, wall)

    def queue_boards(self, stamp: int, wall: int) -> None:
        """Queue the blackboards if they changed: after a tick, or while a tick is stopped at a breakpoint."""
        if self._blackboard_tracker is not None:
            boards = self._blackboard_tracker.snapshot_if_changed()
            if boards is not None:
                self.queue.append(BlackboardItem(stamp, wall, boards))
                self._weight_queued += 1
        self.boards_checked_at = time.monotonic_ns()

    def queue_scene(self, stamp: int, wall: int) -> None:
        """Queue the moving part of the scene, unless the last scene is too recent.

        Args:
            stamp: The time in ns of the tree's clock.
            wall: The wall clock, ns since the epoch.
        """
        if self._next_scene_stamp is not None and stamp < self._next_scene_stamp:
            return
        # 10 % early is accepted, so that jitter of the ticks does not skip every other scene.
        self._next_scene_stamp = stamp + SCENE_INTERVAL_NS - SCENE_INTERVAL_NS // 10
        data = merge_scenes(MovingScene, [source.moving_scene() for source in self._scene_sources])
        item = MovingSceneItem(stamp, wall, data, compute_weight(data))
        self.queue.append(item)
        self._weight_queued += item.weight

    def raised(self, error: NodeExecutionError, stamp: int) -> None:
        """Queue the error message."""
        self.queue.append(ExceptionItem(stamp, time.time_ns(), error.path, str(error)))
