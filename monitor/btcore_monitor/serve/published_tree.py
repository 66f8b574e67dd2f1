"""A published tree: its observer on the tick thread, and its servers on the publisher's thread."""

import contextlib
import time
import uuid
from collections.abc import Callable, Sequence
from typing import Final

from btcore.loading.tree_xml import tree_to_xml
from btcore.tree.tree import Tree
from btcore_monitor.serve.blackboards import BlackboardTracker
from btcore_monitor.serve.change_queue import ChangeQueue
from btcore_monitor.serve.groot1 import Groot1Server
from btcore_monitor.serve.groot2 import Groot2Server, read_statuses
from btcore_monitor.serve.hook_controller import HookController
from btcore_monitor.serve.publisher_sockets import PublisherSockets
from btcore_monitor.serve.queueing_observer import (
    BlackboardItem,
    EndItem,
    MovingSceneItem,
    QueueingObserver,
    TransitionItem,
    merge_scenes,
)
from btcore_monitor.serve.run_channel_server import RunChannelServer
from btcore_monitor.wire.msgpack_values import Boards, encode_boards
from btcore_monitor.wire.run_channel import ANNOUNCEMENT
from btcore_scene import SceneSource, StaticScene

_MAX_DRAIN_S: Final = 0.02
"""Maximum time (wall clock) for queued items before the publisher serves its sockets again."""

_MAX_BOARDS_AGE_NS: Final = 1_000_000_000
"""Maximum age (ns, wall clock) of the blackboards of the last tick; older blackboards are read again."""


