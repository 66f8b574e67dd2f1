"""The server: registers every feature of the language server, and keeps the project up to date.

Each feature is a module with functions of `(project, document, …)`. Their results are types of the protocol.
"""

import asyncio
import gc
import inspect
from collections.abc import Awaitable, Callable, Generator, Iterable
from concurrent.futures import Future
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec
from lsprotocol import types
from pygls import uris
from pygls.exceptions import JsonRpcException, JsonRpcInvalidParams
from pygls.lsp.server import LanguageServer
from pygls.protocol import LanguageServerProtocol
from pygls.protocol.json_rpc import JsonRPCNotification, JsonRPCRequestMessage, JsonRPCResponseMessage
from pygls.protocol.language_server import lsp_method

from btcore import __version__
from btcore.errors import BtcoreError
from btcore.input_files import real_path
from btcore_studio.language import (
    completion,
    formatting,
    hover,
    inlay_hints,
    lenses,
    navigation,
    outline,
    quick_fixes,
    rename,
    semantic_tokens,
)
from btcore_studio.language.checker import Checker
from btcore_studio.language.diagnostics import Report
from btcore_studio.language.drawing import draw_document
from btcore_studio.language.edit_commands import compute_edit, copy_nodes, last_warnings, preview_edit
from btcore_studio.language.leaf_code import leaf_of
from btcore_studio.language.library_worker import StartWorker, WorkerProcess
from btcore_studio.language.live import LiveExtension, LiveTree
from btcore_studio.language.mock_runs import PageRuns
from btcore_studio.language.model_edits import FieldError
from btcore_studio.language.node_form import form_of
from btcore_studio.language.palette import palette_of
from btcore_studio.language.project import DocumentKey, Project, Settings, SourceDocument
from btcore_studio.language.proofs import CounterexampleParams, PageProofs, ProofParams, ProofResult
from btcore_studio.language.real_runs import RealRuns
from btcore_studio.language.shown_runs import ShownMomentParams, ShownRun, ShownRuns
from btcore_studio.language.studio_protocol import (
    BreakpointsParams,
    CopyParams,
    CopyResult,
    Data,
    DocumentParams,
    Drawing,
    DrawingParams,
    EditParams,
    Leaf,
    LeafParams,
    NewEntryParams,
    Palette,
    Place,
    RealRunParams,
    RecordingParams,
    ReleaseParams,
    WatchParams,
)
from btcore_studio.language.tree_reading import known_document
from btcore_studio.language.what_if import WhatIfParams, run_what_if

NAME: Final = "btcore"
GC_THRESHOLD: Final = 1_000_000
"""The number of new objects after which the server's garbage collector runs during a request.

With Python's default, the collector would take half of the time of each request. Usually the server collects
garbage before, while the client sends nothing.
"""
COLLECT_AFTER_S: Final = 0.02
"""Time (s) without a message, after which garbage is collected: the page still paints then."""
MANY_OBJECTS: Final = 20_000
"""Number of new objects above which garbage is collected."""
Params = TypeVar("Params", bound=Data)


