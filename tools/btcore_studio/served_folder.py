"""The folder whose files an agent or a page of the studio may name."""

import os
import re
import stat
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from btcore import bundled_trees
from btcore.errors import BtcoreError
from btcore.input_files import real_path
from btcore.suggestions import did_you_mean

MAX_TREE_SIZE: Final = 2_000_000
"""The maximum size of a tree or of a TreeNodesModel (bytes)."""
MAX_LOG_SIZE: Final = 64_000_000
"""The maximum size of a log (bytes)."""
MAX_LISTED: Final = 200
"""The maximum number of trees that are listed."""
TREES: Final = (".xml",)
LOGS: Final = (".btrec.txt", ".btlog", ".db3", ".btdb", ".mcap", ".fbl")

_MAX_LENGTH: Final = 500
_MAX_VISITED: Final = 20_000
_CONTROL: Final = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]")


class RefusedError(BtcoreError):
    """Raised for a request that is not permitted or not possible; the message is for the client."""


class ServedFolder:
    """A folder whose files a client may name.

    Raises:
        RefusedError: There is no such folder.
    """

    def __init__(self, root: Path) -> None:
        if not root.is_dir():
            raise RefusedError(f"there is no folder '{root}'")
        self.root = real_path(root)

    def find(self, name: str, suffixes: Sequence[str], max_size: int) -> Path:
        """Return the real path of a file.

        Args:
            name: The path, relative to the folder.
            suffixes: The permitted suffixes.
            max_size: The maximum size of the file (bytes).

        Raises:
            RefusedError: The path is absolute, leads out of the folder, or does not name a regular file with
                one of the suffixes and a permitted size.
        """
        path = self._inside(name, suffixes)
        try:
            state = path.stat()
        except OSError as error:
            message = f"'{name}' can't be read: {(error.strerror or 'invalid name').lower()}"
            known = [other for other in self.files(suffixes) if not isinstance(error, PermissionError)]
            raise RefusedError(message + did_you_mean(name, known)) from None
        if not stat.S_ISREG(state.st_mode):
            raise RefusedError(f"'{name}' is refused: it is not a regular file")
        if state.st_size > max_size:
            raise RefusedError(
                f"'{name}' is refused: it has {state.st_size:,} bytes; at most {max_size:,} are permitted"
            )
        return path

    def find_new(self, name: str, suffixes: Sequence[str]) -> Path:
        """Return the real path of a file that is to be created in an existing folder.

        Args:
            name: The path, relative to the folder.
            suffixes: The permitted suffixes.

        Raises:
            RefusedError: The path is absolute, leads out of the folder, is hidden, or has another suffix; or
                the file exists; or its folder does not.
        """
        path = self._inside(name, suffixes)
        if any(part.startswith(".") for part in path.relative_to(self.root).parts):
            raise RefusedError(f"'{name}' is refused: it is hidden")
        if not path.parent.is_dir():
            raise RefusedError(f"'{name}' can't be created: there is no folder '{Path(name).parent}'")
        if os.path.lexists(path):
            raise RefusedError(f"'{name}' can't be created: it exists")
        return path

    def find_tree(self, name: str) -> Path:
        """Return the real path of a tree: of a file in the folder, or of a bundled tree.

        Args:
            name: The path, relative to the folder, or the name of a bundled tree, such as `bumpgo`.

        Raises:
            RefusedError: As `find`.
        """
        if not name.endswith(TREES) and name in bundled_trees.names():
            return bundled_trees.folder() / f"{name}.xml"
        return self.find(name, TREES, MAX_TREE_SIZE)

    def read_tree(self, name: str) -> str:
        """Return the text of a tree in the folder; bytes that are not UTF-8 are replaced.

        Raises:
            RefusedError: As `find`.
        """
        path = self.find(name, TREES, MAX_TREE_SIZE)
        try:
            with path.open("rb") as file:
                return file.read(MAX_TREE_SIZE).decode(errors="replace")
        except OSError as error:
            raise RefusedError(f"'{name}' can't be read: {error.strerror}") from None

    def files(self, suffixes: Sequence[str]) -> list[str]:
        """Return the first files with these suffixes, relative to the folder and sorted; no hidden files."""
        names: list[str] = []
        for path in self._walk():
            if path.name.lower().endswith(tuple(suffixes)) and not _CONTROL.search(path.name):
                names.append(path.relative_to(self.root).as_posix())
                if len(names) == MAX_LISTED:
                    break
        return names

    def _walk(self) -> Iterator[Path]:
        """Yield files in the folder and below it. Symbolic links and hidden files are omitted."""
        visited = 0
        for folder, folders, names in os.walk(self.root):
            folders[:] = sorted(name for name in folders if not name.startswith("."))
            for name in sorted(names):
                visited += 1
                if visited > _MAX_VISITED:
                    return
                path = Path(folder, name)
                if not name.startswith(".") and not path.is_symlink():
                    yield path

    def _inside(self, name: str, suffixes: Sequence[str]) -> Path:
        """Return the real path of *name*, which must end with one of *suffixes*."""
        if not name or len(name) > _MAX_LENGTH:
            raise RefusedError(f"a path is refused: its length must be 1 to {_MAX_LENGTH} characters")
        if _CONTROL.search(name):
            raise RefusedError(f"the path {name!a} is refused: it contains control characters")
        absolute = name.startswith(("/", "\\", "~")) or re.match(r"[A-Za-z]:", name)
        if absolute or ".." in re.split(r"[/\\]", name):
            raise RefusedError(
                f"'{name}' is refused: give a path relative to the served folder, without '..'"
            )
        path = real_path(self.root / name)
        if not path.is_relative_to(self.root):
            raise RefusedError(f"'{name}' is refused: it leads out of the served folder")
        if not path.name.lower().endswith(tuple(suffixes)):
            raise RefusedError(f"'{name}' is refused: the name must end with {' or '.join(suffixes)}")
        return path
