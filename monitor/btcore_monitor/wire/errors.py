"""The exceptions for received bytes that are invalid, and for requests that a robot rejects."""

from btcore_monitor.errors import MonitorError


class ProtocolError(MonitorError, ValueError):
    """Received bytes are invalid in the protocol. The message names the expected and the received data.

    Likely causes: another program answers at that address, or one side is much newer.
    """


class RobotRefusedError(ProtocolError):
    """The robot answered a request with an error.

    Args:
        sentence: The text that the robot sent, if *message* has more.
    """

    def __init__(self, message: str, sentence: str = "") -> None:
        super().__init__(message)
        self.sentence = sentence or message


def describe_bytes(data: bytes) -> str:
    """Return *data* for an error message: its length, and its first 24 bytes in hexadecimal."""
    if not data:
        return "nothing"
    dots = " …" if len(data) > 24 else ""
    return f"{len(data)} bytes ({data[:24].hex(' ')}{dots})"


def describe_value(value: object) -> str:
    """Return a received *value* for an error message: at most 40 characters, or the name of its type."""
    return repr(value)[:40] if isinstance(value, str | int | float | None) else type(value).__name__
