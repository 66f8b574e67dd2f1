"""Navigation through the server, as an editor requests it: `btcore lsp` over stdio."""

import asyncio
from pathlib import Path

import pytest

pytest.importorskip("pytest_lsp")

from lsprotocol import types
from pygls.exceptions import JsonRpcException

from tests.acceptance.editor import position, start_session

MAIN = """<root BTCPP_format="4" main_tree_to_execute="Zustellen">
    <include path="türen.xml"/>
    <BehaviorTree ID="Zustellen">
        <Sequence name="🚚">
            <Script name="📦📦" code="ziel := 'Küche'"/>
            <SubTree ID="Türen" raum="{ziel}"/><Fahren/>
        </Sequence>
    </BehaviorTree>
</root>
"""
DOORS = """<root BTCPP_format="4">
    <BehaviorTree ID="Türen">
        <SetBlackboard value="{raum}" output_key="letzter"/>
    </BehaviorTree>
</root>
"""


def test_editor_navigates_and_renames(tmp_path: Path) -> None:
    main, doors = tmp_path / "main.xml", tmp_path / "türen.xml"
    main.write_text(MAIN, encoding="utf-8")
    doors.write_text(DOORS, encoding="utf-8")
    leaves = "# 🤖\nimport btcore\n\n\n@btcore.action\ndef fahren():\n    pass\n"
    (tmp_path / "leaves.py").write_text(leaves, encoding="utf-8")
    asyncio.run(navigate(tmp_path, main, doors))


async def navigate(folder: Path, main: Path, doors: Path) -> None:
    async with start_session([folder], {"trusted": True, "plugins": ["leaves.py"]}) as editor:
        uri = editor.open(main)
        # A change that is not saved: each place below it moves.
        editor.replace(uri, MAIN.index("    <BehaviorTree"), MAIN.index("    <BehaviorTree"), "<!-- 🤖 -->\n")
        text = editor.texts[uri]
        document = types.TextDocumentIdentifier(uri)

        def at(place: str) -> types.Position:
            return position(text, text.index(place))

        outline = await editor.text_document_document_symbol_async(types.DocumentSymbolParams(document))
        assert [item.name for item in outline or ()] == ["türen.xml", "Zustellen"]
        folded = await editor.text_document_folding_range_async(types.FoldingRangeParams(document))
        assert (3, 7) in [(item.start_line, item.end_line) for item in folded or ()]
        (found,) = await editor.text_document_definition_async(types.DefinitionParams(document, at('Türen"')))
        assert found.uri == doors.as_uri()
        assert found.range == types.Range(types.Position(1, 22), types.Position(1, 27))
        await editor.find_mistakes(uri)  # the leaves are imported before
        (found,) = await editor.text_document_definition_async(
            types.DefinitionParams(document, at("Fahren/"))
        )
        assert (found.uri, found.range.start.line) == ((folder / "leaves.py").as_uri(), 4)
        context = types.ReferenceContext(include_declaration=False)
        places = await editor.text_document_references_async(
            types.ReferenceParams(context, document, at("ziel :="))
        )
        assert [item.range.start for item in places or ()] == [
            at("raum="), at("ziel}"), types.Position(2, 31),
        ]  # fmt: skip
        found_symbols = await editor.workspace_symbol_async(types.WorkspaceSymbolParams("tür"))
        assert [item.name for item in found_symbols or ()] == ["Türen"]

        prepared = await editor.text_document_prepare_rename_async(
            types.PrepareRenameParams(document, at("raum="))
        )
        assert prepared == types.PrepareRenamePlaceholder(types.Range(at("raum="), at('="{ziel')), "raum")
        edit = await editor.text_document_rename_async(types.RenameParams(document, at("raum="), "zimmer"))
        assert edit is not None
        assert {name: len(edits) for name, edits in (edit.changes or {}).items()} == {
            uri: 1,
            doors.as_uri(): 1,
        }
        with pytest.raises(JsonRpcException, match="<Sequence> is a node of btcore"):
            await editor.text_document_prepare_rename_async(
                types.PrepareRenameParams(document, at("Sequence n"))
            )
        with pytest.raises(JsonRpcException, match="' ' is not allowed"):
            await editor.text_document_rename_async(types.RenameParams(document, at('Türen"'), "Alle Türen"))
        assert editor.shown == []
