"""`btcore run --watch`: a saved file replaces the tree; errors in the file are reported."""

import json
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from btcore.logs import read_log
from tests.btcore.cli.conftest import Cli, LastJson, TreeFile

FIRST = '<Sequence><Script code="n := 1"/><Sleep name="first" msec="60000"/></Sequence>'
SECOND = '<Sequence><ScriptCondition code="n == 1"/><Sleep name="second" msec="60000"/></Sequence>'
BLINKS = '<Repeat num_cycles="-1"><Sleep name="blink" msec="20"/></Repeat>'


class Running:
    """A run in a separate process, and its output so far."""

    def __init__(self, *options: str | Path) -> None:
        command = [sys.executable, "-u", "-m", "btcore", "run", *map(str, options)]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.output: list[str] = []
        self.errors: list[str] = []
        self.readers: list[threading.Thread] = []
        self._read(self.process.stdout, self.output)
        self._read(self.process.stderr, self.errors)

    def _read(self, stream: Any, into: list[str]) -> None:
        def read() -> None:
            for line in stream:
                into.append(line.rstrip("\n"))

        self.readers.append(threading.Thread(target=read))
        self.readers[-1].start()

    def wait_for(self, words: str, times: int = 1) -> None:
        """Return when *words* have been printed on stdout or stderr, this number of times."""
        deadline = time.monotonic() + 100
        while sum(words in line for line in [*self.output, *self.errors]) < times:
            assert time.monotonic() < deadline, (words, self.output, self.errors)
            assert self.process.poll() is None, self.errors
            time.sleep(0.005)

    def end(self, number: int = signal.SIGINT) -> int:
        """Send the signal *number* to the process and return its exit code."""
        self.process.send_signal(number)
        code = self.process.wait(100)
        self.close()
        return code

    def close(self) -> None:
        """End the process and close its streams."""
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        for reader in self.readers:
            reader.join()
        for stream in (self.process.stdout, self.process.stderr):
            if stream is not None:
                stream.close()

    def report(self) -> dict[str, Any]:
        """Return the object that ``--json`` printed."""
        data: dict[str, Any] = json.loads(self.output[-1])
        return data


@pytest.fixture
def watched() -> Iterator[Callable[..., Running]]:
    """Return a function that starts a watching run at 20 Hz, with its transitions on stdout."""
    begun: list[Running] = []

    def begin(*options: str | Path) -> Running:
        begun.append(Running("--watch", "--rate", "20", "--log", "-", "--json", *options))
        return begun[-1]

    yield begin
    for one in begun:
        one.close()


def test_saved_tree_replaces_the_old_tree_and_keeps_the_blackboard(
    watched: Callable[..., Running], tree_file: TreeFile
) -> None:
    file = tree_file(FIRST)
    running = watched(file)
    running.wait_for("first                     IDLE -> RUNNING")
    tree_file(SECOND)
    running.wait_for("second                    IDLE -> RUNNING")
    assert running.end() == 130
    changes = [line.split("]: ")[1] for line in running.output if "]: " in line]
    halted = changes.index("first                     RUNNING -> IDLE")
    began = changes.index("Sequence                  IDLE -> RUNNING", 1)
    assert halted < began, "the old tree is halted before the new one is ticked"
    assert f"reloaded {file}" in running.errors
    report = running.report()
    assert list(report["nodes"]) == ["Sequence::1", "ScriptCondition::2", "second"], "of the last tree"
    assert report["nodes"]["second"]["halted"] == 1
    assert report["reloads"] == 1


def test_broken_tree_is_reported_and_the_old_tree_continues(
    watched: Callable[..., Running], tree_file: TreeFile
) -> None:
    running = watched(tree_file(BLINKS))
    running.wait_for("blink                     IDLE -> RUNNING")
    tree_file('<Sequense name="second"/>')
    running.wait_for("tree.xml:3:5: E101 unknown node <Sequense>")
    running.wait_for("tree.xml has errors: the previous tree continues")
    so_far = sum("blink" in line for line in running.output)
    running.wait_for("blink", so_far + 20)
    tree_file(SECOND.replace("n == 1", "true"))
    running.wait_for("second                    IDLE -> RUNNING")
    assert running.end(signal.SIGTERM) == 143
    assert running.report()["reloads"] == 1


def test_saved_include_reloads_the_tree(
    watched: Callable[..., Running], tree_file: TreeFile, tmp_path: Path
) -> None:
    part = (
        '<root BTCPP_format="4"><BehaviorTree ID="Part"><Sleep name="{}" msec="60000"/></BehaviorTree></root>'
    )
    (tmp_path / "part.xml").write_text(part.format("old"))
    file = tree_file('<SubTree ID="Part"/>')
    file.write_text(file.read_text().replace("<Behav", '<include path="part.xml"/><Behav'))
    running = watched(file)
    running.wait_for("old                       IDLE -> RUNNING")
    (tmp_path / "part.xml").write_text(part.format("new"))
    running.wait_for("new                       IDLE -> RUNNING")


def test_completed_tree_waits_for_the_next_save(watched: Callable[..., Running], tree_file: TreeFile) -> None:
    running = watched(tree_file("<AlwaysSuccess/>"))
    running.wait_for("waiting for a new version of tree.xml")
    tree_file("<AlwaysFailure/>")
    running.wait_for("✘ FAILURE  tree  tick 1  waiting for a new version of tree.xml")
    assert running.end() == 130
    assert running.report()["status"] == "FAILURE"


