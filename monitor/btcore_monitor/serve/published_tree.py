"""One tree being served: who hears it on the thread that ticks, and who answers for it on the other."""

import time
import uuid
from collections.abc import Callable, Sequence
from typing import Final

from btcore.tree.tree import Tree
from btcore.xml.render.tree_xml import tree_to_xml
from btcore_monitor.serve.blackboards import BlackboardTracker
from btcore_monitor.serve.groot1 import Groot1Server
from btcore_monitor.serve.groot2 import Groot2Server, statuses_of
from btcore_monitor.serve.hook_controller import HookController
from btcore_monitor.serve.queueing_observer import (
    BoardsChanged,
    Finished,
    QueueingObserver,
    SceneTaken,
    StampedTransition,
    merge_scenes,
)
from btcore_monitor.serve.scene import SceneServer
from btcore_monitor.wire.msgpack_values import Boards, encode_boards
from btcore_scene import SceneSource, StaticScene

_SECONDS_A_TURN: Final = 0.02
"""Time (wall clock) for queued items before the sockets have their turn."""

_FRESH_NS: Final = 1_000_000_000
"""Blackboards seen after a tick that ended longer ago (wall clock) are read again."""


class PublishedTree:
    """What a publisher has for *tree*, whose id on the wire is new. *scene*: whether it has the channel.

    *groot1* is the last uid that Groot 1 knows of the tree before, 0 if there was none, and None if Groot 1
    isn't spoken. *control* is how long (s) hooks outlive the last request; None: there are none.

    Made, and told to hear and to end, on the thread that ticks.
    """

    def __init__(
        self,
        tree: Tree,
        resources: Sequence[object],
        scene: bool,
        groot1: int | None = None,
        control: float | None = None,
    ) -> None:
        self.tree = tree
        identity = uuid.uuid4()
        self.tree_id = identity.hex
        self._sources = [one for one in resources if isinstance(one, SceneSource)] if scene else []
        self._tracker = BlackboardTracker(tree)
        self._boards: Boards | None = None
        self._observer = QueueingObserver(self._tracker, self._sources)
        xml = tree_to_xml(tree).encode()
        statuses = statuses_of(tree)
        hooks = None if control is None else HookController(tree, control)
        self.groot2 = Groot2Server(tree, xml, self._answer_boards, identity, hooks)
        self.groot1 = None if groot1 is None else Groot1Server(tree, groot1)
        self.scene: SceneServer | None = None
        if scene:
            parts = [one.scene_static() for one in self._sources]
            static = merge_scenes(StaticScene, parts) if parts else None
            self.scene = SceneServer(self.tree_id, xml, static, statuses, tree.clock.now())
        self._unsubscribe: Callable[[], None] | None = None

    def subscribe(self) -> None:
        """Hear the tree from now on."""
        self._unsubscribe = self.tree.subscribe(self._observer)
        if self._sources:
            self._observer.look(self.tree.clock.now(), time.time_ns())

    def leave(self) -> None:
        """Hear and control the tree no more."""
        self.remove_hooks()
        if self._unsubscribe is not None:
            self._unsubscribe()

    def remove_hooks(self) -> None:
        """Take all hooks away, for good; from any thread."""
        if self.groot2.control is not None:
            self.groot2.control.close()

    def finish(self) -> None:
        """Hear the tree no more, and let clients know that nothing follows."""
        self.leave()
        self._observer.queue.append(Finished(self.tree.clock.now(), time.time_ns(), self.tree.status))

    # what follows runs on the publisher's thread

    def drain(self) -> bool:
        """Take queued items in, for a turn; returns whether there are more."""
        queue = self._observer.queue
        dropped = self.groot2.dropped
        enough = time.monotonic() + _SECONDS_A_TURN
        for _ in range(len(queue)):
            item = queue.popleft()
            if isinstance(item, StampedTransition):
                self.groot2.add_transition(item)
                if self.groot1 is not None:
                    self.groot1.add_transition(item, time.monotonic())
            elif isinstance(item, BoardsChanged):
                self._observer.big_taken += 1
                self._boards = item.boards
            elif isinstance(item, SceneTaken):
                self._observer.big_taken += item.weight
            if self.scene is not None:
                self.scene.put(item)
            if time.monotonic() > enough:
                break
        if self.scene is not None:
            self.scene.flush()
        if self.groot2.dropped != dropped:
            statuses = statuses_of(self.tree)
            self.groot2.correct(statuses)
            if self.groot1 is not None:
                self.groot1.correct(statuses, time.time_ns(), time.monotonic())
        return bool(queue)

    def _answer_boards(self, names: list[str]) -> bytes:
        boards = self._boards
        if boards is None or time.monotonic_ns() - self._observer.ended_at > _FRESH_NS:
            boards = self._tracker.read_now()
        return encode_boards(self._tracker.for_groot(names, boards))
