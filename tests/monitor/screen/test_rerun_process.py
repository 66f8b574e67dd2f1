"""rerun's processes: listening at this machine only, silent, and reported when they fail."""

import os
import re
import signal
import stat
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

from btcore.cli.main import main
from btcore_monitor.screen.rerun_process import (
    RerunProcess,
    ScreenError,
    create_environment,
    find_viewer_program,
)
from btcore_monitor.screen.sinks import serve_web

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads the sockets of a process from /proc")

LOG = Path(__file__).parents[3] / "tests" / "btcore" / "logs" / "captures" / "v4_sample.btlog"
LOOPBACK = {"0100007F", "00000000000000000000000001000000"}
TREE = """
<root BTCPP_format="4">
  <BehaviorTree ID="T"><Sleep name="🔋" msec="60000"/></BehaviorTree>
</root>
"""


def listening(pid: int | str = "self") -> list[str]:
    """Return the addresses at which process *pid* listens, as in /proc/net/tcp: ADDRESS:PORT in hex."""
    found = set()
    for entry in Path(f"/proc/{pid}/fd").iterdir():
        if entry.is_symlink():
            try:
                found.add(str(entry.readlink()))
            except FileNotFoundError:
                continue
    tables = [Path(f"/proc/net/{name}").read_text().splitlines()[1:] for name in ("tcp", "tcp6")]
    lines = [line.split() for table in tables for line in table]
    return [line[1] for line in lines if line[3] == "0A" and f"socket:[{line[9]}]" in found]


@pytest.fixture
def headless(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Make the viewer run without a window. Return the file with the viewer's process ID."""
    folder = tmp_path / "path" / "rerun_cli"
    folder.mkdir(parents=True)
    (folder / "__init__.py").touch()
    pid = tmp_path / "pid"
    program = folder / "rerun"
    program.write_text(f'#!/bin/sh\necho $$ > {pid}\nexec {find_viewer_program()} --headless "$@"\n')
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(folder.parent), *sys.path]))
    monkeypatch.setenv("DISPLAY", ":99")
    yield pid
    if pid.exists():
        os.kill(int(pid.read_text()), signal.SIGKILL)


def test_a_run_with_its_viewer_prints_the_summary_alone(vulkan: None, headless: Path, tmp_path: Path) -> None:
    (tmp_path / "t.xml").write_text(TREE)
    options = ["--monitor", "--fast", "--duration", "30"]
    command = [sys.executable, "-m", "btcore", "run", str(tmp_path / "t.xml"), *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode, done.stdout) == (0, "")
    # On a slow machine, the run explains its waits.
    summary = re.sub(r"(?m)^monitor: (the viewer: )?waiting until .*\n", "", done.stderr)
    assert re.fullmatch(r"▶ RUNNING  t  30\.0 s, 300 ticks, .*\n\n node .*\n─+\n.* Sleep .*\n", summary)
    addresses = listening(headless.read_text().strip())
    assert addresses  # the viewer stays open
    assert {address.partition(":")[0] for address in addresses} <= LOOPBACK


def test_viewer_without_display_is_error_with_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISPLAY", ":77")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    done = CliRunner().invoke(main, ["replay", str(LOG)])
    assert done.exit_code == 2
    assert re.search(r"error: the viewer \(rerun\) .*: .*Failed to open connection to X server", done.stderr)
    assert "Traceback" not in done.stderr
    assert "internal error" not in done.stderr


def test_the_web_viewer_and_its_relay_listen_at_this_machine_only(free_port: Callable[[], int]) -> None:
    before = set(listening())
    view = serve_web(free_port(), free_port())
    addresses = set(listening()) - before
    assert len(addresses) == 2
    assert {address.partition(":")[0] for address in addresses} <= LOOPBACK
    assert view.address.startswith("rerun+http://127.0.0.1:")


def test_viewers_that_start_at_the_same_moment_get_different_ports(free_port: Callable[[], int]) -> None:
    port = free_port()
    viewers = [RerunProcess("--serve-web", "--web-viewer-port=0", port=port) for _ in range(2)]
    try:
        assert viewers[0].port == port
        assert viewers[1].port != port
        for viewer in viewers:
            viewer.wait_until_listening()
    finally:
        for viewer in viewers:
            viewer.close()


def test_viewer_that_is_closed_while_it_starts_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("btcore_monitor.screen.rerun_process.find_viewer_program", lambda: "/bin/true")
    viewer = RerunProcess()
    with pytest.raises(ScreenError, match=r"the viewer \(rerun\) ended while starting: it was closed"):
        viewer.wait_until_listening()
    viewer.close()


def test_usage_statistics_are_off_unless_the_user_forces_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """rerun sends nothing if CI is set, unless FORCE_RERUN_ANALYTICS is set, too."""
    monkeypatch.delenv("CI", raising=False)
    monkeypatch.delenv("FORCE_RERUN_ANALYTICS", raising=False)
    assert create_environment()["CI"] == "true"
    assert "FORCE_RERUN_ANALYTICS" not in create_environment()
    monkeypatch.setenv("FORCE_RERUN_ANALYTICS", "1")
    assert create_environment()["FORCE_RERUN_ANALYTICS"] == "1"
