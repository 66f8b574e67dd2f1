"""The child process of the language server: imports node libraries and checks documents.

Node libraries of a workspace run the code of its author. Here they can neither stop nor block the server,
which ends this process after a time limit. Messages are lines of JSON: the settings and their answer, then
one answer for each request.
"""

import json
import os
import queue
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from traceback import extract_tb
from typing import Any, BinaryIO, Final, NamedTuple

from btcore.blackboard.ports import braced_key
from btcore.errors import BtcoreError
from btcore.input_files import read_file, real_path
from btcore.registry.registry import Registry
from btcore.xml.models.model_file import (
    add_document_models,
    add_explicit_nodes,
    add_models,
    model_elements,
)
from btcore.xml.read.document import Document
from btcore.xml.read.read import parse_file, parse_text, read
from btcore_studio.language.diagnostics import check
from btcore_studio.language.node_models import NodeModel, add_mock_nodes, find_model_files, models_of

MAX_SOURCES: Final = 5_000
"""Maximum number of source files whose changes are watched."""


class _Texts(dict[Path, str]):
    """The texts of open documents; *read* collects the files that a check reads."""

    def __init__(self) -> None:
        super().__init__()
        self.read: set[Path] = set()

    def get(self, key: Path, default: Any = None) -> Any:
        """Return the text of the open document, or None."""
        self.read.add(key)
        return super().get(key, default)

    def __bool__(self) -> bool:
        return True


def module_file(plugin: str, folders: Sequence[Path]) -> Path | None:
    """Return the file of a node library in *folders*, or None.

    Args:
        plugin: A module, `module:function`, or the path of a Python file.
        folders: The folders that paths and modules are relative to.
    """
    if plugin.endswith(".py"):
        candidates = [plugin]
    else:
        parts = plugin.partition(":")[0].replace(".", "/")
        candidates = [f"{parts}.py", f"{parts}/__init__.py"]
    for folder in folders or [Path()]:
        for candidate in candidates:
            if (folder / candidate).is_file():
                return real_path(folder / candidate)
    return None


class Libraries:
    """The nodes that trees of the workspace may use.

    Args:
        folders: The folders of the workspace.
        plugins: Modules and Python files.
        models: Patterns of model files, relative to the folders.
        trusted: Whether *plugins* are imported.
        last: The nodes and the enums of the last process, which replace those of plugins that cannot be
            imported. A mistake in a file that is being edited must not make its nodes unknown in every tree.

    Attributes:
        nodes: The nodes.
        problems: Sentences about libraries that cannot be loaded, each with the file and the line (from 1) of
            the mistake, or with "" and 0.
        kept: The nodes of *last* that are used, by ID.
        sources: The files that the nodes depend on.
    """

    def __init__(
        self,
        folders: Sequence[Path],
        plugins: Sequence[str],
        models: Sequence[str],
        trusted: bool,
        last: tuple[Sequence[NodeModel], Mapping[str, int]] = ((), {}),
    ) -> None:
        self.nodes = Registry.standard()
        self.problems: list[tuple[str, str, int]] = []
        self.kept: dict[str, NodeModel] = {}
        self.sources: set[Path] = set()
        self._has_models = False
        for unavailable in self.nodes.add_installed_libraries(strict=False):
            if unavailable.missing_module is None:
                self._report(unavailable.error)
        if trusted:
            sys.path += map(str, folders)
        is_complete = trusted
        for plugin in plugins:
            file = module_file(plugin, folders)
            if file is not None:
                self.sources.add(file)
            if trusted and not self._import(plugin, file, folders):
                is_complete = False
        for pattern in models:
            self._add_models(pattern, folders)
        if not is_complete:
            known = {model.id for model in models_of(self.nodes)}
            self.kept = {model.id: model for model in last[0] if model.id not in known}
            add_mock_nodes(self.nodes, self.kept.values(), last[1])
        for module in list(sys.modules.values()) if trusted else ():
            source = getattr(module, "__file__", None)
            if source and any(real_path(source).is_relative_to(folder) for folder in folders):
                self.sources.add(real_path(source))

    def _import(self, plugin: str, file: Path | None, folders: Sequence[Path]) -> bool:
        """Import a plugin. Return whether that succeeded."""
        try:
            self.nodes.add_plugin(str(file) if file is not None and plugin.endswith(".py") else plugin)
        except BtcoreError as error:
            self._report(error, folders, file)
            return False
        return True

    def _add_models(self, pattern: str, folders: Sequence[Path]) -> None:
        paths = find_model_files(pattern, folders)
        if not paths:
            self.problems.append((f"no model file matches '{pattern}'", "", 0))
        for path in paths:
            self.sources.add(path)
            self._add_model_file(self.nodes, path)

    def _add_model_file(self, nodes: Registry, path: Path) -> None:
        try:
            add_models(nodes, path)
            self._has_models = True
        except BtcoreError as error:
            self._report(error)

    def _report(
        self, error: BaseException, folders: Sequence[Path] = (), library: Path | None = None
    ) -> None:
        """Add *error* to the problems, with the last line in *folders* that it comes from.

        The nodes depend on each of these files, so that a repair is noticed.

        Args:
            folders: The folders of the workspace.
            library: The file whose first line is the place if no other line is known, or None.
        """
        cause: BaseException = error.__cause__ or error
        places = [(frame.filename, frame.lineno or 1) for frame in extract_tb(cause.__traceback__)]
        if isinstance(cause, SyntaxError) and cause.filename:
            places.append((cause.filename, cause.lineno or 1))
        own = [
            (file, line)
            for name, line in places
            if any((file := real_path(name)).is_relative_to(folder) for folder in folders)
        ]
        self.sources |= {file for file, _ in own}
        if not own and library is not None:
            own = [(library, 1)]
        place = (str(own[-1][0]), own[-1][1]) if own else ("", 0)
        self.problems.append((str(error), *place))

    def nodes_for(self, document: Document) -> Registry:
        """Return the nodes for the trees of *document*, as for `btcore validate`.

        While a tree is written, the code of its nodes may be missing, so the models of the document suffice
        for unknown nodes. Only the models of a project override installed nodes, as with `--model`.
        """
        documents = read(document).documents
        is_project = document.file.endswith(".btproj")
        if not (self._has_models or is_project or any(map(model_elements, documents))):
            return self.nodes
        nodes = self.nodes.copy()
        for source in documents:
            # The check reports invalid models.
            with suppress(BtcoreError):
                add_document_models(nodes, source, override=is_project)
        if self._has_models or is_project:
            add_explicit_nodes(nodes, documents)
        return nodes


