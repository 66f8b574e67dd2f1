"""`btcore studio` as a process: what it shows for each source, and how it ends."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from websockets.sync.client import connect

from btcore import bundled_trees
from btcore_studio.page_server import server
from tests.tools.btcore_studio.page_server.conftest import TREE, PageClient

# The command needs no content of the page.
WITH_PAGE = """
import sys, pathlib
from btcore.__main__ import main
from btcore_studio.page_server import server
page = pathlib.Path(sys.argv.pop(1))
server.built_page = lambda: page
sys.exit(main())
"""


@contextmanager
def running(built: Path, folder: Path, *arguments: str) -> Iterator[tuple[subprocess.Popen[str], PageClient]]:
    command = [sys.executable, "-c", WITH_PAGE, str(built), "studio", "--json", *arguments]
    pipe = subprocess.PIPE
    with subprocess.Popen(
        command, cwd=folder, stdout=pipe, stderr=pipe, text=True, encoding="utf-8"
    ) as process:
        try:
            assert process.stdout is not None
            url = json.loads(process.stdout.readline())["url"]
            origin: Any = url.rsplit("/", 2)[0]
            with connect(url.replace("http:", "ws:") + "socket", origin=origin, max_size=None) as socket:
                yield process, PageClient(socket)
        finally:
            process.kill()


def test_file_is_edited_until_a_signal(folder: Path, built: Path) -> None:
    with running(built, folder, "tree.xml", "--tree", "Rounds") as (process, page):
        start = page.request("btcore/start")
        uri = (folder / "tree.xml").as_uri()
        assert start == {
            "folder": str(folder),
            "uri": uri,
            "tree": "Rounds",
            "readOnly": False,
            "guide": start["guide"],
            "live": start["live"],
            "trusted": False,
            "recording": None,
            "versions": None,
        }
        page.request("btcore/read", {"uri": uri})
        edit = {"range": {"start": {"line": 0, "character": 0}, "end": {"line": 0, "character": 0}}}
        page.request("btcore/push", {"uri": uri, "version": 1, "edits": [{**edit, "newText": "<!-- x -->"}]})
        process.send_signal(signal.SIGTERM)
        _, errors = process.communicate(timeout=60)
        # Windows has no SIGTERM: it ends the process at once.
        assert process.returncode == (143 if os.name == "posix" else 1)
    if os.name == "posix":
        assert "tree.xml has unsaved changes" in errors
        kept = Path(errors.split("kept in ")[1].replace("\n", "").strip())
        assert kept.read_text(encoding="utf-8") == "<!-- x -->" + TREE
        assert (kept.parent.parent.stat().st_mode & 0o77) == 0
    assert (folder / "tree.xml").read_text(encoding="utf-8") == TREE


def test_folder_shows_its_main_tree(folder: Path, built: Path) -> None:
    (folder / "a.btproj").write_text('<root project_name="a"/>')
    (folder / "b.xml").write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="B"><Sleep/></BehaviorTree></root>'
    )
    with running(built, folder) as (_, page):
        start = page.request("btcore/start")
        assert start["uri"] == (folder / "tree.xml").as_uri()
        assert [file["name"] for file in page.request("btcore/files")] == ["a.btproj", "b.xml", "tree.xml"]


def test_bundled_tree_is_read_only(folder: Path, built: Path) -> None:
    with running(built, folder, "bumpgo") as (_, page):
        start = page.request("btcore/start")
        assert start["uri"] == (bundled_trees.folder() / "bumpgo.xml").as_uri()
        assert start["readOnly"] is True


def test_recording_is_read_only_and_has_moments(folder: Path, built: Path) -> None:
    run = [sys.executable, "-m", "btcore", "run", "tree.xml", "--record", "run.btrec.txt", "--fast"]
    subprocess.run(run, cwd=folder, check=True, capture_output=True)
    with running(built, folder, "run.btrec.txt") as (_, page):
        start = page.request("btcore/start")
        assert start["readOnly"] is True
        assert start["recording"]["count"] >= 1
        assert page.request("btcore/read", {"uri": start["uri"]})["text"] == TREE
        moment = page.request("btcore/moment", {"position": 1})
        assert (moment["position"], moment["root"]) == (1, 2)
        assert page.error("btcore/moment", {"position": "x"})[0] == -32602


def test_usage_errors(cli: Callable[..., Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "built_page", lambda: None)
    assert "make page" in cli("studio").stderr
    monkeypatch.setattr(server, "built_page", lambda: tmp_path)
    assert "needs a file" in cli("studio", "-").stderr
    assert cli("studio", "missing.xml").exit_code == 2
    (tmp_path / "notes.txt").write_text("x")
    (tmp_path / "run.btlog").write_text("x")
    assert "--save-recording run.btrec.txt" in " ".join(
        cli("studio", str(tmp_path / "run.btlog")).stderr.split()
    )
    assert "must end with .xml or .btproj" in cli("studio", str(tmp_path / "notes.txt")).stderr
    tree = str(bundled_trees.folder() / "bumpgo.xml")
    assert "takes two files, and no SOURCE" in cli("studio", ".", "--compare", tree, tree).stderr
    assert "is a folder: compare two files" in cli("studio", "--compare", str(tmp_path), tree).stderr
    assert "must end with .xml" in cli("studio", "--compare", tree, str(tmp_path / "notes.txt")).stderr
    (tmp_path / "other.xml").write_bytes(b"<root>\xff</root>")
    assert "is not UTF-8" in cli("studio", "--compare", tree, str(tmp_path / "other.xml")).stderr
