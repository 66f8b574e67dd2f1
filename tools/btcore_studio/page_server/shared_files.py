"""The files that all pages of a studio share: who changes a text, and when it is written to the disk.

A text accepts edits of its present version only. A page that was slower than another page or the disk
receives the other edits, rebases its own, and repeats. So no edit is lost.
"""

import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Protocol

from pygls import uris

from btcore.input_files import file_stamp, read_error, read_file, real_path
from btcore.output_files import write_file
from btcore.xml.edit.editor import Edit, apply_edits
from btcore_studio.edit.text_edits import line_edits, merge_edits, smallest_edit
from btcore_studio.language.project import SUFFIXES, file_uri
from btcore_studio.language.studio_protocol import Position, Range, TextEdit
from btcore_studio.language.text_positions import TextPositions
from btcore_studio.served_folder import RefusedError, ServedFolder

MAX_TEXT: Final = 8 << 20
"""Maximum size of a text (bytes), so that a message of 16 MiB can contain it."""
NODE_SUFFIX: Final = "_node.py"
"""The end of the names of Python files, which a page may create but not change."""
MAX_TEXTS: Final = 256
"""Maximum number of texts that are open at the same time."""
MAX_EDITS: Final = 10_000
"""Maximum number of edits in a request."""
MAX_KEPT: Final = 256_000_000
"""Maximum size of the previous contents that are kept (bytes). The oldest are deleted first."""

_BOM: Final = b"\xef\xbb\xbf"
_ENCODING: Final = re.compile(r"""<\?xml\b[^>]{0,200}?\bencoding\s*=\s*["']([\w.-]{1,40})""")


class StaleTextError(Exception):
    """The edits are edits of an older version."""


class Page(Protocol):
    """A page, as far as the shared files need it."""

    def notify(self, method: str, params: object) -> None:
        """Send a notification."""


@dataclass(eq=False)
class SharedText:
    """The text of a file.

    Attributes:
        path: The real path.
        uri: The URI.
        text: The text without a byte order mark.
        disk: The content of the file that the text contains or, by a decision of the user, replaces.
        base: The text in *disk*, from which unsaved changes are counted.
        version: The number of the text, which each change increases.
        pages: The pages that have read the text.
        conflict: The content of the file if it changed on disk where the text has unsaved changes.
        is_deleted: Whether the file was deleted.
    """

    path: Path
    uri: str
    text: str
    disk: bytes
    base: str
    version: int = 1
    pages: set[Page] = field(default_factory=set)
    conflict: bytes | None = None
    is_deleted: bool = False
    # The state of the file when it was read, and at the last check: a file that is being written is not read.
    read_stamp: object = None
    seen_stamp: object = None

    @property
    def is_unsaved(self) -> bool:
        """Whether the text is not in the file."""
        return self.is_deleted or self.encoded() != self.disk

    def encoded(self) -> bytes:
        """Return the text as the content of the file, with the byte order mark that the file had."""
        return (_BOM if self.disk.startswith(_BOM) else b"") + self.text.encode()


