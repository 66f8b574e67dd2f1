"""The sockets of a publisher: their limits, their keys, and the ports to which they are bound."""

from collections.abc import Iterator
from typing import Final

import zmq

from btcore_monitor.keys import RobotKeys
from btcore_monitor.serve.gateway import Gateway
from btcore_monitor.serve.groot1 import Groot1Sockets
from btcore_monitor.serve.request_socket import RequestSocket
from btcore_monitor.serve.tcp_ports import (
    GROOT1_ALONE_PORT_COUNT,
    GROOT1_PORT_COUNT,
    GROOT2_PORT_COUNT,
    ServeError,
    Socket,
    bind_consecutive,
)
from btcore_monitor.wire.groot1 import PORT_BESIDE_GROOT2

_MAX_REQUEST_BYTES: Final = 1 << 20
_MAX_SUBSCRIPTION_BYTES: Final = 1 << 10
_MAX_UNSENT_MESSAGES: Final = 2_000
"""Maximum queued messages of a slow client; the client requests further messages again later."""

_ZAP_ENDPOINT: Final = "inproc://zeromq.zap.01"
_ZAP_VERSION: Final = b"1.0"
_ZAP_FRAMES: Final = 7


class Authenticator:
    """Checks the keys of clients: a handler of ZAP, the ZeroMQ Authentication Protocol (RFC 27).

    libzmq sends a request to `socket` for each connection to a socket with keys, and waits for the reply
    before the connection carries any message. Use it from one thread at a time.

    Args:
        context: The ZeroMQ context of the sockets with keys.
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


class PublisherSockets:
    """The sockets of a publisher, bound to their ports.

    Args:
        groot2_port: The port for Groot 2's requests; 0 = a free port, None = no support for Groot 2.
        groot1_port: The port for Groot 1's updates; 0 = a free port, None = no support for Groot 1.
        bind: The interface (`*`: all interfaces).
        serves_run_channel: Whether to publish the run channel.
        keys: The keys for encrypted connections; None = not encrypted.
        watch_port: The first of further ports for clients without keys, see `serve`.

    Raises:
        PortInUseError: Another program uses a port.
        ServeError: The ports or the interface are invalid.

    Attributes:
        gateway: The process that accepts the connections.
        serves_groot2: Whether Groot 2 is served.
        groot2_requests: The requests of Groot 2.
        watch_requests: The requests of clients without keys, if other clients have keys.
        notifications: The notifications of Groot 2.
        run_channel: The run channel, or None. An XPUB socket: its subscriptions are the clients' requests.
        groot1: The sockets of Groot 1, or None.
        authenticator: Checks the keys of clients, or None.
        port: The port of Groot 2's requests, or of Groot 1's if Groot 2 is not served.
        address: The address of the tree for a client on this machine.
        groot1_port: The port of Groot 1's updates, or None; the next port answers its requests.
        watch_address: The address of the tree for a client on this machine that has no key; "" without
            *watch_port*.
        watch_groot1_port: The port of Groot 1's updates for clients without keys, or None.
    """

    def __init__(
        self,
        groot2_port: int | None,
        groot1_port: int | None,
        bind: str,
        serves_run_channel: bool,
        keys: RobotKeys | None = None,
        watch_port: int | None = None,
    ) -> None:
        if groot2_port and groot1_port and -GROOT1_PORT_COUNT < groot1_port - groot2_port < GROOT2_PORT_COUNT:
            raise ServeError(
                f"Groot 2 needs the ports {groot2_port} to {groot2_port + GROOT2_PORT_COUNT - 1} and Groot 1 "
                f"needs {groot1_port} and {groot1_port + 1}, which overlap: choose another port, such as "
                f"{PORT_BESIDE_GROOT2} for Groot 1"
            )
        self.serves_groot2 = groot2_port is not None
        self._context: zmq.Context[Socket] = zmq.Context()
        self.groot2_requests = RequestSocket(self._context, _MAX_REQUEST_BYTES)
        self.watch_requests = RequestSocket(self._context, _MAX_REQUEST_BYTES)
        self.notifications = self._create_sender(zmq.PUB)
        self.run_channel = self._create_sender(zmq.XPUB) if serves_run_channel else None
        if self.run_channel is not None:
            self.run_channel.setsockopt(zmq.SNDHWM, _MAX_UNSENT_MESSAGES)
        self.groot1 = None if groot1_port is None else Groot1Sockets(self._context)
        self.authenticator: Authenticator | None = None
        self.watch_address = ""
        self.watch_groot1_port: int | None = None
        host = "127.0.0.1" if bind in ("*", "0.0.0.0") else bind
        try:
            self.gateway = Gateway()
        except OSError as error:
            raise ServeError(f"cannot create a folder for the monitor's sockets: {error}") from None
        try:
            if keys is not None:
                self.authenticator = Authenticator(self._context, keys)
                if watch_port is not None:
                    # In this order: a socket's keys apply to the ports to which it is bound afterwards.
                    port, self.watch_groot1_port = self._bind_watch_ports(
                        groot2_port, groot1_port, watch_port, bind
                    )
                    self.watch_address = f"tcp://{host}:{port}"
                for socket in self._sockets_with_keys():
                    keys.secure(socket)
            self.port, self.groot1_port = self._bind(self.groot2_requests, groot2_port, groot1_port, bind)
            self.gateway.start()
        except BaseException:
            self._context.destroy(linger=0)
            self.gateway.close()
            raise
        self.address = f"tcp://{host}:{self.port}"

    def _create_sender(self, socket_type: int) -> Socket:
        socket = self._context.socket(socket_type)
        socket.setsockopt(zmq.MAXMSGSIZE, _MAX_SUBSCRIPTION_BYTES)
        # Otherwise closing would wait for clients that do not read.
        socket.setsockopt(zmq.LINGER, 0)
        return socket

    def _sockets_with_keys(self) -> Iterator[Socket]:
        """Yield the sockets to which clients with keys connect, if there are keys."""
        yield self.groot2_requests.socket
        yield self.notifications
        if self.run_channel is not None:
            yield self.run_channel
        if self.groot1 is not None:
            yield self.groot1.updates
            yield self.groot1.requests.socket

    def readable(self) -> Iterator[Socket]:
        """Yield the sockets that receive something."""
        yield self.groot2_requests.socket
        yield self.watch_requests.socket
        if self.authenticator is not None:
            yield self.authenticator.socket
        if self.run_channel is not None:
            yield self.run_channel
        if self.groot1 is not None:
            yield self.groot1.requests.socket

    def _bind(
        self,
        groot2_requests: RequestSocket,
        groot2_port: int | None,
        groot1_port: int | None,
        host: str,
        setting: str = "port",
    ) -> tuple[int, int | None]:
        """Bind the ports. Return those of requests (of Groot 2, or else 1) and of Groot 1's updates."""
        stream = [] if self.run_channel is None else [self.run_channel]
        requests_port, updates_port = 0, None
        row: list[Socket | None]
        if groot2_port is not None:
            row = [groot2_requests.socket, self.notifications, *stream]
            requests_port = bind_consecutive(self.gateway, row, host, groot2_port, setting=setting)
        if self.groot1 is not None and groot1_port is not None:
            row = [self.groot1.updates, self.groot1.requests.socket]
            count = GROOT1_PORT_COUNT
            if groot2_port is None:
                row += [None, *stream]
                count = GROOT1_ALONE_PORT_COUNT
            updates_port = bind_consecutive(self.gateway, row, host, groot1_port, count, setting)
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
            are_chosen = first and groot1_port and groot2_port  # 0 means a free port
            watch_groot1_port = first + groot1_port - groot2_port if are_chosen else 0
        return self._bind(self.watch_requests, watch_groot2_port, watch_groot1_port, host, "watch_port")

    def close(self) -> None:
        """Close the sockets, and end the gateway."""
        # 200 ms for the last message to clients that read; closing does not wait for other clients.
        if self.run_channel is not None:
            self.run_channel.close(linger=200)
        self.groot2_requests.socket.close(linger=200)
        self.watch_requests.socket.close(linger=200)
        self.notifications.close(linger=0)
        if self.groot1 is not None:
            self.groot1.close(linger=200)
        if self.authenticator is not None:
            self.authenticator.socket.close(linger=0)
        self._context.term()
        self.gateway.close()
