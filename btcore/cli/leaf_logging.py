"""Printing the log messages of leaves during a run, above the live status line."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from rich.console import Console
from rich.text import Text

_WORDS: Final = (
    (logging.ERROR, "error: ", "bold red"),
    (logging.WARNING, "warning: ", "bold yellow"),
    (logging.NOTSET, "", ""),
)


class ConsoleLogHandler(logging.Handler):
    """A handler that prints each log record on *console*; warnings and errors have a coloured prefix."""

    def __init__(self, console: Console) -> None:
        super().__init__()
        self.console = console

    def emit(self, record: logging.LogRecord) -> None:
        """Print *record*; errors of formatting or printing are reported as `logging` reports them."""
        try:
            word, style = next((word, style) for level, word, style in _WORDS if record.levelno >= level)
            self.console.print(Text.assemble((word, style), self.format(record)), soft_wrap=True)
        except Exception:
            self.handleError(record)


@contextmanager
def log_to_console(console: Console) -> Iterator[None]:
    """Return a context in which logged warnings and errors appear on *console*.

    If the root logger already has a handler, the program has configured logging itself: nothing changes.
    *console* must be the console of the live status line, so that messages appear above that line.
    """
    root = logging.getLogger()
    if root.handlers:
        yield
        return
    handler = ConsoleLogHandler(console)
    root.addHandler(handler)
    try:
        yield
    finally:
        root.removeHandler(handler)
