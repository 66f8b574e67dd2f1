"""What is said when bytes are not what a protocol promises."""

from btcore_monitor.errors import MonitorError


class ProtocolError(MonitorError, ValueError):
    """Received bytes don't fit the protocol: the message says what was expected, and what came.

    Likely causes: another program answers at that address, or one side is much newer.
    """


class RobotRefusedError(ProtocolError):
    """The robot answered a request with an error; the message is the robot's own sentence."""


def describe_bytes(data: bytes, room: int = 24) -> str:
    """*data* for an error message: its length, and its first *room* bytes in hex."""
    if not data:
        return "nothing"
    dots = " …" if len(data) > room else ""
    return f"{len(data)} bytes ({data[:room].hex(' ')}{dots})"
