"""The exit codes of the command line."""

from enum import IntEnum


class ExitCode(IntEnum):
    """What a command's process exits with."""

    SUCCESS = 0
    FAILURE = 1
    """A tree ended in FAILURE, or the runs that were compared differ."""
    USER_ERROR = 2
    """A mistake in a tree or on the command line."""
    LEAF_ERROR = 3
    """A leaf raised."""
    INTERNAL_ERROR = 70
    """An error of btcore itself: EX_SOFTWARE of sysexits.h."""
    INTERRUPTED = 130
    """Ctrl-C or SIGTERM: 128 + SIGINT, as shells have it."""
