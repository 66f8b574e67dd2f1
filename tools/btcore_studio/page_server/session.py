"""The state of a studio that all its pages share, and the messages of each page."""

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

import msgspec
from lsprotocol import types
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from btcore.documentation_site import FIRST_PAGE
from btcore.errors import BtcoreError
from btcore.input_files import file_stamp
from btcore.json_text import load_json
from btcore_studio.compare.comparison import Comparison, compare
from btcore_studio.language.live import LiveExtension
from btcore_studio.language.project import (
    MAX_FILES,
    PROJECT_SUFFIX,
    SUFFIXES,
    Project,
    SourceDocument,
    file_uri,
    find_files,
)
from btcore_studio.language.server import create_server
from btcore_studio.language.studio_protocol import TextEdit, WhyParams
from btcore_studio.language.timeline import RecordedRun
from btcore_studio.page_server.shared_files import SharedFiles, StaleTextError
from btcore_studio.served_folder import RefusedError

CHECK_INTERVAL_S: Final = 0.1
"""Time between two checks of the open files on disk (s)."""
SCAN_INTERVAL_S: Final = 1.0
"""Minimum time between two searches for the files of the folder (s)."""
CLOSE_WAIT_S: Final = 3.0
"""Time (s) after the last page of a comparison was closed, within which it can be loaded again."""
_SCAN_SHARE: Final = 0.05
"""Maximum share of the time in which the folder is searched."""
_MAX_WAITING: Final = 64 << 20
"""Maximum bytes that wait until a page receives them. A page that is slower is closed."""

_MAX_SEARCHED: Final = 500
_MAX_HEAD: Final = 16 << 10
"""Maximum number of files, and of bytes in each, in which the main tree of a folder is searched."""

_PARSE_ERROR: Final = -32700
_INVALID_REQUEST: Final = -32600
_METHOD_NOT_FOUND: Final = -32601
_INVALID_PARAMS: Final = -32602
_INTERNAL_ERROR: Final = -32603
_CONTENT_MODIFIED: Final = -32801
_REQUEST_FAILED: Final = -32803

_LANGUAGE_PREFIXES: Final = ("textDocument/", "btcore/")
_LANGUAGE_METHODS: Final = frozenset({types.INITIALIZE, types.INITIALIZED, types.WORKSPACE_SYMBOL})
"""What a page may request from its language server, beside the methods with the prefixes."""


class _Document(msgspec.Struct):
    uri: str


class _Pushed(msgspec.Struct):
    uri: str
    version: int
    edits: list[TextEdit]


class _Created(msgspec.Struct):
    name: str
    text: str


class _Resolved(msgspec.Struct):
    uri: str
    keep: Literal["disk", "page"]


class _Position(msgspec.Struct):
    position: int


class _Compared(msgspec.Struct):
    tree: str | None = None


class Version(NamedTuple):
    """A version of a file that is compared: its name for the user, and its file; None is no file."""

    name: str
    file: Path | None


@dataclass(frozen=True)
class Shown:
    """What a studio shows.

    Attributes:
        folder: The folder whose files are shown.
        file: The file to show first; None for the first file with a main tree.
        tree: The ID of the tree to show first; None for the main tree.
        is_read_only: Whether nothing is written.
        plugins: Node libraries that the user of the command line trusts.
        models: Files with a TreeNodesModel.
        recorded: A recording of the tree in *file*, or None.
        versions: The old and the new version of a file, which are compared; a page can request no other file.
        live: Connects pages with running trees; None if no installed package can do it.
        trusts_leaves: Whether pages may run trees with their real leaves, also without *plugins*.
    """

    folder: Path
    file: Path | None = None
    tree: str | None = None
    is_read_only: bool = False
    plugins: tuple[str, ...] = ()
    models: tuple[str, ...] = ()
    recorded: RecordedRun | None = None
    versions: tuple[Version, Version] | None = None
    live: LiveExtension | None = None
    trusts_leaves: bool = False

    @property
    def is_trusted(self) -> bool:
        """Whether the code of leaves may be imported and run."""
        return self.trusts_leaves or bool(self.plugins)


