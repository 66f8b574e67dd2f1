"""The tick thread's side of publishing: it appends to a queue, and that is all it does.

No lock, no socket, no serialising: a ``deque`` hands things over under the interpreter's own
lock. The queue is bounded. If the publisher can't follow, the oldest transitions fall out (their
numbers tell), and scenes are not taken at all (counted).
"""

import time
from collections import ChainMap, deque
from collections.abc import Mapping, Sequence
from dataclasses import fields
from itertools import chain
from typing import Any, Final, NamedTuple, TypeVar

from btcore.engine.observers import Observer
from btcore.errors import NodeExecutionError
from btcore.status import Status, Transition
from btcore_monitor.serve.blackboards import BlackboardTracker
from btcore_monitor.wire.msgpack_values import Boards
from btcore_scene import MovingScene, SceneSource, StaticScene

QUEUE_AT_MOST: Final = 200_000
"""Items that wait for the publisher."""

_BIG_AT_MOST: Final = 500
"""Scenes and blackboards that wait, which are big; further ones are skipped."""

_BLOB: Final = 1 << 16
"""Bytes of a grid or picture in a scene that count as one big thing more."""

SCENE_EVERY_NS: Final = 30_000_000
"""The least time (tree clock) between two scenes."""


_LISTS: Final = {
    one.name for kind in (StaticScene, MovingScene) for one in fields(kind) if "Sequence" in str(one.type)
}
"""Fields of a scene that are sequences of messages."""

S = TypeVar("S", StaticScene, MovingScene)


def merge_scenes(kind: type[S], scenes: Sequence[S]) -> S:
    """Return *scenes* as one: sequences and maps are joined, of other values the first counts."""
    whole: dict[str, Any] = {}
    for name in (one.name for one in fields(kind)):
        values = [value for scene in scenes if (value := getattr(scene, name)) is not None]
        if name in _LISTS and values:
            whole[name] = tuple(chain.from_iterable(values))
        elif values:
            whole[name] = dict(ChainMap(*values)) if isinstance(values[0], Mapping) else values[0]
    return kind(**whole)


def weight(scene: MovingScene) -> int:
    """Return how many large messages *scene* counts for."""
    blobs = [grid.cells for grid in scene.grids] + [picture.data for picture in scene.pictures]
    return 1 + sum(map(len, blobs)) // _BLOB


class StampedTransition(NamedTuple):
    """A transition, and when it was by the wall clock (ns since the epoch)."""

    change: Transition
    wall: int


class TickEnded(NamedTuple):
    """The end of a tick of the root."""

    tick: int
    stamp: int
    wall: int
    duration: int
    status: Status


class BoardsChanged(NamedTuple):
    """All blackboards, frozen, after a tick that wrote one."""

    stamp: int
    wall: int
    boards: Boards


class SceneTaken(NamedTuple):
    """The moving part of the scene after a tick."""

    stamp: int
    wall: int
    data: MovingScene
    weight: int


class NodeException(NamedTuple):
    """A node raised."""

    stamp: int
    wall: int
    path: str
    message: str


class Finished(NamedTuple):
    """Nothing follows."""

    stamp: int
    wall: int
    status: Status


Item = StampedTransition | TickEnded | BoardsChanged | SceneTaken | NodeException | Finished


class QueueingObserver(Observer):
    """Hears one tree and queues what it hears for the publisher."""

    def __init__(self, boards: BlackboardTracker | None, scenes: Sequence[SceneSource]) -> None:
        self.queue: deque[Item] = deque(maxlen=QUEUE_AT_MOST)
        self.big_taken = 0
        """Scenes, by their weight, and blackboards that the publisher's thread took; it alone counts here."""
        self._big_put = 0
        self.ended_at = 0
        """The monotonic time (ns) up to which the queued blackboards are the latest."""
        self._boards = boards
        self._scenes = scenes
        self._next_scene: int | None = None

    def transition(self, change: Transition) -> None:
        """Queue *change*."""
        self.queue.append(StampedTransition(change, time.time_ns()))

    def ticked(self, tick: int, stamp: int, duration_ns: int, status: Status) -> None:
        """Queue the tick's end, the blackboards if they changed, and the scene if it is time."""
        wall = time.time_ns()
        queue = self.queue
        queue.append(TickEnded(tick, stamp, wall, duration_ns, status))
        if self._big_put - self.big_taken > _BIG_AT_MOST:
            return
        if self._boards is not None:
            boards = self._boards.snapshot_if_changed()
            if boards is not None:
                queue.append(BoardsChanged(stamp, wall, boards))
                self._big_put += 1
        self.ended_at = time.monotonic_ns()
        if self._scenes:
            self.look(stamp, wall)

    def look(self, stamp: int, wall: int) -> None:
        """Queue the moving part of the scene, unless the last one is too recent."""
        if self._next_scene is not None and stamp < self._next_scene:
            return
        # a little early is in time: ticks may jitter
        self._next_scene = stamp + SCENE_EVERY_NS - SCENE_EVERY_NS // 10
        data = merge_scenes(MovingScene, [source.scene_moving() for source in self._scenes])
        taken = SceneTaken(stamp, wall, data, weight(data))
        self.queue.append(taken)
        self._big_put += taken.weight

    def raised(self, error: NodeExecutionError, stamp: int) -> None:
        """Queue the sentence."""
        self.queue.append(NodeException(stamp, time.time_ns(), error.path, str(error)))
