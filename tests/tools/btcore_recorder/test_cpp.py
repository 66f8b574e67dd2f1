"""Runs of BehaviorTree.CPP, recorded by `data/random_run.cpp`, are repeated transition by transition."""

import json
import re
from pathlib import Path

import pytest

from btcore import Observer, Status, Transition
from btcore_recorder import Replay

DATA = Path(__file__).parent / "data"
RECORDINGS = sorted(DATA.glob("*.btrec.txt"))


class Transitions(Observer):
    """The transitions of a replay, as lines of `random_run.cpp`."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def transition(self, change: Transition) -> None:
        self.lines.append(f"{change.uid} {int(change.status)}")


def check_replay(path: Path) -> None:
    """Run a recording again, and compare it with what `random_run.cpp` has printed."""
    lines = path.with_name(path.name.replace(".btrec.txt", ".transitions")).read_text().splitlines()
    replay, now = Replay(path), Transitions()
    replay.tree.subscribe(now)
    assert replay.verify() is None
    assert replay.recording.damage == ""
    replay.tree.flush_observers()
    expected = [line for line in lines if line[0].isdigit()]
    if "threads" in lines:
        expected, now.lines = sorted(expected), sorted(now.lines)
    assert now.lines == expected
    for key, text in (line.split(" ", 2)[1:] for line in lines if line.startswith("= ")):
        value = replay.tree.blackboard[key]
        assert (value if isinstance(value, str) else float(value)) == pytest.approx(json.loads(text))
    assert replay.seek(0)
    assert replay.verify() is None


@pytest.mark.parametrize("path", RECORDINGS, ids=lambda path: path.name.partition(".")[0])
def test_a_run_in_cpp_is_repeated(path: Path) -> None:
    check_replay(path)


def test_the_recorded_runs_are_various() -> None:
    words = {line.partition(" ")[0] for path in RECORDINGS for line in path.read_text().splitlines()}
    needed = {"raised", "halt", "halt_began", "child_ticked", "child_halted", "status_set", "removed", "enum"}
    assert needed <= words


def test_transitions_after_an_exception_may_be_unknown(tmp_path: Path) -> None:
    # BehaviorTree.CPP does not halt the tree after an exception, but the program may.
    text = (DATA / "kinds_3.btrec.txt").read_text()
    path = tmp_path / "raised.btrec.txt"
    path.write_text(re.sub(r"(?s)(\nraised .*?\n)end .*", r'\1end ["IDLE", -1, null]\n', text))
    replay = Replay(path)
    assert replay.verify() is None
    assert replay.steps[-1].inputs[-1].uid == 7
    assert replay.tree.status is Status.IDLE
