"""The exit codes of the command line."""

from enum import IntEnum
from signal import SIGINT, SIGTERM


class ExitCode(IntEnum):
    """The exit code of a command's process."""

    SUCCESS = 0
    FAILURE = 1
    """The tree ended in FAILURE, the compared runs differ, or a recording has no tree."""
    USER_ERROR = 2
    """An error in a tree, on the command line, or of a provider, such as a robot that cannot be reached."""
    LEAF_ERROR = 3
    """A leaf raised an exception, or a tick exceeded its limit."""
    INCOMPLETE_OUTPUT = 4
    """A log, a recording or stdout is incomplete, for example because the disk is full, or a question of
    `btcore prove` has no answer."""
    INTERNAL_ERROR = 70
    """An error in btcore itself: EX_SOFTWARE of sysexits.h."""
    HUNG_UP = 129
    """The terminal was closed (SIGHUP): 128 + SIGHUP, the convention of shells."""
    INTERRUPTED = 130
    """Ctrl-C: 128 + SIGINT."""
    TERMINATED = 143
    """SIGTERM: 128 + SIGTERM."""


def code_of_signal(number: int) -> ExitCode:
    """Return the exit code of a command that the signal *number* ended."""
    codes: dict[int, ExitCode] = {SIGINT: ExitCode.INTERRUPTED, SIGTERM: ExitCode.TERMINATED}
    return codes.get(number, ExitCode.HUNG_UP)  # Windows has no SIGHUP
