"""Bind consecutive ports: two for Groot 2 or Groot 1, and one for the run channel."""

import contextlib
import errno
import os
import random
import socket
import sys
from collections.abc import Sequence
from typing import Final

import zmq

from btcore_monitor.errors import MonitorError
from btcore_monitor.serve.gateway import Gateway

GROOT2_PORT_COUNT: Final = 3
"""Number of ports for Groot 2: requests (port), notifications (port + 1), the run channel (port + 2)."""

GROOT1_PORT_COUNT: Final = 2
"""Number of ports for Groot 1: updates (port), requests (port + 1)."""

GROOT1_ALONE_PORT_COUNT: Final = 4
"""Number of ports for Groot 1 without Groot 2: updates (port), requests (port + 1), none at port + 2, and the
run channel (port + 3), which is always two ports above the requests."""

_FREE_FROM: Final = 20_000
_FREE_TO: Final = 32_000
"""Free ports are chosen below 32768, where Linux's default range for outgoing connections begins."""

_ATTEMPTS: Final = 200

_BACKLOG: Final = 100
"""Maximum connections that wait until the gateway accepts them, as in libzmq."""


class ServeError(MonitorError):
    """A tree can't be published at the given ports or interface."""


class PortInUseError(ServeError):
    """Another program listens at a required port. Likely cause: a second robot, or an old run.

    Args:
        first: The first of the required ports.
        count: The number of required ports.
        setting: The field of `MonitorSettings` that selects the ports: "port" or "watch_port".

    Attributes:
        port: The port in use.
        setting: As given.
    """

    def __init__(self, port: int, first: int, count: int = GROOT2_PORT_COUNT, setting: str = "port") -> None:
        self.port = port
        self.setting = setting
        message = f"port {port} is in use"
        if port != first:
            message += f" ({first} to {first + count - 1} are needed)"
        option = _option(setting)
        super().__init__(f"{message}: choose another port with {option}, or a free port with {option} 0")


Socket = zmq.Socket[bytes]


def bind_consecutive(
    gateway: Gateway,
    sockets: Sequence[Socket | None],
    host: str,
    port: int,
    count: int = GROOT2_PORT_COUNT,
    setting: str = "port",
) -> int:
    """Bind *sockets* to consecutive ports of *host*, behind *gateway*.

    Args:
        gateway: The gateway, which accepts the connections.
        sockets: The sockets, in the order of their ports; None leaves out a port.
        host: The address of the interface (`*`: all interfaces).
        port: The first port; 0 chooses free ports.
        count: The number of ports in the range, for error messages and free ports.
        setting: The field of `MonitorSettings` that selects the port, for errors.

    Returns:
        The first port.

    Raises:
        PortInUseError: Another program uses a port.
        ServeError: *host* or *port* is invalid, or no free ports were found.
    """
    if port and not 1 <= port <= 65536 - count:
        raise ServeError(f"port {port} is out of range: choose one from 1 to {65536 - count}")
    address = _resolve_interface(host)
    is_used = [socket is not None for socket in sockets]
    for _ in range(_ATTEMPTS):
        first = port or random.SystemRandom().randrange(_FREE_FROM, _FREE_TO, count)
        try:
            listeners = _listen(is_used, host, address, first, count, setting)
        except PortInUseError:
            if port:
                raise
            continue
        for listener, target in zip(listeners, filter(None, sockets), strict=True):
            gateway.add_port(listener, target)
        return first
    raise ServeError(
        f"no {count} consecutive free ports were found from {_FREE_FROM} to {_FREE_TO}: choose a port with "
        f"{_option(setting)}"
    )


def _listen(
    is_used: Sequence[bool], host: str, address: str, port: int, count: int, setting: str
) -> list[socket.socket]:
    """Listen at the used ports from *port* on: at all of them, or at none if there is an error."""
    listeners: list[socket.socket] = []
    for offset, used in enumerate(is_used):
        if not used:
            continue
        listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        listeners.append(listener)
        try:
            if sys.platform != "win32":
                # Ports of an ended program are free at once.
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind((address, port + offset))
            listener.listen(_BACKLOG)
        except OSError as error:
            for other in listeners:
                other.close()
            raise _explain_error(error.errno or 0, host, port, port + offset, count, setting) from None
    return listeners


def _resolve_interface(host: str) -> str:
    """Return the IPv4 address of *host*: an address, the name of an interface, or `*`."""
    if host == "*":
        return "0.0.0.0"
    with contextlib.suppress(OSError):
        socket.inet_pton(socket.AF_INET, host)
        return host
    # libzmq resolves the names of interfaces.
    with zmq.Context() as context, context.socket(zmq.PAIR) as probe:
        try:
            probe.bind(f"tcp://{host}:*")
        except zmq.ZMQError as error:
            raise _explain_error(int(error.errno or 0), host, 0, 0, 0, "") from None
        endpoint = probe.getsockopt_string(zmq.LAST_ENDPOINT)
    return endpoint.removeprefix("tcp://").rpartition(":")[0]


def _explain_error(code: int, host: str, first: int, port: int, count: int, setting: str) -> ServeError:
    if code == errno.EADDRINUSE:
        return PortInUseError(port, first, count, setting)
    if code == errno.EACCES:
        option = _option(setting)
        return ServeError(f"this user may not open port {port}: choose a port above 1023 with {option}")
    return ServeError(
        f"cannot listen at '{host}' ({os.strerror(code)}): --bind takes the address of an interface of this "
        "machine, 127.0.0.1 for this machine only, or * for all interfaces"
    )


def _option(setting: str) -> str:
    """Return the option of the command line that sets a field."""
    return "--" + setting.replace("_", "-")
