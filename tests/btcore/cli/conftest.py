"""Fixtures for the tests of the command line: a function that calls it, and a node library."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from btcore.cli.main import main

Cli = Callable[..., Result]
TreeFile = Callable[..., Path]
LastJson = Callable[[Result], dict[str, Any]]

LIBRARY = '''
import random
import time

from btcore import Condition, In, Put, StatefulAction, Status, action, condition


@condition
def battery_ok(level: In[float] = 0.9, minimum: In[float] = 0.2) -> bool:
    """The battery holds more than *minimum* (0–1)."""
    return level > minimum


@action
def greet(who: In[str], greeting: Put[str]) -> bool:
    """Write a greeting."""
    greeting(f"Hello, {who}")
    return True


@action
def explode() -> bool:
    raise ValueError("the fuse was lit")


class Walk(StatefulAction):
    """Walk for *steps* ticks."""

    steps: In[int] = 3

    def on_start(self) -> Status:
        self.left = self.steps
        return self.on_running()

    def on_running(self) -> Status:
        self.left -= 1
        return Status.RUNNING if self.left >= 0 else Status.SUCCESS

    def on_halted(self) -> None:
        print("halted while walking")


class EveryThird(Condition):
    def __init__(self) -> None:
        self.asked = 0

    def tick(self) -> bool:
        self.asked += 1
        return self.asked % 3 == 0


class RepeatedToss(StatefulAction):
    def __init__(self, chance: random.Random) -> None:
        self.chance = chance

    def on_start(self) -> Status:
        return self.on_running()

    def on_running(self) -> Status:
        return Status.SUCCESS if self.chance.random() < 0.1 else Status.RUNNING


class Slow(StatefulAction):
    def on_start(self) -> Status:
        time.sleep(0.05)
        return Status.RUNNING

    def on_running(self) -> Status:
        return Status.SUCCESS


@action
def say() -> bool:
    print("here we go", flush=True)
    return True


class Stubborn(StatefulAction):
    def on_start(self) -> Status:
        return Status.RUNNING

    def on_running(self) -> Status:
        return Status.RUNNING

    def on_halted(self) -> None:
        raise RuntimeError("never!")
'''


@pytest.fixture
def cli(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Cli:
    """Call the command line in a temporary folder: ``cli("run", "tree.xml")``."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "110")
    monkeypatch.delenv("BTCORE_DEBUG", raising=False)

    def call(*arguments: str | Path, input: str | bytes | None = None) -> Result:
        words = [str(argument) for argument in arguments]
        return CliRunner().invoke(main, words, input=input, prog_name="btcore")

    return call


@pytest.fixture
def library(tmp_path: Path) -> Path:
    """Write a node library into a file."""
    path = tmp_path / "robot_things.py"
    path.write_text(LIBRARY, encoding="utf-8")
    return path


@pytest.fixture
def tree_file(tmp_path: Path) -> Callable[..., Path]:
    """Write a tree of format 4 into a file; *body* is the content of its BehaviorTree."""

    def write(body: str, name: str = "tree.xml") -> Path:
        path = tmp_path / name
        path.write_text(
            f'<root BTCPP_format="4" main_tree_to_execute="Main">\n  <BehaviorTree ID="Main">\n    {body}\n'
            "  </BehaviorTree>\n</root>\n",
            encoding="utf-8",
        )
        return path

    return write


@pytest.fixture
def last_json() -> Callable[[Result], dict[str, Any]]:
    """Return the JSON object in the last line of a result's stdout."""

    def read(result: Result) -> dict[str, Any]:
        data: dict[str, Any] = json.loads(result.stdout.splitlines()[-1])
        return data

    return read
