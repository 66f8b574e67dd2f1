"""The exceptions for received bytes that are invalid, and for requests that a robot rejects."""

from btcore_monitor.errors import MonitorError


class ProtocolError(MonitorError, ValueError):
    """Received bytes are invalid in the protocol. The message names the expected and the received data.

    Likely causes: another program answers at that address, or one side is much newer.
    """


class RobotRefusedError(ProtocolError):
    """The robot answered a request with an error. The message is the text that the robot sent."""


def describe_bytes(data: bytes, limit: int = 24) -> str:
    """Return *data* for an error message: its length, and its first *limit* bytes in hexadecimal."""
    if not data:
        return "nothing"
    dots = " …" if len(data) > limit else ""
    return f"{len(data)} bytes ({data[:limit].hex(' ')}{dots})"


def describe_value(value: object, limit: int = 40) -> str:
    """Return a received *value* for an error message: at most *limit* characters, or the name of its type."""
    return repr(value)[:limit] if isinstance(value, str | int | float | None) else type(value).__name__
