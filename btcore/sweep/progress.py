"""The progress bar of a sweep on stderr."""

from collections.abc import Iterable
from types import TracebackType
from typing import Final

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text

from btcore.cli import terminal

_MAX_WARNINGS: Final = 10


class Bar:
    """The progress bar of a sweep; without a terminal only warnings are printed.

    Args:
        name: The name of the sweep.
        total: The number of episodes.
        done: The number of episodes that are already finished.
    """

    def __init__(self, name: str, total: int, done: int) -> None:
        self.console: Console = terminal.stderr_console()
        self._printed: set[str] = set()
        self._failed = 0
        self._bar = Progress(
            TextColumn("[bold]{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[state]}"),
            TimeRemainingColumn(),
            console=self.console,
            transient=True,
            disable=not self.console.is_terminal,
        )
        self._task = self._bar.add_task(name, total=total, completed=done, state="starting workers")

    def __enter__(self) -> "Bar":
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()

    def advance(self, success: bool, workers: int) -> None:
        """Advance the bar by an episode.

        Args:
            success: Whether the episode was a success.
            workers: The current number of workers.
        """
        self._failed += not success
        state = f"[red]{self._failed} ✘[/] " if self._failed else ""
        state += f"[dim]{workers} worker{'s' * (workers != 1)}[/]"
        self._bar.update(self._task, advance=1, state=state)

    def warn(self, warnings: Iterable[str]) -> None:
        """Print *warnings* above the bar, each only once."""
        for warning in warnings:
            if warning not in self._printed and len(self._printed) < _MAX_WARNINGS:
                self._printed.add(warning)
                self.console.print(Text.assemble(("warning: ", "bold yellow"), warning), soft_wrap=True)
