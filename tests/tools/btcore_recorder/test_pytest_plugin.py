"""The recordings of failed tests, in separate runs of pytest."""

import os
import re
import subprocess
import sys
from pathlib import Path

import btcore
import btcore_recorder
from btcore_recorder import Replay

TESTS = """
import pytest
from btcore_recorder import record

XML = '''<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>
  <Script code="n := 1"/><Sleep msec="100"/></Sequence></BehaviorTree></root>'''

@pytest.mark.parametrize("is_good", [False, True])
def test_it(btcore_harness, is_good):
    harness = btcore_harness(XML)
    harness.tick(3)
    assert is_good

def test_that_records(btcore_harness, tmp_path):
    harness = btcore_harness(XML)
    with record(harness.tree, tmp_path / "own.btrec.txt"):
        harness.tick()

def test_that_ticks_nothing(btcore_harness):
    btcore_harness(XML)
    assert False
"""


def run(folder: Path, *options: str) -> str:
    (folder / "test_it.py").write_text(TESTS)
    places = (Path(module.__file__ or "").parent.parent for module in (btcore, btcore_recorder))
    plugins = ("btcore.testing.pytest_plugin", "btcore_recorder.pytest_plugin")
    command = [sys.executable, "-m", "pytest", "-q", *(f"-p{plugin}" for plugin in plugins), *options]
    done = subprocess.run(
        [*command, f"--basetemp={folder / 'temp'}"],
        cwd=folder,
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join(map(str, places)),
            "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
            "PYTEST_ADDOPTS": "-p no:cacheprovider",
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert "2 failed, 2 passed" in done.stdout, done.stdout
    return done.stdout


def test_the_recording_of_a_failed_test_is_kept(tmp_path: Path) -> None:
    [named] = re.findall(r"^btcore replay (.*)$", run(tmp_path), re.MULTILINE)
    assert list((tmp_path / "temp" / "recordings").iterdir()) == [Path(named)]
    replay = Replay(named)
    assert replay.verify() is None
    assert (replay.tree.ticks, replay.tree.status) == (3, btcore.RUNNING)


def test_an_option_turns_the_recordings_off(tmp_path: Path) -> None:
    assert "btcore replay" not in run(tmp_path, "-pno:btcore_recorder.pytest_plugin")
    assert not (tmp_path / "temp" / "recordings").exists()