class TreeServerProtocol(LanguageServerProtocol):
    """The protocol with UTF-16 positions, which every client supports. The project holds the documents."""

    _server: "TreeServer"

    def structure_message(self, data: dict[str, Any]) -> Any:
        """Return the message in a JSON object. A request with invalid parameters gets an error reply.

        pygls would print a traceback instead, and not reply.
        """
        method = data.get("method") if "jsonrpc" in data else None
        params_class = self._server.params_classes.get(method) if isinstance(method, str) else None
        message_class = self.get_message_type(method) if isinstance(method, str) else None
        if message_class is None and params_class is None:
            return super().structure_message(data)
        reason = ""
        try:
            if message_class is not None:
                return self._converter.structure(data, message_class)
            params = msgspec.convert(data.get("params") or {}, params_class)
            return JsonRPCRequestMessage(data["id"], str(method), self.VERSION, params)
        except msgspec.ValidationError as error:
            reason = f": {error}"
        except Exception:  # the errors of the converter have no common class
            pass
        if "id" in data:
            invalid = JsonRpcInvalidParams(f"the parameters of {method} are invalid{reason}")
            self._send_response(data["id"], error=invalid.to_response_error())
        # The protocol permits to ignore notifications with this prefix, and pygls logs them in one line.
        return JsonRPCNotification(method=f"$/invalid/{method}", jsonrpc=self.VERSION, params={})

    def handle_message(self, message: Any) -> None:
        """Call the handler of a message."""
        super().handle_message(message)
        self._server.collect_later()

    def _send_data(self, data: Any) -> None:
        """Send a message. The results of requests `btcore/…` can be large: they are encoded quickly."""
        writer: Any = self.writer
        if writer is None or not isinstance(getattr(data, "result", None), Data):
            super()._send_data(data)
            return
        try:
            body = msgspec.json.encode({"jsonrpc": self.VERSION, "id": data.id, "result": data.result})
        except UnicodeEncodeError:  # a lone surrogate
            super()._send_data(data)
            return
        head = f"Content-Length: {len(body)}\r\n\r\n".encode() if self._include_headers else b""
        sent = writer.write(head + body)
        if inspect.isawaitable(sent):
            asyncio.ensure_future(sent)  # noqa: RUF006 - an executor has it, as in pygls

    def _serialize_message(self, data: Any) -> Any:
        """Return a part of a message as JSON data."""
        if isinstance(data, Data):
            return msgspec.to_builtins(data)
        if isinstance(data, (JsonRPCResponseMessage, JsonRPCNotification)):
            # The converter would copy the JSON data of the requests `btcore/…`.
            return {name: getattr(data, name) for name in type(data).__slots__ if name[0] != "_"}
        return super()._serialize_message(data)

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

    def _send_handler_result(self, future: Future[Any], *, msg_id: int | str) -> None:
        """Send the result of a request. A refused operation is an answer, and not a failure of the server."""
        error = None if future.cancelled() else future.exception()
        if isinstance(error, BtcoreError):
            error = RequestError(
                str(error), data={"field": error.field} if isinstance(error, FieldError) else None
            )
        if isinstance(error, (rename.RenameError, RequestError)):
            self._request_futures.pop(msg_id, None)
            self._send_response(msg_id, error=error.to_response_error())
        else:
            super()._send_handler_result(future, msg_id=msg_id)


class RequestError(JsonRpcException):
    """A request cannot be answered. The message is for the user."""

    CODE = types.LSPErrorCodes.RequestFailed.value


class TreeServer(LanguageServer):
    """A language server for documents of trees.

    Attributes:
        project: The documents and files of the client's workspace.
        checker: The background checks of the documents.
        live: The running tree that the page watches.
        shown: The recorded runs that the page shows.
        proofs: The searches of the page.
        real_runs: The run of the page with real leaves.
        was_shut_down: Whether the client has requested the end of the server.
        params_classes: The parameters of requests outside of the Language Server Protocol, by method.
    """

    def __init__(self, live: LiveExtension | None, start_worker: StartWorker) -> None:
        super().__init__(
            NAME,
            __version__,
            text_document_sync_kind=types.TextDocumentSyncKind.Incremental,
            protocol_cls=TreeServerProtocol,
        )
        self.project = Project()
        self.checker = Checker(self.project, self._publish, self._show, self._refresh, start_worker)
        self.live = LiveTree(live, lambda data: self.protocol.notify("btcore/live", data))
        self.shown = ShownRuns()
        self.proofs = PageProofs(
            self.project,
            self.shown,
            lambda data: self.protocol.notify("btcore/proofProgress", data),
        )
        self.real_runs = RealRuns(
            self.project,
            self.live,
            self.shown,
            lambda data: self.protocol.notify("btcore/realRun", data),
        )
        self.was_shut_down = False
        self.params_classes: dict[str, type[Data]] = {}
        self._collection: asyncio.TimerHandle | None = None

    def add_request(
        self,
        method: str,
        params_class: type[Params],
        handler: Callable[[Params], Data | dict[str, Any] | Awaitable[Data | None] | None],
    ) -> None:
        """Register a request that is not in the Language Server Protocol.

        Args:
            params_class: The parameters. Requests with invalid parameters get an error reply.
            handler: Returns the result. The message of a BtcoreError is the error reply.
        """
        self.params_classes[method] = params_class

        self.feature(method)(handler)

    def collect_later(self) -> None:
        """Collect garbage when the client has sent nothing for some time.

        Documents contain cycles of objects. A collection takes as long as a drawing.
        """
        if self._collection is not None:
            self._collection.cancel()
        with suppress(RuntimeError):  # no event loop
            self._collection = asyncio.get_running_loop().call_later(COLLECT_AFTER_S, _collect)

    async def close(self) -> None:
        """End the background checks and their process, and the connection with a running tree."""
        if self._collection is not None:
            self._collection.cancel()
        self.proofs.stop()
        await asyncio.gather(self.checker.close(), self.live.close(), self.real_runs.close())

    def _publish(self, file: DocumentKey, version: int | None, reports: list[Report]) -> None:
        uri = file if isinstance(file, str) else self.project.uri(file)
        diagnostics = [report.diagnostic() for report in reports]
        self.text_document_publish_diagnostics(types.PublishDiagnosticsParams(uri, diagnostics, version))

    def _show(self, message: str) -> None:
        self.window_show_message(types.ShowMessageParams(types.MessageType.Warning, message))

    def _refresh(self) -> None:
        """Make the client request again what depends on the available nodes."""
        workspace = self.client_capabilities.workspace
        if workspace is None:
            return
        if workspace.semantic_tokens is not None and workspace.semantic_tokens.refresh_support:
            self.workspace_semantic_tokens_refresh(None)
        if workspace.inlay_hint is not None and workspace.inlay_hint.refresh_support:
            self.workspace_inlay_hint_refresh(None)


