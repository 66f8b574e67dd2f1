"""`btcore run`: the course of a run, its end, and its output."""

import inspect
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import IO, Any

import pytest

from btcore import Tree, builds
from btcore.cli.commands.run import run as run_command
from btcore.testing import Harness
from tests.btcore.cli.conftest import Cli, LastJson, TreeFile

KEYS = ["status", "ticks", "time_s", "real_time_factor", "nodes"]


def test_success_exits_with_0_and_failure_with_1(cli: Cli, tree_file: TreeFile) -> None:
    assert cli("run", tree_file("<AlwaysSuccess/>"), "--fast").exit_code == 0
    assert cli("run", tree_file("<AlwaysFailure/>"), "--fast").exit_code == 1


def test_a_skipped_root_exits_with_0(cli: Cli, tree_file: TreeFile, last_json: LastJson) -> None:
    result = cli("run", tree_file('<AlwaysFailure _skipIf="true"/>'), "--fast", "--json")
    assert result.exit_code == 0
    assert last_json(result)["status"] == "SKIPPED"


def test_json_is_the_last_line_and_counts_the_results_of_every_node(
    cli: Cli, tree_file: TreeFile, library: Path, last_json: LastJson
) -> None:
    tree = tree_file(
        '<Sequence name="main"><BatteryOk/><Walk name="stroll" steps="4"/>'
        '<AlwaysFailure _skipIf="true"/><Inverter><AlwaysFailure/></Inverter></Sequence>'
    )
    result = cli("run", tree, "--plugin", library, "--fast", "--json")
    data = last_json(result)
    assert result.exit_code == 0, result.output
    assert list(data) == KEYS
    assert data["status"] == "SUCCESS"
    assert data["ticks"] == 5
    assert data["time_s"] == 0.4
    assert list(data["nodes"]) == [
        "main",
        "BatteryOk::2",
        "stroll",
        "AlwaysFailure::4",
        "Inverter::5",
        "AlwaysFailure::6",
    ]
    assert data["nodes"]["stroll"] == {
        "id": "Walk",
        "ticks": 5,
        "success": 1,
        "failure": 0,
        "skipped": 0,
        "halted": 0,
    }
    assert data["nodes"]["AlwaysFailure::4"]["skipped"] == 1
    assert data["nodes"]["AlwaysFailure::6"]["failure"] == 1


def test_nodes_with_same_path_differ_by_uid(cli: Cli, tree_file: TreeFile, last_json: LastJson) -> None:
    tree = tree_file('<Sequence name="top"><AlwaysSuccess name="a"/><AlwaysSuccess name="a"/></Sequence>')
    assert list(last_json(cli("run", tree, "--fast", "--json"))["nodes"]) == ["top", "a#1", "a#2"]


def test_a_missing_object_of_an_own_class_is_explained(cli: Cli, tree_file: TreeFile, tmp_path: Path) -> None:
    (tmp_path / "weighing.py").write_text(
        "from btcore import action\n\n\nclass Scale: ...\n\n\n"
        "@action\ndef weigh(scale: Scale) -> bool:\n    return True\n"
    )
    result = cli("run", tree_file("<Weigh/>"), "--plugin", tmp_path / "weighing.py")
    assert result.exit_code == 2
    assert "E118 <Weigh> needs a Scale" in result.stderr
    assert "derive the class from btcore.TreeResource" in result.stderr


def test_a_leaf_that_fails_with_an_object_that_exists_has_no_hint_about_objects(
    cli: Cli, tree_file: TreeFile, tmp_path: Path
) -> None:
    (tmp_path / "die.py").write_text(
        "import random\nfrom btcore import NodeError, SyncAction\n\n\nclass Die(SyncAction):\n"
        "    def __init__(self, rng: random.Random) -> None:\n        raise NodeError('the die is lost')\n\n"
        "    def tick(self) -> bool:\n        return True\n"
    )
    result = cli("run", tree_file("<Die/>"), "--plugin", tmp_path / "die.py")
    assert "E118 the die is lost" in result.stderr
    assert "derive the class" not in result.stderr