class PublishedTree:
    """The observer and the servers of one tree, which gets a new ID on the wire.

    The tick thread calls the constructor, `subscribe`, `unsubscribe` and `end_stream`.

    Args:
        tree: The tree to publish.
        resources: Objects of the robot. Only scene sources among them are used.
        sockets: The sockets of the publisher, which determine the protocols that are served.
        max_heartbeat_delay: The maximum heartbeat delay of hooks in s, or None without hooks.
        previous: The tree that this tree replaces, or None.

    Attributes:
        tree: The tree.
        tree_id: Its ID on the wire.
        entry_changes: Changes of entries that clients request.
    """

    def __init__(
        self,
        tree: Tree,
        resources: Sequence[object],
        sockets: PublisherSockets,
        max_heartbeat_delay: float | None,
        previous: "PublishedTree | None" = None,
    ) -> None:
        self.tree = tree
        serves_run_channel = sockets.run_channel is not None
        tree_uuid = uuid.uuid4()
        self.tree_id = tree_uuid.hex
        self.entry_changes = ChangeQueue()
        self._scene_sources = (
            [source for source in resources if isinstance(source, SceneSource)] if serves_run_channel else []
        )
        self._blackboard_tracker = BlackboardTracker(tree)
        self._boards: Boards | None = None
        self._observer = QueueingObserver(self._blackboard_tracker, self._scene_sources)
        ending = ANNOUNCEMENT if serves_run_channel else b""
        xml = tree_to_xml(tree).encode()
        statuses = read_statuses(tree)
        hook_controller = None if max_heartbeat_delay is None else HookController(tree, max_heartbeat_delay)
        self.groot2_server = Groot2Server(
            tree, xml + ending, self._create_boards_reply, tree_uuid, hook_controller
        )
        self.groot1_server: Groot1Server | None = None
        if sockets.groot1 is not None:
            # Groot 1 notices a new tree by its uids, so they continue after those of the previous tree.
            before = None if previous is None else previous.groot1_server
            offset = 0 if before is None else before.end
            # With Groot 2, the run channel is next to Groot 2's ports, and only Groot 2's reply announces it.
            self.groot1_server = Groot1Server(tree, offset, ending=b"" if sockets.serves_groot2 else ending)
        self.run_channel_server: RunChannelServer | None = None
        if serves_run_channel:
            parts = [source.static_scene() for source in self._scene_sources]
            static = merge_scenes(StaticScene, parts) if parts else None
            self.run_channel_server = RunChannelServer(self.tree_id, xml, static, statuses, tree.clock.now())
        self._unsubscribe_observer: Callable[[], None] | None = None

    def subscribe(self) -> None:
        """Observe the tree from now on."""
        self._unsubscribe_observer = self.tree.subscribe(self._observer)
        observers = self.tree.context.observers
        assert observers is not None, "there is an observer"
        observers.before_tick = self.entry_changes.execute_all
        if self._scene_sources:
            self._observer.queue_scene(self.tree.clock.now(), time.time_ns())

    def unsubscribe(self) -> None:
        """Stop observing and controlling the tree."""
        self.remove_hooks()
        self.entry_changes.refuse("the run has ended, or has another tree")
        if self._unsubscribe_observer is not None:
            self._unsubscribe_observer()
            if self.tree.context.observers is not None:
                self.tree.context.observers.before_tick = None

    def remove_hooks(self) -> None:
        """Remove all hooks and reject later requests about hooks. Any thread may call this method."""
        if self.groot2_server.hook_controller is not None:
            self.groot2_server.hook_controller.close()

    def end_stream(self) -> None:
        """Stop observing the tree, and queue the end of the stream for clients."""
        self.unsubscribe()
        self._observer.queue.append(EndItem(self.tree.clock.now(), time.time_ns(), self.tree.status))

    # The following methods run on the publisher's thread.

    def drain(self) -> bool:
        """Process queued items for a limited time. Return whether there are more."""
        queue = self._observer.queue
        dropped_before = self.groot2_server.dropped_transitions
        deadline = time.monotonic() + _MAX_DRAIN_S
        # At most the items that are queued now: the tree may append items faster than this loop takes them.
        for _ in range(len(queue)):
            item = queue.popleft()
            if isinstance(item, TransitionItem):
                self.groot2_server.add_transition(item)
                if self.groot1_server is not None:
                    self.groot1_server.add_transition(item, time.monotonic())
            elif isinstance(item, BlackboardItem):
                self._observer.weight_taken += 1
                self._boards = item.boards
            elif isinstance(item, MovingSceneItem):
                self._observer.weight_taken += item.weight
            if self.run_channel_server is not None:
                self.run_channel_server.add_item(item)
            if time.monotonic() > deadline:
                break
        if self.run_channel_server is not None:
            self.run_channel_server.flush()
        if self.groot2_server.dropped_transitions != dropped_before:
            statuses = read_statuses(self.tree)
            self.groot2_server.correct_statuses(statuses)
            if self.groot1_server is not None:
                self.groot1_server.correct_statuses(statuses, time.time_ns(), time.monotonic())
        return bool(queue)

    def queue_boards_at_breakpoint(self) -> None:
        """Queue the blackboards of a tick that is stopped at a breakpoint."""
        # Another thread of the program may write to the blackboard: it is then queued after the tick.
        with contextlib.suppress(RuntimeError):
            self.tree.hooks.call_while_stopped(self._queue_boards)

    def change_entries_at_breakpoint(self) -> None:
        """Execute the changes of entries that wait, if a tick is stopped at a breakpoint."""
        if self.entry_changes.has_waiting and self.tree.hooks.call_while_stopped(
            self.entry_changes.execute_all
        ):
            self.queue_boards_at_breakpoint()

    def _queue_boards(self) -> None:
        self._observer.queue_boards(self.tree.clock.now(), time.time_ns())

    def _create_boards_reply(self, names: list[str]) -> bytes:
        boards = self._boards
        if boards is None or time.monotonic_ns() - self._observer.boards_checked_at > _MAX_BOARDS_AGE_NS:
            boards = self._blackboard_tracker.read_now()
        return encode_boards(self._blackboard_tracker.create_groot_reply(names, boards))
