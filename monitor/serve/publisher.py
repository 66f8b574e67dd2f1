"""The publisher's thread: it owns the sockets, drains the queue, answers and sends.

Nothing here runs on the thread that ticks, but for making and closing a Publisher.
"""

import logging
import threading
import time
import uuid
from collections.abc import Sequence
from types import TracebackType
from typing import Final, Self

import zmq

from btcore.tree import Tree
from btcore.xml.write import tree_to_xml
from monitor.serve.boards import BoardKeeper, Boards, portable_board
from monitor.serve.groot2 import Groot2Server, statuses_of
from monitor.serve.ports import Socket, bind_in_a_row
from monitor.serve.recorder import BoardsChanged, Changed, Finished, Recorder, SceneSource, SceneTaken
from monitor.serve.scene import SceneServer
from monitor.wire import scene as wire
from monitor.wire.values import encode_boards

_POLL_MS: Final = 10
_SECONDS_A_TURN: Final = 0.02
"""Time (wall clock) for queued items before the sockets have their turn."""

_FRESH_NS: Final = 1_000_000_000
"""Blackboards seen after a tick that ended longer ago (wall clock) are read again."""

_REQUEST_AT_MOST: Final = 1 << 20
_LIVE_AT_MOST: Final = 2_000
"""Messages that wait for one slow client; what it misses beyond, it asks for again."""

_log = logging.getLogger("monitor")


