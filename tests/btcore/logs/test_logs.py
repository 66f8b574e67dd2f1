"""Properties of all logs: one line attaches them, each tick is written, and errors do not affect the tree."""

import importlib
import json
import logging
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import btcore
from btcore import NodeExecutionError, Registry, Status, Tree
from btcore.logs import BtLog, ConsoleLog, Log, LogError, open_log, read_log
from btcore_monitor.logs import SqliteLog, TraceLog

PROGRAM = """
import sys
import btcore
from btcore.logs import open_log

ticks = 0

@btcore.action
def pause() -> bool:
    if ticks == 4:
        print("in tick 4", flush=True)
        sys.stdin.readline()
    return False

nodes = btcore.Registry.standard()
nodes.add(pause)
body = '<Fallback><Inverter><AlwaysSuccess/></Inverter><Pause/></Fallback>'
tree = btcore.loads(f'<root BTCPP_format="4"><BehaviorTree ID="M">{body}</BehaviorTree></root>', nodes=nodes)
log = open_log(tree, sys.argv[1])
while True:
    ticks += 1
    tree.tick_once()
    print(f"ticked {ticks}", flush=True)
    sys.stdin.readline()
"""
ONE_TICK = ["RUNNING", "RUNNING", "SUCCESS", "IDLE", "FAILURE", "FAILURE", "IDLE", "IDLE", "FAILURE", "IDLE"]

# A format of another package: a .btlog with another extension.
ROBOT_LOGS = """
from btcore.logs import BtLog, read_btlog
from btcore.logs.formats import LogFormat

FORMAT = LogFormat(
    lambda tree, path: BtLog(tree, path.with_suffix(".btlog")),
    lambda path: read_btlog(path.with_suffix(".btlog")),
)
"""


def run_and_kill(path: Path, last_words: str) -> str:
    """Run PROGRAM with its log in *path* until it prints *last_words*, kill it, and return its output."""
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "PYTHONDONTWRITEBYTECODE": "1"},
    )
    with process:
        assert process.stdin is not None
        assert process.stdout is not None
        message = ""
        for line in process.stdout:
            message += line
            if line.strip() == last_words:
                break
            if line.startswith(("ticked", "in tick")):
                process.stdin.write("\n")
                process.stdin.flush()
        process.send_signal(signal.SIGKILL)
        process.wait()
        message += process.stdout.read()
    assert last_words in message
    return message


def statuses_in(path: Path) -> list[str]:
    """Return the last statuses of the nodes in the log *path*."""
    if path.suffix != ".json":
        recording = read_log(path)
        assert recording.damage == ""
        return [change.status.name for change in recording.transitions]
    events = json.loads(path.read_text())["traceEvents"]
    return [event["args"].get("status", "RUNNING") for event in events]


@pytest.mark.parametrize("name", ["run.btlog", "run.db3", "run.json"])
@pytest.mark.parametrize("last_words", ["ticked 3", "in tick 4"])
def test_killed_process_loses_at_most_tick_in_progress(tmp_path: Path, name: str, last_words: str) -> None:
    run_and_kill(tmp_path / name, last_words)
    expected = [word for word in ONE_TICK if name != "run.json" or word != "IDLE"]
    assert statuses_in(tmp_path / name) == expected * 3


def test_killed_process_has_printed_every_completed_tick(tmp_path: Path) -> None:
    message = run_and_kill(Path("-"), "ticked 3")
    assert re.findall(r"-> (\w+)$", message, re.MULTILINE) == ONE_TICK * 3