def _collect() -> None:
    if gc.get_count()[0] > MANY_OBJECTS:
        gc.collect()


def create_server(
    live: LiveExtension | None = None,
    start_worker: StartWorker = WorkerProcess.start,
    has_processes: bool = True,
) -> TreeServer:
    """Return a server with all features, which is not started yet.

    Args:
        live: Connects with running trees; default the installed extension with its default settings.
        start_worker: Starts the worker that checks documents; default a process.
        has_processes: Whether a search for a proof gets a process of its own.
    """
    server = TreeServer(live, start_worker)
    _keep_up_to_date(server)
    _add_features(server)
    _add_studio_requests(server, has_processes)
    return server


def _add_features(server: TreeServer) -> None:
    """Register every feature that answers requests.

    A feature of a whole document is a function of `(project, document)`. A feature of a place has the offset
    of the cursor as its third argument, and a feature of a range has the range. All other features have the
    parameters of the request.
    """
    project = server.project

    def of_request(method: str, feature: Callable[..., Any], options: Any = None) -> None:
        def handle(params: Any) -> Any:
            document = project.document(params.text_document.uri)
            return feature(project, document, params) if document is not None else None

        server.feature(method, options)(handle)

    def of_document(method: str, feature: Callable[..., Any], options: Any = None) -> None:
        of_request(method, lambda project, document, _: feature(project, document), options)

    def of_range(method: str, feature: Callable[..., Any], options: Any = None) -> None:
        of_request(
            method, lambda project, document, params: feature(project, document, params.range), options
        )

    def of_place(method: str, feature: Callable[..., Any], options: Any = None) -> None:
        def at_offset(project: Project, document: SourceDocument, params: Any) -> Any:
            return feature(project, document, document.positions.offset(params.position))

        of_request(method, at_offset, options)

    def complete(project: Project, document: SourceDocument, params: types.CompletionParams) -> Any:
        offset = document.positions.offset(params.position)
        trigger = params.context.trigger_character if params.context is not None else None
        item = _completion_item_capabilities(server)
        snippets = item is not None and item.snippet_support is True
        markdown = item is not None and types.MarkupKind.Markdown in (item.documentation_format or ())
        return completion.complete(project, document, offset, trigger or "", snippets, markdown)

    def describe(project: Project, document: SourceDocument, offset: int) -> types.Hover | None:
        capabilities = server.client_capabilities.text_document
        formats = capabilities.hover.content_format if capabilities and capabilities.hover else None
        return hover.hover(project, document, offset, types.MarkupKind.Markdown in (formats or ()))

    # completion, hover, inlay_hints, semantic_tokens
    of_request(types.TEXT_DOCUMENT_COMPLETION, complete, types.CompletionOptions(completion.TRIGGERS))
    of_place(types.TEXT_DOCUMENT_HOVER, describe)
    of_range(types.TEXT_DOCUMENT_INLAY_HINT, inlay_hints.inlay_hints)
    legend = semantic_tokens.LEGEND
    of_document(types.TEXT_DOCUMENT_SEMANTIC_TOKENS_FULL, semantic_tokens.semantic_tokens, legend)
    of_range(types.TEXT_DOCUMENT_SEMANTIC_TOKENS_RANGE, semantic_tokens.semantic_tokens, legend)

    of_place(types.TEXT_DOCUMENT_DEFINITION, navigation.find_definition)
    of_place(types.TEXT_DOCUMENT_PREPARE_RENAME, rename.prepare_rename)
    of_document(types.TEXT_DOCUMENT_DOCUMENT_SYMBOL, outline.find_document_symbols)
    of_document(types.TEXT_DOCUMENT_FOLDING_RANGE, outline.find_folding_ranges)

    def references(project: Project, document: SourceDocument, params: types.ReferenceParams) -> Any:
        offset = document.positions.offset(params.position)
        return navigation.find_references(project, document, offset, params.context.include_declaration)

    def renaming(project: Project, document: SourceDocument, params: types.RenameParams) -> Any:
        offset = document.positions.offset(params.position)
        return rename.workspace_edit(
            project, rename.rename_symbol(project, document, offset, params.new_name)
        )

    of_request(types.TEXT_DOCUMENT_REFERENCES, references)
    of_request(types.TEXT_DOCUMENT_RENAME, renaming, types.RenameOptions(prepare_provider=True))

    @server.feature(types.WORKSPACE_SYMBOL)
    def workspace_symbols(params: types.WorkspaceSymbolParams) -> list[types.WorkspaceSymbol]:
        return outline.find_workspace_symbols(project, params.query)

    # quick_fixes, formatting, lenses
    kinds = [types.CodeActionKind.QuickFix, types.CodeActionKind.RefactorRewrite]
    of_request(types.TEXT_DOCUMENT_CODE_ACTION, quick_fixes.code_actions, types.CodeActionOptions(kinds))
    of_request(types.TEXT_DOCUMENT_FORMATTING, formatting.format_document)
    of_request(types.TEXT_DOCUMENT_RANGE_FORMATTING, formatting.format_range)
    of_document(types.TEXT_DOCUMENT_CODE_LENS, lenses.code_lenses)


