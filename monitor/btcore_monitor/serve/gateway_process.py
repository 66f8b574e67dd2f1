"""Accept the clients' connections and forward their bytes to the publisher's sockets, within limits.

libzmq has no limit for the frames of an unfinished message, the topics of a subscriber, or connections, so a
stranger could fill the memory of the robot's process. This module therefore runs between the clients and
libzmq, in a process of its own: checking hostile bytes neither takes the interpreter's lock of the robot nor
its priority. Bytes are forwarded unchanged. A client that exceeds a limit is disconnected before libzmq
receives the frame.

The process imports only the standard library, so that it starts fast (`python -I -S`).
It ends when the robot's process writes to the socket at its standard input, or ends.
"""

import contextlib
import errno
import json
import os
import selectors
import socket
import sys
import time
from collections import deque

MAX_CONNECTIONS = 32
"""Maximum connections per port. Further clients wait until a connection ends."""

MAX_CONNECTIONS_PER_SECOND = 50
"""Maximum new connections per second and port, after the first MAX_CONNECTIONS."""

MAX_FRAMES_PER_MESSAGE = 16
"""Maximum frames of a message: an envelope with an empty delimiter frame, and a request of two frames."""

MAX_TOPICS = 32
"""Maximum simultaneous subscriptions of a connection."""

MAX_TOPIC_BYTES = 200
"""Maximum bytes of a topic."""

MAX_ENCRYPTED_TOPICS_BYTES = 32 << 10
"""Maximum bytes that a subscriber may send if the connection is encrypted, so that topics can't be counted.
The client then connects again and continues."""

MAX_COMMAND_BYTES = 1024
"""Maximum bytes of a command, for instance of the handshake."""

MAX_FRAMES_AHEAD = 8
"""Frames that a client may send before it receives any bytes, where the publisher replies. Further frames
wait, so the replies to a client that does not read can't fill the memory. A request has 2 or 3 frames."""

MAX_FRAMES_AHEAD_WITHOUT_REPLY = 2 * MAX_TOPICS
"""The same, where subscriptions get no reply."""

MAX_HELD_BYTES = 40 << 20
"""Maximum bytes that wait in this process for slow clients, in all. If there are more, the client with the
most waiting bytes is disconnected. A message of the run channel has at most 32 MB."""

MAX_PIECES_AT_ONCE = 4
"""Maximum requests of the run channel at a port that wait for a reply, at most 1 per connection: a topic of
few bytes requests a reply of 1 MB or more. Further requests wait."""

PIECE_TIMEOUT_S = 1.0
"""Seconds after which a request of the run channel no longer counts: not every request has a reply."""

CLIENT_TIMEOUT_S = 10.0
"""Seconds after which a client that does not read, or that waits for no reply, is disconnected."""

GREETING_TIMEOUT_S = 5.0
"""Maximum seconds until the first bytes of a connection. libzmq limits the rest of the handshake."""

FLUSH_TIMEOUT_S = 5.0
"""Maximum seconds for bytes that wait at the end. Clients that read need so long on a busy machine only."""

KEEPALIVE = (("TCP_KEEPIDLE", 10), ("TCP_KEEPINTVL", 5), ("TCP_KEEPCNT", 3))
"""A connection to a vanished machine ends after 10 + 3 * 5 = 25 s."""

_READ = 64 << 10
_SWEEP_INTERVAL_S = 0.5
_PRIORITY = 5  # "nice" steps below the robot's process
_MORE, _LONG, _COMMAND = 1, 2, 4  # bits of a frame's first byte
_SIGNATURE_SIZE, _GREETING_SIZE_2, _GREETING_SIZE_3 = 10, 12, 64
_WITHOUT_ENCRYPTION = b"NULL".ljust(20, b"\0")
_REQUEST_TOPIC = b"request/"  # requests of the run channel: REQUEST_TOPIC of wire/run_channel.py
_SUBSCRIBE, _CANCEL = b"SUBSCRIBE", b"CANCEL"
_COMMANDS = (b"READY", b"ERROR", b"PING", b"PONG")


