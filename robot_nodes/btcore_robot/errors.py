"""The base class of this package's errors."""


class RobotError(Exception):
    """Base class of all errors that `btcore_robot` raises; the message is a sentence for the user."""
