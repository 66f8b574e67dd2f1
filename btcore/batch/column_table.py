"""Where the keys of a tree lead: from scope and key to the column, by the ordinary blackboards' rules.

The scopes are blackboards without values, copied from those of the plan, so that remapping, ``@`` and
autoremap are decided by the code that decides them for one agent. Every entry has one column.
"""

from collections.abc import Mapping

from btcore.batch.agent_sets import AgentSets
from btcore.batch.column import Column
from btcore.blackboard.blackboard import Blackboard, Entry
from btcore.clock import Clock
from btcore.tree.tree import Tree
from btcore.values import ANY, ValueType


class ColumnTable:
    """The columns of a batch. *version* counts the entries that were made since it began."""

    def __init__(self, crowd: AgentSets) -> None:
        self.crowd = crowd
        self.version = 0
        self._columns: dict[Entry, Column] = {}

    def column(self, board: Blackboard, key: str) -> Column | None:
        """The column that *key* of *board* leads to, or None."""
        entry = board.find(key)
        return None if entry is None else self.column_of(entry, key)

    def create(self, board: Blackboard, key: str, declared: ValueType = ANY) -> Column:
        """The column of *key*, made where the route ends if there is none. Raises BlackboardError."""
        before = board.find(key)
        entry = board.create(key, declared)
        if before is None:
            self.version += 1
        return self.column_of(entry, key)

    def column_for_write(self, board: Blackboard, key: str) -> tuple[Column, bool]:
        """The column that a write of *key* goes to, and whether it is that very scope's.

        A write goes another way than :meth:`create` where a remapping brings in an ``@``. Raises
        BlackboardError.
        """
        while key.startswith("@"):
            board, key = board.root, key[1:]
        entry = board.local_entries().get(key)
        if entry is not None:
            return self.column_of(entry, key), True
        entry = board._route(key, ANY, False)
        if entry not in self._columns:
            self.version += 1
        return self.column_of(entry, key), False

    def adopt(self, board: Blackboard, everyone: int) -> None:
        """Take the entries of *board* for such as all agents have."""
        for key, entry in board.local_entries().items():
            self.column_of(entry, key, everyone)

    def refresh(self) -> None:
        """See what was written into the columns' arrays between two ticks."""
        for column in self._columns.values():
            column.refresh()

    def column_of(self, entry: Entry, key: str, exists: int = 0) -> Column:
        """The column of *entry*; a new one is there for the agents *exists*."""
        column = self._columns.get(entry)
        if column is None:
            self._columns[entry] = column = Column(key, entry, self.crowd, exists)
        return column


class Slot:
    """A key in one scope, whose column is looked for again only when there are new entries."""

    __slots__ = ("_column", "_version", "_version_written", "_written", "board", "key", "schema")

    def __init__(self, schema: ColumnTable, board: Blackboard, key: str) -> None:
        self.schema = schema
        self.board = board
        self.key = key
        self._column: Column | None = None
        self._version = -1
        self._written: tuple[Column, bool] | None = None
        self._version_written = -1

    @property
    def column(self) -> Column | None:
        """The column that the key leads to, or None."""
        if self._version != self.schema.version:
            self._column = self.schema.column(self.board, self.key)
            self._version = self.schema.version
        return self._column

    def column_for_write(self) -> tuple[Column, bool]:
        """As :meth:`ColumnTable.column_for_write`."""
        if self._written is None or self._version_written != self.schema.version:
            self._written = self.schema.column_for_write(self.board, self.key)
            self._version_written = self.schema.version
        return self._written

    def get_or_create_column(self) -> Column:
        """The column, made if there is none. Raises BlackboardError."""
        column = self.column
        if column is None:
            column = self.schema.create(self.board, self.key)
        return column


def copied_scopes(tree: Tree, clock: Clock) -> dict[int, Blackboard]:
    """The scopes of *tree* without values, by the identity of the blackboards that they are copies of."""
    made: dict[int, Blackboard] = {}

    def copy(board: Blackboard) -> Blackboard:
        known = made.get(id(board))
        if known is not None:
            return known
        parent = None if board.parent is None else copy(board.parent)
        made[id(board)] = other = Blackboard(parent, clock)
        outside: Mapping[str, str] = board._outside
        for inner, outer in outside.items():
            other.remap(inner, outer)
        for key, entry in board.local_entries().items():
            other.local_entries()[key] = Entry(entry.declared, entry.inferred)
        other.autoremap = board.autoremap
        return other

    for subtree in tree.subtrees:
        copy(subtree.blackboard)
    return made