class WorkerSettings(NamedTuple):
    """The first message to the process: the folders of the workspace, and the settings of the client.

    *last_models* and *last_enums* are those that the last process has described.
    """

    folders: Sequence[str]
    plugins: Sequence[str]
    models: Sequence[str]
    given: Sequence[str]
    trusted: bool
    last_models: Sequence[Mapping[str, Any]]
    last_enums: Mapping[str, int]


class Worker:
    """Answers the requests of the server."""

    def __init__(self, settings: WorkerSettings) -> None:
        folders = [Path(folder) for folder in settings.folders]
        last = [NodeModel.from_data(data) for data in settings.last_models], settings.last_enums
        self._libraries = Libraries(folders, settings.plugins, settings.models, settings.trusted, last)
        self._given = [braced_key(key) or key for key in settings.given]
        self._texts = _Texts()

    def describe(self) -> dict[str, Any]:
        """Return the available nodes."""
        libraries = self._libraries
        models = [libraries.kept.get(model.id, model) for model in models_of(libraries.nodes)]
        return {
            "models": [model.as_data() for model in models],
            "enums": libraries.nodes.types.enums,
            "problems": libraries.problems,
            "sources": sorted(map(str, libraries.sources))[:MAX_SOURCES],
        }

    def answer(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Check a document.

        Args:
            request: The *file* to check, or the *text* of a document without a file, and the *texts* of
                documents that changed since the last request; None = the document was closed.

        Returns:
            The *reports*, and the *files* that were read.
        """
        for file, text in request["texts"].items():
            if text is None:
                self._texts.pop(Path(file), None)
            else:
                self._texts[Path(file)] = text
        self._texts.read = set()

        def text_of(file: str) -> str:
            if not file:
                return str(request["text"])
            text: str | None = self._texts.get(real_path(file))
            if text is not None:
                return text
            try:
                return read_file(file).decode("utf-8-sig", "replace")
            except (OSError, ValueError):
                return ""  # the missing file is what the diagnostic reports

        reports = check(lambda: self._parse(request), self._libraries.nodes_for, self._given, text_of)
        return {"reports": reports, "files": sorted(map(str, self._texts.read))}

    def _parse(self, request: Mapping[str, Any]) -> Document:
        if request["file"]:
            return parse_file(request["file"], unsaved=self._texts)
        document = parse_text(request["text"])
        document.unsaved = self._texts
        return document


def _lines_of(stream: BinaryIO) -> Iterator[bytes]:
    """Yield the lines of *stream*. End the process at its end, even while a node library is imported."""
    lines: queue.SimpleQueue[bytes] = queue.SimpleQueue()

    def read() -> None:
        for line in stream:
            lines.put(line)
        os._exit(0)

    threading.Thread(target=read, daemon=True).start()
    while True:
        yield lines.get()


def main() -> None:
    """Answer the lines of stdin on stdout, until stdin ends."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # node libraries may print
    requests = _lines_of(sys.stdin.buffer)

    def reply(data: Mapping[str, Any]) -> None:
        answers.write(json.dumps(data).encode() + b"\n")
        answers.flush()

    worker = Worker(WorkerSettings(**json.loads(next(requests))))
    reply(worker.describe())
    for line in requests:
        reply(worker.answer(json.loads(line)))


if __name__ == "__main__":
    main()