@pytest.mark.parametrize("name", ["run.btlog", "run.db3", "run.json"])
def test_nothing_is_written_before_end_of_tick(small: Callable[..., Tree], tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    seen = []
    nodes = Registry.standard()
    nodes.add(btcore.action(ID="Look")(lambda: seen.append(len(statuses_in(path))) or True))
    tree = small("<Sequence><AlwaysSuccess/><Look/></Sequence>", nodes=nodes)
    with open_log(tree, path):
        tree.tick_once()
        tree.tick_once()
    whole = len(statuses_in(path))
    assert seen == [0, whole // 2]


@pytest.mark.parametrize("name", ["run.btlog", "run.db3"])
def test_halt_between_ticks_is_written_at_once(small: Callable[..., Tree], tmp_path: Path, name: str) -> None:
    tree = small('<Sequence><Sleep msec="100"/></Sequence>')
    with open_log(tree, tmp_path / name):
        tree.tick_once()
        tree.halt()
        assert statuses_in(tmp_path / name) == ["RUNNING", "RUNNING", "IDLE", "IDLE"]


@pytest.mark.parametrize("name", ["run.btlog", "run.db3"])
def test_tick_that_raises_and_the_following_halt_are_written(
    small: Callable[..., Tree], tmp_path: Path, name: str
) -> None:
    nodes = Registry.standard()

    @btcore.action(ID="Broken")
    def broken() -> bool:
        raise ValueError("broken")

    nodes.add(broken)
    tree = small("<Sequence><AlwaysSuccess/><Broken/></Sequence>", nodes=nodes)
    with open_log(tree, tmp_path / name):
        with pytest.raises(NodeExecutionError):
            tree.tick_once()
        assert statuses_in(tmp_path / name) == ["RUNNING", "SUCCESS", "IDLE", "IDLE"]


@pytest.mark.parametrize("name", ["run.btlog", "run.db3", "run.json"])
def test_closed_log_records_nothing_more(small: Callable[..., Tree], tmp_path: Path, name: str) -> None:
    tree = small("<AlwaysSuccess/>")
    log = open_log(tree, tmp_path / name)
    tree.tick_once()
    log.close()
    log.close()
    before = statuses_in(tmp_path / name)
    tree.tick_once()
    assert statuses_in(tmp_path / name) == before != []


def test_log_that_fails_during_the_run_ends_with_a_warning(
    small: Callable[..., Tree], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "run.btlog"
    os.mkfifo(path)
    reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    tree = small("<AlwaysSuccess/>")
    with BtLog(tree, path):
        tree.tick_once()
        os.close(reader)
        with caplog.at_level(logging.WARNING, "btcore"):
            assert [tree.tick_once() for _ in range(3)] == [Status.SUCCESS] * 3
    assert [record.getMessage() for record in caplog.records] == [
        f"the log {path} is incomplete, writing failed: Broken pipe"
    ]


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("a.btlog", BtLog),
        ("a.db3", SqliteLog),
        ("a.btdb", SqliteLog),
        ("a.json", TraceLog),
        ("-", ConsoleLog),
    ],
)
def test_file_extension_selects_the_log_class(
    small: Callable[..., Tree], tmp_path: Path, name: str, kind: type[Log]
) -> None:
    with open_log(small("<AlwaysSuccess/>"), name if name == "-" else tmp_path / name) as log:
        assert type(log) is kind


WRITTEN = "logs that can be written end in .btlog, .btdb, .btrec.txt, .db3, .json or .mcap"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("a.btlgo", f"a.btlgo: {WRITTEN}; did you mean a.btlog?"),
        ("a", f"a: {WRITTEN}; did you mean a.btlog?"),
        ("", f".: {WRITTEN}; for example run.btlog"),
        ("a.fbl", "a.fbl: a log in this format can be read, but not written; use a.btlog"),
    ],
)
def test_unknown_file_extension_is_refused(small: Callable[..., Tree], name: str, message: str) -> None:
    with pytest.raises(LogError) as caught:
        open_log(small("<AlwaysSuccess/>"), name)
    assert str(caught.value) == message


