"""An editor without a screen: it starts `btcore lsp`, types into documents, and receives diagnostics."""

import asyncio
import sys
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from lsprotocol import types
from pygls.protocol import default_converter
from pytest_lsp import LanguageClient

LIMIT_S = 300.0
"""The time limit for each answer of the server (s)."""


class Editor(LanguageClient):
    """The client's side of a session.

    Attributes:
        texts: The text of each open document by URI.
        published: The last diagnostics of each document, with their version.
        shown: The messages for the user.
        errors: What went wrong in the server outside of requests.
    """

    def __init__(self) -> None:
        super().__init__(converter_factory=default_converter)
        self.texts: dict[str, str] = {}
        self.versions: dict[str, int] = {}
        self.published: dict[str, types.PublishDiagnosticsParams] = {}
        self.shown: list[str] = []
        self._news = asyncio.Event()

        @self.feature(types.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)
        def publish(params: types.PublishDiagnosticsParams) -> None:
            self.published[params.uri] = params
            self._news.set()

        @self.feature(types.WINDOW_SHOW_MESSAGE)
        def show(params: types.ShowMessageParams) -> None:
            self.shown.append(params.message)
            self._news.set()

        @self.feature(types.CLIENT_REGISTER_CAPABILITY)
        def register(params: types.RegistrationParams) -> None:
            pass

    def open(self, document: Path | str, text: str | None = None) -> str:
        """Open a file or a URI, and return the URI."""
        uri = document.as_uri() if isinstance(document, Path) else document
        if text is None:
            assert isinstance(document, Path)
            text = document.read_bytes().decode()
        self.texts[uri], self.versions[uri] = text, 1
        item = types.TextDocumentItem(uri, "xml", 1, text)
        self.text_document_did_open(types.DidOpenTextDocumentParams(item))
        return uri

    def replace(self, uri: str, start: int, end: int, text: str) -> None:
        """Replace the characters from *start* to *end* of an open document by an incremental change."""
        before = self.texts[uri]
        self.versions[uri] += 1
        span = types.Range(position(before, start), position(before, end))
        self.texts[uri] = before[:start] + text + before[end:]
        change = types.TextDocumentContentChangePartial(span, text)
        identifier = types.VersionedTextDocumentIdentifier(self.versions[uri], uri)
        self.text_document_did_change(types.DidChangeTextDocumentParams(identifier, [change]))

    def close(self, uri: str) -> None:
        """Close a document without saving it."""
        identifier = types.TextDocumentIdentifier(uri)
        self.text_document_did_close(types.DidCloseTextDocumentParams(identifier))

    async def find_mistakes(self, uri: str) -> list[types.Diagnostic]:
        """Return the diagnostics of the current version of an open document."""
        async with asyncio.timeout(LIMIT_S):
            while uri not in self.published or self.published[uri].version != self.versions[uri]:
                self._news.clear()
                await self._news.wait()
        return list(self.published[uri].diagnostics)

    async def until(self, condition: Any) -> None:
        """Wait until *condition*() is true, which is checked after each notification of the server."""
        async with asyncio.timeout(LIMIT_S):
            while not condition():
                self._news.clear()
                await self._news.wait()


def position(text: str, offset: int) -> types.Position:
    """Return the position of *offset*, computed independently of the server."""
    before = text[:offset].replace("\r\n", "\n").replace("\r", "\n")
    line = before.rpartition("\n")[2]
    return types.Position(before.count("\n"), len(line.encode("utf-16-le", "surrogatepass")) // 2)


@asynccontextmanager
async def start_session(
    folders: Sequence[Path] = (), settings: Any = None, cwd: Path | None = None
) -> AsyncIterator[Editor]:
    """Start the server, initialize it, and shut it down in the end.

    Args:
        folders: The folders of the workspace.
        settings: The settings of the client.
        cwd: The current folder of the server.
    """
    editor = Editor()
    await editor.start_io(sys.executable, "-m", "btcore", "lsp", "--stdio", cwd=cwd)
    workspace = [types.WorkspaceFolder(folder.as_uri(), folder.name) for folder in folders]
    capabilities = types.ClientCapabilities(
        # Editors offer several encodings; the server must choose UTF-16, which all of them support.
        general=types.GeneralClientCapabilities(
            position_encodings=[types.PositionEncodingKind.Utf8, types.PositionEncodingKind.Utf16]
        )
    )
    try:
        result = await editor.initialize_session(
            types.InitializeParams(capabilities, workspace_folders=workspace, initialization_options=settings)
        )
        editor.server_capabilities = result.capabilities
        assert result.capabilities.position_encoding == types.PositionEncodingKind.Utf16
        yield editor
        await editor.shutdown_session()
        assert editor.error is None
    finally:
        if editor._server is not None and editor._server.returncode is None:
            editor._server.kill()
        await editor.stop()
