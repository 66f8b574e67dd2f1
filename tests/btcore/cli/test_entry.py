"""The command's process: Ctrl-C while it is still importing, and terminals with little encoding."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from btcore.cli.main import OWN_COMMANDS, main


@pytest.mark.parametrize("module", ["click.core", "btcore.errors", "rich.console", "btcore.tree.tree"])
def test_ctrl_c_while_a_module_is_imported_prints_no_traceback(module: str) -> None:
    with subprocess.Popen(
        [sys.executable, "-X", "importtime", "-m", "btcore", "run", "bumpgo", "--fast", "--duration", "9"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        pipesize=4096,  # so that the process cannot be far ahead of the line that is read
        # These tests may run under nohup, and a child process inherits ignored signals.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        assert process.stderr is not None
        # With -X importtime, a line follows each import.
        assert any(line.split("|")[-1].strip() == module for line in process.stderr)
        process.send_signal(signal.SIGINT)
        # libmpdec prints a warning when the import of decimal was interrupted and is repeated.
        noise = ("import time:", "./Modules/_decimal/")
        printed = [line for line in process.stderr if not line.startswith(noise)]
    assert process.returncode == 130
    assert "".join(printed).strip() == "interrupted"


ADDED_COMMANDS = (
    "monitor",
    "hook",
    "keys",
    "record",
    "replay",
    "map",
    "world",
    "drive",
    "book",
    "sweep",
    "bench",
)


@pytest.mark.parametrize(
    "command",
    [
        ["--help"],
        ["show", "tree.xml"],
        ["show", "tree.xml", "--data"],
        ["validate", "tree.xml"],
        ["nodes"],
        ["run", "tree.xml", "--fast", "--log", "b.db3", "--log", "-"],
        ["stats", "a.db3"],
        ["diff", "a.db3", "a.db3"],
        ["replay", "a.db3", "--text"],
        *([name, "--help"] for name in (*OWN_COMMANDS, *ADDED_COMMANDS)),
    ],
    ids=" ".join,
)
@pytest.mark.usefixtures("folder")
def test_command_prints_on_a_terminal_that_is_limited_to_ascii(command: list[str]) -> None:
    if command[0] == "book":
        pytest.importorskip("cv2")
    result = CliRunner(charset="ascii").invoke(main, command, prog_name="btcore")
    assert result.exit_code == 0, result.output
    assert result.output_bytes.isascii()


@pytest.mark.usefixtures("folder")
def test_json_on_a_terminal_that_is_limited_to_ascii_keeps_every_character() -> None:
    result = CliRunner(charset="ascii").invoke(main, ["show", "tree.xml", "--json"], prog_name="btcore")
    assert json.loads(result.output_bytes)["name"] == "Küche → 😀"


@pytest.mark.usefixtures("folder")
def test_characters_beyond_ascii_are_replaced_by_similar_characters_or_escapes() -> None:
    result = CliRunner(charset="ascii").invoke(main, ["show", "tree.xml"], prog_name="btcore")
    assert r"`-- K\u00fcche > \ud83d\ude00  Sequence  1" in result.output


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Change to a folder with the tree tree.xml, whose names are not ASCII, and the log a.db3."""
    monkeypatch.chdir(tmp_path)
    tree = '<Sequence name="Küche → 😀"><Sleep name="Schläfchen" msec="9"/></Sequence>'
    Path("tree.xml").write_text(
        f'<root BTCPP_format="4"><BehaviorTree ID="Main">{tree}</BehaviorTree></root>', encoding="utf-8"
    )
    CliRunner().invoke(main, ["run", "tree.xml", "--fast", "--log", "a.db3"])
