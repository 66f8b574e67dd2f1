"""Playing the episodes of a sweep that are not yet done."""

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
    """By what episodes are played: *workers* processes here (None: one a core), or those of a *scheduler*.

    Each is tried *attempts* times if its worker dies.
    """

    workers: int | None
    scheduler: str | None
    attempts: int

    def open(self, folder: Path) -> "AbstractContextManager[Workers]":
        """The workers; those here write what they print into *folder*."""
        # Here and not above: whoever asks for help, or is wrong, has not to wait for it.
        from btcore.sweep.cluster import local, remote

        if self.scheduler is not None:
            return remote(self.scheduler, self.attempts)
        return local(self.workers, self.attempts, folder)


class ExecutionSummary(NamedTuple):
    """How it went: whether Ctrl-C ended it, how many episodes were played, in which *wall* time (s).

    *busy* is the part of the workers' time in which they played, their start included; *workers* is how many
    there were at the end, *deaths* how many died.
    """

    interrupted: bool = False
    episodes: int = 0
    wall: float = 0.0
    workers: int = 0
    deaths: int = 0
    busy: float = 0.0


def run_sweep(journal: Journal, script: Program | None, means: WorkerOptions) -> ExecutionSummary:
    """Play what *journal* doesn't have, and write it there, until all is done or Ctrl-C.

    Raises :class:`click.UsageError` for a setting that can't be run with its first seed.
    """
    sweep = journal.definition
    todo = [number for number in range(len(sweep)) if number not in journal.done]
    if not todo:
        return ExecutionSummary()
    for record in journal.done.values():
        success.is_success(table.row(sweep.episode(record["episode"]), record), script)
    began = time.perf_counter()
    with (
        _stoppable() as stopped,
        Bar(Path(sweep.tree).stem, len(sweep), len(journal.done)) as bar,
        means.open(journal.folder) as workers,
    ):
        count, played = 0, 0.0
        for episode, result in workers.run_episodes((sweep.episode(number) for number in todo), stopped):
            record = _record(episode, result)
            _check(record, episode, sweep)
            bar.warn(record.pop("said", ()))
            journal.add(record)
            count += 1
            played += record.get("wall_s", 0.0)
            bar.advance(success.is_success(table.row(episode, record), script), workers.count)
        wall = time.perf_counter() - began
        busy = played / (wall * max(workers.count, 1))
        return ExecutionSummary(stopped(), count, wall, workers.count, workers.deaths, busy)


def _record(episode: Episode, result: object) -> Record:
    """What the journal gets of what came of *episode*."""
    if isinstance(result, dict):
        return {"episode": episode.number, **result}
    times = result[0] if isinstance(result, tuple) else 0
    return {"episode": episode.number, "code": None, "report": None, "killed": times}


def _check(record: Record, episode: Episode, sweep: SweepDefinition) -> None:
    """A mistake that the first seed shows is in the setting: nobody wants to see it a thousand times."""
    if record["code"] == ExitCode.USER_ERROR and episode.number < len(sweep.settings):
        told = f"\n({setting(episode.values)})" if episode.values else ""
        raise click.UsageError(f"{record['fault']}{told}")


@contextmanager
def _stoppable() -> Iterator[Callable[[], bool]]:
    """What ends a process only makes the callable true, the first time."""
    heard = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield heard.is_set
        return

    def handler(number: int, frame: FrameType | None) -> None:
        if heard.is_set():
            raise KeyboardInterrupt
        heard.set()

    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [(number, signal.signal(number, handler)) for number in numbers]
    try:
        yield heard.is_set
    finally:
        for number, earlier in before:
            signal.signal(number, earlier)