class ClientStream:
    """Checks the bytes that a client sends: ZMTP 2.0, 3.0 or 3.1, encrypted or not.

    The frames of an encrypted connection are counted but can't be read. They are limited by their size and,
    at a port for topics, by the bytes in all.

    Args:
        takes_topics: Whether the port takes subscriptions; otherwise it takes requests.
        size: Maximum bytes of a request.
    """

    def __init__(self, takes_topics: bool, size: int) -> None:
        self.is_zmtp = False
        """Whether the first bytes are those of ZMTP."""
        self.frames = 0
        """The number of complete frames so far."""
        self.topics: set[bytes] = set()
        self.request = b""
        """The topic at the end of the bytes that were checked last, if it requests a reply."""
        self._takes_topics = takes_topics
        self._size = size
        self._head = bytearray()  # the greeting, then the beginning of each frame
        self._greeting_size = 0  # 0: unknown yet
        self._is_in_greeting = True
        self._has_identity = False  # in ZMTP 2.0, the first frame is the client's identity
        self._is_encrypted = False
        self._flags = 0
        self._left = 0  # bytes of the current frame's body
        self._body: bytearray | None = None
        self._total = 0
        self._message_frames = self._message_size = 0

    def check(self, data: bytes, frames: int) -> int:
        """Check *data* up to the end of the *frames*-th frame, or of a topic that requests a reply.

        Returns:
            The number of checked bytes.

        Raises:
            ConnectionAbortedError: The bytes must not be forwarded.
        """
        at, end, last = 0, len(data), self.frames + frames
        self.request = b""
        while at < end and self.frames < last and not self.request:
            if self._left:
                step = min(self._left, end - at)
                if self._body is not None:
                    self._body += data[at : at + step]
                at += step
                self._left -= step
                if not self._left:
                    self._end_frame()
                continue
            self._head.append(data[at])
            at += 1
            if self._is_in_greeting:
                self._check_greeting()
            elif len(self._head) == (9 if self._head[0] & _LONG else 2):
                self._begin_frame()
        return at

    def _check_greeting(self) -> None:
        head = self._head
        if head[0] != 0xFF:
            raise ConnectionAbortedError("not ZMTP 2 or 3")
        self.is_zmtp = True
        if len(head) == _SIGNATURE_SIZE and not head[9] & 1:
            raise ConnectionAbortedError("not ZMTP 2 or 3")
        if len(head) == _SIGNATURE_SIZE + 1:
            # The revision: 1 is ZMTP 2.0, 3 is ZMTP 3.
            if head[10] != 1 and head[10] < 3:
                raise ConnectionAbortedError("not ZMTP 2 or 3")
            self._has_identity = head[10] == 1
            self._greeting_size = _GREETING_SIZE_2 if self._has_identity else _GREETING_SIZE_3
        if len(head) == self._greeting_size:
            mechanism = bytes(head[12:32])
            self._is_encrypted = not self._has_identity and mechanism != _WITHOUT_ENCRYPTION
            self._is_in_greeting = False
            self._head = bytearray()

    def _begin_frame(self) -> None:
        flags, size = self._head[0], int.from_bytes(self._head[1:], "big")
        self._head = bytearray()
        self._flags = flags
        if flags & ~(_MORE | _LONG | _COMMAND) or (flags & _COMMAND and flags & _MORE):
            raise ConnectionAbortedError("not a frame of ZMTP")
        self._check_limit(flags, size)
        self._left = size
        # Bodies of requests are not read.
        is_read = not self._is_encrypted and (flags & _COMMAND or self._takes_topics)
        self._body = bytearray() if is_read else None
        if not size:
            self._end_frame()

    def _check_limit(self, flags: int, size: int) -> None:
        if self._takes_topics:
            most = MAX_COMMAND_BYTES if self._is_encrypted or flags & _COMMAND else MAX_TOPIC_BYTES + 1
            if self._has_identity:
                most = 255
            if self._is_encrypted:
                self._total += size
                if self._total > MAX_ENCRYPTED_TOPICS_BYTES:
                    raise ConnectionAbortedError("too many subscriptions")
        elif flags & _COMMAND:
            most = MAX_COMMAND_BYTES
        else:
            self._message_frames += 1
            self._message_size += size
            if self._message_frames > MAX_FRAMES_PER_MESSAGE:
                raise ConnectionAbortedError("too many frames")
            size, most = self._message_size, self._size
            if not flags & _MORE:
                self._message_frames = self._message_size = 0
        if size > most:
            raise ConnectionAbortedError("too many bytes")

    def _end_frame(self) -> None:
        self.frames += 1
        body, self._body = self._body, None
        if self._has_identity:
            self._has_identity = False
        elif body is None:
            pass
        elif self._flags & _COMMAND:
            self._process_command(bytes(body))
        elif self._flags & _MORE or not body or body[0] > 1:
            raise ConnectionAbortedError("not a subscription")
        else:
            self._process_subscription(body[0] == 1, bytes(body[1:]))

    def _process_command(self, body: bytes) -> None:
        # A command begins with its name, and the length of the name.
        name, rest = body[1 : 1 + body[0]] if body else b"", body[1 + body[0] :] if body else b""
        if self._takes_topics and name in (_SUBSCRIBE, _CANCEL):
            self._process_subscription(name == _SUBSCRIBE, rest)
        elif name not in _COMMANDS:
            raise ConnectionAbortedError("unknown command")

    def _process_subscription(self, subscribes: bool, topic: bytes) -> None:
        if not subscribes:
            self.topics.discard(topic)
            return
        self.topics.add(topic)
        if len(topic) > MAX_TOPIC_BYTES or len(self.topics) > MAX_TOPICS:
            raise ConnectionAbortedError("too many subscriptions")
        if topic.startswith(_REQUEST_TOPIC):
            self.request = topic


