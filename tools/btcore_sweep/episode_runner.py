"""Running the unfinished episodes of a sweep, with a progress bar."""

import threading
import time
from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import click
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text

from btcore.cli import terminal
from btcore.exit_codes import ExitCode
from btcore.script.program import Program
from btcore.signals import EndingSignals
from btcore.suggestions import counted
from btcore_sweep import table
from btcore_sweep.definition import Episode, SweepDefinition, format_combination
from btcore_sweep.sweep_folder import Record, SweepFolder

if TYPE_CHECKING:
    from btcore_sweep.cluster import Workers


_MAX_WARNINGS: Final = 10


class ExecutionSummary(NamedTuple):
    """The result of `run_sweep`.

    Attributes:
        signal: The number of the signal that ended the sweep, or 0.
        episodes: The number of episodes that were run.
        wall: The duration in s of real time, including the start of the workers.
        workers: The number of workers at the end.
        deaths: The number of workers that died while they ran an episode.
        busy: The fraction of *wall* that the workers spent running episodes.
    """

    signal: int = 0
    episodes: int = 0
    wall: float = 0.0
    workers: int = 0
    deaths: int = 0
    busy: float = 0.0


def run_sweep(
    folder: SweepFolder,
    script: Program | None,
    pool: "AbstractContextManager[Workers]",
    must_record: bool = False,
) -> ExecutionSummary:
    """Run the episodes that are not finished yet, and add each of them to the folder.

    Ctrl-C, SIGTERM or SIGHUP ends the sweep early.

    Args:
        folder: The folder of the sweep, entered as a context manager.
        script: The condition for a success, or None.
        pool: A context with the workers, which is entered if there are episodes to run.
        must_record: Whether to keep the recordings of the episodes without success.

    Raises:
        click.UsageError: A combination of parameter values cannot be run with the first seed, or *script*
            uses an unknown column.
        click.ClickException: The workers cannot be reached, or cannot run episodes.
    """
    sweep = folder.definition
    todo = [number for number in range(len(sweep)) if number not in folder.done]
    if not todo:
        return ExecutionSummary()
    # If there are finished episodes, an error in the script is reported before workers are started.
    for record in folder.done.values():
        table.create_row(sweep.episode(record["episode"]), record, script)

    def recording_arguments(episode: Episode) -> Sequence[str]:
        # Only the script tells which episodes to keep.
        record_on = "failure" if script is None else "always"
        return (str(folder.recording(episode.number).resolve()), record_on) if must_record else ()

    began = time.perf_counter()
    stopped = threading.Event()
    with (
        EndingSignals(stopped.set) as signals,
        _Bar(Path(sweep.tree).stem, len(sweep), len(folder.done)) as bar,
        pool as workers,
    ):
        count, episode_time = 0, 0.0
        episodes = (sweep.episode(number) for number in todo)
        for episode, result in workers.run_episodes(episodes, stopped.is_set, recording_arguments):
            record = {"episode": episode.number, **result}
            _raise_user_error(record, episode, sweep)
            bar.warn(record.pop("warnings", ()))
            folder.add(record)
            count += 1
            episode_time += record.get("wall_s", 0.0)
            success = table.create_row(episode, record, script)["success"]
            if success and must_record:
                with suppress(OSError):
                    folder.recording(episode.number).unlink()
            bar.count_episode(success, workers.count)
        wall = time.perf_counter() - began
        busy = episode_time / (wall * max(workers.count, 1))
        return ExecutionSummary(signals.number, count, wall, workers.count, workers.deaths, busy)


def _raise_user_error(record: Record, episode: Episode, sweep: SweepDefinition) -> None:
    """Raise UsageError if an episode with the first seed had a user error, which all seeds would repeat.

    An error after the start of a run, such as an event that was not possible, may be due to the seed.
    """
    had_error = record["code"] == ExitCode.USER_ERROR and not record.get("began")
    if had_error and episode.number < len(sweep.combinations):
        values = f"\n({format_combination(episode.values)})" if episode.values else ""
        raise click.UsageError(f"{record['fault']}{values}")


class _Bar(Progress):
    """The progress bar of a sweep on stderr; without a terminal only warnings are printed.

    Args:
        name: The name of the sweep.
        total: The number of episodes.
        done: The number of episodes that are already finished.
    """

    def __init__(self, name: str, total: int, done: int) -> None:
        console = terminal.stderr_console()
        super().__init__(
            TextColumn("[bold]{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[state]}"),
            TimeRemainingColumn(),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        )
        self._printed: set[str] = set()
        self._failed = 0
        self._task = self.add_task(name, total=total, completed=done, state="starting workers")

    def count_episode(self, success: bool, workers: int) -> None:
        """Advance the bar by an episode.

        Args:
            success: Whether the episode was a success.
            workers: The current number of workers.
        """
        self._failed += not success
        state = f"[red]{self._failed} ✘[/] " if self._failed else ""
        state += f"[dim]{counted(workers, 'worker')}[/]"
        self.update(self._task, advance=1, state=state)

    def warn(self, warnings: Iterable[str]) -> None:
        """Print *warnings* above the bar, each only once."""
        for warning in warnings:
            if warning not in self._printed and len(self._printed) < _MAX_WARNINGS:
                self._printed.add(warning)
                text = Text.assemble(("warning: ", "bold yellow"), warning)
                self.console.print(text, soft_wrap=True)
