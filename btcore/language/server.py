"""The server: registers every feature of the language server, and keeps the project up to date.

Each feature is a module with functions of `(project, document, …)`. Their results are types of the protocol.
"""

from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any, Final

from lsprotocol import types
from pygls import uris
from pygls.lsp.server import LanguageServer
from pygls.protocol import LanguageServerProtocol
from pygls.protocol.language_server import lsp_method

from btcore import __version__
from btcore.language.project import Project, Settings, SourceDocument

NAME: Final = "btcore"


class TreeServerProtocol(LanguageServerProtocol):
    """The protocol with UTF-16 positions, which every client supports. The project holds the documents."""

    @lsp_method(types.INITIALIZE)
    def lsp_initialize(self, params: types.InitializeParams) -> Generator[Any, Any, types.InitializeResult]:
        """Initialize the server."""
        if params.capabilities.general is not None:
            # pygls would choose the first encoding that the client lists.
            params.capabilities.general.position_encodings = [types.PositionEncodingKind.Utf16]
        result = yield from super().lsp_initialize(params)
        return result

    # The methods of pygls would keep a second copy of each text. They also end lines at characters such as
    # U+2028, where the lines of the protocol do not end.

    @lsp_method(types.TEXT_DOCUMENT_DID_OPEN)
    def lsp_text_document__did_open(
        self, params: types.DidOpenTextDocumentParams
    ) -> Generator[Any, Any, None]:
        """Call the handler of the server."""
        yield self.fm.features[types.TEXT_DOCUMENT_DID_OPEN], (params,), None

    @lsp_method(types.TEXT_DOCUMENT_DID_CHANGE)
    def lsp_text_document__did_change(
        self, params: types.DidChangeTextDocumentParams
    ) -> Generator[Any, Any, None]:
        """Call the handler of the server."""
        yield self.fm.features[types.TEXT_DOCUMENT_DID_CHANGE], (params,), None

    @lsp_method(types.TEXT_DOCUMENT_DID_CLOSE)
    def lsp_text_document__did_close(
        self, params: types.DidCloseTextDocumentParams
    ) -> Generator[Any, Any, None]:
        """Call the handler of the server."""
        yield self.fm.features[types.TEXT_DOCUMENT_DID_CLOSE], (params,), None


class TreeServer(LanguageServer):
    """A language server for documents of trees.

    Attributes:
        project: The documents and files of the client's workspace.
    """

    def __init__(self) -> None:
        super().__init__(
            NAME,
            __version__,
            text_document_sync_kind=types.TextDocumentSyncKind.Incremental,
            protocol_cls=TreeServerProtocol,
        )
        self.project = Project()


def create_server() -> TreeServer:
    """Return a server with all features, which is not started yet."""
    server = TreeServer()
    _add_lifecycle(server)
    _add_features(server)
    return server


def _add_features(server: TreeServer) -> None:
    """Register every feature that answers requests.

    A feature of a whole document is a function of `(project, document)`. A feature of a place has the offset
    of the cursor as its third argument. All other features have the parameters of the request.
    """
    project = server.project

    def of_document(method: str, feature: Callable[..., Any], options: Any = None) -> None:
        def handle(params: Any) -> Any:
            document = project.document(params.text_document.uri)
            return feature(project, document) if document is not None else None

        server.feature(method, options)(handle)

    def of_place(method: str, feature: Callable[..., Any], options: Any = None) -> None:
        def handle(params: Any) -> Any:
            document = project.document(params.text_document.uri)
            if document is None:
                return None
            return feature(project, document, document.positions.offset(params.position))

        server.feature(method, options)(handle)

    def of_request(method: str, feature: Callable[..., Any], options: Any = None) -> None:
        def handle(params: Any) -> Any:
            document = project.document(params.text_document.uri)
            return feature(project, document, params) if document is not None else None

        server.feature(method, options)(handle)

    # completion, hover, inlay_hints, semantic_tokens

    # navigation, outline

    # quick_fixes, formatting, lenses


def _add_lifecycle(server: TreeServer) -> None:
    """Register what keeps the project up to date."""
    project = server.project

    @server.feature(types.INITIALIZE)
    def initialize(params: types.InitializeParams) -> None:
        folders = [folder.uri for folder in params.workspace_folders or ()]
        if not folders and params.root_uri:
            folders = [params.root_uri]
        paths = [uris.to_fs_path(uri) for uri in folders]
        project.configure(
            [Path(path) for path in paths if path], Settings.from_client(params.initialization_options)
        )

    @server.feature(types.TEXT_DOCUMENT_DID_OPEN)
    def did_open(params: types.DidOpenTextDocumentParams) -> None:
        item = params.text_document
        changed(project.open(item.uri, item.text, item.version))

    @server.feature(types.TEXT_DOCUMENT_DID_CHANGE)
    def did_change(params: types.DidChangeTextDocumentParams) -> None:
        identifier = params.text_document
        changed(project.change(identifier.uri, params.content_changes, identifier.version))

    @server.feature(types.TEXT_DOCUMENT_DID_CLOSE)
    def did_close(params: types.DidCloseTextDocumentParams) -> None:
        project.close(params.text_document.uri)

    def changed(document: SourceDocument) -> None:
        """Check the document again."""
