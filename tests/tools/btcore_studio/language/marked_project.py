"""A project on disk for tests, which mark the place of the cursor with ¦."""

from collections.abc import Iterable
from pathlib import Path

from lsprotocol.types import Location, Range

from btcore.xml.edit.editor import apply_edits
from btcore_studio.language.project import Project, Settings, SourceDocument
from btcore_studio.language.rename import FileEdits, workspace_edit
from tests.tools.btcore_studio.edit.inverse_edits import invert_edits

CURSOR = "¦"


class MarkedProject:
    """The files in *folder* as a project. Texts that are opened with `open` are unsaved changes."""

    def __init__(self, folder: Path, settings: Settings | None = None) -> None:
        self.folder = folder
        self.project = Project()
        self.project.configure([folder], settings or Settings())

    def write(self, files: dict[str, str]) -> None:
        """Write files, and search the files of the project again."""
        for name, text in files.items():
            (self.folder / name).parent.mkdir(parents=True, exist_ok=True)
            (self.folder / name).write_text(text, encoding="utf-8")
        self.project.forget_files()

    def open(self, name: str, text: str) -> SourceDocument:
        """Open a file with a text that is not saved."""
        return self.project.open(self.project.uri(self.folder / name), text, 1)

    def document(self, name: str) -> SourceDocument:
        """Return an open document or a file."""
        document = self.project.file(self.folder / name)
        assert document is not None, name
        return document

    def at(self, name: str, place: str) -> tuple[Project, SourceDocument, int]:
        """Return the arguments of a feature for the cursor ¦ in *place*, which the file contains once."""
        document = self.document(name)
        text = place.replace(CURSOR, "")
        assert document.text.count(text) == 1, f"{document.text.count(text)} times in {name}: {text}"
        return self.project, document, document.text.index(text) + place.index(CURSOR)

    def text_at(self, uri: str, place: Range) -> str:
        """Return the text at the UTF-16 positions of *place*, computed without btcore."""
        document = self.project.document(uri)
        assert document is not None
        lines = document.text.split("\n")
        if place.start.line != place.end.line:
            return "…"
        units = lines[place.start.line].encode("utf-16-le")
        return units[2 * place.start.character : 2 * place.end.character].decode("utf-16-le")

    def shown(self, locations: Iterable[Location]) -> list[str]:
        """Return each location as `file:line:text`, with the line from 1."""
        return [
            f"{self._name(item.uri)}:{item.range.start.line + 1}:{self.text_at(item.uri, item.range)}"
            for item in locations
        ]

    def apply(self, edits: FileEdits) -> dict[str, str]:
        """Return the texts of the changed files. The inverse of the edits restores them."""
        changed: dict[str, str] = {}
        changes = workspace_edit(self.project, edits).changes or {}
        for uri, text_edits in changes.items():
            document = self.project.document(uri)
            assert document is not None
            before = document.text
            lines = [line.encode("utf-16-le") for line in before.split("\n")]
            for change in sorted(text_edits, key=lambda item: item.range.start, reverse=True):
                start, end = change.range.start, change.range.end
                assert start.line == end.line
                line = lines[start.line]
                lines[start.line] = (
                    line[: 2 * start.character]
                    + change.new_text.encode("utf-16-le")
                    + line[2 * end.character :]
                )
            text = "\n".join(line.decode("utf-16-le") for line in lines)
            assert text == apply_edits(before, edits[uri])
            assert apply_edits(text, invert_edits(before, edits[uri])) == before
            changed[self._name(uri)] = text
        return changed

    def _name(self, uri: str) -> str:
        document = self.project.document(uri)
        path = document.path if document is not None else None
        if path is None or not path.is_relative_to(self.folder.resolve()):
            return uri.rpartition("/")[2]
        return path.relative_to(self.folder.resolve()).as_posix()