def test_duration_ends_the_run_with_0_and_halts_the_tree(
    cli: Cli, tree_file: TreeFile, library: Path, last_json: LastJson
) -> None:
    tree = tree_file('<Walk name="far" steps="1000000"/>')
    result = cli("run", tree, "--plugin", library, "--fast", "--duration", "2", "--rate", "20", "--json")
    data = last_json(result)
    assert result.exit_code == 0
    assert (data["status"], data["ticks"], data["time_s"]) == ("RUNNING", 40, 2.0)
    assert data["nodes"]["far"]["halted"] == 1
    assert "halted while walking" in result.stdout
    assert "stopped by --duration" in result.stderr


@pytest.mark.parametrize(
    ("until", "code", "ticks"), [("done", 1, 1), ("failure", 1, 1), ("success", 0, 3), ("never", 0, 50)]
)
def test_until_sets_the_result_that_ends_the_run(
    cli: Cli, tree_file: TreeFile, library: Path, last_json: LastJson, until: str, code: int, ticks: int
) -> None:
    tree = tree_file("<EveryThird/>")
    result = cli("run", tree, "--plugin", library, "--fast", "--until", until, "--duration", "5", "--json")
    assert (result.exit_code, last_json(result)["ticks"]) == (code, ticks)


def test_sleep_ends_on_time_between_two_ticks(cli: Cli, tree_file: TreeFile, last_json: LastJson) -> None:
    data = last_json(cli("run", tree_file('<Sleep msec="250"/>'), "--fast", "--rate", "1", "--json"))
    assert data["time_s"] == 0.25


def test_raising_leaf_is_named_with_its_cause_and_the_exit_code_is_3(
    cli: Cli, tree_file: TreeFile, library: Path, last_json: LastJson, monkeypatch: pytest.MonkeyPatch
) -> None:
    tree = tree_file('<Parallel name="both"><Walk name="stroll"/><Explode name="bomb"/></Parallel>')
    result = cli("run", tree, "--plugin", library, "--fast", "--json")
    assert result.exit_code == 3
    assert "bomb" in result.stderr
    assert "ValueError: the fuse was lit" in result.stderr
    assert "Traceback" not in result.output
    assert "halted while walking" in result.stdout, "the rest of the tree is halted"
    data = last_json(result)
    assert list(data) == [*KEYS, "error"]
    file, _, line = data["error"].pop("at").rpartition(":")
    source = Path(file).read_text().splitlines()[int(line) - 1]
    assert "fuse" in source
    place = f"{file}:{line}: in explode()\n   {line} |  {source.strip()}\n"
    assert result.stderr.endswith(f"{place}Set BTCORE_DEBUG=1 to print the traceback.\n")
    monkeypatch.setenv("BTCORE_DEBUG", "1")
    debugged = cli("run", tree, "--plugin", library, "--fast")
    assert "Traceback (most recent call last):\n" in debugged.stderr
    assert f'File "{file}", line {line}, in explode\n    {source.strip()}\nValueError' in debugged.stderr
    assert debugged.stderr.endswith(place)
    assert data["error"] == {
        "node": "bomb",
        "id": "Explode",
        "while": "ticking",
        "exception": "ValueError",
        "message": "the fuse was lit",
    }


PAUSING = """
import btcore

@btcore.action
def grasp() -> bool:
    grip = 2.5
    breakpoint()
    return grip < 10
"""


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="there are no pseudo-terminals here")
def test_a_breakpoint_in_a_leaf_has_the_terminal_to_itself(tree_file: TreeFile, tmp_path: Path) -> None:
    plugin = tmp_path / "leaves.py"
    plugin.write_text(PAUSING, encoding="utf-8")
    tree = tree_file('<Sequence><Sleep msec="200"/><Grasp/></Sequence>')
    terminal, inside = os.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "btcore", "run", tree, "--plugin", plugin],
        env={**os.environ, "TERM": "xterm"},
        stdin=inside,
        stdout=inside,
        stderr=inside,
    )
    os.close(inside)

    def read_until(text: str) -> str:
        found = ""
        while text not in found:
            found += os.read(terminal, 1000).decode(errors="replace")
        return found

    assert f"{plugin}(8)grasp()" in read_until("(Pdb) ")
    os.write(terminal, b"print(grip)\n")
    assert read_until("(Pdb) ").replace("\r", "") == "print(grip)\n2.5\n(Pdb) "
    os.write(terminal, b"continue\n")
    read_until("SUCCESS")
    assert process.wait(60) == 0
    os.close(terminal)


