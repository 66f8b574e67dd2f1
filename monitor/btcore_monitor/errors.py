"""The base class of all exceptions of this package."""


class MonitorError(Exception):
    """Base class of every exception that btcore_monitor defines."""
