"""The exceptions of this package."""

from btcore.errors import BtcoreError


class MonitorError(BtcoreError):
    """Base class of every exception that btcore_monitor defines."""


class RecordingError(MonitorError):
    """A recording's file is incomplete, because it cannot be written, for example on a full disk.

    rerun never closes such a recording: the process has to end by `btcore_monitor.process_end.abandon`.
    """
