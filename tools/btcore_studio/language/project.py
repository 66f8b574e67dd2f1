"""The project that an editor shows: its open documents, its files, and the nodes that its trees may use."""

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Final

from lsprotocol import types
from pygls import uris

from btcore.errors import TreeError
from btcore.input_files import FileStamp, file_stamp, read_file, real_path
from btcore.registry.registry import Registry
from btcore.xml.edit.editor import Edit
from btcore.xml.read.document import Document
from btcore.xml.read.read import parse_file, parse_text
from btcore.xml.read.scan import Scan, scan
from btcore_studio.language.diagnostics import Report
from btcore_studio.language.node_models import NodeModel, add_mock_nodes
from btcore_studio.language.studio_protocol import Position
from btcore_studio.language.text_positions import TextPositions

MAX_FILES: Final = 2_000
"""Maximum number of XML files of a project that are checked."""
MAX_ENTRIES: Final = 50_000
"""Maximum number of files and folders that are visited to find the files of a project."""
DocumentKey = Path | str
"""The path of a document, or the URI of a document without a file."""
PROJECT_SUFFIX: Final = ".btproj"
"""The ending of the names of projects of Groot 2."""
SUFFIXES: Final = (".xml", PROJECT_SUFFIX)
_SKIPPED_FOLDERS: Final = {"node_modules", "build", "dist", "install", "log", "__pycache__", "site-packages"}
_NO_PATH: Final = re.compile("[\0\ud800-\udfff]")
_TREES: Final = re.compile(rb"<\s*(?:root|Root|BehaviorTree|TreeNodesModel)\b")


@dataclass(frozen=True)
class Settings:
    """The settings of the client.

    Attributes:
        trusted: Whether Python files of the workspace may be imported.
        plugins: Node libraries, as with `--plugin`: modules, and Python files relative to the workspace.
        models: Files with a TreeNodesModel, as with `--model`, relative to the workspace; may contain
            wildcards such as `models/*.xml`.
        given: Keys that programs set before the first tick, as with `--given`.
    """

    trusted: bool = False
    plugins: tuple[str, ...] = ()
    models: tuple[str, ...] = ()
    given: tuple[str, ...] = ()

    @classmethod
    def from_client(cls, data: object) -> "Settings | None":
        """Return the settings in *data*, which the client sent, or None if it contains no settings.

        Values of a wrong type are ignored.
        """
        section = data.get("btcore", data) if isinstance(data, Mapping) else None
        if not isinstance(section, Mapping) or not section.keys() & {field.name for field in fields(cls)}:
            return None
        lists: dict[str, tuple[str, ...]] = {}
        for name in ("plugins", "models", "given"):
            value = section.get(name)
            values = value if isinstance(value, list) else []
            lists[name] = tuple(item for item in values if isinstance(item, str) and item.strip())
        return cls(trusted=section.get("trusted") is True, **lists)


class SourceDocument:
    """The text of one file: of an open document, or of the file on disk.

    Attributes:
        uri: The URI of the document.
        path: The absolute path without symbolic links; None if the document has no file.
        text: The text.
        version: The client's version of an open document; None for a file on disk.
    """

    def __init__(self, uri: str, text: str, version: int | None = None) -> None:
        self.uri = uri
        path = uris.to_fs_path(uri) if uri.startswith("file:") else None
        self.path = real_path(path) if path else None
        self.text = text
        self.version = version

    @property
    def key(self) -> DocumentKey:
        """The path, or the URI of a document without a file."""
        return self.path or self.uri

    @cached_property
    def scan(self) -> Scan:
        """The elements of the text, which may be broken XML."""
        return scan(self.text)

    @cached_property
    def positions(self) -> TextPositions:
        """The lines of the text, to convert offsets and positions."""
        return TextPositions(self.text)

    @property
    def mark_length(self) -> int:
        """The length of the byte order mark with which the text begins: 0 or 1."""
        return int(self.text.startswith("\ufeff"))

    def position(self, offset: int) -> Position:
        """Return the position of an offset, which counts from after the byte order mark."""
        return Position(*self.positions.place(offset + self.mark_length))

    def text_edits(self, edits: Iterable[Edit]) -> list[types.TextEdit]:
        """Return *edits* of the text as edits of the protocol."""
        return [types.TextEdit(self.positions.range(start, end), text) for start, end, text in edits]

    def apply(
        self, changes: Iterable[types.TextDocumentContentChangeEvent], version: int
    ) -> "SourceDocument":
        """Return the document after *changes*, which apply to each other's result.

        Args:
            changes: Replaced ranges, or whole texts.
            version: The version of the result.
        """
        document = self
        for change in changes:
            if isinstance(change, types.TextDocumentContentChangePartial):
                positions = document.positions
                start, end = sorted(
                    (positions.offset(change.range.start), positions.offset(change.range.end))
                )
                text = document.text[:start] + change.text + document.text[end:]
            else:
                text = change.text
            document = SourceDocument(self.uri, text, version)
        return document


