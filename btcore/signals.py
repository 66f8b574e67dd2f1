"""The signals that end a process: Ctrl-C, SIGTERM and SIGHUP (the terminal was closed)."""

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from types import FrameType
from typing import Self

from btcore.exit_codes import code_of_signal

NEW_PROCESS_GROUP = 0
"""The argument `creationflags` of `subprocess.Popen` with which Ctrl-C in the console does not end a child
process on Windows. Elsewhere `start_new_session`, which Windows ignores, has this effect."""

if sys.platform == "win32":
    import subprocess

    NEW_PROCESS_GROUP = subprocess.CREATE_NEW_PROCESS_GROUP


class EndingSignals:
    """Handles SIGINT (Ctrl-C), SIGTERM and SIGHUP in a `with` block.

    The first signal calls `stop`, which lets the present work end as usual. A second signal, or one while
    `stop` is None, raises KeyboardInterrupt. That of SIGTERM or SIGHUP leaves the block as SystemExit: within
    the block, an exit would be taken for an error of the leaf that is just ticked.

    Attributes:
        stop: Called by the first signal, or None; it may be changed in the `with` block.
        number: The number of the first signal, or 0.
    """

    def __init__(self, stop: Callable[[], object] | None = None) -> None:
        self.stop = stop
        self.number = 0
        self._raised = 0
        self._handlers: AbstractContextManager[None]

    def __enter__(self) -> Self:
        self._handlers = _install_handler(self._handle)
        self._handlers.__enter__()
        return self

    def __exit__(self, error_type: object, error: BaseException | None, trace: object) -> None:
        self._handlers.__exit__(None, None, None)
        if isinstance(error, KeyboardInterrupt) and self._raised not in (0, signal.SIGINT):
            raise SystemExit(code_of_signal(self._raised)) from None

    def _handle(self, number: int, frame: FrameType | None) -> None:
        is_first = self.number == 0
        self.number = self.number or number
        if is_first and self.stop is not None:
            self.stop()
        else:
            self._raised = number
            raise KeyboardInterrupt


@contextmanager
def delayed_signals() -> Iterator[None]:
    """Return a context that delays SIGINT, SIGTERM and SIGHUP until its end.

    An exception of their handlers would leave a process behind that is just being started.
    """
    received: list[int] = []
    try:
        with _install_handler(lambda number, frame: received.append(number)):
            yield
    finally:
        if received:
            signal.raise_signal(received[0])


@contextmanager
def _install_handler(handler: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """Return a context in which *handler* handles SIGINT, SIGTERM and SIGHUP.

    Outside the main thread, where Python allows no signal handlers, the context has no effect.
    """
    numbers = [signal.SIGINT, signal.SIGTERM]
    # Windows has no SIGHUP; nohup sets it to SIG_IGN, so that the process survives the terminal.
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    in_main_thread = threading.current_thread() is threading.main_thread()
    before = {number: signal.signal(number, handler) for number in numbers if in_main_thread}
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)