def test_tree_that_raised_waits_for_next_save(watched: Callable[..., Running], tree_file: TreeFile) -> None:
    running = watched(tree_file('<ScriptCondition name="early" code="nobody == 1"/>'))
    running.wait_for("✘ RAISED  tree  tick 1  waiting for a new version of tree.xml")
    tree_file("<AlwaysSuccess/>")
    running.wait_for("✔ SUCCESS  tree")
    assert running.end() == 130
    assert sum("'early' <ScriptCondition> raised while ticking" in line for line in running.errors) == 1
    assert "error" not in running.report()


def test_duration_ends_the_wait(cli: Cli, tree_file: TreeFile, last_json: LastJson) -> None:
    result = cli("run", tree_file("<AlwaysFailure/>"), "--watch", "--duration", "0.3", "--json")
    assert result.exit_code == 0
    assert 0.3 <= last_json(result)["time_s"] < 5
    assert "stopped by --duration" in result.stderr


def test_wait_in_simulated_time_ends_immediately(cli: Cli, tree_file: TreeFile, last_json: LastJson) -> None:
    result = cli("run", tree_file("<AlwaysFailure/>"), "--watch", "--fast", "--duration", "3600", "--json")
    assert result.exit_code == 0
    assert (last_json(result)["time_s"], last_json(result)["ticks"]) == (3600.0, 1)


def test_simulated_time_without_a_duration_stops_until_the_next_save(
    watched: Callable[..., Running], tree_file: TreeFile
) -> None:
    running = watched(tree_file('<Sleep msec="250"/>'), "--fast")
    running.wait_for("waiting for a new version of tree.xml")
    tree_file('<Sleep msec="500"/>')
    running.wait_for("waiting for a new version of tree.xml", 2)
    assert running.end() == 130
    assert running.report()["time_s"] == 0.75


def test_last_exception_decides_the_exit_code(cli: Cli, tree_file: TreeFile) -> None:
    tree = tree_file('<ScriptCondition code="nobody == 1"/>')
    result = cli("run", tree, "--watch", "--fast", "--duration", "1")
    assert result.exit_code == 3
    assert result.stderr.count("raised while ticking") == 1


def test_new_tree_gets_its_own_logs_and_the_old_logs_are_complete(
    watched: Callable[..., Running], tree_file: TreeFile, tmp_path: Path
) -> None:
    logs = [tmp_path / name for name in ("run.btlog", "run.db3")]
    running = watched(tree_file(FIRST), "--log", logs[0], "--log", logs[1])
    running.wait_for("first                     IDLE -> RUNNING")
    tree_file(SECOND)
    running.wait_for("second                    IDLE -> RUNNING")
    running.end()
    for log in logs:
        for name, path in (("first", log), ("second", log.with_name(f"run.2{log.suffix}"))):
            recording = read_log(path)
            reported_values = [
                change.status.name
                for change in recording.transitions
                if recording.nodes[change.uid].name == name
            ]
            assert reported_values == ["RUNNING", "IDLE"], path
            assert recording.damage == ""


def test_unwritable_log_of_a_new_tree_is_reported(
    watched: Callable[..., Running], tree_file: TreeFile, tmp_path: Path
) -> None:
    running = watched(tree_file(FIRST), "--log", tmp_path / "run.btlog")
    running.wait_for("first                     IDLE -> RUNNING")
    (tmp_path / "run.2.btlog").mkdir()
    tree_file(SECOND)
    running.wait_for("run.2.btlog: cannot write a log here: this is a folder")
    running.wait_for("second                    IDLE -> RUNNING")


def test_tree_that_requires_a_missing_resource_is_reported(
    watched: Callable[..., Running], tree_file: TreeFile, tmp_path: Path
) -> None:
    plugin = tmp_path / "needy.py"
    plugin.write_text(
        "from btcore import action\n\nclass Submarine: pass\n\n@action\ndef dive(boat: Submarine) -> bool:\n"
        "    return True\n"
    )
    running = watched(tree_file(FIRST), "--plugin", plugin)
    running.wait_for("first                     IDLE -> RUNNING")
    tree_file("<Dive/>")
    running.wait_for("note: resources are created only at the start of a run: start a new run for this tree")
    running.wait_for("the previous tree continues")


def test_explicit_tag_may_change_its_ports(
    watched: Callable[..., Running], tree_file: TreeFile, tmp_path: Path
) -> None:
    model = tmp_path / "model.xml"
    model.write_text('<root><TreeNodesModel><Action ID="Other"/></TreeNodesModel></root>')
    running = watched(tree_file('<Action ID="Haul" name="old" goal="a"/>'), "--model", model)
    running.wait_for("waiting for a new version of tree.xml")
    tree_file('<Action ID="Haul" name="new" goal="a" speed="2"/>')
    running.wait_for("new                       IDLE -> SUCCESS")


def test_tree_id_may_change_without_tree_option(watched: Callable[..., Running], tree_file: TreeFile) -> None:
    file = tree_file(FIRST)
    running = watched(file)
    running.wait_for("first                     IDLE -> RUNNING")
    file.write_text(tree_file(SECOND, "other.xml").read_text().replace("Main", "Other"))
    running.wait_for("second                    IDLE -> RUNNING")
