"""``btcore run`` with --publish, --save and --port: the run is unchanged, and all events arrive."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
from collections import Counter, defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner
from rerun.chunk import RrdReader

import btcore
from btcore import Run, RunSettings
from btcore.cli.main import main
from btcore.errors import SettingsError
from btcore.field_options import create_options
from btcore.options import arguments, changed_option_names, from_values
from btcore_monitor.client_options import KeyOptions
from btcore_monitor.events import (
    ConnectionEvent,
    Event,
    LostTransitionsEvent,
    MovingSceneEvent,
    StaticSceneEvent,
    TickEvent,
    TransitionEvent,
    TreeEvent,
)
from btcore_monitor.keys import create_keys
from btcore_monitor.monitor_processes import wait_until_connected
from btcore_monitor.monitor_settings import MonitorSettings
from btcore_monitor.screen.style import COLOUR_BLIND
from btcore_monitor.serve import serve
from btcore_monitor.viewer_options import DrawingOptions, ViewerOptions, choose_palette
from btcore_monitor.watch.feed import Feed
from tests.monitor.conftest import Command

TREE = """
<root BTCPP_format="4">
  <BehaviorTree ID="M">
    <Repeat num_cycles="-1"><Sequence><Sleep msec="100"/><AlwaysSuccess/></Sequence></Repeat>
  </BehaviorTree>
</root>
"""


def run(*options: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", "btcore", "run", *options]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def report(output: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(output.splitlines()[-1])
    del found["real_time_factor"]
    return found


@pytest.fixture
def free_port(sample: btcore.Tree) -> int:
    with serve(sample, groot2_port=0) as publisher:
        return publisher.port


@pytest.fixture
def tree_file(tmp_path: Path) -> str:
    path = tmp_path / "tree.xml"
    path.write_text(TREE)
    return str(path)


def columns(recording: Path, pattern: str, store: Any = None) -> dict[str, list[Any]]:
    """Return the values of a recording's data, or of its blueprint *store*, by entity and component."""
    found: dict[str, list[Any]] = defaultdict(list)
    reader = RrdReader(recording)
    for chunk in reader.stream(store=store) if store else reader.stream():
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if re.search(pattern, key := f"{chunk.entity_path} {name}"):
                found[key] += batch.column(name).to_pylist()
    return found