class Project:
    """The documents and files of a project, and the nodes that its trees may use.

    Attributes:
        folders: The folders of the workspace.
        settings: The settings of the client.
        registry: The available nodes. Nodes of Python libraries are mock nodes with the same ports.
        models: The nodes of Python libraries and model files by ID, with the places of their source.
        find_new_warnings: Returns the new warnings of the last edit that was returned with a drawing.
    """

    def __init__(self) -> None:
        self.folders: list[Path] = []
        self.settings = Settings()
        self.registry = Registry.standard()
        self.models: dict[str, NodeModel] = {}
        self.find_new_warnings: Callable[[], list[str]] = list
        self._open: dict[str, SourceDocument] = {}
        self._on_disk: dict[Path, tuple[FileStamp | None, SourceDocument]] = {}
        self._files: list[Path] | None = None
        self._reports: dict[DocumentKey, tuple[int | None, list[Report]]] = {}

    def configure(self, folders: Sequence[Path], settings: Settings) -> None:
        """Set the folders of the workspace and the settings of the client."""
        self.folders = [real_path(folder) for folder in folders]
        self.settings = settings
        self._files = None

    # --- documents

    @property
    def open_documents(self) -> list[SourceDocument]:
        """The documents that are open in the editor."""
        return list(self._open.values())

    @property
    def unsaved(self) -> dict[Path, str]:
        """The texts of the open documents by path."""
        return {document.path: document.text for document in self._open.values() if document.path is not None}

    def open(self, uri: str, text: str, version: int) -> SourceDocument:
        """Open a document, or replace its text."""
        document = self._open[uri] = SourceDocument(uri, text, version)
        return document

    def change(
        self, uri: str, changes: Iterable[types.TextDocumentContentChangeEvent], version: int
    ) -> SourceDocument:
        """Change an open document. Raises KeyError if it is not open."""
        document = self._open[uri] = self._open[uri].apply(changes, version)
        return document

    def close(self, uri: str) -> None:
        """Close a document: its text is the file on disk from now on."""
        self._open.pop(uri, None)

    def document(self, uri: str) -> SourceDocument | None:
        """Return the open document *uri*, else its file on disk; None if the file cannot be read."""
        known = self._open.get(uri)
        if known is not None:
            return known
        path = uris.to_fs_path(uri) if uri.startswith("file:") else None
        return self.file(Path(path)) if path else None

    def file(self, path: Path) -> SourceDocument | None:
        """Return the document of a file: its open document, else the file on disk.

        Returns:
            None if the file cannot be read as UTF-8.
        """
        if path not in self._on_disk:
            try:
                path = real_path(path)
            except ValueError:  # a NUL character or a lone surrogate
                return None
        for document in self._open.values():
            if document.path == path:
                return document
        try:
            stamp = file_stamp(path)
            known = self._on_disk.get(path)
            if known is not None and known[0] == stamp:
                return known[1]
            text = read_file(path).decode("utf-8-sig")
        except (OSError, ValueError):
            return None
        document = SourceDocument(file_uri(path), text)
        self._on_disk[path] = (stamp, document)
        return document

    def uri(self, path: Path) -> str:
        """Return the URI of a file: the client's URI if the file is open."""
        for uri, document in self._open.items():
            if document.path == path:
                return uri
        return file_uri(path)

    def parse(self, document: SourceDocument) -> Document | None:
        """Return *document* as `btcore validate` reads it; None if it is not XML.

        The documents that it includes are read from open documents, too.
        """
        try:
            if document.path is None:
                return parse_text(document.text)
            return self.parse_path(document.path)
        except TreeError:
            return None

    def parse_path(self, path: Path) -> Document:
        """Parse the open document or the file *path*.

        Raises:
            TreeError: The file cannot be read, or is not valid XML.
        """
        return parse_file(path, unsaved=self.unsaved)

    # --- diagnostics

    def reports(self, document: SourceDocument) -> list[Report]:
        """Return the errors and warnings of *document*; none if the check of this text is not finished."""
        version, reports = self._reports.get(document.key, (None, []))
        return reports if version == document.version else []

    def set_reports(self, key: DocumentKey, version: int | None, reports: list[Report]) -> None:
        """Keep the errors and warnings of one version of a document."""
        self._reports[key] = (version, reports)

    # --- files

    @property
    def files(self) -> list[Path]:
        """The files with trees or models: the open documents, then the files in the workspace's folders."""
        if self._files is None:
            self._files = [path for path in find_files(self.folders, SUFFIXES, MAX_FILES) if has_trees(path)]
        opened = [document.path for document in self._open.values() if document.path is not None]
        return list(dict.fromkeys([*opened, *self._files]))

    def documents(self) -> Iterator[SourceDocument]:
        """Yield the document of each file of the project, and open documents without a file."""
        for document in self._open.values():
            if document.path is None:
                yield document
        for path in self.files:
            source = self.file(path)
            if source is not None:
                yield source

    def roots_of(self, path: Path) -> list[Path]:
        """Return the documents to check in order to find the mistakes in the file *path*.

        They are the projects of Groot 2 (`.btproj`) that include the file, because its trees may call each
        other without includes; else the file itself.
        """
        projects = [file for file in self.files if file.suffix == PROJECT_SUFFIX and file != path]
        return [project for project in projects if path in self._included_by(project)] or [path]

    def _included_by(self, path: Path) -> set[Path]:
        """Return the files that a document includes directly."""
        document = self.file(path)
        if document is None:
            return set()
        includes = [element for root in document.scan.roots for element in root.iter("include")]
        paths = [written for element in includes if is_usable_path(written := element.get("path") or "")]
        return {real_path(path.parent / written) for written in paths}

    def forget_files(self) -> None:
        """Search the files of the workspace again, because files were created or deleted."""
        self._files = None

    # --- nodes

    def set_models(self, models: Sequence[NodeModel], enums: Mapping[str, int]) -> None:
        """Replace the nodes of Python libraries and model files.

        Args:
            models: The nodes that are not built in.
            enums: The registered enum names.
        """
        registry = Registry.standard()
        add_mock_nodes(registry, models, enums)
        self.registry = registry
        self.models = {model.id: model for model in models}


