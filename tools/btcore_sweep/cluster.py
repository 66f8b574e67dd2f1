"""The workers that run episodes: processes on this machine, or the workers of a Dask scheduler."""

import faulthandler
import logging
import math
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from pathlib import Path
from queue import Empty, SimpleQueue
from time import monotonic
from typing import Final
from uuid import uuid4

import click
import dask
from dask.system import CPU_COUNT
from distributed import Client, Future, KilledWorker, LocalCluster

from btcore_sweep.definition import Episode
from btcore_sweep.episode import Result, run_episode

LOG: Final = "workers.log"
LOG_VARIABLE: Final = "BTCORE_SWEEP_LOG"

_CONNECT_TIMEOUT_S: Final = 30.0  # for connecting to a scheduler, and again for its first worker
_STOP_INTERVAL_S: Final = 0.1  # between two checks whether to stop
_COUNT_INTERVAL_S: Final = 2.0  # between two counts of the workers

_CONFIGURATION: Final = {
    # Dask must report each death of a worker: `Workers` counts the attempts itself.
    "distributed.scheduler.allowed-failures": 0,
    # Never pause workers, and never write results to disk: results are small.
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    # The profiler samples each worker 100 times a second, for a dashboard that is not served.
    "distributed.worker.profile.enabled": False,
}


class Workers:
    """The workers of a Dask client.

    Args:
        attempts: The maximum number of runs of an episode whose worker dies.
    """

    def __init__(self, client: Client, attempts: int) -> None:
        self.client = client
        self.attempts = attempts
        self.count = 0
        """The number of workers when they were last counted."""
        self.deaths = 0
        """The number of workers that have died while they ran an episode."""
        self._counted = -math.inf
        self._folder = str(Path.cwd())
        self._session = uuid4().hex[:8]
        self._finished: SimpleQueue[Future] = SimpleQueue()
        self._running: dict[str, tuple[Episode, Future]] = {}
        self._again: list[Episode] = []
        self._killed: dict[int, int] = {}

    def run_episodes(
        self,
        episodes: Iterator[Episode],
        stopped: Callable[[], object],
        recording_arguments: Callable[[Episode], Sequence[str]],
    ) -> Iterator[tuple[Episode, Result]]:
        """Run episodes in parallel, and yield each with its result as soon as it is finished.

        At any time, no more episodes are submitted than there are workers, so that the death of a worker
        affects a single episode. If the worker died in every attempt, the result contains the number of
        deaths under the key `killed`.

        Args:
            episodes: The episodes to run.
            stopped: Called at least every 0.1 s. When it returns a true value, the submitted episodes are
                cancelled.
            recording_arguments: Returns the arguments of `run_episode` after the second.

        Raises:
            click.ClickException: The connection to the scheduler is lost, or a worker cannot run episodes.
        """
        while not stopped():
            self._count()
            self._submit(episodes, recording_arguments)
            if not self._running and self.count:
                return
            try:
                future = self._finished.get(timeout=_STOP_INTERVAL_S)
            except Empty:
                continue
            episode, _ = self._running.pop(future.key)
            # Before the result is processed, so that no worker is idle in the meantime.
            self._submit(episodes, recording_arguments)
            result = self._result(future, episode)
            if result is not None:
                yield episode, result
        self.client.cancel([future for _, future in self._running.values()])

    def _count(self) -> None:
        if monotonic() - self._counted >= _COUNT_INTERVAL_S:
            try:
                self.count = len(self.client.nthreads())
            except (OSError, TimeoutError) as error:
                raise _scheduler_gone() from error
            self._counted = monotonic()

    def _submit(
        self, episodes: Iterator[Episode], recording_arguments: Callable[[Episode], Sequence[str]]
    ) -> None:
        while len(self._running) < self.count:
            episode = self._again.pop() if self._again else next(episodes, None)
            if episode is None:
                return
            # Dask identifies tasks by their keys: another attempt needs another key.
            key = f"episode-{self._session}-{episode.number}-{self._killed.get(episode.number, 0)}"
            arguments = episode.command, self._folder, *recording_arguments(episode)
            future = self.client.submit(run_episode, *arguments, key=key, pure=False)
            self._running[key] = episode, future
            future.add_done_callback(self._finished.put)  # called on a thread of the client

    def _result(self, future: Future, episode: Episode) -> Result | None:
        """Return the result of *episode*, or None if the episode will be run again."""
        try:
            result: Result = future.result()
        except KilledWorker as killed:
            died = killed.allowed_failures + 1
        except CancelledError as error:
            raise _scheduler_gone() from error
        except Exception as error:
            raise click.ClickException(
                f"a worker cannot run episodes: {type(error).__name__}: {error}. Check that it has the same "
                "versions of btcore and Python as this machine."
            ) from error
        else:
            return result
        self.deaths += died
        times = self._killed[episode.number] = self._killed.get(episode.number, 0) + died
        if times >= self.attempts:
            return {"code": None, "report": None, "killed": times}
        self._again.append(episode)
        return None