def test_a_run_that_is_watched_and_recorded_is_the_same_and_every_transition_arrives(
    tmp_path: Path, free_port: int
) -> None:
    pytest.importorskip("pybullet")
    bumpgo = ["run", "bumpgo", "--world", "arena", "--seed", "3", "--fast", "--json", "--duration", "12"]
    recording = tmp_path / "run.rrd"
    with Feed(f":{free_port}") as feed:
        process = subprocess.Popen(
            [
                *[sys.executable, "-m", "btcore", *bumpgo],
                *["--publish", "groot2", "--port", str(free_port), "--save", str(recording)],
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        events = list(feed.events(until_end=True))
        output, messages = process.communicate(timeout=60)
    assert process.returncode == 0, messages
    found = report(output)
    assert found == report(CliRunner().invoke(main, bumpgo, catch_exceptions=False).stdout)
    assert f"publishing at tcp://127.0.0.1:{free_port} (btcore monitor tcp://" in messages

    changes = [event for event in events if isinstance(event, TransitionEvent)]
    assert [change.number for change in changes] == list(range(1, len(changes) + 1))
    assert [event.tick for event in events if isinstance(event, TickEvent)] == list(range(1, 121))
    assert not [event for event in events if isinstance(event, LostTransitionsEvent)]
    tree = next(event.tree for event in events if isinstance(event, TreeEvent))
    results = Counter((tree.by_uid[change.uid].path, change.status) for change in changes)
    for node, counts in found["nodes"].items():
        # a result that is repeated is a tick without a transition
        assert 0 <= results[node, 2] <= counts["success"]
        assert 0 <= results[node, 3] <= counts["failure"]
    [(condition, counts)] = [item for item in found["nodes"].items() if item[0].startswith("IsObstacle")]
    assert (results[condition, 2], results[condition, 3]) == (counts["success"], counts["failure"])
    assert counts["success"] > 0 < counts["failure"]

    assert next(event.data for event in events if isinstance(event, StaticSceneEvent)).frame == "map"
    moving = [event.data for event in events if isinstance(event, MovingSceneEvent)]
    assert len(moving) > 100
    assert moving[-1].frames
    assert moving[-1].scan is not None
    assert moving[-1].velocity is not None
    assert isinstance(events[-1], ConnectionEvent)
    assert events[-1].state == "ended"

    rows = columns(recording, "^/log/numbers (number|uid|previous|status)$|^/tick/duration Scalars")
    assert len(rows.pop("/tick/duration Scalars:scalars")) == 120
    numbers = [[value for (value,) in rows[name]] for name in sorted(rows)]
    assert sorted(zip(*numbers, strict=True)) == [
        (change.number, change.previous, change.status, change.uid) for change in changes
    ]


def test_a_recording_on_a_full_disk_ends_with_an_error_and_the_exit_code_4(
    tmp_path: Path, tree_file: str
) -> None:
    resource = pytest.importorskip("resource", reason="Windows cannot limit the size of files")
    recording, limit = tmp_path / "run.rrd", 1 << 14  # afterwards a write fails as on a full disk
    options = ["--fast", "--duration", "30", "--json", "--save", str(recording)]
    done = subprocess.run(
        [sys.executable, "-m", "btcore", "run", tree_file, *options],
        capture_output=True,
        text=True,
        timeout=120,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    assert done.returncode == 4, done.stderr
    assert f"error: the recording {recording} is incomplete: no space left on the disk" in done.stderr
    assert json.loads(done.stdout.splitlines()[-1])["ticks"] == 300
    assert "not finished" not in done.stderr
    assert "Traceback" not in done.stderr


def test_an_interrupted_run_completes_its_recording(tmp_path: Path, tree_file: str) -> None:
    recording = tmp_path / "run.rrd"
    options = [tree_file, "--save", str(recording), "--verbose"]
    process = subprocess.Popen(
        [sys.executable, "-m", "btcore", "run", *options],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    reported = process.stderr.readline()
    address = reported.split("publishing at ")[1].split()[0]
    with Feed(address) as feed:
        events = feed.events(until_end=True)
        assert next(event for event in events if isinstance(event, TickEvent)).tick >= 1
        process.send_signal(signal.SIGINT)
        assert [event for event in events if isinstance(event, ConnectionEvent)][-1].state == "ended"
    _, rest = process.communicate(timeout=60)
    assert process.returncode == 130, rest
    assert "Traceback" not in rest
    assert recording.stat().st_size > 1000


@pytest.mark.skipif(sys.platform != "linux", reason="finds the processes of a run in /proc")
def test_ctrl_c_during_the_wait_for_a_recording_ends_all_monitors(
    command: Callable[..., Command], tmp_path: Path, free_port: int
) -> None:
    (tmp_path / "tree.xml").write_text(TREE.replace("AlwaysSuccess", "GoOn"))
    text = "from btcore import condition\nfrom pathlib import Path\n\n@condition\ndef go_on() -> bool:\n"
    (tmp_path / "nodes.py").write_text(f"{text}    return not Path('stop').exists()\n")
    outputs = ["--save", "run.rrd", "--serve-web", free_port, "--verbose"]
    run = command("run", "tree.xml", "--plugin", "nodes.py", *outputs)
    run.wait_for(r"(?s)(run channel.*){2}")
    children = Path(f"/proc/{run.process.pid}/task/{run.process.pid}/children").read_text().split()
    [recorder] = [int(pid) for pid in children if b"--save" in Path(f"/proc/{pid}/cmdline").read_bytes()]
    os.kill(recorder, signal.SIGSTOP)
    (tmp_path / "stop").touch()
    run.wait_for("writing run.rrd: waiting until all data is received")
    run.process.send_signal(signal.SIGINT)
    os.kill(recorder, signal.SIGCONT)
    assert run.end() == 130, run.stderr_text  # no process has stderr open
    assert "Traceback" not in run.stderr_text


PROGRAM = """
from pathlib import Path
from btcore import NodeExecutionError, Registry, Run, action
from btcore_monitor.monitor_settings import MonitorSettings

@action
def broken() -> bool:
    raise ValueError

nodes = Registry.standard()
nodes.add(broken)
run = Run("tree.xml", nodes=nodes, settings=[MonitorSettings(save=Path("run.rrd"))])
try:
    with run:
        run.tick_to_end()
except NodeExecutionError:
    print(run.end_reason, *run.providers.errors)
"""


def test_an_incomplete_recording_is_reported_after_the_exception_of_a_leaf(tmp_path: Path) -> None:
    (tmp_path / "tree.xml").write_text(TREE.replace("AlwaysSuccess", "Broken"))
    resource = pytest.importorskip("resource", reason="Windows cannot limit the size of files")
    limit = 1 << 14
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        capture_output=True,
        text=True,
        timeout=120,
        cwd=tmp_path,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    failed = "raised writing run.rrd: the monitor's process failed with exit code 4\n"
    assert done.stdout == failed, done.stderr


def test_a_changed_tree_is_published_at_the_same_port_and_saved_separately(
    tmp_path: Path, tree_file: str, free_port: int
) -> None:
    recording = tmp_path / "run.rrd"
    options = ["--watch", "--publish", "groot2", "--port", str(free_port)]
    options += ["--save", str(recording), "--verbose"]
    process = subprocess.Popen(
        [sys.executable, "-m", "btcore", "run", tree_file, *options],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    for line in process.stderr:
        if "by btcore's run channel" in line:
            break  # the recorder listens
    seen: list[TreeEvent] = []
    links: list[str] = []
    ticks = 0
    with Feed(f":{free_port}") as feed:
        for event in feed.events(until_end=True):
            if isinstance(event, TreeEvent):
                seen.append(event)
                ticks = 0
            elif isinstance(event, ConnectionEvent):
                links.append(event.state)
            elif isinstance(event, TickEvent):
                ticks += 1
                if ticks == 2 and len(seen) == 1:
                    Path(tree_file).write_text(TREE.replace('"M"', '"Saved"'))
                elif ticks == 2:
                    process.send_signal(signal.SIGINT)
    _, reported = process.communicate(timeout=60)
    assert process.returncode == 130, reported
    assert [event.tree.name for event in seen] == ["M", "Saved"]
    # A robot on a starved machine may count as lost for a moment.
    assert re.fullmatch(r"waiting connected( lost connected)*( lost)? ended", " ".join(links))
    assert "Traceback" not in reported
    for file in (recording, tmp_path / "run.2.rrd"):
        assert file.stat().st_size > 1000


@pytest.mark.parametrize("both", [False, True])
def test_groot1_is_served_alone_or_beside_groot2(
    both: bool, tree_file: str, free_port: int, capsys: pytest.CaptureFixture[str]
) -> None:
    """Alone, Groot 1 has the given port and the next port; beside Groot 2, its ports are 999 higher."""
    settings = MonitorSettings(publish=("groot1", "groot2") if both else ("groot1",), port=free_port)
    with Run(tree_file, settings=[settings, RunSettings(fast=True)]) as run:
        first = free_port + (999 if both else 0)
        reported = f"Groot 1 finds it at publisher port {first} and server port {first + 1}"
        assert reported + (f", since Groot 2 has {free_port}" if both else "") in capsys.readouterr().err
        # alone, Groot 1's ports have the run channel; beside Groot 2, it is next to Groot 2's ports
        spoken = "Groot 1's protocol" if both else "run channel"
        events: list[Event] = []
        with Feed(f":{first + 1}") as feed:
            while not any(isinstance(event, TransitionEvent) for event in events):
                run.step()
                run.clock.advance(0.1)
                events += feed.poll(0.02)
    [connected] = [
        event for event in events if isinstance(event, ConnectionEvent) and event.state == "connected"
    ]
    assert spoken in connected.detail


def test_run_with_keys_records_itself_and_prints_options_of_clients(tmp_path: Path, tree_file: str) -> None:
    robot, desk = (create_keys(tmp_path / name) for name in ("robot", "desk"))
    recording = tmp_path / "run.rrd"
    keys = ["--key-file", str(tmp_path / "robot"), "--allow-key", desk, "--watch-port", "0"]
    look = ["--find", "Sleep", "--palette", "colour-blind", "--log-level", "warn"]
    done = run(
        *[tree_file, "--fast", "--duration", "1", "--save", str(recording), "--verbose", *look],
        *["--publish", "groot2", "--port", "0", "--bind", "*", "--allow-control", *keys],
    )
    assert done.returncode == 0, done.stderr
    address = re.search(r"publishing at (tcp://127\.0\.0\.1:\d+) \(btcore monitor (.*)\)\n", done.stderr)
    assert address is not None
    assert address[2] == f"{address[1]} --key-file YOURS --robot-key {robot}"
    assert "by btcore's run channel" in done.stderr
    assert "watching without keys: tcp://127.0.0.1:" in done.stderr
    assert "warning" not in done.stderr
    # The drawing options apply to the recording.
    highlights = columns(recording, "^/tree/highlights LineStrips2D:colors")
    assert list(highlights.values()) == [[[COLOUR_BLIND.highlight]]]
    filters = columns(recording, "filter_by_log_level", RrdReader(recording).blueprints()[-1])
    assert list(filters.values()) == [[["WARN", "ERROR"]]]


def test_publishing_to_the_network_without_keys_prints_one_warning(tree_file: str) -> None:
    done = run(tree_file, "--fast", "--duration", "1", "--publish", "groot2", "--port", "0", "--bind", "*")
    assert done.stderr.count("warning") == 1
    assert (
        "warning: published at '*' without keys: every program that reaches the port can watch" in done.stderr
    )


def usage_errors(free_port: int) -> dict[str, tuple[list[str], str]]:
    outputs = "--monitor, --serve-web, --save FILE.rrd or --screenshot FILE.png"
    return {
        "groot1": (
            ["--publish", "groot1", "--port", str(free_port - 1)],
            f"port {free_port} is in use ({free_port - 1} to {free_port + 2} are needed)",
        ),
        "both": (
            ["--publish", "groot2", "--publish", "groot1", "--port", "65000"],
            "--port 65000 leaves no port for Groot 1, which is 999 further: choose one up to 64535",
        ),
        "look": (["--publish", "groot2", "--find", "Dock*"], f"--find needs {outputs}"),
        "log of no viewer": (["--publish", "groot2", "--verbose"], f"--verbose needs {outputs}"),
        "only bind": (["--bind", "*"], f"--bind needs --publish, {outputs}"),
        "only port": (["--port", "0"], f"--port needs --publish, {outputs}"),
        "only insecure": (["--publish", "groot2", "--insecure"], "--insecure needs --allow-control"),
        "no control": (["--save", "run.rrd", "--allow-control"], "--allow-control needs --publish groot2"),
        "suffix": (["--save", "run.txt"], "a recording is an .rrd file: --save run.rrd"),
        "no folder for the picture": (
            ["--screenshot", "/no/such/folder/run.png"],
            "--screenshot /no/such/folder/run.png: there is no folder /no/such/folder",
        ),
        "folder": (["--save", "/no/such/folder/run.rrd"], "there is no folder /no/such/folder"),
        "bind": (
            ["--publish", "groot2", "--port", "0", "--bind", "203.0.113.9"],
            "cannot listen at '203.0.113.9'",
        ),
        "port": (["--publish", "groot2", "--port", str(free_port)], f"port {free_port} is in use"),
        "no key file": (
            ["--publish", "groot2", "--allow-key", "desk.pub"],
            "--allow-key needs --key-file with the robot's secret key",
        ),
        "no key file for a watch port": (
            ["--publish", "groot2", "--watch-port", "0"],
            "--watch-port needs --key-file with the robot's secret key",
        ),
        "no client": (
            ["--publish", "groot2", "--key-file", "robot"],
            "--key-file needs --allow-key with the public keys of the clients",
        ),
        "not published": (
            ["--key-file", "robot", "--allow-key", "desk.pub"],
            f"--key-file needs --publish, {outputs}",
        ),
        "missing key": (
            ["--publish", "groot2", "--key-file", "/no/robot", "--allow-key", "desk.pub"],
            "there is no file /no/robot: btcore keys FILE creates a key",
        ),
        "control": (
            ["--publish", "groot2", "--port", "0", "--bind", "*", "--allow-control"],
            "control from the network ('*') needs keys: use --key-file and --allow-key",
        ),
    }


USAGE_ERRORS = ["groot1", "both", "suffix", "folder", "no folder for the picture", "bind", "port"]
WITHOUT_EFFECT = ["look", "log of no viewer", "only bind", "only port", "only insecure", "no control"]
KEY_ERRORS = [
    "no key file",
    "no key file for a watch port",
    "no client",
    "not published",
    "missing key",
    "control",
]


@pytest.mark.parametrize("name", [*USAGE_ERRORS, *WITHOUT_EFFECT, *KEY_ERRORS])
def test_a_usage_error_is_reported_once_before_the_run_starts(
    name: str, tree_file: str, free_port: int, no_threads_left: Callable[..., None]
) -> None:
    options, message = usage_errors(free_port)[name]
    with socket.create_server(("127.0.0.1", free_port)):
        arguments = ["run", tree_file, "--fast", "--duration", "1", *options]
        done = CliRunner().invoke(main, arguments, prog_name="btcore")
    assert done.exit_code == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == ""
    assert done.stderr.count("error") == 1


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is always a display")
def test_monitor_without_display_is_refused_first(tree_file: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    done = CliRunner().invoke(main, ["run", tree_file, "--monitor", "--fast", "--duration", "1"])
    assert done.exit_code == 2
    assert done.stderr == (
        "error: --monitor: there is no display here. --serve-web shows the run in a browser, --save FILE.rrd "
        "records it for later, and --publish groot2 lets a monitor connect from elsewhere\n"
    )


def test_port_in_use_is_recognised_by_setting(tree_file: str, free_port: int) -> None:
    with socket.create_server(("127.0.0.1", free_port)):
        settings = MonitorSettings(publish=("groot2",), port=free_port)
        with pytest.raises(SettingsError, match=f"port {free_port} is in use") as caught:
            Run(tree_file, settings=[settings, RunSettings(fast=True)]).__enter__()
    assert caught.value.setting == "port"


def test_palette_of_the_environment_is_a_default_and_no_option(
    tree_file: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BTCORE_PALETTE", "colour-blind")
    assert choose_palette(None) == "colour-blind"
    assert choose_palette("groot") == "groot"
    assert changed_option_names(DrawingOptions()) == []
    arguments = ["run", tree_file, "--fast", "--duration", "1", "--publish", "groot2", "--port", "0"]
    assert CliRunner().invoke(main, arguments).exit_code == 0
    monkeypatch.setenv("BTCORE_PALETTE", "rainbow")
    done = CliRunner().invoke(main, arguments)
    assert done.exit_code == 2
    assert "(env var: 'BTCORE_PALETTE'): 'rainbow' is not one of 'groot', 'colour-blind'" in done.stderr


@pytest.mark.parametrize("bare", [False, True])
def test_arguments_give_the_settings_to_another_process(bare: bool) -> None:
    settings = [
        MonitorSettings(publish=("groot1", "groot2"), port=0, serve_web=8080, find=("-a", "b")),
        ViewerOptions(save=Path("a.rrd"), at=-1.5, size="400x300", verbose=True),
        KeyOptions(key_file=Path("desk"), robot_keys=("k1", "k2")),
    ]
    for item in [type(settings_type)() for settings_type in settings] if bare else settings:
        command = click.Command("any", params=list(create_options(type(item))))
        assert from_values(type(item), command.make_context("any", arguments(item)).params) == item


def test_a_run_without_monitors_of_its_own_does_not_wait_for_others(
    endless: btcore.Tree, until: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    with serve(endless, groot2_port=0) as publisher, Feed(publisher.address) as viewer:
        until(lambda: (viewer.poll(0.01), publisher.client_count)[1], "the client")
        wait_until_connected(publisher, [])
    assert capsys.readouterr().err == ""
