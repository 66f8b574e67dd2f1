"""Targets of the Makefile report a missing result, and show that a long command is running."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PROGRESS = ROOT / ".ci/progress"

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")


def make(folder: Path, *arguments: str) -> "subprocess.CompletedProcess[str]":
    """Run make in a copy of what it needs, without a display."""
    shutil.copy(ROOT / "Makefile", folder)
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in ("DISPLAY", "WAYLAND_DISPLAY", "MAKEFLAGS", "MAKELEVEL")
    }
    command = ["make", "--silent", *arguments, f"PYTHON={sys.executable}"]
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=100, check=False
    )


def dry_run(*arguments: str) -> str:
    """Return the commands that make would run in the project."""
    command = ["make", "--dry-run", "--silent", *arguments, f"PYTHON={sys.executable}"]
    environment = {
        name: value for name, value in os.environ.items() if name not in ("CI", "MAKEFLAGS", "MAKELEVEL")
    }
    return subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=100, check=True
    ).stdout


def test_every_test_is_in_one_lane() -> None:
    lanes = ("core", "monitor", "robot", "sim", "tools", "docs", "ros2")
    printed = dry_run(*(f"test-{lane}" for lane in lanes))
    calls = [line for line in printed.splitlines() if "/pytest -n" in line]
    if sys.platform != "linux":
        calls.append("tests/ros2")
    assert len(calls) == len(lanes)
    tested = [ROOT / word for line in calls for word in set(line.split()) if word.startswith("tests/")]
    for file in (ROOT / "tests").rglob("test_*.py"):
        assert sum(file.is_relative_to(folder) for folder in tested) == 1, file


def test_types_on_windows_and_pages_are_tested_in_continuous_integration_only() -> None:
    file, test = "tests/docs/test_docs.py", "test_the_examples_of_a_page_run"
    assert f"\ndef {test}(" in (ROOT / file).read_text(encoding="utf-8")
    assert "\nexport CI=true\n" in (ROOT / ".ci/run").read_text(encoding="utf-8")
    for ci in ("", "true"):
        printed = dry_run("lint", "pure", f"CI={ci}")
        assert ("mypy --platform win32" in printed) is bool(ci)
        assert (f"--deselect {file}::{test}\n" in printed) is not bool(ci)
    assert "--deselect" not in dry_run("test-docs")


@pytest.mark.parametrize("code", [0, 4])
def test_the_demo_fails_if_there_is_no_picture(tmp_path: Path, code: int) -> None:
    program = tmp_path / ".venv/bin/btcore"
    program.parent.mkdir(parents=True)
    # The program fails as `btcore run` does without a driver, or writes the picture.
    program.write_text(f'#!/bin/sh\necho "$@"\n[ {code} = 0 ] && touch out/bumpgo.png\nexit {code}\n')
    program.chmod(0o755)
    for name in ("pyproject.toml", "setup.py", ".venv/project", ".venv/ready"):
        (tmp_path / name).touch()
    (tmp_path / "out").mkdir()
    (tmp_path / "out/bumpgo.png").touch()  # of an earlier run
    done = make(tmp_path, "--assume-old=vulkan", "demo")
    assert "--screenshot out/bumpgo.png" in done.stdout, done.stderr
    assert (tmp_path / "out/bumpgo.png").exists() is (code == 0)
    assert ("the picture    out/bumpgo.png" in done.stdout) is (code == 0)
    assert ("The demo is incomplete: see the error above.\n" in done.stderr) is (code != 0)
    assert (done.returncode != 0) is (code != 0)


def test_a_failed_command_is_printed_with_its_output_and_exit_code() -> None:
    script = "import sys; print('installing'); sys.exit('no network')"
    done = subprocess.run(
        [sys.executable, PROGRESS, "setting up", sys.executable, "-c", script],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert (done.returncode, done.stdout) == (1, "· setting up\n")
    assert sorted(done.stderr.splitlines()) == ["installing", "no network"]


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="there are no pseudo-terminals here")
def test_the_last_line_of_a_running_command_is_shown_on_a_terminal() -> None:
    terminal, inside = os.openpty()
    script = "print('compiling', flush=True); input(); print('done')"
    process = subprocess.Popen(
        [sys.executable, PROGRESS, "building", sys.executable, "-c", script],
        stdin=subprocess.PIPE,
        stdout=inside,
    )
    os.close(inside)
    shown = b""
    while b" s: compiling" not in shown:
        shown += os.read(terminal, 1000)
    process.communicate(b"\n", timeout=100)
    os.close(terminal)
    assert process.returncode == 0
    assert shown.startswith("· building\r\n".encode())