class Port:
    """A port at which clients connect, and the publisher's socket to which their bytes are forwarded.

    Args:
        listener: The listening socket.
        path: The path of the publisher's socket.
        takes_topics: Whether the publisher's socket takes subscriptions; otherwise it takes requests.
        replies: Whether the publisher replies to what clients send.
        size: Maximum bytes of a request.
    """

    def __init__(
        self, listener: socket.socket, path: str, takes_topics: bool, replies: bool, size: int
    ) -> None:
        self.listener = listener
        self.path = path
        self.takes_topics = takes_topics
        self.size = size
        self.frames_ahead = MAX_FRAMES_AHEAD if replies else MAX_FRAMES_AHEAD_WITHOUT_REPLY
        # A request of the maximum size and its envelope, or the maximum topics.
        self.bytes_ahead = max(size, 2 * MAX_TOPICS * MAX_TOPIC_BYTES) + _READ
        self.connections = 0
        self.is_listening = False
        self.requesting: dict[Connection, float] = {}
        """Connections that wait for a reply to a request of the run channel, and since when."""
        self.waiting: deque[Connection] = deque()
        """Connections with a further request."""
        self._permits = float(MAX_CONNECTIONS)
        self._permits_at = time.monotonic()

    def may_accept(self, now: float) -> bool:
        """Return whether a new connection is within the limits at *now*."""
        self._permits += (now - self._permits_at) * MAX_CONNECTIONS_PER_SECOND
        self._permits = min(self._permits, MAX_CONNECTIONS)
        self._permits_at = now
        return self._permits >= 1 and self.connections < MAX_CONNECTIONS

    def accept(self) -> socket.socket | None:
        """Accept a connection, if there is any."""
        try:
            client, _ = self.listener.accept()
        except OSError:
            # Also if there are too many open files. A permit is used, so this is not tried all the time.
            self._permits -= 1
            return None
        self._permits -= 1
        client.setblocking(False)
        with contextlib.suppress(OSError):
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            client.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            for name, value in KEEPALIVE:
                if hasattr(socket, name):
                    client.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)
        return client


