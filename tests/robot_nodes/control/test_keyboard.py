"""Driving with keys: scripts of keys, the input of a terminal, and the command."""

import json
import os
import pty
import select
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from click.testing import CliRunner, Result

pytest.importorskip("pybullet")

from btcore.cli.main import main
from btcore_robot.control.keyboard import KEY_TIMEOUT, KeyInputError, Terminal, parse_key_script, parse_keys

Run = Callable[..., Result]
SECOND = 1_000_000_000


@pytest.fixture
def drive(monkeypatch: pytest.MonkeyPatch) -> Run:
    monkeypatch.setenv("COLUMNS", "110")

    def call(*arguments: str) -> Result:
        return CliRunner().invoke(main, ["drive", "--fast", *arguments], prog_name="btcore")

    return call


def test_a_script_presses_its_keys_in_turn() -> None:
    keys = parse_key_script("w:5, a:2,space,q:0.5")
    moments = (0.0, 4.9, 5.0, 6.9, 7.0, 8.0, 8.4, 8.5)
    assert [keys.pressed(round(moment * SECOND)) for moment in moments] == list("wwaa qqx")


@pytest.mark.parametrize("text", ["", "f:2", "w:", "w:fast", "w:-1", "w:0", "w:nan", "5:w"])
def test_an_invalid_script_raises(text: str) -> None:
    with pytest.raises(KeyInputError, match="w"):
        parse_key_script(text)


def test_arrows_and_capitals_are_keys() -> None:
    assert parse_keys("w\x1b[AzD\x1b[D x") == ["w", "w", "d", "a", " ", "x"]


def test_the_robot_drives_by_the_keys(drive: Run) -> None:
    result = drive("--keys", "w:4,s:2", "--seed", "2", "--json")
    assert result.exit_code == 0, result.output
    reported = json.loads(result.stdout.splitlines()[-1])
    assert reported["time_s"] == pytest.approx(6.0, abs=0.2)
    assert reported["robot"]["distance_m"] == pytest.approx(4 * 0.3 + 2 * 0.2, abs=0.25)


def test_a_map_is_made_while_driving(drive: Run, tmp_path: Path) -> None:
    from btcore_robot.occupancy_map import load_map
    from btcore_sim.map_rasteriser import rasterise
    from btcore_sim.worlds import load_world_description

    file = tmp_path / "arena.yaml"
    output = drive("--keys", "a:14,w:3", "--map-to", str(file), "--seed", "3", "--json").stdout
    reported = json.loads(output.splitlines()[-1])
    map = load_map(file)
    assert reported["map"]["scans"] > 20
    assert (map.width, map.height) == (reported["map"]["width"], reported["map"]["height"])
    assert map.occupied.sum() > 400
    assert map.free.sum() * map.resolution**2 > 30.0
    # The walls are where they are in the world, although the robot started elsewhere.
    world = rasterise(load_world_description("arena"))
    indices = world.indices(map.centers(*np.nonzero(map.occupied)))
    thick_walls = cv2.dilate(world.occupied.astype(np.uint8), np.ones((5, 5)))
    assert thick_walls[indices[:, 0], indices[:, 1]].mean() > 0.95


def test_the_error_without_a_terminal_names_the_keys_option(drive: Run) -> None:
    result = drive()
    assert result.exit_code == 2
    assert "standard input is not a terminal" in result.stderr
    assert "--keys" in result.stderr


def test_invalid_keys_and_a_missing_folder_are_reported(drive: Run, tmp_path: Path) -> None:
    assert "'f:3' has no key to drive by" in drive("--keys", "w:1,f:3").stderr
    result = drive("--keys", "w:1", "--map-to", str(tmp_path / "no" / "map.yaml"))
    assert result.exit_code == 2
    assert "there is no folder" in result.stderr


def test_keys_of_a_terminal_drive_and_x_ends() -> None:
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "btcore", "drive", "--json"]
    with subprocess.Popen(
        command, stdin=theirs, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=Path(__file__).parents[3]
    ) as driven:
        assert driven.stdout is not None
        assert driven.stderr is not None
        try:
            ready, _, _ = select.select([driven.stderr], [], [], 60)
            assert ready
            assert b"forward" in driven.stderr.readline()
            for key in (*8 * [b"w"], b"x"):
                os.write(ours, key)
                select.select([driven.stdout], [], [], 0.2)
            reported = json.loads(driven.stdout.read().splitlines()[-1])
        finally:
            driven.kill()
            os.close(ours)
            os.close(theirs)
    assert reported["robot"]["distance_m"] > 0.1


def test_keys_of_a_windows_console_drive(monkeypatch: pytest.MonkeyPatch) -> None:
    # An arrow key is a prefix and a letter, and a function key (here F1) drives nowhere.
    typed = ["w", "\xe0", "K", "\x00", ";"]
    console = SimpleNamespace(kbhit=lambda: bool(typed), getwch=lambda: typed.pop(0))
    monkeypatch.setitem(sys.modules, "msvcrt", console)
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(isatty=lambda: True))
    with Terminal() as keys:
        assert keys.pressed(0) == "a"
        assert keys.pressed(KEY_TIMEOUT) == "a"
        assert keys.pressed(KEY_TIMEOUT + 1) is None
        typed.append("x")
        assert keys.pressed(SECOND) == "x"
