"""`btcore run --log`: logs of a run, for other tools."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from btcore.logs import read_log
from tests.btcore.cli.conftest import Cli, TreeFile


def test_every_log_is_complete_down_to_last_halt(cli: Cli, tree_file: TreeFile, tmp_path: Path) -> None:
    tree = tree_file('<Sleep name="nap" msec="60000"/>')
    names = ["run.btlog", "run.db3", "run.json", "-"]
    logs = [part for name in names for part in ("--log", name)]
    result = cli("run", tree, "--fast", "--duration", "1", *logs)
    assert result.exit_code == 0, result.output
    for name in names[:2]:
        changes = read_log(tmp_path / name).transitions
        assert [change.status.name for change in changes] == ["RUNNING", "IDLE"], name
    trace = json.loads((tmp_path / "run.json").read_text())
    assert any(event.get("name") == "nap" for event in trace["traceEvents"])
    assert [line.split()[-3:] for line in result.stdout.splitlines()] == [
        ["IDLE", "->", "RUNNING"],
        ["RUNNING", "->", "IDLE"],
    ]


def test_the_json_object_is_the_last_line_after_a_log_on_stdout(cli: Cli, tree_file: TreeFile) -> None:
    result = cli("run", tree_file("<AlwaysSuccess/>"), "--fast", "--log", "-", "--json")
    assert json.loads(result.stdout.splitlines()[-1])["status"] == "SUCCESS"


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["run.btlgo"], "did you mean run.btlog?"),
        (["run.btlog", "./run.btlog"], "--log './run.btlog' is given more than once"),
        (["-", "-"], "--log '-' is given more than once"),
    ],
)
def test_invalid_log_name_is_refused_before_the_first_tick(
    cli: Cli, tree_file: TreeFile, library: Path, names: list[str], message: str
) -> None:
    logs = [part for name in names for part in ("--log", name)]
    result = cli("run", tree_file("<Say/>"), "--plugin", library, "--fast", *logs)
    assert result.exit_code == 2
    assert message in result.stderr
    assert "here we go" not in result.stdout
    assert "Traceback" not in result.stderr


def test_log_that_is_cut_short_makes_the_exit_code_4(tree_file: TreeFile, tmp_path: Path) -> None:
    resource = pytest.importorskip("resource", reason="Windows cannot limit the size of files")
    tree = tree_file('<KeepRunningUntilFailure><Sleep msec="100"/></KeepRunningUntilFailure>')
    logs = [str(tmp_path / name) for name in ("run.btlog", "run.db3", "run.json")]
    options = [part for log in logs for part in ("--log", log)]
    limit = 100_000  # bytes; afterwards a write fails as on a full disk
    done = subprocess.run(
        [sys.executable, "-m", "btcore", "run", str(tree), "--fast", "--duration", "800", *options],
        capture_output=True,
        text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    assert done.returncode == 4
    for log in logs:
        assert f"the log {log} is incomplete, writing failed" in done.stderr.replace("\n", " ")
    assert "Traceback" not in done.stderr
    assert len(read_log(logs[0]).transitions) > 1000
