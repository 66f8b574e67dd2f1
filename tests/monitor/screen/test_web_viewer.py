"""``--serve-web``: the viewer in a browser, without files from other hosts; tested in headless Chromium."""

import io
import re
import signal
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from btcore.cli.main import main
from btcore_monitor.screen.style import GROOT
from tests.conftest import open_chromium
from tests.monitor.conftest import Command

ROOT = Path(__file__).parents[3]
LOG = ROOT / "tests" / "btcore" / "logs" / "captures" / "v4_sample.btlog"
RUNNING = 1
TREE = """
<root BTCPP_format="4">
  <BehaviorTree ID="T">
    <Sequence><AlwaysSuccess name="start"/><Sleep name="wait" msec="600000"/></Sequence>
  </BehaviorTree>
</root>
"""
WITHIN = 100
"""A timeout (s): drawing in software on a busy machine is slow."""


@pytest.fixture
def browser_with_webgl() -> Iterator[Any]:
    with open_chromium(
        "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"
    ) as chromium:
        yield chromium


@pytest.fixture
def tree_file(tmp_path: Path) -> Path:
    path = tmp_path / "tree.xml"
    path.write_text(TREE)
    return path


def address_of(command: Any) -> str:
    """Wait for the address that *command* prints, and return it."""
    return str(command.wait_for(r"look at (http://\S+?);?\s")[1])


def fetched(url: str) -> bytes:
    with urllib.request.urlopen(url, timeout=WITHIN) as answer:
        return bytes(answer.read())


def test_the_page_is_served_with_all_its_files_and_without_external_links(
    command: Callable[..., Command], free_port: Callable[[], int]
) -> None:
    port = free_port()
    replay = command("replay", LOG, "--serve-web", port)
    url = address_of(replay)
    assert url.startswith(
        f"http://127.0.0.1:{port}/?hide_welcome_screen&url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A"
    )
    page = fetched(url).decode()
    assert not re.search(r"<(link|script|img)\b[^>]*https?://", page)
    sources = re.findall(r"<script src=\"([^\"]+)\"", page)
    assert sources == ["re_viewer.js"]
    assert len(fetched(f"http://127.0.0.1:{port}/re_viewer.js")) > 10_000
    assert fetched(f"http://127.0.0.1:{port}/re_viewer_bg.wasm").startswith(b"\0asm")

    refused = CliRunner().invoke(main, ["replay", str(LOG), "--serve-web", str(port)])
    assert refused.exit_code == 2
    assert f"cannot serve the web viewer on port {port}: " in refused.stderr
    assert "Traceback" not in refused.stderr

    replay.wait_for("Ctrl-C ends it")
    assert replay.end(signal.SIGINT) == 0, replay.stderr_text


def test_a_finished_run_stays_in_the_browser_until_ctrl_c(
    command: Callable[..., Command], tree_file: Path, free_port: Callable[[], int]
) -> None:
    run = command("run", tree_file, "--fast", "--duration", "1", "--serve-web", free_port())
    run.wait_for("the run is over; the viewer for browsers stays open until Ctrl-C")
    assert b"<canvas" in fetched(address_of(run))
    assert run.end(signal.SIGINT) == 0, run.stderr_text
    assert "Traceback" not in run.stderr_text


def test_a_run_that_is_ended_while_it_starts_closes_the_viewer(
    command: Callable[..., Command], tree_file: Path, free_port: Callable[[], int]
) -> None:
    port = free_port()
    run = command("run", tree_file, "--serve-web", port, "--verbose")
    run.wait_for("publishing at")
    assert run.end(signal.SIGTERM) == 143, run.stderr_text
    with pytest.raises(OSError, match="refused"):
        fetched(f"http://127.0.0.1:{port}/")


def test_a_live_tree_is_drawn_in_chromium_without_an_error_on_its_console(
    command: Callable[..., Command], tree_file: Path, browser_with_webgl: Any, free_port: Callable[[], int]
) -> None:
    run = command("run", tree_file, "--serve-web", free_port())
    url = address_of(run)
    context = browser_with_webgl.new_context(viewport={"width": 600, "height": 400}, color_scheme="dark")
    page = context.new_page()
    errors: list[str] = []
    urls: list[str] = []
    page.on("console", lambda entry: errors.append(entry.text) if entry.type == "error" else None)
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("request", lambda request: urls.append(request.url))
    page.goto(f"{url}&renderer=webgl")
    leaf = np.array([GROOT.fill[RUNNING] >> shift & 0xFF for shift in (24, 16, 8)])
    deadline = time.monotonic() + WITHIN
    painted = 0
    while painted < 300 and time.monotonic() < deadline:
        page.wait_for_timeout(500)
        picture = Image.open(io.BytesIO(page.screenshot(timeout=1000 * WITHIN))).convert("RGB")
        painted = int((np.abs(np.asarray(picture, dtype=int) - leaf).max(axis=2) <= 2).sum())
    assert painted >= 300, f"no RUNNING leaf is seen; console: {errors}"
    assert errors == []
    assert {url.split("/")[2].partition(":")[0] for url in urls if "://" in url} == {"127.0.0.1"}
    context.close()
    assert run.end(signal.SIGINT) == 130, run.stderr_text
    with pytest.raises(OSError, match="refused"):
        fetched(url)
