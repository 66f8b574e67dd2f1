"""Completion, hover, hints and tokens of the real server, in a document with unsaved and broken text."""

import asyncio

import pytest

pytest.importorskip("pytest_lsp")

from lsprotocol import types

from btcore_studio.language.semantic_tokens import LEGEND
from tests.acceptance.editor import Editor, position, start_session

TEXT = """<root BTCPP_format="4">
<BehaviorTree ID="Größe🤖"><Sequence>
<Script code="z := 1; n := 2"/><Delay delay_msec="{n}"><AlwaysSuccess/></Delay>
</Sequence></BehaviorTree>
</root>
"""


async def labels(editor: Editor, uri: str, offset: int) -> list[str]:
    """Return the completion items at *offset* in the order of the server."""
    identifier = types.TextDocumentIdentifier(uri)
    params = types.CompletionParams(identifier, position(editor.texts[uri], offset))
    found = await editor.text_document_completion_async(params)
    assert isinstance(found, types.CompletionList)
    return [item.label for item in sorted(found.items, key=lambda item: item.sort_text or "")]


async def type_and_ask() -> None:
    async with start_session() as editor:
        uri = editor.open("untitled:baum.xml", TEXT)
        end = TEXT.index("\n</Sequence>")
        editor.replace(uri, end, end, '\n<Delay delay_msec="{')
        cursor = end + len('\n<Delay delay_msec="{')
        assert await labels(editor, uri, cursor) == ["n", "z", "delay_msec"]

        identifier = types.TextDocumentIdentifier(uri)
        text = editor.texts[uri]
        place = position(text, text.index("{n}") + 1)
        found = await editor.text_document_hover_async(types.HoverParams(identifier, place))
        assert found is not None
        assert "Written by:" in found.contents.value  # type: ignore[union-attr]

        everything = types.Range(types.Position(0, 0), position(text, len(text)))
        hints = await editor.text_document_inlay_hint_async(types.InlayHintParams(identifier, everything))
        assert [hint.label for hint in hints or ()] == [": unsigned int"]

        tokens = await editor.text_document_semantic_tokens_full_async(types.SemanticTokensParams(identifier))
        assert tokens is not None
        assert LEGEND.token_types[tokens.data[3]] == "variable"
        ranged = await editor.text_document_semantic_tokens_range_async(
            types.SemanticTokensRangeParams(identifier, everything)
        )
        assert ranged == tokens


def test_features_answer_over_the_protocol() -> None:
    asyncio.run(type_and_ask())