class StudioSession:
    """The shared state of a studio. Use it in an `async with` statement.

    Args:
        shown: What is shown.
        previous: A folder for the previous contents of the files that are written.

    Attributes:
        ended: Set if the studio should end, because the last page of a comparison was closed.

    Raises:
        RefusedError: There is no such folder.
    """

    def __init__(self, shown: Shown, previous: Path) -> None:
        self.shown = shown
        self.ended = asyncio.Event()
        self.files = SharedFiles(shown.folder, shown.is_read_only, previous)
        self._pages: set[PageSession] = set()
        self._stamps: dict[Path, object] = {}
        self._tasks: list[asyncio.Task[None]] = []
        self._scanner = ThreadPoolExecutor(1, "folder")

    async def __aenter__(self) -> "StudioSession":
        self._stamps = self._scan()
        self.files.set_files(_of_trees(self._stamps))
        self._tasks = [asyncio.create_task(task) for task in (self._check_disk(), self._watch_folder())]
        return self

    async def __aexit__(self, *error: object) -> None:
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._scanner.shutdown()

    async def serve_page(self, connection: ServerConnection) -> None:
        """Serve a page until it is closed."""
        page = PageSession(self, connection)
        self._pages.add(page)
        self.files.join(page)
        try:
            await page.serve()
        finally:
            self._pages.discard(page)
            self.files.leave(page)
            if self.shown.versions is not None:
                asyncio.get_running_loop().call_later(CLOSE_WAIT_S, self._end_without_pages)

    def _end_without_pages(self) -> None:
        if not self._pages:
            self.ended.set()

    def start(self) -> dict[str, object]:
        """Return the reply to `btcore/start`."""
        shown = self.shown
        file = shown.file
        if file is None:
            trees = _of_trees(self._stamps)
            file = next(filter(_names_main_tree, trees[:_MAX_SEARCHED]), None)
            if file is None:
                of_trees = (path for path in trees if path.suffix != PROJECT_SUFFIX)
                file = next(of_trees, next(iter(trees), None))
        return {
            "folder": str(self.files.folder),
            "guide": f"{FIRST_PAGE}guides/studio.html",
            "uri": "" if file is None else file_uri(file),
            "tree": shown.tree,
            "readOnly": shown.is_read_only,
            "live": shown.live is not None and shown.recorded is None,
            "trusted": shown.is_trusted,
            "recording": None if shown.recorded is None else shown.recorded.summary(),
            "versions": shown.versions and [version.name for version in shown.versions],
        }

    # --- the folder

    async def _check_disk(self) -> None:
        compared = [version.file for version in self.shown.versions or () if version.file is not None]
        stamps = [file_stamp(file) for file in compared]
        while True:
            await asyncio.sleep(CHECK_INTERVAL_S)
            self.files.check_disk()
            before, stamps = stamps, [file_stamp(file) for file in compared]
            if stamps != before:
                for page in self._pages:
                    page.notify("btcore/compared", {})

    async def _watch_folder(self) -> None:
        """Notify the language servers of files that other programs create, change or delete."""
        loop = asyncio.get_running_loop()
        wait = SCAN_INTERVAL_S
        while True:
            await asyncio.sleep(wait)
            begun = loop.time()
            stamps = await loop.run_in_executor(self._scanner, self._scan)
            wait = max(SCAN_INTERVAL_S, (loop.time() - begun) / _SCAN_SHARE)
            before, self._stamps = self._stamps, stamps
            kinds = types.FileChangeType
            changes = [
                {
                    "uri": file_uri(path),
                    "type": kinds.Created
                    if path not in before
                    else (kinds.Changed if path in stamps else kinds.Deleted),
                }
                for path in before.keys() | stamps.keys()
                if before.get(path) != stamps.get(path)
            ]
            if changes:
                self.files.set_files(_of_trees(stamps))
                for page in self._pages:
                    page.notify_language_server(
                        types.WORKSPACE_DID_CHANGE_WATCHED_FILES, {"changes": changes}
                    )

    def _scan(self) -> dict[Path, object]:
        """Return the files of the folder, with a value that changes with the content."""
        stamps: dict[Path, object] = {}
        for path in find_files([self.files.folder], (*SUFFIXES, ".py"), MAX_FILES):
            stamp = file_stamp(path, follow_symlinks=False)
            if stamp is not None:
                stamps[path] = stamp
        return stamps


