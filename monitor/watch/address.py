"""Where a robot is: ``tcp://robot.local:1667``, or any shorter form of that."""

import re
from typing import Final, NamedTuple

from monitor.wire.groot2 import DEFAULT_PORT

_FORM: Final = re.compile(
    r"(?:tcp://)?(?P<host>\[[0-9A-Fa-f:.%\w]+\]|[^:/\s\[\]]*)(?::(?P<port>[0-9]{1,5}))?/?"
)


class AddressFault(ValueError):
    """A text that no robot's address can be read from."""


class Address(NamedTuple):
    """A host (IPv6 in brackets) and the port of Groot 2's requests."""

    host: str
    port: int

    def at(self, offset: int = 0) -> str:
        """The ZMQ endpoint *offset* ports further."""
        return f"tcp://{self.host}:{self.port + offset}"

    def __str__(self) -> str:
        return self.at()


def parse_address(text: str) -> Address:
    """The address in *text*: ``tcp://HOST:PORT``, ``HOST:PORT``, ``HOST``, ``:PORT`` or ``PORT``.

    The host defaults to 127.0.0.1 and the port to 1667. Raises :class:`AddressFault`.
    """
    text = text.strip()
    if text.isascii() and text.isdigit():
        text = f":{text}"
    found = _FORM.fullmatch(text)
    if found is None:
        raise AddressFault(f"'{text}' is no address: write tcp://HOST:PORT, HOST:PORT, HOST or PORT")
    port = int(found["port"] or DEFAULT_PORT)
    if not 1 <= port <= 65533:
        raise AddressFault(f"port {port} is out of range: a robot is found at a port from 1 to 65533")
    return Address(found["host"] or "127.0.0.1", port)