class Publisher:
    """Publishes one tree until closed. Made by :func:`monitor.serve.serve`; a context manager."""

    def __init__(
        self, tree: Tree, port: int, bind: str, scene: bool, resources: Sequence[object], grace: float
    ) -> None:
        self._tree = tree
        self._grace = grace
        sources = [one for one in resources if isinstance(one, SceneSource)] if scene else []
        self._keeper = BoardKeeper(tree)
        self._recorder = Recorder(self._keeper, sources)
        self._boards: Boards | None = None
        xml = tree_to_xml(tree).encode()
        identity = uuid.uuid4()
        self.tree_id = identity.hex
        """New for every publisher; clients tell a restart by it."""
        statuses = statuses_of(tree)
        self._groot2 = Groot2Server(tree, xml, self._answer_boards, identity)
        self._scene: SceneServer | None = None
        if scene:
            statics = [portable_board(one.scene_static()) for one in sources]
            self._scene = SceneServer(self.tree_id, xml, statics, statuses, tree.clock.now())
        self._context: zmq.Context[Socket] = zmq.Context()
        self._replies = self._context.socket(zmq.REP)
        self._notices = self._context.socket(zmq.PUB)
        self._stream = self._context.socket(zmq.XPUB)
        self._replies.setsockopt(zmq.MAXMSGSIZE, _REQUEST_AT_MOST)
        self._stream.setsockopt(zmq.MAXMSGSIZE, _REQUEST_AT_MOST)
        self._stream.setsockopt(zmq.SNDHWM, _LIVE_AT_MOST)
        for socket in (self._replies, self._notices, self._stream):
            socket.setsockopt(zmq.LINGER, 0)
        for name, value in wire.KEEPALIVE.items():
            self._stream.setsockopt(getattr(zmq, name), value)
        used = [self._replies, self._notices] + ([self._stream] if scene else [])
        try:
            self.port = bind_in_a_row(used, bind, port)
        except BaseException:
            for socket in (self._replies, self._notices, self._stream):
                socket.close()
            self._context.term()
            raise
        self.address = f"tcp://{_reachable(bind)}:{self.port}"
        """Where a client on this machine finds the tree."""
        self._change = threading.Condition()
        self._clients = 0
        self._finished = False
        self._stop = threading.Event()
        self._unsubscribe = tree.subscribe(self._recorder)
        now = time.time_ns()
        if sources:
            self._recorder.look(tree.clock.now(), now)
        self._thread = threading.Thread(target=self._run, name="btcore-publisher", daemon=True)
        self._thread.start()

    @property
    def clients(self) -> int:
        """Clients of the scene channel that are here now (Groot 2's protocol doesn't tell)."""
        return self._clients

    @property
    def dropped(self) -> int:
        """Transitions lost because the publisher could not follow the tree."""
        return self._groot2.dropped

    def wait_for_clients(self, count: int, timeout: float) -> bool:
        """Wait at most *timeout* s (wall clock) until *count* clients or more are here; 0: until none is."""
        with self._change:
            return self._change.wait_for(
                lambda: self._clients >= count if count else self._clients == 0, timeout
            )

    def finish(self) -> None:
        """Say that nothing follows, and go on answering; for when a recording is still being written."""
        if self._finished:
            return
        self._finished = True
        self._unsubscribe()
        self._recorder.queue.append(Finished(self._tree.clock.now(), time.time_ns(), self._tree.status))

    def close(self, grace: float | None = None) -> None:
        """Send what is queued, say goodbye, and stop.

        Clients that are still catching up get at most *grace* s of wall clock (default: as given
        to ``serve``) to do so.
        """
        if self._stop.is_set():
            return
        self.finish()
        try:
            if self._scene is not None and self._thread.is_alive():
                self.wait_for_clients(0, self._grace if grace is None else grace)
        finally:
            self._stop.set()
            self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    # what follows runs on the publisher's thread

    def _run(self) -> None:
        poller = zmq.Poller()
        poller.register(self._replies, zmq.POLLIN)
        if self._scene is not None:
            poller.register(self._stream, zmq.POLLIN)
        next_sign = 0.0
        try:
            while not self._stop.is_set():
                busy = self._drain()
                ready = dict(poller.poll(0 if busy else _POLL_MS))
                if self._replies in ready:
                    self._answer()
                if self._scene is None:
                    continue
                if self._stream in ready:
                    self._hear(self._scene)
                now = time.monotonic()
                if now >= next_sign:
                    next_sign = now + wire.ALIVE_EVERY
                    self._send(*self._scene.alive())
            while self._drain():
                pass
        except Exception:
            _log.exception("the publisher stops; the tree goes on")
        finally:
            # the goodbye is in flight to clients that read; those that don't aren't waited for
            self._stream.close(linger=200)
            self._replies.close(linger=200)
            self._notices.close(linger=0)
            self._context.term()
            with self._change:
                self._clients = 0
                self._change.notify_all()

    def _drain(self) -> bool:
        """Take queued items in; returns whether there are more."""
        queue = self._recorder.queue
        dropped = self.dropped
        enough = time.monotonic() + _SECONDS_A_TURN
        for _ in range(len(queue)):
            item = queue.popleft()
            if isinstance(item, Changed):
                self._groot2.heard(item)
            elif isinstance(item, BoardsChanged | SceneTaken):
                self._recorder.big_taken += 1
                if isinstance(item, BoardsChanged):
                    self._boards = item.boards
            if self._scene is not None:
                self._scene.put(item)
            if time.monotonic() > enough:
                break
        if self._scene is not None:
            self._scene.flush()
            for topic, data in self._scene.news():
                self._send(topic, data)
        if self.dropped != dropped:
            self._groot2.correct(statuses_of(self._tree))
        return bool(queue)

    def _send(self, topic: bytes, data: bytes) -> None:
        self._stream.send_multipart([topic, data], zmq.DONTWAIT)

    def _answer(self) -> None:
        self._drain()  # all of it, unless the tree floods the queue
        frames = self._replies.recv_multipart()
        self._replies.send_multipart(self._groot2.answer(frames))

    def _hear(self, scene: SceneServer) -> None:
        while self._stream.poll(0, zmq.POLLIN):
            for topic, data in scene.subscription(self._stream.recv()):
                self._send(topic, data)
        if len(scene.clients) != self._clients:
            with self._change:
                self._clients = len(scene.clients)
                self._change.notify_all()

    def _answer_boards(self, names: list[str]) -> bytes:
        boards = self._boards
        if boards is None or time.monotonic_ns() - self._recorder.ended_at > _FRESH_NS:
            boards = self._keeper.read_now()
        return encode_boards(self._keeper.for_groot(names, boards))


def _reachable(bind: str) -> str:
    return "127.0.0.1" if bind in ("*", "0.0.0.0") else bind