class Connection:
    """A client's connection, and the connection to the publisher's socket (*server*) behind it."""

    def __init__(self, forwarder: "Forwarder", port: Port, client: socket.socket, now: float) -> None:
        self.port = port
        self.client = client
        self.server: socket.socket | None = None
        self.is_closed = False
        self._forwarder = forwarder
        self._stream = ClientStream(port.takes_topics, port.size)
        self._unchecked = b""  # bytes of the client
        self._to_server = b""
        self._to_client: deque[bytes] = deque()
        self.held = 0
        """The number of bytes that wait for the client."""
        self._frames_ahead, self._bytes_ahead = port.frames_ahead, port.bytes_ahead
        self._is_in_queue = False  # whether `_to_server` ends with a request that waits
        self._request = b""  # the topic of the request until the reply begins
        self._received = b""  # the last bytes before the reply begins
        self._has_server_ended = False
        self._waits_since: float | None = None
        self._opened = now

    def serve(self, ready: socket.socket, events: int, now: float) -> None:
        """Move bytes after *events* of the socket *ready*."""
        try:
            if ready is self.client:
                if events & selectors.EVENT_WRITE:
                    self._send_to_client()
                if events & selectors.EVENT_READ:
                    self._receive_from_client()
            else:
                if events & selectors.EVENT_WRITE:
                    self._send_to_server()
                if events & selectors.EVENT_READ:
                    self._receive_from_server()
            self._forward()
        except OSError:
            self.close()
            return
        if self._has_server_ended and not self.held:
            self.close()
            return
        self._watch(now)

    def is_overdue(self, now: float) -> bool:
        """Return whether the client has not made progress for too long."""
        if self.server is None:
            return now - self._opened > GREETING_TIMEOUT_S
        return self._waits_since is not None and now - self._waits_since > CLIENT_TIMEOUT_S

    def close(self) -> None:
        """Close both connections."""
        if not self.is_closed:
            self.is_closed = True
            self.port.connections -= 1
            self.port.requesting.pop(self, None)
            self._forwarder.held -= self.held
            for end in (self.client, self.server):
                if end is not None:
                    self._forwarder.watch(end, 0, self)
                    end.close()

    def _receive_from_client(self) -> None:
        if self._unchecked or self.held or self._to_server:
            return
        data = _receive(self.client)
        if data == b"":
            raise ConnectionResetError
        self._unchecked = data or b""

    def _forward(self) -> None:
        """Check bytes of the client and send them to the server, as far as the client may be ahead."""
        while self._unchecked and not self._to_server and not self.held:
            if self._frames_ahead <= 0 or self._bytes_ahead <= 0 or self in self.port.requesting:
                return
            frames = self._stream.frames
            checked = self._stream.check(self._unchecked[: self._bytes_ahead], self._frames_ahead)
            self._frames_ahead -= self._stream.frames - frames
            self._bytes_ahead -= checked
            if self.server is None and self._stream.is_zmtp:
                self.server = _connect(self.port.path)
            self._to_server, self._unchecked = self._unchecked[:checked], self._unchecked[checked:]
            if self._stream.request:
                self._request, self._received = self._stream.request, b""
                self._is_in_queue = True
                self.port.waiting.append(self)
            self._send_to_server()

    def send_request(self, now: float) -> None:
        """Send the request that waited for the requests of other connections."""
        self._is_in_queue = False
        self.port.requesting[self] = now
        self.serve(self.client, 0, now)

    def end_request(self, now: float) -> None:
        """Permit the client's next request, although there was no reply."""
        del self.port.requesting[self]
        self._waits_since = None
        self.serve(self.client, 0, now)

    def _find_reply(self, data: bytes) -> None:
        # The reply begins with the topic. When less is received than there is room for, no more bytes wait.
        if self._request:
            self._received = self._received[-MAX_TOPIC_BYTES:] + data
            if self._request not in self._received:
                return
            self._request = self._received = b""
        if len(data) < _READ:
            del self.port.requesting[self]

    def _send_to_server(self) -> None:
        if self.server is not None and self._to_server and not self._is_in_queue:
            self._to_server = self._to_server[_send(self.server, self._to_server) :]

    def _receive_from_server(self) -> None:
        if self.server is None:
            return
        data = _receive(self.server)
        if data == b"":
            self._has_server_ended = True
            self._unchecked = self._to_server = b""
        elif data:
            # The bytes of a slow client wait here, because they would wait in the robot's process otherwise.
            if self._to_client and len(self._to_client[-1]) < _READ:
                self._to_client[-1] += data
            else:
                self._to_client.append(data)
            self._hold(len(data))
            # A reply, or at least news: the client may send again.
            self._frames_ahead = self.port.frames_ahead
            self._bytes_ahead = self.port.bytes_ahead
            if self in self.port.requesting:
                self._find_reply(data)
            self._send_to_client()

    def _send_to_client(self) -> None:
        while self._to_client:
            data = self._to_client[0]
            sent = _send(self.client, data)
            if sent:
                self._hold(-sent)
                self._waits_since = None
            if sent < len(data):
                self._to_client[0] = data[sent:]
                return
            self._to_client.popleft()

    def _hold(self, size: int) -> None:
        self.held += size
        self._forwarder.held += size

    def _watch(self, now: float) -> None:
        waits = bool(self.held or self._to_server or self._unchecked)
        if not waits:
            self._waits_since = None
        elif self._waits_since is None:
            self._waits_since = now
        events = selectors.EVENT_WRITE if self.held else 0
        if not waits and not self._has_server_ended:
            events |= selectors.EVENT_READ
        self._forwarder.watch(self.client, events, self)
        if self.server is not None:
            events = selectors.EVENT_WRITE if self._to_server and not self._is_in_queue else 0
            if not self._has_server_ended:
                events |= selectors.EVENT_READ
            self._forwarder.watch(self.server, events, self)


