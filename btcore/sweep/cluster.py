"""The workers that play episodes: processes on this machine, one a core, or those of a Dask scheduler."""

import logging
import math
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from pathlib import Path
from queue import Empty, SimpleQueue
from time import monotonic
from typing import Final, NamedTuple
from uuid import uuid4

import click
import dask
from dask.system import CPU_COUNT
from distributed import Client, Future, KilledWorker, LocalCluster

from btcore.sweep.definition import Episode
from btcore.sweep.episode import Result, run_episode

LOG: Final = "workers.log"
LOG_VARIABLE: Final = "BTCORE_SWEEP_LOG"

_CONNECT: Final = 30.0  # s in which a scheduler answers, and has a worker
_LOOK: Final = 0.1  # s between two looks at whether to stop
_COUNT: Final = 2.0  # s between two counts of the workers

_CONFIGURATION: Final = {
    # Each death is told: who counts them is `Workers`.
    "distributed.scheduler.allowed-failures": 0,
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    # It looks at each worker a hundred times a second, for a dashboard that isn't served.
    "distributed.worker.profile.enabled": False,
}


class Killed(NamedTuple):
    """What came of an episode whose workers died while they played it, *times* times."""

    times: int


class Workers:
    """The workers that *client* reaches. An episode is tried *attempts* times if its workers die."""

    def __init__(self, client: Client, attempts: int) -> None:
        self.client = client
        self.attempts = attempts
        self.count = 0
        """How many there were at the last look."""
        self.deaths = 0
        """How many died so far while they played."""
        self._counted = -math.inf
        self._folder = str(Path.cwd())
        self._session = uuid4().hex[:8]
        self._finished: SimpleQueue[Future] = SimpleQueue()
        self._playing: dict[str, tuple[Episode, Future]] = {}
        self._again: list[Episode] = []
        self._killed: dict[int, int] = {}

    def run_episodes(
        self, episodes: Iterator[Episode], stopped: Callable[[], bool]
    ) -> Iterator[tuple[Episode, Result | Killed]]:
        """Play *episodes*, and give each with what came of it, as soon as it has; until *stopped* says so.

        No more are handed out than there are workers, so that one that dies takes one episode with it.
        Raises :class:`click.ClickException` when the scheduler is gone or no worker can play.
        """
        while not stopped():
            self._count()
            self._hand_out(episodes)
            if not self._playing and self.count:
                return
            try:
                future = self._finished.get(timeout=_LOOK)
            except Empty:
                continue
            episode, _ = self._playing.pop(future.key)
            # Before the result is looked at: nobody has to wait for that.
            self._hand_out(episodes)
            result = self._result(future, episode)
            if result is not None:
                yield episode, result
        self.client.cancel([future for _, future in self._playing.values()])

    def _count(self) -> None:
        if monotonic() - self._counted >= _COUNT:
            try:
                self.count = len(self.client.nthreads())
            except (OSError, TimeoutError) as fault:
                raise _gone() from fault
            self._counted = monotonic()

    def _hand_out(self, episodes: Iterator[Episode]) -> None:
        while len(self._playing) < self.count:
            episode = self._again.pop() if self._again else next(episodes, None)
            if episode is None:
                return
            key = f"episode-{self._session}-{episode.number}-{self._killed.get(episode.number, 0)}"
            future = self.client.submit(run_episode, episode.command, self._folder, key=key, pure=False)
            self._playing[key] = episode, future
            future.add_done_callback(self._finished.put)

    def _result(self, future: Future, episode: Episode) -> Result | Killed | None:
        """What came of it; None: it will be played again."""
        try:
            result: Result = future.result()
        except KilledWorker as killed:
            died = killed.allowed_failures + 1
        except CancelledError as fault:
            raise _gone() from fault
        except Exception as fault:
            raise click.ClickException(
                f"a worker can't play episodes: {type(fault).__name__}: {fault}. Has it the same btcore, "
                "and Python, as this machine?"
            ) from fault
        else:
            return result
        self.deaths += died
        times = self._killed[episode.number] = self._killed.get(episode.number, 0) + died
        if times >= self.attempts:
            return Killed(times)
        self._again.append(episode)
        return None


@contextmanager
def local(count: int | None, attempts: int, folder: Path) -> Iterator[Workers]:
    """*count* processes on this machine, by default one for each core that this process may use.

    What they print, last words included, goes into a file in *folder*.
    """
    _hush()
    here = {LOG_VARIABLE: str((folder / LOG).resolve())}
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
            preload="btcore.sweep.worker",
            env=here,
        ) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        yield Workers(client, attempts)


@contextmanager
def remote(address: str, attempts: int) -> Iterator[Workers]:
    """The workers of the Dask scheduler at *address*. Raises :class:`click.ClickException` where none is."""
    _hush()
    try:
        client = Client(address, timeout=_CONNECT, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as fault:
        raise click.ClickException(
            f"--scheduler {address}: no Dask scheduler answers there ({fault}). 'dask scheduler' starts one, "
            "and 'dask worker ADDRESS --nthreads 1' a worker on each machine."
        ) from fault
    with client:
        try:
            client.wait_for_workers(1, timeout=_CONNECT)
        except TimeoutError as fault:
            raise click.ClickException(
                f"--scheduler {address}: it has no workers; 'dask worker {address} --nthreads 1' starts one."
            ) from fault
        yield Workers(client, attempts)


def _hush() -> None:
    """What Dask logs is told by us, as far as it is of use."""
    logging.getLogger("distributed").setLevel(logging.CRITICAL)


def _gone() -> click.ClickException:
    return click.ClickException(
        "the Dask scheduler is gone. What is done is kept: the same command goes on with the rest."
    )