def test_exception_while_halting_exits_with_3(
    cli: Cli, tree_file: TreeFile, library: Path, last_json: LastJson
) -> None:
    tree = tree_file('<Stubborn name="mule"/>')
    result = cli("run", tree, "--plugin", library, "--fast", "--duration", "1", "--json")
    assert result.exit_code == 3
    assert "'mule' <Stubborn> raised while being halted: RuntimeError: never!" in result.stderr
    assert last_json(result)["error"]["while"] == "being halted"


def test_tree_option_selects_a_tree_of_the_file(cli: Cli, tmp_path: Path) -> None:
    file = tmp_path / "two.xml"
    file.write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="Good"><AlwaysSuccess/></BehaviorTree>'
        '<BehaviorTree ID="Bad"><AlwaysFailure/></BehaviorTree></root>'
    )
    assert cli("run", file, "--fast", "--tree", "Good").exit_code == 0
    assert cli("run", file, "--fast", "--tree", "Bad").exit_code == 1


def test_same_seed_gives_the_same_report_except_for_the_factor(
    cli: Cli, tree_file: TreeFile, library: Path, last_json: LastJson
) -> None:
    def run(seed: int) -> dict[str, Any]:
        tree = tree_file("<RepeatedToss/>")
        data = last_json(
            cli("run", tree, "--plugin", library, "--fast", "--seed", seed, "--duration", "50", "--json")
        )
        del data["real_time_factor"]
        return data

    assert run(1) == run(1)
    assert len({run(seed)["ticks"] for seed in range(8)}) > 1


def test_real_time_run_follows_the_system_clock(
    cli: Cli, tree_file: TreeFile, library: Path, last_json: LastJson
) -> None:
    tree = tree_file('<Walk steps="6"/>')
    started = time.monotonic()
    data = last_json(cli("run", tree, "--plugin", library, "--rate", "20", "--json"))
    assert time.monotonic() - started >= 0.3
    assert data["ticks"] == 7
    assert data["time_s"] >= 0.3