class Forwarder:
    """Forwards bytes between clients and the publisher's sockets until *control* has data or ends.

    Args:
        ports: The ports to serve.
        control: A file descriptor.
        parent: The ID of the parent process, whose end also ends `run` (0: no effect).
    """

    def __init__(self, ports: list[Port], control: int, parent: int = 0) -> None:
        self.held = 0
        """The number of bytes that wait for the clients of all connections."""
        self._ports = ports
        self._control = control
        self._connections: set[Connection] = set()
        self._selector = selectors.DefaultSelector()
        self._parent = parent

    def run(self) -> None:
        """Serve the ports."""
        for port in self._ports:
            port.listener.setblocking(False)
        self._selector.register(self._control, selectors.EVENT_READ)
        sweep_at = 0.0
        while True:
            now = time.monotonic()
            if now >= sweep_at:
                sweep_at = now + _SWEEP_INTERVAL_S
                self._sweep(now)
            for port in self._ports:
                self._listen(port, port.may_accept(now))
            ready = self._selector.select(self._limit_timeout(sweep_at - now))
            now = time.monotonic()
            for key, events in ready:
                if key.fileobj == self._control:
                    self._finish()
                    return
                if isinstance(key.data, Port):
                    self._accept(key.data, now)
                elif not key.data.is_closed:
                    self._serve(key.data, key.fileobj, events, now)
            for port in self._ports:
                self._send_requests(port, now)
            # A fork of the robot's process may hold the control connection open.
            if self._parent and os.getppid() != self._parent:
                self._finish()
                return

    def watch(self, watched: socket.socket, events: int, data: "Port | Connection") -> None:
        """Watch *events* of a socket from now on; 0 watches none."""
        try:
            key = self._selector.get_key(watched)
        except KeyError:
            if events:
                self._selector.register(watched, events, data)
            return
        if not events:
            self._selector.unregister(watched)
        elif key.events != events:
            self._selector.modify(watched, events, data)

    def _limit_timeout(self, seconds: float) -> float:
        # A port that does not listen may get a permit soon.
        waits = any(not port.is_listening and port.connections < MAX_CONNECTIONS for port in self._ports)
        return max(0.0, min(seconds, 1 / MAX_CONNECTIONS_PER_SECOND) if waits else seconds)

    def _listen(self, port: Port, listens: bool) -> None:
        if listens is not port.is_listening:
            port.is_listening = listens
            self.watch(port.listener, selectors.EVENT_READ if listens else 0, port)

    def _accept(self, port: Port, now: float) -> None:
        client = port.accept()
        if client is not None:
            port.connections += 1
            connection = Connection(self, port, client, now)
            self._connections.add(connection)
            self.watch(client, selectors.EVENT_READ, connection)

    def _serve(self, connection: Connection, ready: object, events: int, now: float) -> None:
        assert isinstance(ready, socket.socket)
        connection.serve(ready, events, now)
        if self.held > MAX_HELD_BYTES:
            largest = max(self._connections, key=lambda connection: connection.held)
            largest.close()
            self._connections.discard(largest)
        if connection.is_closed:
            self._connections.discard(connection)

    def _send_requests(self, port: Port, now: float) -> None:
        while port.waiting and len(port.requesting) < MAX_PIECES_AT_ONCE:
            connection = port.waiting.popleft()
            if not connection.is_closed:
                connection.send_request(now)

    def _sweep(self, now: float) -> None:
        for port in self._ports:
            for connection, since in list(port.requesting.items()):
                if now - since > PIECE_TIMEOUT_S:
                    connection.end_request(now)
        for connection in {each for each in self._connections if each.is_closed or each.is_overdue(now)}:
            connection.close()
            self._connections.discard(connection)

    def _finish(self) -> None:
        """Forward what the publisher still sends, then close all connections."""
        self._selector.unregister(self._control)
        for port in self._ports:
            self._listen(port, False)
        for connection in {each for each in self._connections if each.server is None}:
            connection.close()
            self._connections.discard(connection)
        deadline = time.monotonic() + FLUSH_TIMEOUT_S
        while self._connections and (now := time.monotonic()) < deadline:
            for key, events in self._selector.select(deadline - now):
                if not key.data.is_closed:
                    self._serve(key.data, key.fileobj, events, now)
        for connection in self._connections:
            connection.close()
        for port in self._ports:
            port.listener.close()
        self._selector.close()


