"""The errors of this package."""

from btcore import BtcoreError


class RosError(BtcoreError):
    """Raised when ROS 2 is not installed, or cannot be used as it is installed or configured."""
