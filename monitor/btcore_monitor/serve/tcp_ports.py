"""Bind consecutive ports: two for Groot 2 or Groot 1, and one for the scene channel."""

import random
from collections.abc import Sequence
from typing import Any, Final

import zmq

from btcore_monitor.errors import MonitorError

PORTS: Final = 3
"""Number of ports for Groot 2: requests (port), notifications (port + 1), the scene channel (port + 2)."""

GROOT1_PORTS: Final = 2
"""Number of ports for Groot 1: updates (port), requests (port + 1)."""

GROOT1_ALONE: Final = 4
"""Number of ports for Groot 1 without Groot 2: updates (port), requests (port + 1), none at port + 2, and the
scene channel (port + 3), which is always two ports above the requests."""

_FREE_FROM: Final = 20_000
_FREE_TO: Final = 32_000
"""Free ports are chosen below 32768, where Linux's default range for outgoing connections begins."""

_ATTEMPTS: Final = 200


class ServeError(MonitorError):
    """A tree can't be published at the given ports or interface."""


class PortInUseError(ServeError):
    """Another program listens at a required port. Likely cause: a second robot, or an old run."""

    def __init__(self, port: int, first: int, count: int = PORTS, option: str = "--port") -> None:
        self.port = port
        message = f"port {port} is in use"
        if port != first:
            message += f" ({first} to {first + count - 1} are needed)"
        super().__init__(f"{message}: choose another port with {option}, or a free port with {option} 0")


Socket = zmq.Socket[bytes]


def bind_in_a_row(
    sockets: Sequence[Socket | None], host: str, port: int, count: int = PORTS, option: str = "--port"
) -> int:
    """Bind *sockets* to consecutive ports of *host*.

    Args:
        sockets: The sockets, in the order of their ports; None leaves out a port.
        host: The address of the interface (``*``: all interfaces).
        port: The first port; 0 chooses free ports.
        count: The number of ports in the range, for error messages and free ports.
        option: The command line's option for the port, for error messages.

    Returns:
        The first port.

    Raises:
        PortInUseError: Another program uses a port.
        ServeError: *host* or *port* is invalid, or no free ports were found.
    """
    if port:
        if not 1 <= port <= 65536 - count:
            raise ServeError(f"port {port} is out of range: choose one from 1 to {65536 - count}")
        _bind_all(sockets, host, port, count, option)
        return port
    for _ in range(_ATTEMPTS):
        base = random.SystemRandom().randrange(_FREE_FROM, _FREE_TO, count)
        try:
            _bind_all(sockets, host, base, count, option)
        except PortInUseError:
            continue
        return base
    raise ServeError(
        f"no {count} consecutive free ports were found from {_FREE_FROM} to {_FREE_TO}: choose a port with "
        f"{option}"
    )


def _bind_all(sockets: Sequence[Socket | None], host: str, port: int, count: int, option: str) -> None:
    bound: list[tuple[Socket, str]] = []
    for offset, socket in enumerate(sockets):
        if socket is None:
            continue
        address = f"tcp://{host}:{port + offset}"
        try:
            socket.bind(address)
        except zmq.ZMQError as error:
            # All ports or none: the caller may try again with other ports.
            for other, where in bound:
                other.unbind(where)
            raise _explained(error, host, port, port + offset, count, option) from None
        # The endpoint as libzmq resolved it: "*" is not accepted by unbind().
        bound.append((socket, socket.getsockopt_string(zmq.LAST_ENDPOINT).rstrip("\0")))


def _explained(error: zmq.ZMQError, host: str, first: int, port: int, count: int, option: str) -> ServeError:
    code: Any = error.errno
    if code == zmq.EADDRINUSE:
        return PortInUseError(port, first, count, option)
    if code == 13:  # EACCES
        return ServeError(f"this user may not open port {port}: choose a port above 1023 with {option}")
    return ServeError(
        f"cannot listen at '{host}' ({error.strerror}): --bind takes the address of an interface of this "
        "machine, 127.0.0.1 for this machine only, or * for all interfaces"
    )