@contextmanager
def local(count: int | None, attempts: int, folder: Path) -> Iterator[Workers]:
    """Return a context with worker processes on this machine.

    Args:
        count: The number of processes; None for one process per core that this process may use.
        attempts: The maximum number of runs of an episode whose worker dies.
        folder: The folder of the file to which the workers' output is redirected.
    """
    _silence_dask()
    environment = {LOG_VARIABLE: str((folder / LOG).resolve())}
    with (
        dask.config.set(_CONFIGURATION),
        LocalCluster(
            n_workers=count if count is not None else CPU_COUNT,
            threads_per_worker=1,
            processes=True,
            # Without an address the scheduler's HTTP server takes port 8787, on every interface.
            dashboard_address="127.0.0.1:0",
            scheduler_kwargs={"dashboard": False},
            worker_dashboard_address=None,
            silence_logs=logging.CRITICAL,
            host="127.0.0.1",
            preload=__name__,  # Dask calls `dask_setup` in each worker
            env=environment,
        ) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        yield Workers(client, attempts)


@contextmanager
def remote(address: str, attempts: int) -> Iterator[Workers]:
    """Return a context with the workers of a Dask scheduler.

    Args:
        address: The address of the scheduler.
        attempts: The maximum number of runs of an episode whose worker dies.

    Raises:
        click.ClickException: There is no scheduler at *address*, or it has no workers.
    """
    _silence_dask()
    try:
        client = Client(address, timeout=_CONNECT_TIMEOUT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise click.ClickException(
            f"--scheduler {address}: no Dask scheduler answers ({error}). Start it with 'dask scheduler', "
            "and a worker on each machine with 'dask worker ADDRESS --nthreads 1'."
        ) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=_CONNECT_TIMEOUT_S)
        except TimeoutError as error:
            raise click.ClickException(
                f"--scheduler {address}: the scheduler has no workers; start one with 'dask worker {address} "
                "--nthreads 1'."
            ) from error
        yield Workers(client, attempts)


def dask_setup(worker: object) -> None:
    """Set up a worker process on this machine: ignore Ctrl-C, and redirect the output to the sweep's log.

    Ctrl-C is handled by the main process. Dask calls this function by its name.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    log = os.environ.get(LOG_VARIABLE)
    if log:
        # The file descriptors are replaced, not sys.stdout: C libraries and faulthandler write to them too.
        file = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND | getattr(os, "O_BINARY", 0), 0o666)
        os.dup2(file, 1)
        os.dup2(file, 2)
        os.close(file)
        faulthandler.enable()


def _silence_dask() -> None:
    """Suppress Dask's log messages: `Workers` reports deaths of workers and the loss of the scheduler."""
    logging.getLogger("distributed").setLevel(logging.CRITICAL)


def _scheduler_gone() -> click.ClickException:
    return click.ClickException(
        "the Dask scheduler is gone. Finished episodes are kept: run the same command again to continue."
    )
