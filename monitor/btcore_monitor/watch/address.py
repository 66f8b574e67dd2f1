"""The address of a robot: `tcp://robot.local:1667`, or a shorter form.

A robot with Groot 1's protocol publishes updates one port below its port of requests: 1666 and 1667. The
port of updates can follow the address: `tcp://robot.local:1800/1700`.
"""

import re
from typing import Final, NamedTuple

from btcore_monitor.errors import MonitorError
from btcore_monitor.wire.groot2 import DEFAULT_PORT

_FORM: Final = re.compile(
    r"(?:tcp://)?(?P<host>\[[0-9A-Fa-f:.%\w]+\]|[^:/\s\[\]]*)(?::(?P<port>[0-9]{1,5}))?"
    r"/?(?P<updates>(?<=/)[0-9]{1,5})?"
)


class AddressError(MonitorError, ValueError):
    """A text is not the address of a robot."""


class Address(NamedTuple):
    """A host (IPv6 in brackets), the port of requests, and the port of Groot 1's updates."""

    host: str
    port: int
    updates_port: int

    def at(self, offset: int = 0) -> str:
        """Return the ZeroMQ endpoint *offset* ports above the port of requests."""
        return f"tcp://{self.host}:{self.port + offset}"

    def published(self) -> str:
        """Return the ZeroMQ endpoint of Groot 1's updates."""
        return f"tcp://{self.host}:{self.updates_port}"

    def __str__(self) -> str:
        return self.at() + ("" if self.updates_port == self.port - 1 else f"/{self.updates_port}")


def parse_address(text: str) -> Address:
    """Return the address in *text*: `tcp://HOST:PORT`, `HOST:PORT`, `HOST`, `:PORT` or `PORT`.

    Each form may be followed by `/PORT`, the port of Groot 1's updates. The host defaults to 127.0.0.1 and
    the port to 1667.

    Raises:
        AddressError: *text* is not an address, or a port is out of range.
    """
    text = text.strip()
    # A number alone is a port. isdigit() also accepts digits of other scripts, which int() would convert.
    if text.isascii() and text.partition("/")[0].isdigit():
        text = f":{text}"
    match = _FORM.fullmatch(text)
    if match is None:
        raise AddressError(f"'{text}' is not an address: write tcp://HOST:PORT, HOST:PORT, HOST or PORT")
    port = int(match["port"] or DEFAULT_PORT)
    if not 1 <= port <= 65533:  # the two ports above carry notifications and the run channel
        raise AddressError(f"port {port} is out of range: a robot's port is from 1 to 65533")
    updates_port = int(match["updates"] or port - 1)
    if updates_port > 65535:
        raise AddressError(f"port {updates_port} is out of range: the port of updates is from 1 to 65535")
    return Address(match["host"] or "127.0.0.1", port, updates_port)
