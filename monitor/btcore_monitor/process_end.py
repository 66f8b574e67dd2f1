"""End a command on signals and after a time limit, with complete files if possible."""

import contextlib
import os
import sys
import threading
from collections.abc import Iterator
from typing import Final, NoReturn

from btcore.exit_codes import ExitCode
from btcore.signals import EndingSignals
from btcore_monitor.console import print_line, print_message
from btcore_monitor.errors import RecordingError

END_TIMEOUT_S: Final = 30.0
"""Seconds after a time limit within which a command completes its data; after that its process ends."""


def wait_for_stop(duration: float | None = None) -> None:
    """Return on a signal, or after *duration* s, while a view is served to browsers."""
    print_message("Ctrl-C ends it")
    stop = threading.Event()
    with EndingSignals(stop.set):
        stop.wait(duration)


@contextlib.contextmanager
def abandon_if_late(duration: float | None) -> Iterator[None]:
    """Abandon the process if the `with` block lasts longer than *duration* and `END_TIMEOUT_S` together.

    The block itself should end in time. But drawing the tree of a hostile robot may take minutes.
    """
    if duration is None:
        yield
        return
    error = RecordingError(
        f"the time limit of {duration:g} s is over, and the recording could not be completed within another "
        f"{END_TIMEOUT_S:g} s: the tree may be too big to be drawn"
    )
    watchdog = threading.Timer(duration + END_TIMEOUT_S, abandon, [error])
    watchdog.daemon = True
    watchdog.start()
    try:
        yield
    finally:
        watchdog.cancel()


def abandon(error: RecordingError) -> NoReturn:
    """Print *error*, and end the process with the exit code 4, without closing the recording."""
    print_line(f"error: {error}", err=True)
    sys.stdout.flush()
    os._exit(ExitCode.INCOMPLETE_OUTPUT)
