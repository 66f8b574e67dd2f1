"""The publisher's thread: it owns the sockets, drains the queue, answers and sends.

Nothing here runs on the thread that ticks, but for making and closing a Publisher, and for giving it
another tree.
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
from btcore_monitor.serve.groot1 import Groot1Sockets
from btcore_monitor.serve.published_tree import PublishedTree
from btcore_monitor.serve.request_socket import RequestSocket
from btcore_monitor.serve.scene import SceneServer
from btcore_monitor.serve.tcp_ports import (
    GROOT1_ALONE,
    GROOT1_PORTS,
    PORTS,
    ServeError,
    Socket,
    bind_in_a_row,
)
from btcore_monitor.wire import scene_channel as wire
from btcore_monitor.wire.groot1 import BESIDE_GROOT2

_POLL_MS: Final = 10
_REQUEST_AT_MOST: Final = 1 << 20
_LIVE_AT_MOST: Final = 2_000
"""Messages that wait for one slow client; what it misses beyond, it asks for again."""

_log = logging.getLogger("monitor")


class Publisher(Closeable):
    """Publishes one tree until closed. Made by :func:`btcore_monitor.serve.serve`; a context manager."""

    def __init__(
        self,
        tree: Tree,
        port: int | None,
        bind: str,
        scene: bool,
        resources: Sequence[object],
        grace: float,
        groot1: int | None = None,
        control: float | None = None,
    ) -> None:
        if port and groot1 and -GROOT1_PORTS < groot1 - port < PORTS:
            raise ServeError(
                f"Groot 2 needs the ports {port} to {port + PORTS - 1} and Groot 1 needs {groot1} and "
                f"{groot1 + 1}, which meet: choose another for one, such as {BESIDE_GROOT2} for Groot 1"
            )
        self._grace = grace
        self._scene = scene
        self._control = control
        # The tree that ticks, and the one that the publisher's thread is at; it follows soon.
        self._latest = self._published = PublishedTree(
            tree, resources, scene, None if groot1 is None else 0, control
        )
        self._fresh: deque[PublishedTree] = deque()
        self._context: zmq.Context[Socket] = zmq.Context()
        self._requests = RequestSocket(self._context, _REQUEST_AT_MOST)
        self._notices = self._context.socket(zmq.PUB)
        self._stream = self._context.socket(zmq.XPUB)
        self._stream.setsockopt(zmq.MAXMSGSIZE, _REQUEST_AT_MOST)
        self._stream.setsockopt(zmq.SNDHWM, _LIVE_AT_MOST)
        for socket in (self._requests.socket, self._notices, self._stream):
            socket.setsockopt(zmq.LINGER, 0)
        for name, value in wire.KEEPALIVE.items():
            self._stream.setsockopt(getattr(zmq, name), value)
        self._groot1 = None if groot1 is None else Groot1Sockets(self._context)
        self.groot1: int | None = None
        """The port of Groot 1's updates, if it is spoken; its requests go one further."""
        try:
            self.port = self._bind(port, groot1, bind)
        except BaseException:
            for socket in (self._requests.socket, self._notices, self._stream):
                socket.close()
            if self._groot1 is not None:
                self._groot1.close()
            self._context.term()
            raise
        self.address = f"tcp://{_reachable(bind)}:{self.port}"
        """Where a client on this machine finds the tree."""
        self._change = threading.Condition()
        self._clients = 0
        self._finished = False
        self._stop = threading.Event()
        self._latest.subscribe()
        self._thread = threading.Thread(target=self._run, name="btcore-publisher", daemon=True)
        self._thread.start()

    def _bind(self, port: int | None, groot1: int | None, host: str) -> int:
        """Take the ports; returns the one that clients ask at: Groot 2's, or else Groot 1's."""
        stream = [self._stream] if self._scene else []
        asked = 0
        if port is not None:
            asked = bind_in_a_row([self._requests.socket, self._notices, *stream], host, port)
        if self._groot1 is not None and groot1 is not None:
            row: list[Socket | None] = [self._groot1.updates, self._groot1.requests.socket]
            count = GROOT1_PORTS
            if port is None:
                row += [None, *stream]
                count = GROOT1_ALONE
            self.groot1 = bind_in_a_row(row, host, groot1, count)
            asked = asked or self.groot1 + 1
        return asked

    @property
    def tree_id(self) -> str:
        """New for every tree that is served; clients tell by it that there is another one."""
        return self._latest.tree_id

    @property
    def clients(self) -> int:
        """Clients of the scene channel that are here now (Groot 2's protocol doesn't tell)."""
        return self._clients

    @property
    def dropped(self) -> int:
        """Transitions lost because the publisher could not follow the tree."""
        return self._published.groot2.dropped

    def wait_for_clients(self, count: int, timeout: float) -> bool:
        """Wait at most *timeout* s (wall clock) until *count* clients or more are here; 0: until none is."""
        with self._change:
            return self._change.wait_for(
                lambda: self._clients >= count if count else self._clients == 0, timeout
            )

    def replace(self, tree: Tree, resources: Sequence[object] = ()) -> None:
        """Serve *tree* from now on, on the thread that ticks it, and no more the one before.

        Ports and connections stay; clients first get what is queued of the tree before, then are told
        of the new one. *resources* are as for ``serve``.
        """
        if self._finished:
            return
        before = self._latest.groot1
        fresh = PublishedTree(
            tree, resources, self._scene, None if before is None else before.end, self._control
        )
        # In this order: when the publisher's thread finds the new one, the old one's queue is complete.
        self._latest.leave()
        fresh.subscribe()
        self._latest = fresh
        self._fresh.append(fresh)

    def finish(self) -> None:
        """Say that nothing follows, and go on answering; for when a recording is still being written."""
        if self._finished:
            return
        self._finished = True
        self._latest.finish()

    def close(self, grace: float | None = None) -> None:
        """Send what is queued, say goodbye, and stop.

        Clients that are still catching up get at most *grace* s of wall clock (default: as given
        to ``serve``) to do so.
        """
        if self._stop.is_set():
            return
        self.finish()
        try:
            if self._scene and self._thread.is_alive():
                self.wait_for_clients(0, self._grace if grace is None else grace)
        finally:
            self._stop.set()
            self._thread.join()

    # what follows runs on the publisher's thread

    def _run(self) -> None:
        poller = zmq.Poller()
        poller.register(self._requests.socket, zmq.POLLIN)
        if self._scene:
            poller.register(self._stream, zmq.POLLIN)
        if self._groot1 is not None:
            poller.register(self._groot1.requests.socket, zmq.POLLIN)
        next_sign = 0.0
        try:
            while not self._stop.is_set():
                busy = self._drain()
                self._tell_of_hooks()
                ready = dict(poller.poll(0 if busy else _POLL_MS))
                if self._requests.socket in ready:
                    self._answer()
                self._speak_groot1(ready)
                scene = self._published.scene
                if scene is None:
                    continue
                if self._stream in ready:
                    self._hear(scene)
                now = time.monotonic()
                if now >= next_sign:
                    next_sign = now + wire.ALIVE_EVERY
                    self._send(*scene.alive())
            while self._drain():
                pass
            self._speak_groot1({}, at_once=True)
        except Exception:
            _log.exception("the publisher stops; the tree goes on")
        finally:
            # nobody is left who could unlock a breakpoint
            self._published.remove_hooks()
            self._latest.remove_hooks()
            # the goodbye is in flight to clients that read; those that don't aren't waited for
            self._stream.close(linger=200)
            self._requests.socket.close(linger=200)
            self._notices.close(linger=0)
            if self._groot1 is not None:
                self._groot1.close(linger=200)
            self._context.term()
            with self._change:
                self._clients = 0
                self._change.notify_all()

    def _drain(self) -> bool:
        """Take queued items in, and send them; returns whether there are more."""
        followed = bool(self._fresh)
        more = self._published.drain()
        scene = self._published.scene
        if scene is not None:
            for topic, data in scene.pending_frames():
                self._send(topic, data)
        if followed and not more:
            self._follow(self._fresh.popleft())
            return True
        return more

    def _follow(self, fresh: PublishedTree) -> None:
        """Go over to the next tree, and tell everybody."""
        self._speak_groot1({}, at_once=True)
        before, self._published = self._published, fresh
        if before.scene is not None and fresh.scene is not None:
            fresh.scene.clients = before.scene.clients
            for topic, data in fresh.scene.introduction():
                self._send(topic, data)

    def _send(self, topic: bytes, data: bytes) -> None:
        self._stream.send_multipart([topic, data], zmq.DONTWAIT)

    def _answer(self) -> None:
        self._drain()  # all of it, unless the tree floods the queue
        frames = self._requests.take()
        if frames is not None:
            self._requests.answer(self._published.groot2.answer(frames))

    def _tell_of_hooks(self) -> None:
        control = self._published.groot2.control
        if control is not None:
            for frames in control.notices():
                self._notices.send_multipart(frames, zmq.DONTWAIT)

    def _speak_groot1(self, ready: Mapping[Socket, int], at_once: bool = False) -> None:
        sockets, server = self._groot1, self._published.groot1
        if sockets is None or server is None:
            return
        if sockets.requests.socket in ready:
            self._drain()
            server = self._published.groot1 or server
            sockets.answer(server)
        sockets.publish(server, time.monotonic(), at_once)

    def _hear(self, scene: SceneServer) -> None:
        with contextlib.suppress(zmq.Again):
            while True:
                for topic, data in scene.subscription(self._stream.recv(zmq.DONTWAIT)):
                    self._send(topic, data)
        if len(scene.clients) != self._clients:
            with self._change:
                self._clients = len(scene.clients)
                self._change.notify_all()


def _reachable(bind: str) -> str:
    return "127.0.0.1" if bind in ("*", "0.0.0.0") else bind