def _connect(path: str) -> socket.socket:
    """Return a connection to *path*, a path of a Unix socket or `tcp://address:port`."""
    if sys.platform == "win32" or path.startswith("tcp://"):
        host, _, port = path.removeprefix("tcp://").rpartition(":")
        server = socket.create_connection((host, int(port)), GREETING_TIMEOUT_S)
        server.setblocking(False)
        return server
    server = socket.socket(socket.AF_UNIX)
    server.setblocking(False)
    # Unlike with TCP, the connection exists when this returns, or there is an error.
    server.connect(path)
    return server


def _receive(source: socket.socket) -> bytes | None:
    """Return the bytes that wait, or None if there are none; `b""` is the end."""
    try:
        return source.recv(_READ)
    except (BlockingIOError, InterruptedError):
        return None
    except OSError as error:
        if error.errno in (errno.ECONNRESET, errno.EPIPE, errno.ETIMEDOUT):
            return b""
        raise


def _send(target: socket.socket, data: bytes) -> int:
    try:
        return target.send(data)
    except (BlockingIOError, InterruptedError):
        return 0


def main(arguments: str) -> None:
    """Run the gateway of a robot's process.

    *arguments* is JSON: for each port the arguments of `Port` by name, with the file descriptor of the
    listening socket as `descriptor` instead of `listener`.
    """
    if sys.platform != "win32":
        with contextlib.suppress(OSError):
            os.nice(_PRIORITY)
    settings = json.loads(arguments)
    ports = [Port(socket.socket(fileno=port.pop("descriptor")), **port) for port in settings]
    Forwarder(ports, sys.stdin.fileno(), os.getppid()).run()
    # The robot's process does the same, unless it was killed. The import of pathlib would be slow.
    for port in ports:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(port.path)  # noqa: PTH108
    with contextlib.suppress(OSError):
        os.rmdir(os.path.dirname(ports[0].path))  # noqa: PTH106, PTH120
