"""The language server of the page without an installation, here in CPython."""

import asyncio
import subprocess
from pathlib import Path

import pytest

from btcore_studio.language.checker import Checker
from btcore_studio.language.project import Project, Settings
from btcore_studio.site.session import LocalWorker
from tests.tools.btcore_studio.site.session_requests import FOLDER, Page

URI = f"{FOLDER}/tree.xml"
TREE = """<root BTCPP_format="4">
  <BehaviorTree ID="Main"><Sequence><Sleep msec="10"/><SubTree ID="Gone"/></Sequence></BehaviorTree>
</root>
"""


async def open_tree(page: Page) -> None:
    """Open the tree before the server has replied to the first request, as the page does."""
    capabilities = {"workspace": {"semanticTokens": {"refreshSupport": True}}}
    folders = [{"uri": FOLDER, "name": "studio"}]
    params = {"capabilities": capabilities, "workspaceFolders": folders}
    initialized = asyncio.create_task(page.request("initialize", params))
    await asyncio.sleep(0)
    document = {"uri": URI, "languageId": "behaviortree", "version": 1, "text": TREE}
    page.notify("textDocument/didOpen", {"textDocument": document})
    await initialized
    page.notify("initialized", {})


def test_a_document_is_checked_and_drawn_without_a_process(monkeypatch: pytest.MonkeyPatch) -> None:
    async def use() -> None:
        page = Page(None)
        await open_tree(page)
        await page.until(page.problems, URI)
        (problem,) = page.problems[URI]
        assert "Gone" in problem["message"]
        params = {"textDocument": {"uri": URI}, "tree": None, "folded": [], "call": ""}
        drawing = await page.request("btcore/drawing", params)
        assert [node["id"] for node in drawing["nodes"]] == ["Sequence", "Sleep", "SubTree"]

    async def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a process is started")

    monkeypatch.setattr(asyncio, "create_subprocess_exec", refuse)
    monkeypatch.setattr(subprocess, "Popen", refuse)
    asyncio.run(use())


def test_invalid_parameters_are_refused_with_a_sentence() -> None:
    async def use() -> None:
        page = Page(None)
        await open_tree(page)
        error = await page.request("btcore/drawing", {"textDocument": 3})
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