def _add_studio_requests(server: TreeServer, has_processes: bool) -> None:
    """Register the requests by which a page draws and edits trees."""
    project = server.project

    def document(uri: str) -> SourceDocument:
        return known_document(project, uri)

    def draw(params: DrawingParams) -> Drawing:
        return draw_document(project, document(params.text_document.uri), params)

    server.add_request("btcore/drawing", DrawingParams, draw)

    def list_palette(params: DocumentParams) -> Palette:
        return palette_of(project, document(params.text_document.uri))

    server.add_request("btcore/palette", DocumentParams, list_palette)
    server.add_request("btcore/node", Place, lambda place: form_of(project, document(place.uri), place))
    server.add_request(
        "btcore/edit", EditParams, lambda params: compute_edit(project, params.command, params.drawing)
    )
    server.add_request("btcore/warnings", Data, lambda _: last_warnings(project))
    server.add_request("btcore/preview", EditParams, lambda params: preview_edit(project, params.command))

    def write_leaf(params: LeafParams) -> Leaf:
        return leaf_of(project, document(params.text_document.uri), params.id)

    server.add_request("btcore/leaf", LeafParams, write_leaf)
    server.add_request(
        "btcore/copy", CopyParams, lambda params: CopyResult(copy_nodes(project, params.nodes))
    )

    def watch(params: WatchParams) -> None:
        server.live.watch(params.address)

    def set_breakpoints(params: BreakpointsParams) -> None:
        server.live.set_breakpoints(params.keys)

    async def release(params: ReleaseParams) -> None:
        await server.live.release(params.status)

    async def set_entry(params: NewEntryParams) -> None:
        await server.live.change(
            lambda connection: connection.set_entry(params.path, params.key, params.value)
        )

    async def reload(params: DocumentParams) -> None:
        text = document(params.text_document.uri).text
        await server.live.change(lambda connection: connection.replace_tree(text))

    server.add_request("btcore/watch", WatchParams, watch)
    server.add_request("btcore/breakpoints", BreakpointsParams, set_breakpoints)
    server.add_request("btcore/release", ReleaseParams, release)
    server.add_request("btcore/setEntry", NewEntryParams, set_entry)
    server.add_request("btcore/reload", DocumentParams, reload)
    real_runs = server.real_runs

    async def start_real_run(params: RealRunParams) -> None:
        await real_runs.start(document(params.text_document.uri), params)

    async def end_real_run(_: Data) -> None:
        await real_runs.end()

    async def open_recording(_: Data) -> ShownRun:
        return await real_runs.open_recording()

    server.add_request("btcore/startRealRun", RealRunParams, start_real_run)
    server.add_request("btcore/endRealRun", Data, end_real_run)
    server.add_request("btcore/openRecording", Data, open_recording)

    proofs = server.proofs

    async def prove(params: ProofParams) -> ProofResult:
        return await proofs.prove_in_process(params)

    server.add_request("btcore/prove", ProofParams, prove if has_processes else partial(proofs.prove))
    server.add_request("btcore/stopProof", Data, lambda _: proofs.stop())
    server.add_request("btcore/counterexample", CounterexampleParams, partial(proofs.counterexample))
    server.add_request("btcore/moment", ShownMomentParams, partial(server.shown.moment))
    server.add_request("btcore/recording", RecordingParams, partial(server.shown.show_recording))
    runs = PageRuns(project, server.shown)
    what_if = partial(run_what_if, project, server.shown, runs.recorded_run)
    server.add_request("btcore/whatIf", WhatIfParams, what_if)
    for method, params_class, handler in runs.requests:
        server.add_request(method, params_class, partial(handler))  # pygls sets attributes of it


