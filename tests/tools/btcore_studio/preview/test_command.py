"""`btcore preview` as a process: it serves the page, follows the file, and ends with a signal."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from urllib.request import Request, urlopen

from click.testing import Result

XML = '<root BTCPP_format="4"><BehaviorTree ID="Main"><AlwaysSuccess name="Tür"/></BehaviorTree></root>'


def test_page_follows_the_saved_file_until_a_signal(tmp_path: Path) -> None:
    file = tmp_path / "tree.xml"
    file.write_text(XML, encoding="utf-8")
    command = [sys.executable, "-m", "btcore", "preview", "--json", "tree.xml"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            url = json.loads(process.stdout.readline())["url"]
            assert url.startswith("http://127.0.0.1:")
            with urlopen(url + "events", timeout=90) as events:
                assert events.readline() == b"event: document\n"
                events.readline()
                events.readline()
                file.write_text(XML.replace("Tür", "Fenster"), encoding="utf-8")
                # Empty messages may come in between.
                while events.readline() != b"event: document\n":
                    pass
            request = Request(url + "drawing", b"{}", {"Content-Type": "application/json"})
            with urlopen(request, timeout=90) as reply:
                assert json.load(reply)["nodes"][0]["name"] == "Fenster"
            process.send_signal(signal.SIGTERM)
            # Windows has no SIGTERM: it ends the process at once.
            assert process.wait(20) == (143 if os.name == "posix" else 1)
        finally:
            process.kill()


def test_usage_errors(cli: Callable[..., Result]) -> None:
    assert "needs a file" in cli("preview", "-").stderr
    assert cli("preview", "missing.xml").exit_code == 2