class PageSession:
    """The messages of one page: those of shared files, and those of its own language server.

    Args:
        studio: What the pages share.
        connection: The WebSocket.
    """

    def __init__(self, studio: StudioSession, connection: ServerConnection) -> None:
        self._studio = studio
        self._connection = connection
        self._loop = asyncio.get_running_loop()
        self._waiting: deque[bytes] = deque()
        self._waiting_size = 0
        self._has_waiting = asyncio.Event()
        self._language_server = create_server(studio.shown.live)
        self._language_server.shown.recorded = studio.shown.recorded
        if studio.shown.is_read_only:
            self._language_server.live.refusal = "this studio is read-only: it does not change a running tree"
        # pygls sends by `write` of this object.
        self._language_server.protocol.set_writer(self, include_headers=False)
        features = self._language_server.protocol.fm
        # pygls cancels requests itself, without a feature.
        self._language_methods = {
            method
            for method in (*features.features, *features.builtin_features)
            if method.startswith(_LANGUAGE_PREFIXES) or method in _LANGUAGE_METHODS
        } | {types.CANCEL_REQUEST}
        self._handlers: Mapping[str, Callable[[Any], object]] = {
            "btcore/start": lambda _: studio.start(),
            "btcore/files": lambda _: studio.files.files(),
            "btcore/read": self._read,
            "btcore/push": self._push,
            "btcore/save": self._save,
            "btcore/create": self._create,
            "btcore/resolve": self._resolve,
        }
        if studio.shown.recorded is not None:
            self._handlers = {**self._handlers, "btcore/moment": self._moment, "btcore/why": self._explain}
        if studio.shown.versions is not None:
            self._handlers = {**self._handlers, "btcore/comparison": self._compare}

    async def serve(self) -> None:
        """Handle messages until the page is closed."""
        sending = asyncio.create_task(self._send_waiting())
        try:
            async for message in self._connection:
                await self._receive(message)
                # A page with many requests does not delay the others.
                await asyncio.sleep(0)
        except ConnectionClosed:
            pass
        finally:
            sending.cancel()
            await self._language_server.close()

    # --- sending

    def notify(self, method: str, params: object) -> None:
        """Send a notification."""
        self.write(msgspec.json.encode({"jsonrpc": "2.0", "method": method, "params": params}))

    def write(self, data: bytes) -> None:
        """Send a message when the page has received the earlier messages. Any thread may call this."""
        try:
            is_here = asyncio.get_running_loop() is self._loop
        except RuntimeError:
            is_here = False
        if is_here:
            self._append(data)
        else:
            with suppress(RuntimeError):  # the loop has ended
                self._loop.call_soon_threadsafe(self._append, data)

    def close(self) -> None:
        """Do nothing: pygls closes its writer after `exit`, which a page cannot send."""

    def _append(self, data: bytes) -> None:
        self._waiting.append(data)
        self._waiting_size += len(data)
        self._has_waiting.set()
        if self._waiting_size > _MAX_WAITING:
            self._connection.transport.abort()

    async def _send_waiting(self) -> None:
        with suppress(ConnectionClosed):
            while True:
                await self._has_waiting.wait()
                self._has_waiting.clear()
                while self._waiting:
                    data = self._waiting.popleft()
                    await self._connection.send(data, text=True)
                    self._waiting_size -= len(data)

    def _reply(self, request: object, result: object) -> None:
        self.write(msgspec.json.encode({"jsonrpc": "2.0", "id": request, "result": result}))

    def _refuse(self, request: object, code: int, message: str) -> None:
        error = {"code": code, "message": message}
        self.write(msgspec.json.encode({"jsonrpc": "2.0", "id": request, "error": error}))

    # --- receiving

    async def _receive(self, message: str | bytes) -> None:
        """Handle a message. Whatever it is, the page gets a reply, and this process continues."""
        try:
            data = load_json(message) if isinstance(message, str) else None
        except ValueError as error:
            self._refuse(None, _PARSE_ERROR, f"invalid JSON: {error}")
            return
        request = data.get("id") if isinstance(data, dict) else None
        if (
            not isinstance(data, dict)
            or data.get("jsonrpc") != "2.0"
            or not isinstance(request, str | int | None)
            or isinstance(request, bool)
        ):
            self._refuse(None, _INVALID_REQUEST, "expected a message of JSON-RPC 2.0")
            return
        method = data.get("method")
        if not isinstance(method, str):
            method = repr(method)
        try:
            if "method" not in data:  # the reply to a request of the language server
                with suppress(Exception):
                    self._to_language_server(data)
            elif method in self._handlers and not _names_run(data.get("params")):
                result = self._handlers[method](data.get("params"))
                if isinstance(result, Awaitable):
                    result = await result
                if request is not None:
                    self._reply(request, result)
            elif method in self._language_methods:
                self._to_language_server(data)
            elif request is not None:
                self._refuse(request, _METHOD_NOT_FOUND, f"unknown method {str(method)[:100]!a}")
        except StaleTextError:
            self._refuse(request, _CONTENT_MODIFIED, "the text has changed")
        except BtcoreError as error:
            self._refuse(request, _REQUEST_FAILED, str(error))
        except msgspec.ValidationError as error:
            self._refuse(request, _INVALID_PARAMS, f"invalid parameters: {error}")
        except Exception as error:
            self._refuse(request, _INTERNAL_ERROR, f"internal error (please report it): {error!r}")

    # --- the language server

    def notify_language_server(self, method: str, params: object) -> None:
        """Let the page's language server handle a notification."""
        self._handle({"jsonrpc": "2.0", "method": method, "params": params})

    def _to_language_server(self, data: dict[str, Any]) -> None:
        """Let the page's language server handle a message of the page."""
        if data.get("method") == types.INITIALIZE:
            data["params"] = self._own_settings(data.get("params"))
        else:
            for uri in _uris_in(data.get("params")):
                self._studio.files.path(uri)
        self._handle(data)
        if data.get("method") != types.INITIALIZED:
            return
        live = self._studio.shown.live
        if live is not None and live.address:
            self._language_server.live.watch(live.address)
        # The first check loads the node libraries.
        for version in self._studio.shown.versions or ():
            if version.file is not None:
                self._language_server.checker.changed(_document(self._language_server.project, version))

    def _handle(self, data: dict[str, Any]) -> None:
        protocol = self._language_server.protocol
        # pygls would also interpret the objects inside a message that look like messages.
        protocol.handle_message(protocol.structure_message(data))

    def _own_settings(self, params: object) -> dict[str, Any]:
        """Return the parameters of `initialize` with this studio's folder and settings.

        A page must not decide which Python code is imported.
        """
        shown, folder = self._studio.shown, self._studio.files.folder
        return {
            "capabilities": params.get("capabilities", {}) if isinstance(params, dict) else {},
            "processId": None,
            "rootUri": None,
            "workspaceFolders": [{"uri": file_uri(folder), "name": folder.name}],
            "initializationOptions": {
                "trusted": shown.is_trusted,
                "plugins": list(shown.plugins),
                "models": list(shown.models),
            },
        }

    # --- shared files

    def _read(self, params: object) -> object:
        return self._studio.files.read(self, msgspec.convert(params, _Document).uri)

    def _push(self, params: object) -> object:
        pushed = msgspec.convert(params, _Pushed)
        return {"version": self._studio.files.push(self, pushed.uri, pushed.version, pushed.edits)}

    def _save(self, params: object) -> object:
        return self._studio.files.save(msgspec.convert(params, _Document).uri)

    def _create(self, params: object) -> object:
        created = msgspec.convert(params, _Created)
        return {"uri": self._studio.files.create(created.name, created.text)}

    def _resolve(self, params: object) -> None:
        resolved = msgspec.convert(params, _Resolved)
        self._studio.files.resolve(resolved.uri, resolved.keep)

    def _compare(self, params: object) -> Comparison:
        versions, project = self._studio.shown.versions, self._language_server.project
        assert versions is not None
        old, new = (_document(project, version) for version in versions)
        return compare(project, old, new, msgspec.convert(params, _Compared).tree)

    async def _moment(self, params: object) -> object:
        recorded, position = self._studio.shown.recorded, msgspec.convert(params, _Position).position
        assert recorded is not None
        # It runs a part of the recorded tree again, which takes some time.
        return await asyncio.to_thread(recorded.moment, position)

    async def _explain(self, params: object) -> object:
        recorded, asked = self._studio.shown.recorded, msgspec.convert(params, WhyParams)
        assert recorded is not None
        return await asyncio.to_thread(recorded.why, asked.key, asked.position)


def _document(project: Project, version: Version) -> SourceDocument:
    if version.file is None:
        return SourceDocument("untitled:none", "")
    document = project.file(version.file)
    if document is None:
        raise RefusedError(f"'{version.name}' can't be read as a UTF-8 file")
    return document


def _names_run(params: object) -> bool:
    """Return whether a request is about a run of the page, and not about the opened recording."""
    return isinstance(params, dict) and bool(params.get("run"))


def _of_trees(paths: Iterable[Path]) -> list[Path]:
    return sorted(path for path in paths if path.suffix in SUFFIXES)


def _names_main_tree(path: Path) -> bool:
    """Return whether the beginning of a file names its main tree."""
    try:
        with path.open("rb") as file:
            return b"main_tree_to_execute" in file.read(_MAX_HEAD)
    except OSError:
        return False


def _uris_in(value: object) -> Iterator[str]:
    """Yield the URIs of documents in the parameters of a request."""
    if isinstance(value, dict):
        for name, item in value.items():
            if name == "uri" and isinstance(item, str):
                yield item
            else:
                yield from _uris_in(item)
    elif isinstance(value, list):
        for item in value:
            yield from _uris_in(item)
