"""The base class of this package's errors."""

from btcore.errors import BtcoreError


class RobotError(BtcoreError):
    """Base class of all errors that `btcore_robot` raises; the message is a sentence for the user."""
