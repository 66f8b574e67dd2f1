"""What leaves log while a tree runs, as lines of their own above the live line."""

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
    """Prints what is logged on *console*: a line each, WARNING and worse with the word in front."""

    def __init__(self, console: Console) -> None:
        super().__init__()
        self.console = console

    def emit(self, record: logging.LogRecord) -> None:
        """Print *record*; one that can't be written is told of as `logging` does."""
        try:
            word, style = next((word, style) for level, word, style in _WORDS if record.levelno >= level)
            self.console.print(Text.assemble((word, style), self.format(record)), soft_wrap=True)
        except Exception:
            self.handleError(record)


@contextmanager
def log_to_console(console: Console) -> Iterator[None]:
    """Within it warnings that are logged appear on *console*, unless the program has set up logging itself.

    The same console carries the live line, which stays below.
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
