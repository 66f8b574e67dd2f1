"""Where a robot is: ``tcp://robot.local:1667``, or any shorter form of that.

A robot that speaks Groot 1's protocol publishes one port below the one it is asked at, 1666 and 1667. If it
has other ports, the one for publishing stands behind: ``tcp://robot.local:1800/1700``.
"""

import re
from typing import Final, NamedTuple

from btcore_monitor.errors import MonitorError
from btcore_monitor.wire.groot2 import DEFAULT_PORT

_FORM: Final = re.compile(
    r"(?:tcp://)?(?P<host>\[[0-9A-Fa-f:.%\w]+\]|[^:/\s\[\]]*)(?::(?P<port>[0-9]{1,5}))?"
    r"/?(?P<publish>(?<=/)[0-9]{1,5})?"
)


class AddressError(MonitorError, ValueError):
    """A text that no robot's address can be read from."""


class Address(NamedTuple):
    """A host (IPv6 in brackets), the port of requests, and Groot 1's for publishing (0: not told)."""

    host: str
    port: int
    publish: int = 0

    def at(self, offset: int = 0) -> str:
        """The ZMQ endpoint *offset* ports further."""
        return f"tcp://{self.host}:{self.port + offset}"

    def published(self) -> str:
        """The ZMQ endpoint where a robot publishes that speaks Groot 1's protocol."""
        return f"tcp://{self.host}:{self.publish or self.port - 1}"

    def __str__(self) -> str:
        return self.at() + (f"/{self.publish}" if self.publish else "")


def parse_address(text: str) -> Address:
    """The address in *text*: ``tcp://HOST:PORT``, ``HOST:PORT``, ``HOST``, ``:PORT`` or ``PORT``.

    Each may be followed by ``/PORT``, where Groot 1's updates are published. The host defaults to
    127.0.0.1 and the port to 1667. Raises :class:`AddressError`.
    """
    text = text.strip()
    if text.isascii() and text.partition("/")[0].isdigit():
        text = f":{text}"
    found = _FORM.fullmatch(text)
    if found is None:
        raise AddressError(f"'{text}' is no address: write tcp://HOST:PORT, HOST:PORT, HOST or PORT")
    port = int(found["port"] or DEFAULT_PORT)
    if not 1 <= port <= 65533:
        raise AddressError(f"port {port} is out of range: a robot is found at a port from 1 to 65533")
    publish = int(found["publish"] or 0)
    if publish > 65535:
        raise AddressError(f"port {publish} is out of range: a robot publishes at a port from 1 to 65535")
    return Address(found["host"] or "127.0.0.1", port, publish)
