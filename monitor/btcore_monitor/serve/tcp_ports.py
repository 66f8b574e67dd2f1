"""Taking ports in a row: Groot 2's two or Groot 1's two, and the scene channel's."""

import random
from collections.abc import Sequence
from typing import Any, Final

import zmq

from btcore_monitor.errors import MonitorError

PORTS: Final = 3
"""port: requests · port + 1: notifications · port + 2: the scene channel."""

GROOT1_PORTS: Final = 2
"""port: updates · port + 1: requests."""

GROOT1_ALONE: Final = 4
"""As before, and port + 3: the scene channel, as far behind the requests as with Groot 2."""

_FREE_FROM: Final = 20_000
_FREE_TO: Final = 32_000
"""Free ports are looked for below the range that Linux hands out to outgoing connections."""

_ATTEMPTS: Final = 200


class ServeError(MonitorError):
    """A tree can't be published where it was asked for."""


class PortInUseError(ServeError):
    """Another program listens at a port that is needed. Likely cause: a second robot, or an old run."""

    def __init__(self, port: int, first: int, count: int = PORTS) -> None:
        self.port = port
        said = f"port {port} is in use"
        if port != first:
            said += f" ({first} to {first + count - 1} are needed)"
        super().__init__(f"{said}: choose another with --port, or --port 0 for a free one")


Socket = zmq.Socket[bytes]


def bind_in_a_row(sockets: Sequence[Socket | None], host: str, port: int, count: int = PORTS) -> int:
    """Bind the *sockets* to *host* at *port*, *port* + 1 …; port 0 takes free ones. Returns the first port.

    Where there is None instead of a socket nothing is bound; *count* ports in all are said to be needed.
    Raises :class:`PortInUseError`, or :class:`ServeError` if *host* or *port* can't be bound at all.
    """
    if port:
        if not 1 <= port <= 65536 - count:
            raise ServeError(f"port {port} is out of range: choose one from 1 to {65536 - count}")
        _bind_all(sockets, host, port, count)
        return port
    for _ in range(_ATTEMPTS):
        base = random.SystemRandom().randrange(_FREE_FROM, _FREE_TO, count)
        try:
            _bind_all(sockets, host, base, count)
        except PortInUseError:
            continue
        return base
    raise ServeError(
        f"no {count} free ports in a row were found from {_FREE_FROM} to {_FREE_TO}: name one with --port"
    )


def _bind_all(sockets: Sequence[Socket | None], host: str, port: int, count: int) -> None:
    bound: list[tuple[Socket, str]] = []
    for offset, socket in enumerate(sockets):
        if socket is None:
            continue
        address = f"tcp://{host}:{port + offset}"
        try:
            socket.bind(address)
        except zmq.ZMQError as error:
            for other, where in bound:
                other.unbind(where)
            raise _explained(error, host, port, port + offset, count) from None
        bound.append((socket, address))


def _explained(error: zmq.ZMQError, host: str, first: int, port: int, count: int) -> ServeError:
    code: Any = error.errno
    if code == zmq.EADDRINUSE:
        return PortInUseError(port, first, count)
    if code == 13:  # EACCES
        return ServeError(f"port {port} may not be opened by this user: choose one above 1023 with --port")
    return ServeError(
        f"nothing here can listen at '{host}' ({error.strerror}): --bind takes the address of one of this "
        "machine's interfaces, 127.0.0.1 for this machine only, or * for all"
    )
