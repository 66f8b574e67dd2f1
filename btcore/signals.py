"""Handlers of the signals that end a process: Ctrl-C, SIGTERM and SIGHUP (the terminal was closed)."""

import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from types import FrameType


def ending_signals() -> list[signal.Signals]:
    """Return the signals that end a run: SIGINT, SIGTERM and SIGHUP."""
    numbers = [signal.SIGINT, signal.SIGTERM]
    # Windows has no SIGHUP; nohup sets it to SIG_IGN, so that the run survives the terminal.
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    return numbers


@contextmanager
def signal_handlers(
    numbers: Iterable[signal.Signals], handler: Callable[[int, FrameType | None], None]
) -> Iterator[None]:
    """Return a context in which *handler* handles the signals *numbers*.

    Outside the main thread, where Python allows no signal handlers, the context has no effect.
    """
    in_main_thread = threading.current_thread() is threading.main_thread()
    before = {number: signal.signal(number, handler) for number in numbers if in_main_thread}
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)
