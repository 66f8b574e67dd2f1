"""Detect that the XML file of a running tree was saved, and make a new tree that keeps its blackboard."""

import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from btcore.clock import POLL_INTERVAL_S
from btcore.errors import BtcoreError
from btcore.input_files import FileStamp, file_stamp
from btcore.loading.instantiate import instantiate
from btcore.tree.tree import Tree
from btcore.xml.plan.plan import Plans
from btcore.xml.read.read import parse_file, read


class FileWatcher:
    """Detects changes of a file and of the files that it includes.

    Args:
        confined: Whether included files outside of the file's folder are not read.
    """

    def __init__(self, path: Path, confined: bool = False) -> None:
        self._path = path
        self._confined = confined
        self._next_check = time.monotonic() + POLL_INTERVAL_S
        self._is_settling = False
        self._stamps = self._read_stamps()

    def take_save(self) -> bool:
        """Return True once after each save, at the first check that finds all files without a further change.

        This second check avoids reading a file that an editor is still writing. Calling this often is cheap:
        the files are checked at most every `POLL_INTERVAL_S`.
        """
        now = time.monotonic()
        if now < self._next_check:
            return False
        self._next_check = now + POLL_INTERVAL_S
        stamps = {path: file_stamp(path) for path in self._stamps}
        if None in stamps.values():
            return False
        was_settling, self._is_settling = self._is_settling, stamps != self._stamps
        if self._is_settling:
            self._stamps = self._read_stamps()
        return was_settling and not self._is_settling

    def _read_stamps(self) -> dict[Path, FileStamp | None]:
        """Return the stamps of the file and of those that it includes now."""
        files = {self._path}
        with suppress(BtcoreError):
            documents = read(parse_file(self._path, confined=self._confined)).documents
            files.update(Path(document.file) for document in documents if document.file)
        return {path: file_stamp(path) for path in files}


def rebuild_tree(tree: Tree, plans: Plans, resources: Sequence[object]) -> Tree:
    """Return a new tree from *plans*, with the blackboard and the clock of the running *tree*.

    *tree* is not halted: the caller must halt it before the new tree is ticked.

    Raises:
        TreeError: The document has errors. The blackboard is unchanged.
    """
    board = tree.blackboard
    before = set(board.local_entries())
    try:
        return instantiate(plans, resources, board, tree.clock, tree.tick_limit)
    except BtcoreError:
        # Creating nodes has created the entries of their ports: remove these entries.
        for key in board.local_entries().keys() - before:
            board.unset(key)
        raise
