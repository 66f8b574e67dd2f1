"""The exception for invalid worlds, robots, faults and events."""

from btcore.errors import BtcoreError


class SimError(BtcoreError):
    """A world, a robot, a fault or an event is invalid; the message gives the reason and what to do."""
