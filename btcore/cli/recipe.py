"""How a run makes its tree: once, or whenever its file is saved."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from btcore.cli import palettes
from btcore.cli.library import Library
from btcore.cli.pace import LOOK_EVERY
from btcore.registry import Registry
from btcore.reload import Watch
from btcore.xml.check import Examined, examine
from btcore.xml.source import read_file


class Reading(NamedTuple):
    """A document without errors, and the nodes that it was examined with."""

    examined: Examined
    nodes: Registry


class Recipe:
    """The file *path*, which of its trees, and the nodes for it: those *found*, and those of *models*.

    *format* (3 or 4) overrides what the file says.
    """

    def __init__(
        self, path: Path, tree: str | None, found: Library, models: Sequence[Path], format: int | None = None
    ) -> None:
        self.path = path
        self.tree = tree
        self.format = format
        self.found = found
        self.without_code = bool(models)
        palettes.add_palettes(found.nodes, models)

    def read(self) -> Reading:
        """The file as it is now. Raises TreeError."""
        with self.found.explaining():
            document = read_file(self.path)
            nodes = self.found.nodes
            if self.without_code:
                # A saved file may give the ports of an explicit tag anew.
                nodes = nodes.copy()
                palettes.add_named(nodes, [document])
            examined = examine(document, nodes, self.tree, self.format)
            examined.faults.raise_errors()
        return Reading(examined, nodes)


class Saves:
    """Tells that a tree's file, or one that it includes, was saved. To be asked often: it looks rarely."""

    def __init__(self, path: Path) -> None:
        self._watch = Watch(path)
        self._next = time.monotonic() + LOOK_EVERY
        self._written = False

    def __call__(self) -> bool:
        """Whether there is something new, once, as soon as a look finds the writing over."""
        now = time.monotonic()
        if now < self._next:
            return False
        self._next = now + LOOK_EVERY
        before, self._written = self._written, self._watch.saved()
        return before and not self._written