def test_each_log_requires_its_file_extension(small: Callable[..., Tree], tmp_path: Path) -> None:
    tree = small("<AlwaysSuccess/>")
    with pytest.raises(
        LogError, match=r"run.log: the name of this log must end in .btlog; did you mean .*run.btlog\?"
    ):
        BtLog(tree, tmp_path / "run.log")
    with pytest.raises(LogError, match=r"must end in .db3 or .btdb; did you mean .*run.db3\?"):
        SqliteLog(tree, tmp_path / "run.sqlite")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["run.btlog", "run.db3", "run.json"])
def test_invalid_location_is_reported(small: Callable[..., Tree], tmp_path: Path, name: str) -> None:
    tree = small("<AlwaysSuccess/>")
    (tmp_path / "file").touch()
    (tmp_path / name).mkdir()
    for place, message in (
        (tmp_path / "nowhere" / name, "the folder .*nowhere does not exist; create it first"),
        (tmp_path / "file" / name, "file is not a folder"),
        (tmp_path / name, "this is a folder; give the path of a file"),
    ):
        with pytest.raises(LogError, match=f"^{re.escape(str(place))}: cannot write a log here: .*{message}"):
            open_log(tree, place)


@pytest.mark.skipif(
    not Path("/dev/full").exists(), reason="there is no /dev/full, the disk that is always full"
)
@pytest.mark.parametrize("name", ["run.btlog", "run.json"])
def test_full_disk_is_reported_at_the_start(small: Callable[..., Tree], tmp_path: Path, name: str) -> None:
    (tmp_path / name).symlink_to("/dev/full")
    with pytest.raises(LogError, match="cannot write a log here: no space left on device"):
        open_log(small("<AlwaysSuccess/>"), tmp_path / name)


@pytest.fixture
def protected() -> Iterator[Path]:
    """Yield a folder that this process may not write to, even if it runs as root."""
    user = os.geteuid()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "old.btlog").touch()
        (folder / "old.btlog").chmod(0o444)
        folder.chmod(0o555)
        if user == 0:
            os.seteuid(65_534)
        yield folder
        os.seteuid(user)
        folder.chmod(0o700)


@pytest.mark.parametrize("name", ["run.btlog", "run.db3", "run.json"])
def test_write_protected_folder_is_reported(small: Callable[..., Tree], protected: Path, name: str) -> None:
    with pytest.raises(LogError) as caught:
        open_log(small("<AlwaysSuccess/>"), protected / name)
    assert str(caught.value) == (
        f"{protected / name}: cannot write a log here: no permission to write to {protected}"
    )


def test_write_protected_file_is_reported(small: Callable[..., Tree], protected: Path) -> None:
    with pytest.raises(LogError, match=r"no permission to write to .*old\.btlog$"):
        BtLog(small("<AlwaysSuccess/>"), protected / "old.btlog")


@pytest.mark.parametrize("name", ["run.btlog", "run.db3", "run.fbl"])
def test_missing_log_is_reported(tmp_path: Path, name: str) -> None:
    with pytest.raises(LogError, match="cannot read this log: no such file"):
        read_log(tmp_path / name)


def test_reading_a_trace_as_a_log_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        LogError, match=r"logs that can be read end in \.btlog, \.btdb, \.btrec\.txt, \.db3, \.fbl or \.mcap"
    ):
        read_log(tmp_path / "run.json")


def test_an_installed_package_adds_a_format(
    small: Callable[..., Tree], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    metadata = tmp_path / "robot_logs-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: robot-logs\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text("[btcore.logs]\nrlog = robot_logs:FORMAT\n")
    monkeypatch.syspath_prepend(tmp_path)
    path = tmp_path / "run.rlog"
    with pytest.raises(LogError, match=r"run\.rlog: the format \.rlog cannot be loaded: .*'robot_logs'"):
        read_log(path)
    (tmp_path / "robot_logs.py").write_text(ROBOT_LOGS)
    importlib.invalidate_caches()
    with open_log(small("<AlwaysSuccess/>"), path) as log:
        log.tree.tick_while_running()
    assert [change.status.name for change in read_log(path).transitions] == ["SUCCESS", "IDLE"]
