"""Running the unfinished episodes of a sweep."""

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, NamedTuple

import click

from btcore.cli.exit_codes import ExitCode
from btcore.script.program import Program
from btcore.sweep import success, table
from btcore.sweep.definition import Episode, SweepDefinition, setting
from btcore.sweep.journal import Journal, Record
from btcore.sweep.progress import Bar

if TYPE_CHECKING:
    from btcore.sweep.cluster import Workers


class WorkerOptions(NamedTuple):
    """The workers to use.

    Attributes:
        workers: The number of processes on this machine; None for one process per core.
        scheduler: The address of a Dask scheduler whose workers are used instead.
        attempts: How often an episode is tried if its worker dies.
    """

    workers: int | None
    scheduler: str | None
    attempts: int

    def open(self, folder: Path) -> "AbstractContextManager[Workers]":
        """Return a context with the workers; those on this machine write their output to a file in *folder*.

        Raises:
            click.ClickException: The scheduler does not answer, or has no workers.
        """
        # Imported late, since Dask takes long to import: `--help` and usage errors must not wait for it.
        from btcore.sweep.cluster import local, remote

        if self.scheduler is not None:
            return remote(self.scheduler, self.attempts)
        return local(self.workers, self.attempts, folder)


class ExecutionSummary(NamedTuple):
    """The result of `run_sweep`.

    Attributes:
        interrupted: Whether a signal ended the sweep.
        episodes: The number of episodes that were run.
        wall: The duration in s of real time, including the start of the workers.
        workers: The number of workers at the end.
        deaths: The number of workers that died.
        busy: The fraction of *wall* that the workers spent running episodes.
    """

    interrupted: bool = False
    episodes: int = 0
    wall: float = 0.0
    workers: int = 0
    deaths: int = 0
    busy: float = 0.0


def run_sweep(journal: Journal, script: Program | None, means: WorkerOptions) -> ExecutionSummary:
    """Run the episodes that a journal lacks, and write them to it, until all are finished or Ctrl-C.

    Args:
        journal: The journal, entered as a context manager.
        script: The condition for a success, or None.
        means: The workers to use.

    Raises:
        click.UsageError: A combination of parameter values cannot be run with the first seed, or *script*
            uses an unknown column.
        click.ClickException: The workers cannot be reached, or cannot run episodes.
    """
    sweep = journal.definition
    todo = [number for number in range(len(sweep)) if number not in journal.done]
    if not todo:
        return ExecutionSummary()
    # An error in the script is reported before workers are started, if there is a row to try it on.
    for record in journal.done.values():
        success.is_success(table.row(sweep.episode(record["episode"]), record), script)
    began = time.perf_counter()
    with (
        _stoppable() as stopped,
        Bar(Path(sweep.tree).stem, len(sweep), len(journal.done)) as bar,
        means.open(journal.folder) as workers,
    ):
        count, episode_time = 0, 0.0
        for episode, result in workers.run_episodes((sweep.episode(number) for number in todo), stopped):
            record = _record(episode, result)
            _raise_user_error(record, episode, sweep)
            bar.warn(record.pop("said", ()))
            journal.add(record)
            count += 1
            episode_time += record.get("wall_s", 0.0)
            bar.advance(success.is_success(table.row(episode, record), script), workers.count)
        wall = time.perf_counter() - began
        busy = episode_time / (wall * max(workers.count, 1))
        return ExecutionSummary(stopped(), count, wall, workers.count, workers.deaths, busy)


def _record(episode: Episode, result: object) -> Record:
    """Return the journal's record of *episode*."""
    if isinstance(result, dict):
        return {"episode": episode.number, **result}
    times = result[0] if isinstance(result, tuple) else 0
    return {"episode": episode.number, "code": None, "report": None, "killed": times}


def _raise_user_error(record: Record, episode: Episode, sweep: SweepDefinition) -> None:
    """Raise a user error of an episode with the first seed: the other seeds would have the same error."""
    if record["code"] == ExitCode.USER_ERROR and episode.number < len(sweep.settings):
        values = f"\n({setting(episode.values)})" if episode.values else ""
        raise click.UsageError(f"{record['fault']}{values}")


@contextmanager
def _stoppable() -> Iterator[Callable[[], bool]]:
    """Return a context with a function that returns whether SIGINT or SIGTERM was received.

    A second signal raises KeyboardInterrupt. Outside the main thread, where Python allows no signal handlers,
    signals have their usual effect.
    """
    stopped = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stopped.is_set
        return

    def handler(number: int, frame: FrameType | None) -> None:
        if stopped.is_set():
            raise KeyboardInterrupt
        stopped.set()

    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [(number, signal.signal(number, handler)) for number in numbers]
    try:
        yield stopped.is_set
    finally:
        for number, earlier in before:
            signal.signal(number, earlier)
