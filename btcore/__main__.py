"""The command `btcore`, and `python -m btcore`.

Importing the command line takes some tenths of a second. In this time Ctrl-C ends the process at once: an
import that is interrupted by an exception would print a traceback.
"""

import gc
import os
import signal
from types import FrameType
from typing import NoReturn

from btcore.exit_codes import ExitCode


def main() -> None:
    """Run the command line, and exit."""
    # A process that the shell started in the background, or by nohup, may ignore the signal.
    handles_ctrl_c = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if handles_ctrl_c:
        signal.signal(signal.SIGINT, _exit_at_once)
    # Modules are no garbage before the exit: until the command starts, the collector would scan them in vain.
    gc.disable()
    from btcore.cli.main import main as command

    gc.freeze()  # what is frozen is not scanned at the exit either
    gc.enable()
    if handles_ctrl_c:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        command(prog_name="btcore")
    finally:
        if handles_ctrl_c:  # also while Python exits
            signal.signal(signal.SIGINT, _exit_at_once)


def _exit_at_once(number: int, frame: FrameType | None) -> NoReturn:
    os.write(2, b"interrupted\n")
    os._exit(ExitCode.INTERRUPTED)


if __name__ == "__main__":
    main()
