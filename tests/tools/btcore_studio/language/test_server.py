# ruff: noqa: E501 - documents
"""Sessions of an editor with the real server, `btcore lsp`."""

import asyncio
import os
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

pytest.importorskip("pytest_lsp")

from lsprotocol import types

from btcore.entry_points import LIMIT_VARIABLE
from btcore_studio.language import library_worker
from btcore_studio.language.checker import Checker
from btcore_studio.language.diagnostics import Report
from btcore_studio.language.project import DocumentKey, Project, Settings

TREE = '<root BTCPP_format="4">\n<!-- 🤖 --><BehaviorTree ID="Größe"><Greet who="{gast}"/></BehaviorTree>\n</root>\n'
LEAVES = '''
from pathlib import Path
from btcore import In, action

Path(__file__).with_name("imported").write_text("yes")

@action
def greet(who: In[str]) -> bool:
    """Say hello."""
    return True
'''


@pytest.fixture(scope="module")
def editor(acceptance_script: Callable[[str], ModuleType]) -> ModuleType:
    return acceptance_script("editor")


@pytest.fixture(autouse=True)
def no_node_libraries(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the servers import no installed libraries of nodes, which takes longer than most tests."""
    monkeypatch.setenv(LIMIT_VARIABLE, "lsp")


def codes(found: list[types.Diagnostic]) -> list[str]:
    return [str(item.code) for item in found]


def test_a_session_with_several_files(editor: ModuleType, tmp_path: Path) -> None:
    part = tmp_path / "küche.xml"
    part.write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="Küche"><Slep/></BehaviorTree></root>', encoding="utf-8"
    )
    main = tmp_path / "haus.xml"
    main.write_text(
        '<root BTCPP_format="4">\n<include path="küche.xml"/><!-- 🤖 -->'
        '<BehaviorTree ID="Haus"><Sequence><SubTree ID="Kuche"/></Sequence></BehaviorTree></root>',
        encoding="utf-8",
    )  # fmt: skip
    (tmp_path / "other.xml").write_text("<note>not a tree</note>", encoding="utf-8")
    (tmp_path / "broken.xml").write_text('<root BTCPP_format="4"><BehaviorTree ID="A">', encoding="utf-8")

    async def use() -> None:
        async with editor.start_session([tmp_path]) as client:
            uri = client.open(main)
            # The open file is answered first, then the rest of the project.
            found = await client.find_mistakes(uri)
            assert next(iter(client.published)) == uri
            await client.until(lambda: len(client.published) == 3)
            assert {Path(path).name for path in client.published} == {
                "haus.xml",
                "k%C3%BCche.xml",
                "broken.xml",
            }
            assert codes(client.published[part.as_uri()].diagnostics) == ["E101"]
            assert codes(client.published[(tmp_path / "broken.xml").as_uri()].diagnostics) == ["E002"]
            assert codes(found) == ["E109"]
            assert found[0].range == editor_range(editor, client.texts[uri], '"Kuche"')
            # A quick fix, applied as the editor does, mends the tree.
            action = (await actions(client, uri, found[0].range))[0]
            assert action.title == "Change to 'Küche'"
            apply(client, uri, action)
            assert codes(await client.find_mistakes(uri)) == []
            # An unsaved change of the included file is seen by the including file.
            second = client.open(part)
            text = client.texts[second]
            client.replace(second, text.index("Küche"), text.index("Küche") + 5, "Bäder")
            assert codes(await client.find_mistakes(second)) == ["E101"]
            await client.until(lambda: codes(client.published[uri].diagnostics) == ["E109"])
            client.close(second)
            await client.until(lambda: codes(client.published[uri].diagnostics) == [])
            # Formatting and broken XML.
            edits = await formatting(client, uri)
            assert edits
            client.replace(uri, len(client.texts[uri]) - 1, len(client.texts[uri]), "")
            assert codes(await client.find_mistakes(uri)) == ["E002"]
            assert not await formatting(client, uri)
            # A document without a file.
            untitled = client.open("untitled:Untitled-1", TREE)
            assert codes(await client.find_mistakes(untitled)) == ["E101"]
            lenses = await client.text_document_code_lens_async(
                types.CodeLensParams(types.TextDocumentIdentifier(untitled))
            )
            assert [lens.command.command for lens in lenses] == ["btcore.run", "btcore.prove", "btcore.show"]
            # A file that is deleted has no mistakes.
            (tmp_path / "broken.xml").unlink()
            deleted = types.FileEvent((tmp_path / "broken.xml").as_uri(), types.FileChangeType.Deleted)
            client.workspace_did_change_watched_files(types.DidChangeWatchedFilesParams([deleted]))
            await client.until(lambda: not client.published[deleted.uri].diagnostics)
            assert client.shown == []

    asyncio.run(use())


def editor_range(editor: ModuleType, text: str, quoted: str) -> types.Range:
    start = text.index(quoted) + 1
    return types.Range(editor.position(text, start), editor.position(text, start + len(quoted) - 2))


async def actions(client: Any, uri: str, range: types.Range) -> Any:
    context = types.CodeActionContext([])
    params = types.CodeActionParams(types.TextDocumentIdentifier(uri), range, context)
    return await client.text_document_code_action_async(params)


def apply(client: Any, uri: str, action: types.CodeAction) -> None:
    (edit,) = action.edit.changes[uri]  # type: ignore[union-attr, index]
    client.versions[uri] += 1
    identifier = types.VersionedTextDocumentIdentifier(client.versions[uri], uri)
    change = types.TextDocumentContentChangePartial(edit.range, edit.new_text)
    client.text_document_did_change(types.DidChangeTextDocumentParams(identifier, [change]))
    client.texts[uri] = client.texts[uri].replace("Kuche", "Küche")


async def formatting(client: Any, uri: str) -> Any:
    options = types.FormattingOptions(4, True)
    params = types.DocumentFormattingParams(types.TextDocumentIdentifier(uri), options)
    return await client.text_document_formatting_async(params)


class CheckedProject:
    """A project with a background check, without a client."""

    def __init__(self, folder: Path, settings: Settings) -> None:
        self.project = Project()
        self.project.configure([folder], settings)
        self.shown: list[str] = []
        self.found: dict[DocumentKey, list[Report]] = {}
        self.news = asyncio.Event()
        self.checker = Checker(self.project, self.publish, self.shown.append, lambda: None)
        self.checker.start()
        self.checker.check_all()

    def publish(self, key: DocumentKey, version: int | None, reports: list[Report]) -> None:
        self.found[key] = reports
        self.news.set()

    async def until(self, path: Path, expected: list[str]) -> None:
        async with asyncio.timeout(300):
            while [report.code for report in self.found.get(path, ())] != expected or path not in self.found:
                self.news.clear()
                await self.news.wait()


def test_python_leaves_are_imported_only_if_the_user_trusts_them(tmp_path: Path) -> None:
    tree, leaves = tmp_path / "tree.xml", tmp_path / "leaves.py"
    tree.write_text(TREE, encoding="utf-8")
    leaves.write_text(LEAVES, encoding="utf-8")
    imported, other = tmp_path / "imported", tmp_path / "package.xml"
    other.write_text("<package/>", encoding="utf-8")

    async def use() -> None:
        checked = CheckedProject(tmp_path, Settings(plugins=("leaves.py",)))
        await checked.until(tree, ["E101"])
        assert not imported.exists()
        [hint] = checked.shown
        assert hint.startswith("Python leaves are unknown")
        # Now the code runs.
        checked.project.configure([tmp_path], Settings(trusted=True, plugins=("leaves.py",), given=("gast",)))
        checked.checker.reload()
        await checked.until(tree, [])
        assert imported.exists()
        model = checked.project.models["Greet"]
        assert (model.description, model.file, model.line) == ("Say hello.", str(leaves), 7)
        # A change of the source is seen.
        leaves.write_text(LEAVES.replace("who", "guest"), encoding="utf-8")
        os.utime(leaves, ns=(1, 1))
        for file in (other, leaves):
            checked.checker.file_changed(file)
        await checked.until(tree, ["E201"])
        assert checked.project.models["Greet"].ports[0].name == "guest"
        assert checked.found.keys() == {tree}, "other files are not checked as trees"
        assert checked.shown == [hint]
        await checked.checker.close()

    asyncio.run(use())


def test_nodes_of_the_last_import_are_kept_while_a_library_has_a_mistake(tmp_path: Path) -> None:
    tree, leaves = tmp_path / "tree.xml", tmp_path / "leaves.py"
    tree.write_text(TREE, encoding="utf-8")
    leaves.write_text(LEAVES, encoding="utf-8")

    async def use() -> None:
        checked = CheckedProject(tmp_path, Settings(trusted=True, plugins=("leaves.py",)))
        await checked.until(tree, ["W201"])
        for number in (1, 2):
            leaves.write_text(LEAVES + "\nGRÜSSE = 'Hallo 🤖' + 1\n", encoding="utf-8")
            os.utime(leaves, ns=(number, number))
            del checked.found[tree]
            checked.checker.file_changed(leaves)
            checked.checker.check_all()
            await checked.until(tree, ["W201"])
            model = checked.project.models["Greet"]
            assert (model.description, model.file, model.line) == ("Say hello.", str(leaves), 7)
            (problem,) = checked.found[leaves]
            assert "can only concatenate str" in problem.message
            assert (problem.line, problem.is_error) == (LEAVES.count("\n") + 1, True)
        leaves.write_text(LEAVES.replace("who", "guest"), encoding="utf-8")
        os.utime(leaves, ns=(3, 3))
        checked.checker.file_changed(leaves)
        await checked.until(tree, ["E201"])
        assert checked.found[leaves] == []
        assert checked.shown == []
        await checked.checker.close()

    asyncio.run(use())


def test_a_mistake_in_a_helper_of_a_library_is_reported_there_until_it_is_repaired(tmp_path: Path) -> None:
    tree, helper = tmp_path / "tree.xml", tmp_path / "words_of_greeting.py"
    tree.write_text(TREE, encoding="utf-8")
    (tmp_path / "leaves.py").write_text(f"import {helper.stem}\n{LEAVES}", encoding="utf-8")
    helper.write_text("WORDS = (\n", encoding="utf-8")

    async def use() -> None:
        checked = CheckedProject(tmp_path, Settings(trusted=True, plugins=("leaves.py",)))
        await checked.until(helper, [""])
        (problem,) = checked.found[helper]
        assert problem.line == 0
        assert "SyntaxError: '(' was never closed" in problem.message
        # A line in the client's protocol, without a code.
        assert problem.diagnostic().code is None
        helper.write_text("WORDS = ()\n", encoding="utf-8")
        os.utime(helper, ns=(1, 1))
        checked.checker.file_changed(helper)
        await checked.until(helper, [])
        assert checked.shown == []
        await checked.checker.close()

    asyncio.run(use())


def test_nodes_of_the_last_import_are_kept_if_an_import_never_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tree, leaves = tmp_path / "tree.xml", tmp_path / "leaves.py"
    tree.write_text(TREE, encoding="utf-8")
    leaves.write_text(LEAVES, encoding="utf-8")
    ask = library_worker.WorkerProcess.ask

    async def limited(self: library_worker.WorkerProcess, message: Any, limit: float) -> Any:
        return await ask(self, message, 0.2 if message.get("trusted") else limit)

    async def use() -> None:
        checked = CheckedProject(tmp_path, Settings(trusted=True, plugins=("leaves.py",)))
        await checked.until(tree, ["W201"])
        monkeypatch.setattr(library_worker.WorkerProcess, "ask", limited)
        leaves.write_text(LEAVES + "\nwhile True: pass\n", encoding="utf-8")
        del checked.found[tree]
        checked.checker.file_changed(leaves)
        checked.checker.check_all()
        await checked.until(tree, ["W201"])
        assert checked.shown == [
            "The import of the node libraries took longer than 0.2 s. Nodes of the last import are kept."
        ]
        await checked.checker.close()

    asyncio.run(use())


def test_a_project_of_groot(tmp_path: Path) -> None:
    project, first, second = tmp_path / "haus.btproj", tmp_path / "a.xml", tmp_path / "b.xml"
    project.write_text(
        '<root BTCPP_format="4" project_name="Haus"><include path="a.xml"/><include path="b.xml"/>'
        '<TreeNodesModel><Action ID="Greet"><input_port name="who"/></Action></TreeNodesModel></root>',
        encoding="utf-8",
    )
    first.write_text(TREE.replace("who", "whom"), encoding="utf-8")
    second.write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="B"><SubTree ID="Größe"/></BehaviorTree></root>',
        encoding="utf-8",
    )

    async def use() -> None:
        checked = CheckedProject(tmp_path, Settings())
        # The project declares <Greet>, and its trees call each other without includes.
        await checked.until(project, [])
        await checked.until(first, ["E201"])
        assert second not in checked.found
        await checked.checker.close()

    asyncio.run(use())


def test_a_file_is_checked_alone_or_with_the_project_that_includes_it(tmp_path: Path) -> None:
    tree = '<root BTCPP_format="4"><!-- 🤖 --><BehaviorTree ID="{}">{}</BehaviorTree></root>'
    calls = tree.format("Größe", '<Sequence><SubTree ID="Küche"/><Greet/></Sequence>')
    caller, file = tmp_path / "größe.xml", tmp_path / "haus.btproj"
    caller.write_text(calls, encoding="utf-8")
    (tmp_path / "küche.xml").write_text(tree.format("Küche", "<AlwaysSuccess/>"), encoding="utf-8")
    models = '<TreeNodesModel><Action ID="Greet"/></TreeNodesModel>'
    empty = f'<root BTCPP_format="4" project_name="🏠">{models}</root>'
    full = empty.replace(models, f'<include path="größe.xml"/><include path="küche.xml"/>{models}')
    file.write_text(empty, encoding="utf-8")

    async def use() -> None:
        checked = CheckedProject(tmp_path, Settings())
        project = checked.project

        def write(path: Path, text: str, version: int) -> None:
            checked.checker.changed(project.open(path.as_uri(), text, version))

        await checked.until(caller, ["E109", "E101"])
        write(caller, calls + "\n", 1)
        write(file, full, 1)
        await checked.until(caller, [])
        write(caller, calls.replace("Küche", "Kuche"), 2)
        await checked.until(caller, ["E109"])
        assert "did you mean 'Küche'" in checked.found[caller][0].hint
        write(file, empty, 2)
        await checked.until(caller, ["E109", "E101"])
        write(file, full, 3)
        await checked.until(caller, ["E109"])
        # The project is deleted.
        project.close(file.as_uri())
        file.unlink()
        project.forget_files()
        checked.checker.file_changed(file)
        await checked.until(caller, ["E109", "E101"])
        await checked.checker.close()

    asyncio.run(use())


def test_keys_of_an_included_file_may_be_written_by_its_callers(tmp_path: Path) -> None:
    tree = '<root BTCPP_format="4"><!-- 🤖 -->{}<BehaviorTree ID="{}">{}</BehaviorTree></root>'
    nodes = '<SetBlackboard value="{größe}" output_key="x"/><AlwaysSuccess _skipif="1"/>'
    script = f'<Sequence><Script code="zahl += 1"/>{nodes}</Sequence>'
    part, main = tmp_path / "küche.xml", tmp_path / "haus.xml"
    part.write_text(tree.format("", "Küche", script), encoding="utf-8")
    call = '<SubTree ID="Küche" zahl="1" größe="2"/>'
    main.write_text(tree.format('<include path="küche.xml"/>', "Haus", call), encoding="utf-8")

    async def use() -> None:
        checked = CheckedProject(tmp_path, Settings())
        await checked.until(part, ["W212"])
        text = tree.format('<include path="küche.xml"/>', "Haus", call.replace("zahl", "anzahl"))
        checked.checker.changed(checked.project.open(main.as_uri(), text, 1))
        await checked.until(part, ["W209", "W212"])
        await checked.until(main, ["W204"])
        # Without a format, the file has that of the file that includes it.
        text = tree.format("", "Küche", script.replace("<Script", '<AlwaysSuccess _skipif="1"/><Script'))
        text = text.replace(' BTCPP_format="4"', "")
        checked.checker.changed(checked.project.open(part.as_uri(), text, 1))
        await checked.until(part, ["W212", "W209", "W212"])
        # The file is a program of its own if no other file includes it.
        text = tree.format("", "Haus", "<AlwaysSuccess/>")
        checked.checker.changed(checked.project.open(main.as_uri(), text, 2))
        await checked.until(part, ["E009", "E201", "E101", "E201"])
        checked.checker.changed(checked.project.open(part.as_uri(), part.read_text(encoding="utf-8"), 2))
        await checked.until(part, ["W209", "W201", "W212"])
        await checked.checker.close()

    asyncio.run(use())


def test_settings_of_a_wrong_type_are_ignored() -> None:
    wrong = {"btcore": {"trusted": "yes", "plugins": "leaves.py", "models": [1, "", "m.xml"], "given": None}}
    assert Settings.from_client(wrong) == Settings(models=("m.xml",))
    for nothing in ([1], {"btcore": 3}, {}, {"other": {}}, None):
        assert Settings.from_client(nothing) is None
    assert Settings.from_client({"trusted": True}) == Settings(trusted=True)


def test_settings_that_change_during_an_import(tmp_path: Path) -> None:
    tree, leaves = tmp_path / "tree.xml", tmp_path / "leaves.py"
    tree.write_text(TREE, encoding="utf-8")
    leaves.write_text(LEAVES + "\nwhile True: pass\n", encoding="utf-8")

    async def use() -> None:
        checked = CheckedProject(tmp_path, Settings(trusted=True, plugins=("leaves.py",)))
        while not (tmp_path / "imported").exists():
            await asyncio.sleep(0.05)
        checked.project.configure([tmp_path], Settings())
        checked.checker.reload()
        await checked.until(tree, ["E101"])
        assert checked.shown == []
        await checked.checker.close()

    asyncio.run(use())
