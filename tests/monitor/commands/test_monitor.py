"""``btcore monitor`` on the command line: its outputs, and its error messages."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner

from btcore.cli.main import main

ROOT = Path(__file__).parents[3]
NEEDS_LINUX = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is always a display")


def environment(**changes: str) -> dict[str, str]:
    kept = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    return {**kept, "PYTHONPATH": str(ROOT), **changes}


def monitor(*arguments: str | Path, timeout: float = 120.0) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "btcore_monitor", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout, env=environment())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--no-view"], "--no-view leaves nothing to do: add --save FILE.rrd"),
        (["tcp://host:99999", "--no-view", "--save", "x.rrd"], "port 99999 is out of range"),
        (["not an address", "--no-view", "--save", "x.rrd"], "'not an address' is not an address"),
        (["--save", "/nowhere/at/all.rrd", "--no-view"], "there is no folder /nowhere/at"),
        (["--screenshot", "/nowhere/at/all.png"], "there is no folder /nowhere/at"),
        (["nowhere.rrd"], "there is no recording nowhere.rrd"),
        (["nowhere.rrd", "localhost"], "recordings and robots cannot be shown together"),
        (["x.rrd", "--palette", "colour-blind"], "--palette has no effect on a recording"),
        (["x.rrd", "--log-level", "warn"], "--log-level has no effect on a recording"),
        (["--log-level", "loud"], "'loud' is not one of 'trace', 'debug', 'info', 'warn', 'error'"),
        (
            ["localhost:1700", "127.0.0.1:1667", ":1667", "--no-view", "--save", "x.rrd"],
            "tcp://127.0.0.1:1667 is given twice",
        ),
        (["x.rrd", "--find", "Dock*"], "--find has no effect on a recording"),
        (["--palette", "rainbow"], "'rainbow' is not one of 'groot', 'colour-blind'"),
        (["--screenshot", "x.png", "--size", "big"], "'big' is not a size: use WIDTHxHEIGHT"),
        pytest.param(["127.0.0.1:1"], "there is no display here. Use --serve-web", marks=NEEDS_LINUX),
    ],
)
def test_a_usage_error_is_reported_with_exit_code_2(arguments: list[str], message: str) -> None:
    nowhere_to_show = {"DISPLAY": None, "WAYLAND_DISPLAY": None}
    result = CliRunner().invoke(main, ["monitor", *arguments], prog_name="btcore", env=nowhere_to_show)
    assert result.exit_code == 2
    assert isinstance(result.exception, SystemExit)
    assert message in result.stderr


def test_the_error_without_rerun_names_the_package_to_install() -> None:
    code = (
        "import sys, importlib.abc\n"
        "class Hidden(importlib.abc.MetaPathFinder):\n"
        "    def find_spec(self, name, path, target=None):\n"
        "        if name.split('.')[0] == 'rerun': raise ModuleNotFoundError(name)\n"
        "import importlib.util\n"
        "before = importlib.util.find_spec\n"
        "importlib.util.find_spec = lambda name, *more: None if name == 'rerun' else before(name, *more)\n"
        "sys.meta_path.insert(0, Hidden())\n"
        "import runpy\n"
        "sys.argv = ['monitor', '--no-view', '--save', 'x.rrd']\n"
        "runpy.run_module('btcore_monitor', run_name='__main__')\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, env=environment()
    )
    assert result.returncode == 2
    assert "pip install 'btcore[monitor]'" in result.stderr
    assert "Traceback" not in result.stderr


def test_help_is_printed_without_importing_rerun() -> None:
    code = (
        "import sys\nfrom btcore_monitor.commands.monitor import monitor\n"
        "try: monitor(['--help'])\n"
        "finally: sys.stderr.write('imported' if {'rerun', 'zmq', 'numpy'} & set(sys.modules) else 'light')\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, env=environment()
    )
    assert "--serve-web" in result.stdout
    assert result.stderr == "light"


@pytest.mark.skipif(sys.platform != "linux", reason="reads the processor time from /proc")
def test_waiting_for_a_robot_takes_little_processor_time_and_ends_at_sigint_with_1(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "btcore_monitor",
            "127.0.0.1:9",
            "--no-view",
            "--save",
            str(tmp_path / "x.rrd"),
        ],
        stderr=subprocess.PIPE,
        env=environment(),
    )
    try:
        assert b"waiting for the robot" in process.stderr.readline()
        for _ in range(20):  # on a slow machine, the first attempts may include the start
            started = _cpu_seconds(process.pid)
            time.sleep(2.0)
            assert process.poll() is None
            taken = _cpu_seconds(process.pid) - started
            if taken < 0.5:
                break
        assert taken < 0.5
        process.send_signal(signal.SIGINT)
        assert process.wait(100) == 1
    finally:
        process.kill()
        process.communicate()


def _cpu_seconds(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def test_a_file_that_is_not_a_recording_is_reported(tmp_path: Path) -> None:
    junk = tmp_path / "junk.rrd"
    junk.write_text("junk")
    done = CliRunner().invoke(main, ["monitor", str(junk), "--screenshot", str(tmp_path / "junk.png")])
    assert done.exit_code == 2
    assert f"{junk} is not a rerun recording" in done.stderr
