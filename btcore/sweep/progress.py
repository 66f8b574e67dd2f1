"""The bar on stderr while a sweep runs; without a terminal there is none."""

from collections.abc import Iterable
from types import TracebackType
from typing import Final

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text

from btcore.cli import terminal

_MOST_WARNINGS: Final = 10


class Bar:
    """How far a sweep called *name* is: *done* of *total* episodes when it begins."""

    def __init__(self, name: str, total: int, done: int) -> None:
        self.console: Console = terminal.stderr_console()
        self._said: set[str] = set()
        self._bad = 0
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
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()

    def advance(self, success: bool, workers: int) -> None:
        """One more is done."""
        self._bad += not success
        state = f"[red]{self._bad} ✘[/] " if self._bad else ""
        state += f"[dim]{workers} worker{'s' * (workers != 1)}[/]"
        self._bar.update(self._task, advance=1, state=state)

    def warn(self, sentences: Iterable[str]) -> None:
        """Print each warning of *sentences* that wasn't yet printed, above the bar."""
        for sentence in sentences:
            if sentence not in self._said and len(self._said) < _MOST_WARNINGS:
                self._said.add(sentence)
                self.console.print(Text.assemble(("warning: ", "bold yellow"), sentence), soft_wrap=True)
