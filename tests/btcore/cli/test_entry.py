"""The command's process: Ctrl-C while it is still importing."""

import signal
import subprocess
import sys

import pytest


@pytest.mark.parametrize("module", ["click.core", "btcore.errors", "rich.console", "btcore.tree.tree"])
def test_ctrl_c_while_a_module_is_imported_prints_no_traceback(module: str) -> None:
    with subprocess.Popen(
        [sys.executable, "-X", "importtime", "-m", "btcore", "run", "bumpgo", "--fast", "--duration", "9"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # These tests may run under nohup, and a child process inherits ignored signals.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        assert process.stderr is not None
        # With -X importtime, a line follows each import.
        assert any(line.split("|")[-1].strip() == module for line in process.stderr)
        process.send_signal(signal.SIGINT)
        printed = [line for line in process.stderr if not line.startswith("import time:")]
    assert process.returncode == 130
    assert "".join(printed).strip() == "interrupted"
