"""Fixtures for the tests of sweeps: workers that are started once, and leaves that depend on the seed."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from btcore.cli.main import main

ROOT = Path(__file__).parents[3]

CLUSTER = """
import dask
from distributed import LocalCluster

if __name__ == "__main__":
    dask.config.set({"distributed.scheduler.allowed-failures": 0})
    # The profiler would sample each worker 100 times a second.
    dask.config.set({"distributed.worker.profile.enabled": False})
    cluster = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0")
    print(cluster.scheduler_address, flush=True)
    input()
    cluster.close()
"""

LIBRARY = '''
import os
import random
import signal
import time
from pathlib import Path

from btcore import In, Put, StatefulAction, Status, action, condition


@condition
def succeed_by_chance(rng: random.Random, probability: In[float] = 0.5) -> bool:
    """Succeed with *probability*, depending on the seed of the run."""
    return rng.random() < probability


class Walk(StatefulAction):
    """Succeed after a random number of ticks, at most *max_ticks*, depending on the seed of the run."""

    max_ticks: In[int] = 9

    def __init__(self, rng: random.Random) -> None:
        self.rng = rng

    def on_start(self) -> Status:
        self.left = self.rng.randint(1, self.max_ticks)
        return Status.RUNNING

    def on_running(self) -> Status:
        self.left -= 1
        return Status.RUNNING if self.left > 0 else Status.SUCCESS


@action
def raise_error(when: In[bool]) -> bool:
    print("printed by the leaf")
    if when:
        raise ValueError("raised by the leaf")
    return True


@action
def kill_worker(when: In[bool] = True, mark: In[str] = "") -> bool:
    """Kill the worker process. With *mark*, create the file *mark*, and do nothing if it exists already."""
    if when and not (mark and Path(mark).exists()):
        if mark:
            Path(mark).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return True


@action
def wait_seconds(seconds: In[float] = 0.05) -> bool:
    """Take real time, as a simulation does, but no processor time, which other tests need."""
    time.sleep(seconds)
    return True


@action
def wait_after(count: In[int], calls: In[str]) -> bool:
    """Create a file in the folder *calls*. If there are more than *count*, wait for the file go_on there."""
    Path(calls, f"{os.getpid()} {time.monotonic_ns()}").touch()
    while len(os.listdir(calls)) > count and not Path(calls, "go_on").exists():
        time.sleep(0.02)
    return True
'''


def environment() -> dict[str, str]:
    paths = [str(ROOT), os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths)), "COLUMNS": "110"}


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """Start a Dask scheduler with two workers, and provide its address.

    They need a tenth of a core even when nothing happens, so that they end with the module.
    """
    pytest.importorskip("distributed")
    with subprocess.Popen(
        [sys.executable, "-c", CLUSTER],
        env=environment(),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        assert process.stdout is not None
        yield process.stdout.readline().strip()
        process.communicate("\n")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Change to an empty folder that contains only the node library leaves.py."""
    (tmp_path / "leaves.py").write_text(LIBRARY, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "110")
    monkeypatch.delenv("BTCORE_DEBUG", raising=False)
    return tmp_path


@pytest.fixture
def tree(folder: Path) -> Callable[[str], str]:
    """Write a tree into a file; the argument is the content of its BehaviorTree."""

    def write(body: str) -> str:
        (folder / "tree.xml").write_text(
            f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>', encoding="utf-8"
        )
        return "tree.xml"

    return write


@pytest.fixture
def sweep(folder: Path) -> Callable[..., Result]:
    """Call ``btcore sweep`` with the node library."""

    def call(*words: str) -> Result:
        arguments = ["sweep", *words, "--plugin", str(folder / "leaves.py")]
        return CliRunner().invoke(main, arguments, prog_name="btcore")

    return call