def _completion_item_capabilities(server: TreeServer) -> types.ClientCompletionItemOptions | None:
    document = server.client_capabilities.text_document
    completion = document.completion if document is not None else None
    return completion.completion_item if completion is not None else None


def _keep_up_to_date(server: TreeServer) -> None:
    """Register what the client notifies: settings, documents and files."""
    project, checker = server.project, server.checker

    @server.feature(types.INITIALIZE)
    def initialize(params: types.InitializeParams) -> None:
        folders = params.workspace_folders or ()
        if not folders and params.root_uri:
            folders = [types.WorkspaceFolder(params.root_uri, "")]
        settings = Settings.from_client(params.initialization_options)
        project.configure(_paths(folders), settings or Settings())

    @server.feature(types.INITIALIZED)
    def initialized(_: types.InitializedParams) -> None:
        checker.start()
        checker.check_all()
        workspace = server.client_capabilities.workspace
        watching = workspace.did_change_watched_files if workspace is not None else None
        if watching is not None and watching.dynamic_registration:
            watchers = [types.FileSystemWatcher("**/*.{xml,btproj,py}")]
            options = types.DidChangeWatchedFilesRegistrationOptions(watchers)
            method = types.WORKSPACE_DID_CHANGE_WATCHED_FILES
            registration = types.Registration("watch", method, options)
            server.client_register_capability(types.RegistrationParams([registration]))

    # Not a coroutine: `exit` may be the next message, and would end the server before the reply.
    @server.feature(types.SHUTDOWN)
    def shutdown(_: None) -> None:
        checker.close()
        server.live.end()
        server.proofs.stop()
        server.real_runs.end_soon()
        server.was_shut_down = True

    @server.feature(types.TEXT_DOCUMENT_DID_OPEN)
    def did_open(params: types.DidOpenTextDocumentParams) -> None:
        item = params.text_document
        checker.changed(project.open(item.uri, item.text, item.version))

    @server.feature(types.TEXT_DOCUMENT_DID_CHANGE)
    def did_change(params: types.DidChangeTextDocumentParams) -> None:
        identifier = params.text_document
        checker.changed(project.change(identifier.uri, params.content_changes, identifier.version))

    @server.feature(types.TEXT_DOCUMENT_DID_CLOSE)
    def did_close(params: types.DidCloseTextDocumentParams) -> None:
        document = project.document(params.text_document.uri)
        project.close(params.text_document.uri)
        if document is not None:
            checker.changed(document)

    @server.feature(types.TEXT_DOCUMENT_DID_SAVE)
    def did_save(params: types.DidSaveTextDocumentParams) -> None:
        document = project.document(params.text_document.uri)
        if document is not None:
            checker.changed(document)

    @server.feature(types.WORKSPACE_DID_CHANGE_WATCHED_FILES)
    def did_change_watched_files(params: types.DidChangeWatchedFilesParams) -> None:
        if any(change.type != types.FileChangeType.Changed for change in params.changes):
            project.forget_files()
        for change in params.changes:
            path = uris.to_fs_path(change.uri)
            if path:
                checker.file_changed(real_path(path))

    @server.feature(types.WORKSPACE_DID_CHANGE_WORKSPACE_FOLDERS)
    def did_change_folders(params: types.DidChangeWorkspaceFoldersParams) -> None:
        removed = {uris.to_fs_path(folder.uri) for folder in params.event.removed}
        added = [uris.to_fs_path(folder.uri) for folder in params.event.added]
        kept = [
            folder
            for folder in project.folders
            if folder not in {real_path(path) for path in removed if path}
        ]
        project.configure([*kept, *(Path(path) for path in added if path)], project.settings)
        checker.reload()

    @server.feature(types.WORKSPACE_DID_CHANGE_CONFIGURATION)
    def did_change_configuration(params: types.DidChangeConfigurationParams) -> None:
        settings = Settings.from_client(params.settings)
        if settings is not None and settings != project.settings:
            project.configure(project.folders, settings)
            checker.reload()


def _paths(folders: Iterable[types.WorkspaceFolder]) -> list[Path]:
    return [real_path(path) for folder in folders if (path := uris.to_fs_path(folder.uri))]
