"""The language server of the page without an installation, here in CPython."""

import asyncio
import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from btcore_studio.language.checker import Checker
from btcore_studio.language.project import Project, Settings
from btcore_studio.site.session import LocalWorker, SiteSession

URI = "file:///studio/tree.xml"
TREE = """<root BTCPP_format="4">
  <BehaviorTree ID="Main"><Sequence><Sleep msec="10"/><SubTree ID="Gone"/></Sequence></BehaviorTree>
</root>
"""


class Client:
    """The page's side of a session."""

    def __init__(self) -> None:
        self.received: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self.session = SiteSession(lambda message: self.received.put_nowait(json.loads(message)), None)

    def send(self, method: str, params: object, request: int | None = None) -> None:
        message = {"jsonrpc": "2.0", "method": method, "params": params}
        self.session.receive(json.dumps(message if request is None else message | {"id": request}))

    async def wait(self, wanted: dict[str, Any]) -> dict[str, Any]:
        """Return the next message with the *wanted* items."""
        async with asyncio.timeout(30):
            while not wanted.items() <= (message := await self.received.get()).items():
                pass
        return message

    async def open(self, text: str) -> None:
        folders = [{"uri": "file:///studio", "name": "studio"}]
        capabilities = {"workspace": {"semanticTokens": {"refreshSupport": True}}}
        self.send("initialize", {"capabilities": capabilities, "workspaceFolders": folders}, 1)
        document = {"uri": URI, "languageId": "behaviortree", "version": 1, "text": text}
        self.send("textDocument/didOpen", {"textDocument": document})
        await self.wait({"id": 1})
        self.send("initialized", {})


def test_a_document_is_checked_and_drawn_without_a_process(monkeypatch: pytest.MonkeyPatch) -> None:
    async def use() -> None:
        client = Client()
        await client.open(TREE)
        (problem,) = (await client.wait({"method": "textDocument/publishDiagnostics"}))["params"][
            "diagnostics"
        ]
        assert "Gone" in problem["message"]
        params = {"textDocument": {"uri": URI}, "tree": None, "folded": [], "call": ""}
        client.send("btcore/drawing", params, 2)
        drawing = (await client.wait({"id": 2}))["result"]
        assert [node["id"] for node in drawing["nodes"]] == ["Sequence", "Sleep", "SubTree"]

    async def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a process is started")

    monkeypatch.setattr(asyncio, "create_subprocess_exec", refuse)
    monkeypatch.setattr(subprocess, "Popen", refuse)
    asyncio.run(use())


def test_invalid_parameters_are_refused_with_a_sentence() -> None:
    async def use() -> None:
        client = Client()
        await client.open(TREE)
        client.send("btcore/drawing", {"textDocument": 3}, 2)
        error = (await client.wait({"id": 2}))["error"]
        assert error["message"].startswith("the parameters of btcore/drawing are invalid")

    asyncio.run(use())


def test_no_node_library_is_imported_whatever_the_settings_are(tmp_path: Path) -> None:
    imported = tmp_path / "imported"
    (tmp_path / "leaves.py").write_text(f"open({str(imported)!r}, 'w')\n", encoding="utf-8")
    (tmp_path / "tree.xml").write_text(TREE, encoding="utf-8")

    async def use() -> None:
        project = Project()
        project.configure([tmp_path], Settings(trusted=True, plugins=("leaves.py",)))
        checked = asyncio.Event()
        checker = Checker(
            project, lambda *_: checked.set(), lambda _: None, lambda: None, start_worker=LocalWorker.start
        )
        checker.start()
        checker.check_all()
        async with asyncio.timeout(30):
            await checked.wait()
        await checker.close()

    asyncio.run(use())
    assert not imported.exists()
