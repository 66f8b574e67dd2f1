"""The publisher's thread: it owns the sockets, drains the queue, replies to requests and sends messages.

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
from btcore_monitor.keys import RobotKeys
from btcore_monitor.serve.gateway import Gateway
from btcore_monitor.serve.groot1 import Groot1Sockets
from btcore_monitor.serve.published_tree import PublishedTree
from btcore_monitor.serve.request_socket import RequestSocket
from btcore_monitor.serve.run_channel_server import RunChannelServer
from btcore_monitor.serve.tcp_ports import (
    GROOT1_ALONE_PORT_COUNT,
    GROOT1_PORT_COUNT,
    GROOT2_PORT_COUNT,
    ServeError,
    Socket,
    bind_consecutive,
)
from btcore_monitor.time_limits import INTERRUPTED_GRACE_S
from btcore_monitor.wire import run_channel
from btcore_monitor.wire.groot1 import PORT_BESIDE_GROOT2

_POLL_MS: Final = 10
_MAX_REQUEST_BYTES: Final = 1 << 20
_MAX_SUBSCRIPTION_BYTES: Final = 1 << 10
_MAX_UNSENT_MESSAGES: Final = 2_000
"""Maximum queued messages of a slow client; the client requests further messages again later."""

_ANNOUNCE_AFTER_S: Final = 2.0
"""Time (s, wall clock) of waiting after which a warning explains the wait."""

_log = logging.getLogger("monitor")


_ZAP_ENDPOINT: Final = "inproc://zeromq.zap.01"
_ZAP_VERSION: Final = b"1.0"
_ZAP_FRAMES: Final = 7


class Authenticator:
    """Checks the keys of clients: a handler of ZAP, the ZeroMQ Authentication Protocol (RFC 27).

    libzmq sends a request to `socket` for each connection to a socket with keys, and waits for the reply
    before the connection carries any message. Use it from one thread at a time.

    Args:
        context: The ZeroMQ context of the sockets with keys.
        keys: The keys of the robot.
    """

    def __init__(self, context: "zmq.Context[Socket]", keys: RobotKeys) -> None:
        self._allowed = keys.allowed
        self.socket: Socket = context.socket(zmq.REP)
        self.socket.setsockopt(zmq.LINGER, 0)
        self.socket.bind(_ZAP_ENDPOINT)

    def answer(self) -> None:
        """Reply to a waiting request: accept clients with an allowed public key, and refuse all others."""
        frames = self.socket.recv_multipart(zmq.DONTWAIT)
        # The version, the request's number, the domain, the client's address and identity, the mechanism, and
        # the public key. libzmq has verified that the client has the secret key.
        allowed = len(frames) == _ZAP_FRAMES and frames[5] == b"CURVE" and frames[6] in self._allowed
        status, text = (b"200", b"OK") if allowed else (b"400", b"unknown key")
        self.socket.send_multipart([_ZAP_VERSION, frames[1], status, text, b"", b""])


class Publisher(Closeable):
    """Publishes a tree until closed; a context manager. Created by `btcore_monitor.serve.serve`.

    Args:
        tree: The tree to publish.
        groot2_port: The port for Groot 2's requests; 0 = a free port, None = no support for Groot 2.
        bind: The interface (`*`: all interfaces).
        serves_run_channel: Whether to publish the run channel.
        resources: Objects of the robot; those with `static_scene` and `moving_scene` are shown in 3D.
        grace: Maximum time (s, wall clock) that closing waits for clients that have not received the end.
        groot1_port: The port for Groot 1's updates; 0 = a free port, None = no support for Groot 1.
        max_heartbeat_delay: The time (s) without requests after which hooks are disabled; None = clients
            cannot set hooks.
        keys: The keys for encrypted connections; None = not encrypted.
        watch_port: The first of further ports for clients without keys, see `serve`.
    """

    def __init__(
        self,
        tree: Tree,
        groot2_port: int | None,
        bind: str,
        serves_run_channel: bool,
        resources: Sequence[object],
        grace: float,
        groot1_port: int | None = None,
        max_heartbeat_delay: float | None = None,
        keys: RobotKeys | None = None,
        watch_port: int | None = None,
    ) -> None:
        if groot2_port and groot1_port and -GROOT1_PORT_COUNT < groot1_port - groot2_port < GROOT2_PORT_COUNT:
            raise ServeError(
                f"Groot 2 needs the ports {groot2_port} to {groot2_port + GROOT2_PORT_COUNT - 1} and Groot 1 "
                f"needs {groot1_port} and {groot1_port + 1}, which overlap: choose another port, such as "
                f"{PORT_BESIDE_GROOT2} for Groot 1"
            )
        self._grace = grace
        self._resources = resources
        self._serves_run_channel = serves_run_channel
        self._max_heartbeat_delay = max_heartbeat_delay
        self._serves_groot2 = groot2_port is not None
        # After `replace_tree`, the previous tree stays `_published_tree` until its queue is drained.
        self._ticking_tree = self._published_tree = PublishedTree(
            tree,
            resources,
            serves_run_channel,
            previous_uid=None if groot1_port is None else 0,
            max_heartbeat_delay=max_heartbeat_delay,
            serves_groot2=self._serves_groot2,
        )
        self._replacement_trees: deque[PublishedTree] = deque()
        self._context: zmq.Context[Socket] = zmq.Context()
        self._groot2_requests = RequestSocket(self._context, _MAX_REQUEST_BYTES)
        self._notifications_socket = self._context.socket(zmq.PUB)
        # Requests of clients without keys, if other clients have keys.
        self._watch_requests = RequestSocket(self._context, _MAX_REQUEST_BYTES)
        # An XPUB socket receives the subscriptions, which are the clients' requests.
        self._run_channel_socket = self._context.socket(zmq.XPUB)
        for socket in (self._notifications_socket, self._run_channel_socket):
            socket.setsockopt(zmq.MAXMSGSIZE, _MAX_SUBSCRIPTION_BYTES)
            # Otherwise closing would wait for clients that do not read.
            socket.setsockopt(zmq.LINGER, 0)
        self._run_channel_socket.setsockopt(zmq.SNDHWM, _MAX_UNSENT_MESSAGES)
        self._groot1_sockets = None if groot1_port is None else Groot1Sockets(self._context)
        host = "127.0.0.1" if bind in ("*", "0.0.0.0") else bind
        self.watch_address = ""
        """The address of the tree for a client on this machine that has no key; "" without *watch_port*."""
        self.groot1_port: int | None
        """The port of Groot 1's updates, or None; the next port answers its requests."""
        self.watch_groot1_port: int | None = None
        """The port of Groot 1's updates for clients without keys, or None."""
        self._authenticator: Authenticator | None = None
        try:
            self._gateway = Gateway()
        except OSError as error:
            raise ServeError(f"cannot create a folder for the monitor's sockets: {error}") from None
        try:
            if keys is not None:
                self._authenticator = Authenticator(self._context, keys)
                if watch_port is not None:
                    # In this order: a socket's keys apply to the ports to which it is bound afterwards.
                    requests_port, self.watch_groot1_port = self._bind_watch_ports(
                        groot2_port, groot1_port, watch_port, bind
                    )
                    self.watch_address = f"tcp://{host}:{requests_port}"
                for socket in self._list_sockets():
                    keys.secure(socket)
            self.port, self.groot1_port = self._bind(self._groot2_requests, groot2_port, groot1_port, bind)
            self._gateway.start()
        except BaseException:
            self._context.destroy(linger=0)
            self._gateway.close()
            raise
        self.address = f"tcp://{host}:{self.port}"
        """The address of the tree for a client on this machine."""
        self._clients_changed = threading.Condition()
        self._client_count = 0
        self._has_ended = False
        self._stopping = threading.Event()
        self._ticking_tree.subscribe()
        self._thread = threading.Thread(target=self._run, name="btcore-publisher", daemon=True)
        self._thread.start()

    def _list_sockets(self) -> list[Socket]:
        """Return the sockets to which clients with keys connect, if there are keys."""
        groot1_sockets = self._groot1_sockets
        return [
            self._groot2_requests.socket,
            self._notifications_socket,
            self._run_channel_socket,
            *([] if groot1_sockets is None else [groot1_sockets.updates, groot1_sockets.requests.socket]),
        ]

    def _bind(
        self,
        groot2_requests: RequestSocket,
        groot2_port: int | None,
        groot1_port: int | None,
        host: str,
        option: str = "--port",
    ) -> tuple[int, int | None]:
        """Bind the ports. Return those of requests (of Groot 2, or else 1) and of Groot 1's updates."""
        stream = [self._run_channel_socket] if self._serves_run_channel else []
        requests_port, updates_port = 0, None
        row: list[Socket | None]
        if groot2_port is not None:
            row = [groot2_requests.socket, self._notifications_socket, *stream]
            requests_port = bind_consecutive(self._gateway, row, host, groot2_port, option=option)
        if self._groot1_sockets is not None and groot1_port is not None:
            row = [self._groot1_sockets.updates, self._groot1_sockets.requests.socket]
            count = GROOT1_PORT_COUNT
            if groot2_port is None:
                row += [None, *stream]
                count = GROOT1_ALONE_PORT_COUNT
            updates_port = bind_consecutive(self._gateway, row, host, groot1_port, count, option)
            requests_port = requests_port or updates_port + 1
        return requests_port, updates_port

    def _bind_watch_ports(
        self, groot2_port: int | None, groot1_port: int | None, first: int, host: str
    ) -> tuple[int, int | None]:
        """Bind the ports for clients without keys, and return them as `_bind` does.

        If Groot 1 and Groot 2 are served, the distance of their ports is the same with and without keys.
        """
        watch_groot2_port = None if groot2_port is None else first
        watch_groot1_port = None if groot1_port is None else first
        if groot1_port is not None and groot2_port is not None:
            watch_groot1_port = first and groot2_port and groot1_port and first + groot1_port - groot2_port
        return self._bind(self._watch_requests, watch_groot2_port, watch_groot1_port, host, "--watch-port")

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

    def replace_tree(self, tree: Tree, resources: Sequence[object] | None = None) -> None:
        """Publish *tree* instead of the previous tree. Only the tick thread may call this method.

        Ports and connections stay. Clients first get the queued messages of the previous tree, then the new
        tree.

        Args:
            tree: The new tree.
            resources: Objects of the robot, as for `serve`; by default those of the previous tree.
        """
        if self._has_ended:
            return
        if resources is not None:
            self._resources = resources
        # Groot 1 notices the new tree by its uids, so they continue after the previous tree.
        groot1_server = self._ticking_tree.groot1_server
        new_tree = PublishedTree(
            tree,
            self._resources,
            self._serves_run_channel,
            previous_uid=None if groot1_server is None else groot1_server.end,
            max_heartbeat_delay=self._max_heartbeat_delay,
            serves_groot2=self._serves_groot2,
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
            if self._serves_run_channel and self._thread.is_alive():
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
        poller = zmq.Poller()
        for requests in (self._groot2_requests, self._watch_requests):
            poller.register(requests.socket, zmq.POLLIN)
        if self._authenticator is not None:
            poller.register(self._authenticator.socket, zmq.POLLIN)
        if self._serves_run_channel:
            poller.register(self._run_channel_socket, zmq.POLLIN)
        if self._groot1_sockets is not None:
            poller.register(self._groot1_sockets.requests.socket, zmq.POLLIN)
        next_heartbeat = 0.0
        try:
            while not self._stopping.is_set():
                has_more = self._drain()
                self._send_notifications()
                ready = dict(poller.poll(0 if has_more else _POLL_MS))
                if self._authenticator is not None and self._authenticator.socket in ready:
                    self._authenticator.answer()
                if self._groot2_requests.socket in ready:
                    self._answer(self._groot2_requests)
                if self._watch_requests.socket in ready:
                    self._answer(self._watch_requests, may_control=False)
                self._serve_groot1(ready)
                server = self._published_tree.run_channel_server
                if server is not None and self._run_channel_socket in ready:
                    self._read_subscriptions(server)
                now = time.monotonic()
                if now >= next_heartbeat:
                    next_heartbeat = now + run_channel.HEARTBEAT_INTERVAL_S
                    self._gateway.restart_if_ended()
                    if server is not None:
                        self._send(*server.create_heartbeat())
            while self._drain():
                pass
            self._serve_groot1({}, at_once=True)
        except Exception:
            _log.exception("the publisher stops; the tree goes on")
        finally:
            # No client can release a breakpoint any more.
            self._published_tree.remove_hooks()
            self._ticking_tree.remove_hooks()
            # 200 ms for the last message to clients that read; closing does not wait for other clients.
            self._run_channel_socket.close(linger=200)
            self._groot2_requests.socket.close(linger=200)
            self._watch_requests.socket.close(linger=200)
            self._notifications_socket.close(linger=0)
            if self._groot1_sockets is not None:
                self._groot1_sockets.close(linger=200)
            if self._authenticator is not None:
                self._authenticator.socket.close(linger=0)
            self._context.term()
            self._gateway.close()
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
        self._run_channel_socket.send_multipart([topic, data], zmq.DONTWAIT)

    def _answer(self, requests: RequestSocket, may_control: bool = True) -> None:
        self._drain()  # so that the reply is up to date, unless the tree floods the queue
        frames = requests.receive()
        if frames is not None:
            client = requests.client if may_control else None
            requests.answer(self._published_tree.groot2_server.answer(frames, client))

    def _send_notifications(self) -> None:
        hook_controller = self._published_tree.groot2_server.hook_controller
        if hook_controller is not None:
            for frames in hook_controller.take_notifications():
                self._notifications_socket.send_multipart(frames, zmq.DONTWAIT)

    def _serve_groot1(self, ready: Mapping[Socket, int], at_once: bool = False) -> None:
        sockets, server = self._groot1_sockets, self._published_tree.groot1_server
        if sockets is None or server is None:
            return
        if sockets.requests.socket in ready:
            self._drain()
            server = self._published_tree.groot1_server or server
            sockets.answer(server)
        sockets.publish(server, time.monotonic(), at_once)

    def _read_subscriptions(self, server: RunChannelServer) -> None:
        # All subscriptions that wait; zmq.Again ends the loop.
        with contextlib.suppress(zmq.Again):
            while True:
                for topic, data in server.process_subscription(self._run_channel_socket.recv(zmq.DONTWAIT)):
                    self._send(topic, data)
        if len(server.client_tokens) != self._client_count:
            with self._clients_changed:
                self._client_count = len(server.client_tokens)
                self._clients_changed.notify_all()
