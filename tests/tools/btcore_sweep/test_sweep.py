"""`btcore sweep`: each episode is run once, even if processes die, and the table is reproducible."""

import csv
import json
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from btcore import Status
from btcore.cli.main import main
from btcore_recorder import Replay
from tests.btcore.cli.conftest import LastJson
from tests.tools.btcore_sweep.conftest import environment

psutil = pytest.importorskip("psutil")
pytest.importorskip("distributed")

Sweep = Callable[..., Result]
Tree = Callable[[str], str]

MAX_WAIT_S = 120.0  # s, on a slow machine


def read_table(folder: str = "tree.sweep") -> list[dict[str, str]]:
    """Return the rows of results.csv."""
    with Path(folder, "results.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def journal(folder: str = "tree.sweep") -> list[int]:
    """Return the episode numbers in the journal, in order."""
    lines = Path(folder, "journal.jsonl").read_bytes().split(b"\n")[:-1]
    return [json.loads(line)["episode"] for line in lines]


def wait_until(holds: Callable[[], object]) -> None:
    """Wait for *holds* to return a true value."""
    end = time.monotonic() + MAX_WAIT_S
    while not holds():
        assert time.monotonic() < end, "it took too long"
        time.sleep(0.02)


def test_episodes_give_the_results_of_run_and_can_be_replayed(
    sweep: Sweep, tree: Tree, last_json: LastJson, scheduler: str
) -> None:
    file = tree('<Sequence><Walk max_ticks="9"/><SucceedByChance probability="{probability}"/></Sequence>')
    words = ["--seeds", "12", "--param", "bb.probability=0.2,0.9", "--scheduler", scheduler, "--json"]
    result = sweep(file, *words)
    assert result.exit_code == 1, result.stderr
    data = last_json(result)
    assert (data["episodes"], data["done"], data["of"]) == (24, 24, 24)
    assert data["by"]["bb.probability"]["0.2"]["succeeded"] < data["by"]["bb.probability"]["0.9"]["succeeded"]
    assert data["interval"][0] < data["rate"] < data["interval"][1]
    assert data["failing"][0]["node"] == "SucceedByChance::3"
    assert data["failing"][0]["ended"] == len(data["failed"]) == 24 - data["succeeded"]
    table = read_table()
    assert [int(row["episode"]) for row in table] == list(range(24))
    assert [row["seed"] for row in table[:4]] == ["0", "0", "1", "1"]
    for number in (0, 1, data["failed"][-1]["episode"]):
        row = table[number]
        replay = ["run", file, "--plugin", "leaves.py", "--set"]
        replay += [f"probability={row['param.bb.probability']}", "--fast", "--seed", row["seed"], "--json"]
        again = CliRunner().invoke(main, replay)
        report = json.loads(again.stdout.splitlines()[-1])
        assert again.exit_code == int(row["code"])
        assert (report["status"], report["ticks"]) == (row["status"], int(row["ticks"]))
        assert report["time_s"] == float(row["time_s"])
    last = data["failed"][-1]
    recordings = {episode["recording"] for episode in data["failed"]}
    assert recordings == {str(file) for file in Path("tree.sweep/recordings").iterdir()}
    recorded = Replay(last["recording"])
    assert recorded.seek(tick=int(table[last["episode"]]["ticks"]))
    assert recorded.tree.status is Status.FAILURE
    assert recorded.verify() is None
    assert CliRunner().invoke(main, shlex.split(last["replay"])[1:]).exit_code == 1
    assert "SucceedByChance::3" in Path("tree.sweep/report.html").read_text(encoding="utf-8")
    assert last["replay"] in Path("tree.sweep/report.html").read_text(encoding="utf-8").replace("&#x27;", "'")


def test_same_sweep_gives_an_identical_table(sweep: Sweep, tree: Tree, scheduler: str) -> None:
    file = tree('<Fallback><SucceedByChance probability="0.1"/><Walk/></Fallback>')
    for suffix in ("csv", "parquet"):
        for folder in ("first", "second"):
            words = ["--seeds", "10", "--output", folder + suffix, "--format", suffix]
            assert sweep(file, *words, "--scheduler", scheduler).exit_code == 0
        first, second = (Path(folder + suffix, f"results.{suffix}") for folder in ("first", "second"))
        assert first.read_bytes() == second.read_bytes()


GRIPPER = """
from typing import Annotated
from btcore import Settings, condition, option, provider

class GripperSettings(Settings):
    force: Annotated[float, option("Force, in N.")] = 1.0

class Gripper:
    force = 0.0

@provider
def gripper(settings: GripperSettings) -> Gripper:
    gripper = Gripper()
    gripper.force = settings.force
    return gripper

@condition
def is_strong(gripper: Gripper) -> bool:
    return gripper.force > 15
"""


def test_settings_of_a_provider_in_a_plugin_are_parameters(
    sweep: Sweep, tree: Tree, folder: Path, scheduler: str
) -> None:
    (folder / "gripper.py").write_text(GRIPPER, encoding="utf-8")
    plugin = ["--plugin", str(folder / "gripper.py"), "--scheduler", scheduler]
    result = sweep(tree("<IsStrong/>"), "--seeds", "1", "--param", "force=10,20", *plugin)
    assert result.exit_code == 1, result.stderr
    assert [(row["param.force"], row["status"]) for row in read_table()] == [
        ("10", "FAILURE"),
        ("20", "SUCCESS"),
    ]


def test_raising_leaf_is_counted_and_its_output_is_hidden(
    sweep: Sweep, tree: Tree, last_json: LastJson, scheduler: str
) -> None:
    file = tree('<RaiseError when="{is_raising}"/>')
    words = ["--seeds", "2", "--param", "bb.is_raising=false,true", "--scheduler", scheduler, "--json"]
    result = sweep(file, *words)
    assert result.exit_code == 3
    assert "printed by the leaf" not in result.output
    assert last_json(result)["statuses"] == {"SUCCESS": 2, "RAISED": 2}
    (node,) = last_json(result)["failing"]
    assert (node["node"], node["ended"]) == ("RaiseError::1", 2)
    assert {row["error"] for row in read_table()} == {"", "ValueError: raised by the leaf"}


def test_success_if_redefines_success_without_new_episodes(
    sweep: Sweep, tree: Tree, last_json: LastJson, scheduler: str
) -> None:
    words = [tree("<Walk/>"), "--seeds", "10", "--scheduler", scheduler, "--json"]
    assert last_json(sweep(*words))["rate"] == 1.0
    result = sweep(*words, "--success-if", "ticks > 4")
    assert 0 < last_json(result)["rate"] < 1
    assert last_json(result)["workers"]["count"] == 0
    data = last_json(sweep(*words, "--success-if", "ticks > 4", "--output", "new"))
    assert {Path(episode["recording"]) for episode in data["failed"]} == set(Path("new/recordings").iterdir())
    assert sweep(*words, "--success-if", "0", "--output", "off", "--no-record").exit_code == 1
    assert not Path("off/recordings").exists()
    mistaken = sweep(*words, "--success-if", "tiks > 4")
    assert mistaken.exit_code == 2
    assert "did you mean 'ticks'?" in mistaken.stderr


def test_invalid_setting_ends_the_sweep_with_its_message(sweep: Sweep, tree: Tree, scheduler: str) -> None:
    file = tree('<Walk max_ticks="{max_ticks}"/>')
    result = sweep(file, "--seeds", "5", "--param", "bb.max_ticks=3,many", "--scheduler", scheduler)
    assert result.exit_code == 2
    assert "--set max_ticks=many" in result.stderr
    assert "--param bb.max_ticks=many" in result.stderr


def test_a_folder_of_another_sweep_is_a_usage_error(sweep: Sweep, tree: Tree, scheduler: str) -> None:
    words = ["--seeds", "3", "--scheduler", scheduler]
    assert sweep(tree("<Walk/>"), *words).exit_code == 0
    other = sweep("tree.xml", "--seeds", "4", "--scheduler", scheduler)
    assert other.exit_code == 2
    assert "differs in its seeds: 0..2 there, 0..3 now" in " ".join(other.stderr.split())
    changed = sweep(tree('<Walk max_ticks="3"/>'), *words)
    assert changed.exit_code == 2
    assert "the file tree.xml, which has changed since" in " ".join(changed.stderr.split())


def test_episode_of_a_dead_worker_runs_again(
    sweep: Sweep, tree: Tree, last_json: LastJson, folder: Path, scheduler: str
) -> None:
    file = tree(f'<Sequence><KillWorker mark="{folder / "mark"}"/><Walk/></Sequence>')
    data = last_json(sweep(file, "--seeds", "8", "--scheduler", scheduler, "--json"))
    assert data["statuses"] == {"SUCCESS": 8}
    assert data["workers"]["deaths"] >= 1
    assert sorted(journal()) == list(range(8))


def test_episode_that_kills_its_workers_is_recorded_and_the_others_continue(
    sweep: Sweep, tree: Tree, last_json: LastJson, scheduler: str
) -> None:
    file = tree('<Sequence><KillWorker when="{is_killing}"/><Walk/></Sequence>')
    words = ["--seeds", "3..3", "--param", "bb.is_killing=false,true", "--attempts", "2"]
    result = sweep(file, *words, "--scheduler", scheduler, "--json")
    assert result.exit_code == 1, result.stderr
    assert last_json(result)["statuses"] == {"SUCCESS": 1, "KILLED": 1}
    assert read_table()[1]["error"] == "its worker died 2 times"


def start_sweep(*words: str) -> subprocess.Popen[str]:
    """Start a sweep in its own process and session, as from a terminal."""
    return subprocess.Popen(
        [sys.executable, "-m", "btcore", "sweep", *words, "--plugin", str(Path("leaves.py").resolve())],
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def test_killed_sweep_leaves_no_worker_and_the_same_command_continues_it(
    sweep: Sweep, tree: Tree, last_json: LastJson, scheduler: str
) -> None:
    calls = Path("calls").resolve()
    calls.mkdir()
    file = tree(f'<Sequence><WaitSeconds/><WaitAfter count="12" calls="{calls}"/><Walk/></Sequence>')
    words = [file, "--seeds", "24", "--json"]
    with start_sweep(*words, "--workers", "2") as process:
        wait_until(lambda: Path("tree.sweep/journal.jsonl").exists() and len(journal()) >= 3)
        workers = psutil.Process(process.pid).children(recursive=True)
        process.kill()
    (calls / "go_on").touch()
    assert len(workers) >= 2
    _, alive = psutil.wait_procs(workers, MAX_WAIT_S)
    assert alive == []
    before = journal()
    assert len(before) < 24
    with Path("tree.sweep/journal.jsonl").open("ab") as file:
        file.write(b'{"episode":23,"code"')  # as a full disk or a power cut leaves the file
    result = sweep(*words, "--scheduler", scheduler)
    assert result.exit_code == 0, result.stderr
    assert journal()[: len(before)] == before
    assert sorted(journal()) == list(range(24))
    assert last_json(result)["statuses"] == {"SUCCESS": 24}
    sweep(*words, "--scheduler", scheduler, "--output", "whole")
    assert Path("whole/results.csv").read_bytes() == Path("tree.sweep/results.csv").read_bytes()


def test_signal_ends_the_sweep_and_prints_how_to_continue(tree: Tree, sweep: Sweep, scheduler: str) -> None:
    words = [tree('<Sequence><WaitSeconds seconds="0.2"/><Walk/></Sequence>'), "--seeds", "500"]
    with start_sweep(*words, "--scheduler", scheduler) as process:
        wait_until(lambda: Path("tree.sweep/journal.jsonl").exists() and len(journal()) >= 2)
        # While the sweep runs, its lock prevents other sweeps from writing to the folder.
        assert "is writing to 'tree.sweep'" in " ".join(sweep(*words).stderr.split())
        process.send_signal(signal.SIGTERM)
        _, message = process.communicate(timeout=MAX_WAIT_S)
    assert process.returncode == 143
    assert "Traceback" not in message
    assert "run the same command again to continue" in message
    assert 2 <= len(read_table()) == len(journal()) < 500
