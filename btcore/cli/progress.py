"""The output of `btcore run` on stderr during the run: a live status line, and log messages above it."""

import logging
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

from rich.console import Console
from rich.text import Text

from btcore.cli import terminal
from btcore.clock import NS_PER_S
from btcore.escaping import escape_controls
from btcore.status import Status
from btcore.tree.tree import Tree

if TYPE_CHECKING:
    from rich.live import Live

_LIVE_INTERVAL_S: Final = 0.1  # real time between two updates of the live line
_PLAIN_INTERVAL_S: Final = 10.0  # real time between two lines if stderr is not a terminal


class Progress:
    """The live status line of a run. If stderr is not a terminal, a plain line every 10 s.

    Args:
        console: Prints the line.
        name: The name of the run.
        duration: The limit of the run (s of the tree's clock), or None.
    """

    def __init__(self, console: Console, tree: Tree, name: str, duration: float | None) -> None:
        self.tree = tree
        self.name = name
        self.duration = duration
        self.console = console
        self.live: Live | None = None
        self._start_ns = tree.clock.now()
        self._wall_start_s = self._updated_s = time.perf_counter()
        self.line = Text()
        self._breakpoint_hook = sys.breakpointhook
        self._open()

    def _open(self) -> None:
        if self.console.is_terminal:
            from rich.live import Live  # not for a pipe

            self.live = Live(console=self.console, auto_refresh=False, transient=True)
            self.live.start()
            sys.breakpointhook = self._start_debugger

    def on_tick(self, status: Status) -> None:
        """Update the line after a tick that returned *status*, unless the last update is too recent."""
        now = time.perf_counter()
        if now - self._updated_s < (_LIVE_INTERVAL_S if self.live is not None else _PLAIN_INTERVAL_S):
            return
        self._updated_s = now
        self._show(self._format_line(status, now - self._wall_start_s))

    def set_tree(self, tree: Tree) -> None:
        """Show *tree*, which replaces the previous tree of the run."""
        self.tree = tree
        self.line = Text()

    def show_waiting(self, status: Status | None, file: str) -> None:
        """Show that the tree has ended and that the run waits for the next save of its file.

        Args:
            status: The last status of the tree; None if a leaf raised an exception.
        """
        line = Text.assemble(
            terminal.format_status(status), "  ", (self.name, "bold"), f"  tick {self.tree.ticks}"
        )
        line.append(f"  waiting for a new version of {file}", style="dim")
        self._show(line)

    @contextmanager
    def suspend(self) -> Iterator[None]:
        """Return a context in which the line is hidden, so that other output can be printed."""
        self.close()  # a rich display must not be active while other output is printed
        try:
            yield
        finally:
            self._open()
            if self.live is not None:
                self.live.update(self.line, refresh=True)

    def _show(self, line: Text) -> None:
        self.line = line
        if self.live is not None:
            self.live.update(line, refresh=True)
        else:
            self.console.print(line, soft_wrap=True)

    def close(self) -> None:
        """Remove the line."""
        if self.live is not None:
            self.live.stop()
            self.live = None
            sys.breakpointhook = self._breakpoint_hook

    def _start_debugger(self, *arguments: Any, **options: Any) -> Any:
        """Remove the line, which would cover the debugger's prompt, and start the debugger in the caller."""
        self.close()
        if self._breakpoint_hook is sys.__breakpointhook__ and "PYTHONBREAKPOINT" not in os.environ:
            import pdb  # a debugger is rarely needed, and slow to import

            # The hook would stop in its caller, which is this function.
            return pdb.Pdb().set_trace(sys._getframe().f_back)
        return self._breakpoint_hook(*arguments, **options)

    def _format_line(self, status: Status, wall_s: float) -> Text:
        elapsed = (self.tree.clock.now() - self._start_ns) / NS_PER_S
        line = Text.assemble(terminal.format_status(status), "  ", (self.name, "bold"), f"  {elapsed:.1f}")
        line.append(" s" if self.duration is None else f" / {self.duration:g} s")
        line.append(f"  tick {self.tree.ticks}  ×{elapsed / max(wall_s, 1e-9):.1f}", style="dim")
        # Escaped before the line is truncated.
        leaves = [
            escape_controls(node.name, one_line=True)
            for node in self.tree.nodes
            if node._status is Status.RUNNING and not node.children
        ]
        if leaves:
            line.append("  ▸ ", style="dim")
            line.append(", ".join(leaves), style="yellow")
        # A line that wraps would leave its first part on the screen when it is updated.
        line.truncate(max(20, self.console.width - 1), overflow="ellipsis")
        return line


class ConsoleLogHandler(logging.Handler):
    """A handler that prints each log record on *console*; warnings and errors have a coloured prefix."""

    def __init__(self, console: Console) -> None:
        super().__init__()
        self.console = console

    def emit(self, record: logging.LogRecord) -> None:
        """Print *record*. Errors in formatting or printing are reported by `logging.Handler.handleError`."""
        try:
            text = self.format(record)
            if record.levelno >= logging.ERROR:
                terminal.print_error(text, self.console)
            elif record.levelno >= logging.WARNING:
                terminal.print_warning(text, self.console)
            else:
                self.console.print(Text(text), soft_wrap=True)
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