def test_late_ticks_are_dropped_with_a_single_warning(
    cli: Cli, tree_file: TreeFile, library: Path, last_json: LastJson
) -> None:
    result = cli("run", tree_file("<Slow/>"), "--plugin", library, "--rate", "100", "--json")
    assert result.exit_code == 0
    assert result.stderr.count("use a lower --rate") == 1
    assert last_json(result)["ticks"] == 2


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)]
)
def test_signal_halts_the_tree_completes_the_log_and_exits_with_its_code(
    tree_file: TreeFile, library: Path, tmp_path: Path, number: int, code: int
) -> None:
    log = tmp_path / "run.json"
    tree = tree_file('<Sequence><Say/><Walk steps="1000000"/></Sequence>')
    command = [sys.executable, "-m", "btcore", "run", str(tree), "--plugin", str(library), "--json"]
    with subprocess.Popen(
        [*command, "--log", str(log)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
        # These tests may run under nohup, and a child process inherits ignored signals.
        preexec_fn=lambda: signal.signal(number, signal.SIG_DFL),
    ) as process:
        expected_message = _lines(process.stdout)
        assert next(expected_message) == "here we go"
        process.send_signal(number)
        rest = list(expected_message)
        assert process.stderr is not None
        complaint = process.stderr.read()
    assert process.returncode == code
    assert json.loads(log.read_text())
    assert rest[0] == "halted while walking"
    assert rest[-1].startswith('{"status": "RUNNING"')
    assert "interrupted" in complaint
    assert "Traceback" not in complaint


@pytest.mark.parametrize("format", [3, 4])
def test_first_ctrl_c_ends_endless_tick_at_a_node(tree_file: TreeFile, library: Path, format: int) -> None:
    tree = tree_file(
        '<Sequence><Say/><Repeat num_cycles="-1"><AlwaysSuccess name="endless"/></Repeat></Sequence>'
    )
    command = [sys.executable, "-u", "-m", "btcore", "run", str(tree), "--plugin", str(library), "--json"]
    with subprocess.Popen(
        [*command, "--format", str(format)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        expected_message = _lines(process.stdout)
        assert next(expected_message) == "here we go"
        process.send_signal(signal.SIGINT)
        report = json.loads(list(expected_message)[-1])
        assert process.stderr is not None
        complaint = process.stderr.read()
    assert process.returncode == 130
    assert report["status"] == "RUNNING"
    assert report["nodes"]["endless"]["halted"] == 0
    assert "interrupted" in complaint
    assert "Traceback" not in complaint


@pytest.mark.parametrize("format", [3, 4])
def test_tick_limit_ends_run_with_error_that_names_node(cli: Cli, tree_file: TreeFile, format: int) -> None:
    tree = tree_file('<Repeat name="busy" num_cycles="-1"><AlwaysSuccess/></Repeat>')
    result = cli("run", tree, "--format", format, "--tick-limit", "0.05")
    assert result.exit_code == 3
    assert f"{tree}:3: node 'busy' <Repeat> raised while ticking" in result.stderr
    assert "stopped after 0.05 s (tick limit)" in result.stderr
    assert cli("run", tree, "--tick-limit", "0").exit_code == 2


def test_run_under_nohup_survives_sighup(tree_file: TreeFile, library: Path) -> None:
    tree = tree_file('<Sequence><Say/><Walk steps="3"/></Sequence>')
    command = ["nohup", sys.executable, "-u", "-m", "btcore", "run", str(tree), "--plugin", str(library)]
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as process:
        assert next(_lines(process.stdout)) == "here we go"
        process.send_signal(signal.SIGHUP)
    assert process.returncode == 0


def _lines(stream: IO[str] | None) -> Any:
    assert stream is not None
    return (line.rstrip("\n") for line in stream)


def test_table_shows_tree_and_results_of_each_node(cli: Cli, tree_file: TreeFile, library: Path) -> None:
    tree = tree_file('<Sequence name="day"><BatteryOk/><Walk name="stroll" steps="2"/></Sequence>')
    shown = cli("run", tree, "--plugin", library, "--fast").stderr
    assert "SUCCESS" in shown
    row = next(line for line in shown.splitlines() if "stroll" in line)
    assert row.split()[-5:] == ["3", "1", "·", "·", "·"]


def test_long_summary_is_not_wrapped(cli: Cli, tree_file: TreeFile, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    leaf = '<AlwaysSuccess name="a long name of a leaf that is deep in the tree"/>'
    tree = tree_file("<Inverter>" * 20 + leaf + "</Inverter>" * 20)
    heading, *table = cli("run", tree, "--fast").stderr.splitlines()
    assert heading.startswith("✔ SUCCESS  tree")
    assert max(map(len, table)) <= 80
    rows = table[3:]
    assert len(rows) == 21
    assert all(row.split()[-5:].count("1") == 2 for row in rows)


@pytest.mark.skipif(builds.active_build() == "compiled", reason="compiled functions have no signature")
def test_documented_periods_of_ticks_are_the_defaults() -> None:
    table = (Path(__file__).parents[4] / "docs/guides/async.md").read_text(encoding="utf-8")
    documented = {
        name: float(seconds)
        for names, seconds in re.findall(r"^\| (.*) \| ([\d.]+) s, that is", table, re.MULTILINE)
        for name in re.findall(r"[\w.]*?(\w+)(?:\(\))?`", names)
    }
    rate = next(option.default for option in run_command.params if option.name == "rate")
    functions = [Tree.tick_while_running, Tree.run, Harness.run, Harness.run_until, Harness.run_for]
    defaults = {one.__name__: inspect.signature(one).parameters["period"].default for one in functions}
    assert documented == {**defaults, "run": documented["run"]}
    assert "| `btcore run` | 0.1 s, that is `--rate 10` |" in table
    assert rate == 10
