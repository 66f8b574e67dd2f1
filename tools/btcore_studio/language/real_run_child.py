"""`btcore run` in the process of a page's run: `python -m … SIZE [FOLDER]… -- [ARGUMENT]…`.

stdin has SIZE bytes with the text of the tree. When stdin ends after them, because the run should end or the
language server has ended, the run is interrupted as by Ctrl-C.
"""

import io
import os
import signal
import sys
import threading
from collections.abc import Sequence

from btcore.__main__ import main
from btcore.exit_codes import code_of_signal

GRACE_S = 2.0
"""Time (s) after which a leaf that hangs is interrupted, and after which the process then ends."""


def run(arguments: Sequence[str]) -> None:
    """Run the tree from stdin until it ends, or until stdin ends."""
    stop = arguments.index("--")
    text = sys.stdin.buffer.read(int(arguments[0]))
    channel = os.dup(0)
    threading.Thread(target=_end_with, args=(channel,), daemon=True).start()
    # Leaves find an empty stdin: what arrives there is not for them.
    sys.stdin = io.TextIOWrapper(io.BytesIO(text), "utf-8")
    # After the installed packages, so that a file of the folder cannot replace a module of Python.
    sys.path += arguments[1:stop]
    sys.argv[1:] = ["run", "-", *arguments[stop + 1 :]]
    main()


def _end_with(channel: int) -> None:
    while os.read(channel, 1024):
        pass
    for _ in range(2):
        _interrupt()
        threading.Event().wait(GRACE_S)
    os._exit(code_of_signal(signal.SIGINT))


def _interrupt() -> None:
    if sys.platform == "win32":
        signal.raise_signal(signal.SIGINT)
    else:  # this also ends a sleep of the main thread
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)


if __name__ == "__main__":
    run(sys.argv[1:])
