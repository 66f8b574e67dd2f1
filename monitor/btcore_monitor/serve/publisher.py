"""The publisher's thread: it drains the queue, replies to requests and sends messages.

Only creating and closing a Publisher, and replacing its tree, run on the tick thread. ZeroMQ sockets are not
thread-safe, so after their creation only the publisher's thread uses them.
"""

import contextlib
import logging
import threading
import time
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Final

import zmq

from btcore.tree.tree import Tree
from btcore_monitor.closeable import Closeable
from btcore_monitor.serve.change_server import ChangeServer
from btcore_monitor.serve.published_tree import PublishedTree
from btcore_monitor.serve.publisher_sockets import PublisherSockets
from btcore_monitor.serve.request_socket import RequestSocket
from btcore_monitor.serve.run_channel_server import RunChannelServer
from btcore_monitor.serve.tcp_ports import Socket
from btcore_monitor.time_limits import INTERRUPTED_GRACE_S
from btcore_monitor.wire import run_channel

_POLL_MS: Final = 10

_ANNOUNCE_AFTER_S: Final = 2.0
"""Time (s, wall clock) of waiting after which a warning explains the wait."""

_log = logging.getLogger("monitor")


class Publisher(Closeable):
    """Publishes a tree until closed; a context manager. Created by `btcore_monitor.serve.serve`.

    Args:
        tree: The tree to publish.
        sockets: The bound sockets, which the publisher closes.
        resources: Objects of the robot; those with `static_scene` and `moving_scene` are shown in 3D.
        grace: Maximum time (s, wall clock) that closing waits for clients that have not received the end.
        max_heartbeat_delay: The time (s) without requests after which hooks are disabled; None = clients
            cannot set hooks.
        allow_changes: Whether clients may set entries of blackboards, and reload the tree.

    Attributes:
        port: The port of Groot 2's requests, or of Groot 1's if Groot 2 is not served.
        address: The address of the tree for a client on this machine.
        groot1_port: The port of Groot 1's updates, or None; the next port answers its requests.
        watch_address: The address of the tree for a client on this machine that has no key, or "".
        watch_groot1_port: The port of Groot 1's updates for clients without keys, or None.
        reload_requests: Trees that clients send to replace the tree, or None if they may not.
    """

    def __init__(
        self,
        tree: Tree,
        sockets: PublisherSockets,
        resources: Sequence[object],
        grace: float,
        max_heartbeat_delay: float | None = None,
        allow_changes: bool = False,
    ) -> None:
        self._sockets = sockets
        self.port = sockets.port
        self.address = sockets.address
        self.groot1_port = sockets.groot1_port
        self.watch_address = sockets.watch_address
        self.watch_groot1_port = sockets.watch_groot1_port
        self._grace = grace
        self._resources = resources
        self._max_heartbeat_delay = max_heartbeat_delay
        self._change_server = ChangeServer(allow_changes, max_heartbeat_delay is not None)
        self.reload_requests = self._change_server.reloads if allow_changes else None
        # After `replace_tree`, the previous tree stays `_published_tree` until its queue is drained.
        self._ticking_tree = self._published_tree = PublishedTree(
            tree, resources, sockets, max_heartbeat_delay
        )
        self._replacement_trees: deque[PublishedTree] = deque()
        self._clients_changed = threading.Condition()
        self._client_count = 0
        self._has_ended = False
        self._stopping = threading.Event()
        self._ticking_tree.subscribe()
        self._thread = threading.Thread(target=self._run, name="btcore-publisher", daemon=True)
        self._thread.start()

    @property
    def tree_id(self) -> str:
        """The ID of the current tree. Each published tree has a new ID, so clients notice a replaced tree."""
        return self._ticking_tree.tree_id

    @property
    def client_count(self) -> int:
        """The number of connected clients of the run channel. Groot 2's clients are not visible."""
        return self._client_count

    @property
    def dropped_transitions(self) -> int:
        """The number of transitions that were lost because the publisher was too slow."""
        return self._published_tree.groot2_server.dropped_transitions

    def wait_for_clients(self, count: int, timeout: float) -> bool:
        """Wait until clients are connected. Return whether that happened in time.

        Args:
            count: The minimum number of clients.
            timeout: Maximum time in s (wall clock).
        """
        with self._clients_changed:
            return self._clients_changed.wait_for(lambda: self._client_count >= count, timeout)

    def wait_for_no_clients(self, timeout: float) -> bool:
        """Wait until no client is connected. Return whether that happened within *timeout* s."""
        with self._clients_changed:
            return self._clients_changed.wait_for(lambda: self._client_count == 0, timeout)

    def replace_tree(self, tree: Tree) -> None:
        """Publish *tree* instead of the previous tree. Only the tick thread may call this method.

        Ports and connections stay. Clients first get the queued messages of the previous tree, then the new
        tree.
        """
        if self._has_ended:
            return
        new_tree = PublishedTree(
            tree, self._resources, self._sockets, self._max_heartbeat_delay, self._ticking_tree
        )
        # In this order: when the publisher's thread finds the new tree, the old tree's queue is complete.
        self._ticking_tree.unsubscribe()
        new_tree.subscribe()
        self._ticking_tree = new_tree
        self._replacement_trees.append(new_tree)

    def end_stream(self) -> None:
        """End the stream, but continue to reply to requests, for example while a recording is written."""
        if self._has_ended:
            return
        self._has_ended = True
        self._ticking_tree.end_stream()

    def close(self, grace: float | None = None) -> None:
        """Send all queued messages and the end of the stream, then stop.

        *grace* is the maximum time in s (wall clock) for clients that have not received the end of the run
        yet (default: as given to `serve`).
        """
        if self._stopping.is_set():
            return
        self.end_stream()
        try:
            if self._sockets.run_channel is not None and self._thread.is_alive():
                self._wait_for_readers(self._grace if grace is None else grace)
        finally:
            self._stopping.set()
            self._thread.join()

    def __exit__(self, *error: object) -> None:
        self.close(min(self._grace, INTERRUPTED_GRACE_S) if any(error) else None)

    def _wait_for_readers(self, grace: float) -> None:
        """Wait until all clients have received the end, or disconnected, for at most *grace* s."""
        if grace > _ANNOUNCE_AFTER_S and not self.wait_for_no_clients(_ANNOUNCE_AFTER_S):
            grace -= _ANNOUNCE_AFTER_S
            _log.warning(
                "waiting up to %g s until %d clients have received the end of the run; Ctrl-C ends the wait",
                grace,
                self._client_count,
            )
        self.wait_for_no_clients(grace)

    # The following methods run on the publisher's thread.

    def _run(self) -> None:
        sockets = self._sockets
        poller = zmq.Poller()
        for socket in sockets.readable():
            poller.register(socket, zmq.POLLIN)
        next_heartbeat = 0.0
        try:
            while not self._stopping.is_set():
                has_more = self._drain()
                self._send_notifications()
                self._published_tree.change_entries_at_breakpoint()
                self._change_server.send_replies(self._published_tree.entry_changes)
                ready = dict(poller.poll(0 if has_more else _POLL_MS))
                if sockets.authenticator is not None and sockets.authenticator.socket in ready:
                    sockets.authenticator.answer()
                if sockets.groot2_requests.socket in ready:
                    self._answer(sockets.groot2_requests)
                if sockets.watch_requests.socket in ready:
                    self._answer(sockets.watch_requests, may_control=False)
                self._serve_groot1(ready)
                server = self._published_tree.run_channel_server
                if server is not None and sockets.run_channel in ready:
                    self._read_subscriptions(server)
                now = time.monotonic()
                if now >= next_heartbeat:
                    next_heartbeat = now + run_channel.HEARTBEAT_INTERVAL_S
                    sockets.gateway.restart_if_ended()
                    if server is not None:
                        self._send(*server.create_heartbeat())
            while self._drain():
                pass
            self._serve_groot1({}, at_once=True)
            self._change_server.close()
            self._change_server.send_replies(self._published_tree.entry_changes)
        except Exception:
            _log.exception("the publisher stops; the tree goes on")
        finally:
            # No client can release a breakpoint any more.
            self._published_tree.remove_hooks()
            self._ticking_tree.remove_hooks()
            sockets.close()
            with self._clients_changed:
                self._client_count = 0
                self._clients_changed.notify_all()

    def _drain(self) -> bool:
        """Process queued items and send them. Return whether there are more."""
        # Before draining: if a new tree is here already, the old tree's queue gets no more items.
        is_replaced = bool(self._replacement_trees)
        has_more = self._published_tree.drain()
        server = self._published_tree.run_channel_server
        if server is not None:
            for topic, data in server.take_pending_frames():
                self._send(topic, data)
        if is_replaced and not has_more:
            self._switch_to(self._replacement_trees.popleft())
            return True
        return has_more

    def _switch_to(self, new_tree: PublishedTree) -> None:
        """Publish *new_tree* from now on, and send it to all clients."""
        self._serve_groot1({}, at_once=True)
        before, self._published_tree = self._published_tree, new_tree
        if before.run_channel_server is not None and new_tree.run_channel_server is not None:
            new_tree.run_channel_server.client_tokens = before.run_channel_server.client_tokens
            for topic, data in new_tree.run_channel_server.create_tree_frames():
                self._send(topic, data)

    def _send(self, topic: bytes, data: bytes) -> None:
        if self._sockets.run_channel is not None:
            self._sockets.run_channel.send_multipart([topic, data], zmq.DONTWAIT)

    def _answer(self, requests: RequestSocket, may_control: bool = True) -> None:
        self._drain()  # so that the reply is up to date, unless the tree floods the queue
        frames, published = requests.receive(), self._published_tree
        if frames is None or self._change_server.receive(requests, frames, published, may_control):
            return
        client = requests.client if may_control else None
        requests.answer(published.groot2_server.answer(frames, client))

    def _send_notifications(self) -> None:
        hook_controller = self._published_tree.groot2_server.hook_controller
        if hook_controller is not None:
            notifications = hook_controller.take_notifications()
            for frames in notifications:
                self._sockets.notifications.send_multipart(frames, zmq.DONTWAIT)
            if notifications and self._published_tree.run_channel_server is not None:
                self._published_tree.queue_boards_at_breakpoint()

    def _serve_groot1(self, ready: Mapping[Socket, int], at_once: bool = False) -> None:
        sockets, server = self._sockets.groot1, self._published_tree.groot1_server
        if sockets is None or server is None:
            return
        if sockets.requests.socket in ready:
            self._drain()
            server = self._published_tree.groot1_server or server
            sockets.answer(server)
        sockets.publish(server, time.monotonic(), at_once)

    def _read_subscriptions(self, server: RunChannelServer) -> None:
        channel = self._sockets.run_channel
        # All subscriptions that wait; zmq.Again ends the loop.
        with contextlib.suppress(zmq.Again):
            while channel is not None:
                for topic, data in server.process_subscription(channel.recv(zmq.DONTWAIT)):
                    self._send(topic, data)
        if len(server.client_tokens) != self._client_count:
            with self._clients_changed:
                self._client_count = len(server.client_tokens)
                self._clients_changed.notify_all()