class SharedFiles:
    """The texts of the files in a folder. All methods are called by the event loop's thread.

    Args:
        is_read_only: Whether nothing is written.
        previous: A folder for the previous contents of the files that are written.
    """

    def __init__(self, folder: Path, is_read_only: bool, previous: Path) -> None:
        self.is_read_only = is_read_only
        self._served = ServedFolder(folder)
        self.folder = self._served.root
        self._previous = previous
        self._kept: list[tuple[Path, int]] = []
        self._writes = 0
        self._texts: dict[Path, SharedText] = {}
        self._found: list[Path] = []
        self._pages: set[Page] = set()
        self._shown: object = None

    # --- pages

    def join(self, page: Page) -> None:
        """Notify *page* of changes from now on."""
        self._pages.add(page)

    def leave(self, page: Page) -> None:
        """Forget *page*. Its unsaved texts are kept for the next page."""
        self._pages.discard(page)
        for text in list(self._texts.values()):
            text.pages.discard(page)
            if not text.pages and not text.is_unsaved:
                del self._texts[text.path]
        self._show_files()

    # --- the files of the folder

    def path(self, uri: str) -> Path:
        """Return the real path of a file in the folder. It need not exist.

        Raises:
            RefusedError: The file is outside of the folder, or is no file of trees.
        """
        path = uris.to_fs_path(uri) if uri.startswith("file:///") else None
        if not path or "\0" in path:
            raise RefusedError(f"{uri[:200]!a} is refused: it is not the URI of a file on this machine")
        real = real_path(path)
        if not real.is_relative_to(self.folder):
            raise RefusedError(f"'{path}' is refused: it is outside of the folder '{self.folder}'")
        if real.suffix.lower() not in SUFFIXES:
            raise RefusedError(f"'{path}' is refused: its name must end with {' or '.join(SUFFIXES)}")
        return real

    def files(self) -> list[dict[str, object]]:
        """Return the files of the folder, and whether each has unsaved changes."""
        paths = dict.fromkeys([*self._found, *sorted(self._texts)])
        return [
            {
                "uri": file_uri(path),
                "name": path.relative_to(self.folder).as_posix(),
                "unsaved": path in self._texts and self._texts[path].is_unsaved,
            }
            for path in paths
        ]

    def set_files(self, paths: Iterable[Path]) -> None:
        """Set the files that were found in the folder."""
        self._found = list(paths)
        self._show_files()

    def _show_files(self) -> None:
        unsaved = {path for path, text in self._texts.items() if text.is_unsaved}
        shown = self._found, self._texts.keys() - set(self._found), unsaved
        if shown != self._shown:
            self._shown = shown
            files = self.files()
            for page in self._pages:
                page.notify("btcore/files", files)

    # --- texts

    def read(self, page: Page, uri: str) -> dict[str, object]:
        """Return the text of a file, and notify *page* of its changes from now on.

        Raises:
            RefusedError: The file is not permitted, or cannot be read.
        """
        path = self.path(uri)
        text = self._texts.get(path)
        if text is None:
            if len(self._texts) >= MAX_TEXTS:
                raise RefusedError(f"more than {MAX_TEXTS} files are open: close another page")
            name = path.relative_to(self.folder).as_posix()
            data = self._read(self._served.find(name, SUFFIXES, MAX_TEXT))
            try:
                content = _decode(data)
            except UnicodeDecodeError:
                raise RefusedError(f"'{name}' is not UTF-8: convert it first") from None
            text = self._texts[path] = SharedText(path, file_uri(path), content, data, content)
            text.read_stamp = text.seen_stamp = file_stamp(path)
            self._show_files()
        text.pages.add(page)
        if text.conflict is not None:
            page.notify("btcore/disk", _conflict(text))
        return {"text": text.text, "version": text.version, "unsaved": text.is_unsaved}

    def push(self, page: Page, uri: str, version: int, edits: list[TextEdit]) -> int:
        """Apply the edits of *page*, and return the new version.

        Raises:
            RefusedError: Nothing may be changed, or the edits are invalid.
            StaleTextError: The text has another version.
        """
        self._check_writable()
        text = self._open_text(uri)
        if version != text.version:
            raise StaleTextError
        if len(edits) > MAX_EDITS:
            raise RefusedError(f"more than {MAX_EDITS} edits are refused")
        positions = TextPositions(text.text)
        changes = [_edit(positions, edit) for edit in edits]
        done = 0
        for start, end, _ in sorted(changes, key=lambda edit: edit[:2]):
            if start < done or end < start:
                raise RefusedError("edits that overlap are refused")
            done = end
        result = apply_edits(text.text, changes)
        _encoded(result)
        text.text = result
        text.version += 1
        pushed = {"uri": text.uri, "version": version, "edits": edits}
        for other in text.pages - {page}:
            other.notify("btcore/pushed", pushed)
        self._show_files()
        return text.version

    def save(self, uri: str) -> bool:
        """Write the text of a file. Return whether there was something to write.

        Raises:
            RefusedError: Nothing may be written, the file has changed on disk, or it cannot be written.
        """
        self._check_writable()
        text = self._open_text(uri)
        name = self._name(text)
        version = text.version
        self._take_disk(text)
        self._show_files()
        if text.conflict is not None:
            raise RefusedError(f"'{name}' has changed on disk: decide which text to keep, then save it")
        if not text.is_unsaved:
            return False
        if text.version != version:
            raise RefusedError(f"'{name}' has changed on disk: check the merged text, then save it")
        encoding = _ENCODING.match(text.text)
        if encoding and encoding[1].lower() not in ("utf-8", "utf8") and not text.text.isascii():
            raise RefusedError(
                f"'{name}' would be UTF-8, but its XML declaration says {encoding[1]}: change the declaration"
            )
        data = text.encoded()
        if real_path(text.path) != text.path:
            raise RefusedError(f"'{name}' is refused: it has become a symbolic link")
        self._keep(text.path, text.disk)
        try:
            write_file(text.path, data)
        except OSError as error:
            raise RefusedError(f"'{name}' can't be written: {read_error(error)}") from None
        text.disk, text.base, text.is_deleted = data, text.text, False
        text.read_stamp = text.seen_stamp = file_stamp(text.path)
        self._show_files()
        return True

    def create(self, name: str, content: str) -> str:
        """Create a file of trees, or the Python file of a node, and return its URI.

        Args:
            name: The path, relative to the folder.
            content: The text.

        Raises:
            RefusedError: The file exists, is not permitted, or cannot be written.
        """
        self._check_writable()
        path = self._served.find_new(name, (*SUFFIXES, NODE_SUFFIX))
        data = _encoded(content)
        try:
            with path.open("xb") as file:
                file.write(data)
        except OSError as error:
            raise RefusedError(f"'{name}' can't be created: {read_error(error)}") from None
        if path.suffix.lower() in SUFFIXES:
            self.set_files(sorted({*self._found, path}))
        return file_uri(path)

    # --- changes on disk

    def check_disk(self) -> None:
        """Take the changes of other programs. Call this regularly."""
        has_taken = False
        for text in self._texts.values():
            stamp = file_stamp(text.path)
            is_settled, text.seen_stamp = stamp == text.seen_stamp, stamp
            if is_settled and stamp != text.read_stamp:
                has_taken = True
                # An unreadable file is reported when it is saved.
                with suppress(RefusedError):
                    self._take_disk(text)
        if has_taken:
            self._show_files()

    def resolve(self, uri: str, keep: str) -> None:
        """Decide about a text that was changed here and on disk.

        Args:
            keep: "disk" discards the unsaved changes; "page" discards the content of the file with the next
                save.

        Raises:
            RefusedError: The content of the file is not UTF-8, so that it cannot be kept.
        """
        self._check_writable()
        text = self._open_text(uri)
        disk = text.disk if text.conflict is None else text.conflict
        try:
            base = _decode(disk)
        except UnicodeDecodeError:
            if keep == "disk":
                raise RefusedError(f"'{self._name(text)}' on disk is not UTF-8") from None
            base = text.text
        text.disk, text.base, text.conflict = disk, base, None
        if keep == "disk":
            self._change(text, line_edits(text.text, base))
        self._show_files()

    def unsaved(self) -> Iterator[tuple[str, bytes]]:
        """Yield the name and the content of each file with unsaved changes."""
        for text in self._texts.values():
            if text.is_unsaved:
                yield text.path.name, text.encoded()

    def _take_disk(self, text: SharedText) -> None:
        """Take a change of the file on disk: as edits, merged with unsaved changes, or as a conflict."""
        stamp = file_stamp(text.path)
        text.is_deleted = stamp is None
        data = text.disk if text.is_deleted else self._read(text.path)
        text.read_stamp = stamp
        if data == text.disk:
            text.conflict = None
            return
        try:
            theirs = _decode(data)
            merged = merge_edits(text.base, theirs, text.text)
        except UnicodeDecodeError:
            merged = None
        if merged is not None:
            text.disk, text.base, text.conflict = data, theirs, None
            self._change(text, merged)
        elif data != text.conflict:
            text.conflict = data
            for page in text.pages:
                page.notify("btcore/disk", _conflict(text))

    def _change(self, text: SharedText, edits: list[Edit]) -> None:
        """Apply edits that no page has made."""
        if not edits:
            return
        positions = TextPositions(text.text)
        pushed = [
            TextEdit(Range(Position(*positions.place(start)), Position(*positions.place(end))), new)
            for start, end, new in (
                _beside_line_breaks(text.text, smallest_edit(text.text, edit)) for edit in edits
            )
        ]
        text.text = apply_edits(text.text, edits)
        text.version += 1
        for page in text.pages:
            page.notify("btcore/pushed", {"uri": text.uri, "version": text.version - 1, "edits": pushed})

    # ---

    def _check_writable(self) -> None:
        if self.is_read_only:
            raise RefusedError("the studio is read-only: nothing is changed")

    def _open_text(self, uri: str) -> SharedText:
        path = self.path(uri)
        if path not in self._texts:
            raise RefusedError(f"'{path}' is not open")
        return self._texts[path]

    def _name(self, text: SharedText) -> str:
        return text.path.relative_to(self.folder).as_posix()

    def _read(self, path: Path) -> bytes:
        try:
            data = read_file(path, MAX_TEXT + 1)
        except (OSError, ValueError) as error:
            reason = read_error(error) if isinstance(error, OSError) else str(error)
            raise RefusedError(f"'{path.name}' can't be read: {reason}") from None
        if len(data) > MAX_TEXT:
            raise RefusedError(f"'{path.name}' is too large: at most {MAX_TEXT:,} bytes are permitted")
        return data

    def _keep(self, path: Path, data: bytes) -> None:
        """Keep the previous content of a file that is about to be written."""
        self._writes += 1
        kept = self._previous / f"{self._writes:04}-{path.name}"
        try:
            kept.write_bytes(data)
        except OSError as error:
            raise RefusedError(
                f"the previous content of '{path.name}' can't be kept: {read_error(error)}"
            ) from None
        self._kept.append((kept, len(data)))
        while sum(size for _, size in self._kept) > MAX_KEPT and len(self._kept) > 1:
            self._kept.pop(0)[0].unlink(missing_ok=True)


