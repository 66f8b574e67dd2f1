"""``.db3``: the database of BehaviorTree.CPP 4's SqliteLogger, written and read (groot2.md §12).

Three tables: Definitions, a row for each session with the tree's XML; Nodes, the full path of every
node of a session; Transitions, with a stamp in µs since 1970 that is the key, and therefore strictly
increasing over all sessions.
"""

import os
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import ClassVar, Final

from btcore.engine.node import TreeNode
from btcore.engine.observers import Observer
from btcore.logs.database import EXTENSIONS, SqliteWriter
from btcore.logs.files import expect_extension
from btcore.logs.log import Log
from btcore.status import IDLE, Transition
from btcore.tree.tree import Tree
from btcore.xml.render.tree_xml import tree_to_xml

NS_PER_US: Final = 1_000

Extra = Callable[[TreeNode, Transition], str]


class SqliteLog(Log):
    """Writes the transitions of *tree* to the database *path*, as SqliteLogger does, in a new session.

    Without *append* the sessions that are there are deleted (the numbers of sessions go on). *extra* is
    called for every transition, on the thread that ticks; its text becomes the row's ``extra_data``.
    Where a database holds stamps that are later than now (of a run in simulated time), the new session
    begins right after them. A row's ``duration`` is how long (µs) the node was RUNNING, in the row in
    which it leaves it, else 0.

    The database keeps a write-ahead log beside it until the log is closed, so that other programs can
    read while the tree runs; it does not wait for the disk, so it outlives the process, but not the
    power. While another program writes, rows wait for the end of a later tick. Raises LogError.
    """

    write_errors: ClassVar[tuple[type[Exception], ...]] = (OSError, sqlite3.Error)

    def __init__(
        self,
        tree: Tree,
        path: str | os.PathLike[str],
        *,
        append: bool = False,
        idle: bool = True,
        extra: Extra | None = None,
    ) -> None:
        self.path = Path(path)
        expect_extension(self.path, *EXTENSIONS)
        self.extra = extra
        self.extras: list[str] = []
        paths = ((node.path, node.uid) for subtree in tree.subtrees for node in subtree.nodes)
        self._base = SqliteWriter(self.path, tree_to_xml(tree), paths, append=append)
        self.session = self._base.session
        super().__init__(tree, str(self.path), idle=idle)
        self._base.begin_at(self.epoch // NS_PER_US)
        self._stop_asking = tree.subscribe(ExtraDataCollector(self)) if extra is not None else None
        self.attach()

    def write(self, changes: list[Transition]) -> None:
        """Append *changes* in one transaction, with those that had to wait."""
        extras, self.extras = self.extras, []
        for index, (_, stamp, _, uid, previous, status) in enumerate(changes):
            said = extras[index] if index < len(extras) else ""
            self._base.add((stamp - self.start) // NS_PER_US, uid, previous, status, said)
        self._base.flush()

    def finish(self) -> None:
        """Write the rows that had to wait, and put everything into the one file."""
        self._base.finish()

    def release(self) -> None:
        """Close the database."""
        if self._stop_asking is not None:
            self._stop_asking()
        self._base.close()


class ExtraDataCollector(Observer):
    """Asks for the extra data of *log* at the moment of each transition."""

    def __init__(self, log: SqliteLog) -> None:
        self._log = log
        self._nodes = {node.uid: node for node in log.tree.nodes}

    def transition(self, change: Transition) -> None:
        """Ask, and keep the answer for the end of the tick."""
        extra = self._log.extra
        if extra is not None and (change.status is not IDLE or self._log.idle):
            self._log.extras.append(extra(self._nodes[change.uid], change))