def find_files(folders: Iterable[Path], suffixes: tuple[str, ...], most: int) -> list[Path]:
    """Return the files in *folders* and their subfolders, sorted, without hidden and generated folders.

    Args:
        folders: The folders. Symbolic links to folders are not followed.
        suffixes: The endings of the names.
        most: The maximum number of files.
    """
    paths: list[Path] = []
    visited = 0
    for folder in folders:
        for parent, names, files in os.walk(folder):
            names[:] = sorted(name for name in names if name[0] != "." and name not in _SKIPPED_FOLDERS)
            visited += len(names) + len(files)
            paths += (Path(parent) / name for name in sorted(files) if name.endswith(suffixes))
            if len(paths) >= most or visited > MAX_ENTRIES:
                return paths[:most]
    return paths


def file_uri(path: Path | str) -> str:
    """Return the URI of an absolute path."""
    return uris.from_fs_path(str(path)) or ""


def is_usable_path(text: str) -> bool:
    """Return whether a file can have this path: it has no NUL character and no lone surrogate."""
    return text != "" and _NO_PATH.search(text) is None


def has_trees(path: Path) -> bool:
    """Return whether the file begins like a document of trees or models, and not like any other XML."""
    try:
        return _TREES.search(read_file(path, 64_000)) is not None
    except (OSError, ValueError):
        return False
