"""Fixtures: the trees of the captures, commands in separate processes, and waiting for conditions."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import btcore
from btcore import In, Observer, Out, Registry, SimClock, StatefulAction, Status
from btcore.engine.observers import Transitions

ROOT = Path(__file__).parents[2]

LIMIT = 60.0
"""The longest wait (s) for a condition, on a slow machine."""

ENDLESS = """
<root BTCPP_format="4">
  <BehaviorTree ID="Endless">
    <KeepRunningUntilFailure>
      <Sequence>
        <Script code="n:=1"/>
        <AlwaysSuccess name="step"/>
        <Fallback><AlwaysFailure/><AlwaysSuccess/></Fallback>
      </Sequence>
    </KeepRunningUntilFailure>
  </BehaviorTree>
</root>
"""


FORMAT_3 = """
<root main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <Sequence name="root_seq">
      <SetBlackboard output_key="x" value="42"/>
      <Fallback>
        <AlwaysFailure/>
        <Count name="cnt" ticks="3" out="{val}"/>
      </Fallback>
      <SubTree ID="Sub"/>
      <SubTreePlus ID="Sub"/>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="Sub">
    <Sequence><Count ticks="2" out="{o2}"/></Sequence>
  </BehaviorTree>
</root>
"""


class Count(StatefulAction):
    """RUNNING until ticked *ticks* times."""

    ticks: In[int] = 2
    out: Out[float]

    def on_start(self) -> Status:
        self.so_far = 0
        return self.on_running()

    def on_running(self) -> Status:
        self.so_far += 1
        self.out = 1.5 * self.so_far
        return Status.SUCCESS if self.so_far >= self.ticks else Status.RUNNING


@pytest.fixture
def sample(recorded_tree: Callable[[str], str]) -> btcore.Tree:
    """The tree of the captures, on simulated time."""
    nodes = Registry.standard()
    nodes.add(Count)
    source = recorded_tree('<Script code="loc:=target"/><Count ticks="2" out="{o2}"/>')
    return btcore.loads(source, nodes=nodes, resources=[SimClock()])


@pytest.fixture
def sample3() -> btcore.Tree:
    """The tree that the captures of BehaviorTree.CPP 3 were made with, on simulated time."""
    nodes = Registry.standard()
    nodes.add(Count)
    return btcore.loads(FORMAT_3, nodes=nodes, resources=[SimClock()])


@pytest.fixture
def endless() -> btcore.Tree:
    """A tree that is always RUNNING, with about ten transitions per tick."""
    return btcore.loads(ENDLESS, resources=[SimClock()])


class Changes(Observer):
    """The number *count* of a tree's transitions since the object was created."""

    def __init__(self, tree: btcore.Tree) -> None:
        self.count = 0
        tree.subscribe(self)

    def transitions(self, changes: Transitions) -> None:
        self.count += len(changes)


@pytest.fixture
def changes() -> type[Changes]:
    """``changes(tree).count``: the number of a tree's transitions since the call."""
    return Changes


@pytest.fixture
def until() -> Callable[..., None]:
    """Return a function that calls a function until the result is true, for at most a minute."""

    def until(condition: Callable[[], object], what: str = "") -> None:
        deadline = time.monotonic() + LIMIT
        while not condition():
            assert time.monotonic() < deadline, f"not within {LIMIT:g} s: {what}"
            time.sleep(0.002)

    return until


class Command:
    """``btcore …`` in a separate process; *stderr_text* is its output on stderr so far."""

    def __init__(self, *arguments: object, folder: Path) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "btcore", *map(str, arguments)],
            cwd=folder,
            env={
                **os.environ,
                "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "monitor"), str(ROOT / "tools")]),
            },
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.stderr_text = ""
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self.stderr_text += line

    def wait_for(self, pattern: str) -> re.Match[str]:
        """Wait for text on stderr that matches *pattern*, and return the match."""
        deadline = time.monotonic() + 200
        while not (match := re.search(pattern, self.stderr_text)):
            assert self.process.poll() is None, self.stderr_text
            assert time.monotonic() < deadline, self.stderr_text
            time.sleep(0.02)
        return match

    def end(self, number: signal.Signals | None = None) -> int:
        """Send the signal *number* unless it is None, wait for the end, and return the exit code."""
        if number is not None:
            self.process.send_signal(number)
        code = self.process.wait(200)
        self._reader.join(20)
        assert not self._reader.is_alive(), "a process that the command started has not ended"
        return code


@pytest.fixture
def command(tmp_path: Path) -> Iterator[Callable[..., Command]]:
    """Return a function that starts ``btcore …`` in the test's folder."""
    started: list[Command] = []

    def start(*arguments: object) -> Command:
        started.append(Command(*arguments, folder=tmp_path))
        return started[-1]

    yield start
    for command in started:
        if command.process.poll() is None:
            command.process.terminate()
        try:
            command.end()
        except subprocess.TimeoutExpired:
            command.process.kill()
            command.end()
        assert command.process.stderr is not None
        command.process.stderr.close()


@pytest.fixture
def no_threads_left() -> Iterator[None]:
    """Check after the test that no publisher's thread is running."""
    yield
    names = ("btcore-publisher", "btcore-gateway")
    assert not [thread.name for thread in threading.enumerate() if thread.name in names]