def _beside_line_breaks(text: str, edit: Edit) -> Edit:
    """Return the edit without an end between CR and LF, where positions cannot be."""
    start, end, new = edit
    if text[max(0, start - 1) : start + 1] == "\r\n":
        start, new = start - 1, "\r" + new
    if text[max(0, end - 1) : end + 1] == "\r\n":
        end, new = end + 1, new + "\n"
    return Edit(start, end, new)


def _edit(positions: TextPositions, edit: TextEdit) -> Edit:
    start, end = edit.range.start, edit.range.end
    if min(start.line, start.character, end.line, end.character) < 0:
        raise RefusedError("edits at negative positions are refused")
    return Edit(
        positions.offset_at(start.line, start.character),
        positions.offset_at(end.line, end.character),
        edit.new_text,
    )


def _encoded(text: str) -> bytes:
    """Return a text that a page has sent as the content of a file.

    Raises:
        RefusedError: No file may have the text.
    """
    try:
        data = text.encode()
    except UnicodeEncodeError:
        raise RefusedError("a text with half of a surrogate pair is refused") from None
    if len(data) > MAX_TEXT:
        raise RefusedError(f"the file would be too large: at most {MAX_TEXT:,} bytes are permitted")
    return data


def _decode(data: bytes) -> str:
    return data.removeprefix(_BOM).decode()


def _conflict(text: SharedText) -> dict[str, object]:
    assert text.conflict is not None
    return {"uri": text.uri, "text": text.conflict.removeprefix(_BOM).decode(errors="replace")}
