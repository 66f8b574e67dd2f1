"""The blackboard of a batch: each entry is a column, an array with the values of all agents."""

from enum import IntEnum
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from btcore.blackboard.blackboard import Blackboard, Entry
from btcore.clock import Clock
from btcore.tree.tree import Tree
from btcore.values import ANY, BOOL, DOUBLE, INT, INT64, UINT64, ValueType, to_builtin_number, type_of
from btcore.values.types import MAX_EXACT, BoolType, EnumType, IntegerType, RealType
from btcore_batch.agent_sets import AgentSet, AgentSets

Values: TypeAlias = NDArray[Any]


class Form(IntEnum):
    """The form in which an array stores the values."""

    NUMBER = 0  # int64 or float64; a set of agents records which float64 values count as integers
    TRUTH = 1  # bools
    TEXT = 2  # str objects
    OBJECT = 3  # any Python objects; None = no value
    ROWS = 4  # a row of numbers for each agent


NUMBER: Final = Form.NUMBER
TRUTH: Final = Form.TRUTH
TEXT: Final = Form.TEXT
OBJECT: Final = Form.OBJECT
ROWS: Final = Form.ROWS


class BatchValue(NamedTuple):
    """The values of all agents.

    Attributes:
        data: An array with a value for each agent, or a single value for all agents.
        form: The form of the values.
        integers: The set of the agents whose number counts as an integer, even if *data* is float64.
    """

    data: Any
    form: Form
    integers: int


def dtype_of(value_type: ValueType) -> "np.dtype[Any]":
    """Return the dtype of the array in which a leaf gets values of the type *value_type*."""
    if isinstance(value_type, BoolType):
        return np.dtype(np.bool_)
    if isinstance(value_type, EnumType) or value_type is UINT64:
        return np.dtype(object)
    if isinstance(value_type, IntegerType):
        return np.dtype(np.int64)
    return np.dtype(np.float64 if isinstance(value_type, RealType) else object)


def all_within(integers: Values, low: int, high: int) -> bool:
    """Return whether all *integers* are from *low* to *high*.

    A comparison of np.abs() would be wrong for the smallest integer of 64 bits: its absolute value is itself.
    """
    return bool((integers >= low).all() and (integers <= high).all())


def infer_type(data: Any) -> ValueType:
    """Return the type that an untyped entry gets from the first values written to it."""
    if np.ndim(data) != 1:
        return type_of(data)
    if data.dtype == object:
        return type_of(to_builtin_number(data[0]))
    if data.dtype == np.bool_:
        return BOOL
    if data.dtype.kind == "f":
        return DOUBLE
    # As for a Python int, a number that fits into 32 bits is an int.
    return INT if all_within(data, INT.low, INT.high) else INT64


def to_objects(value: BatchValue, agent_sets: AgentSets, agents: AgentSet) -> Values:
    """Return the values of *agents* as an array of Python objects; elements of other agents are arbitrary."""
    data, form, integers = value
    integers &= agents
    if np.ndim(data) == 0:
        scalar = data.item() if isinstance(data, np.generic) else data
        objects = np.empty(agent_sets.count, dtype=object)
        if form is NUMBER:
            objects[...] = float(scalar)
            if integers:
                np.copyto(objects, int(scalar), where=agent_sets.mask(integers))
        else:
            objects[...] = bool(scalar) if form is TRUTH else scalar
        return objects
    if form is ROWS:
        objects = np.full(agent_sets.count, None, dtype=object)
        for index in agent_sets.indices(agents):
            objects[index] = data[index]
        return objects
    result: Values = data.astype(object)
    if form is NUMBER and data.dtype == np.float64:
        for index in agent_sets.indices(integers):
            result[index] = int(result[index])
    return result


class Column:
    """The values of one blackboard entry for all agents.

    Leaves may keep the arrays that they have read, and these must not change. So the first write after a read
    replaces the array by a copy. But if user code has got the array from `shared_array` (*is_shared*),
    the array is never replaced for this reason, and leaves get copies instead.

    Attributes:
        entry: The entry in the batch's scope; its declared type applies to all agents.
        exists: The agents that have the entry.
        written: The agents that have a value.
        values: The array; None before the first write. It contains Python objects if an integer needs more
            than 53 bits.
        integers: The agents whose number counts as an integer although *values* is float64.
    """

    def __init__(self, name: str, entry: Entry, agent_sets: AgentSets, exists: int) -> None:
        self.name = name
        self.entry = entry
        self.agent_sets = agent_sets
        self.exists = exists
        self.written = 0
        self.integers = 0
        self.form: Form = NUMBER
        self.values: Values | None = None
        self.is_shared = False
        self._view: Values | None = None

    @property
    def declared(self) -> ValueType:
        """The declared type."""
        return self.entry.declared

    def integers_among(self, agents: AgentSet) -> AgentSet:
        """Return those of *agents* whose number counts as an integer."""
        if self.values is not None and self.values.dtype == np.int64:
            return agents
        return self.integers & agents

    def readonly_view(self) -> Values:
        """Return the values for leaves: a read-only array that later writes do not change."""
        if self._view is None:
            assert self.values is not None
            self._view = self.values.copy() if self.is_shared else self.values.view()
            self._view.setflags(write=False)
        return self._view

    def shared_array(self) -> Values:
        """Return the stored array, which user code may keep, and may modify between two ticks."""
        self._release_view()
        assert self.values is not None
        self.is_shared = True
        return self.values

    def refresh(self) -> None:
        """Discard the copy for leaves, because user code may have modified the array since."""
        if self.is_shared:
            self._view = None

    def put(self, agents: AgentSet, data: Any, form: Form, integers: int = 0) -> None:
        """Store values for *agents*.

        Args:
            agents: The agents whose values are replaced.
            data: An array with a value for each agent, or a single value.
            form: The form of the values.
            integers: The agents whose number is an integer.
        """
        if not agents:
            return
        self._release_view()
        if self.values is None or (self.form is not form and (self.written | agents) == agents):
            self._allocate(agents, data, form, integers)
        if self.form is not form:
            self._convert_to_objects()
        stored = self.values
        assert stored is not None
        if self.form is NUMBER:
            if integers & agents != agents and stored.dtype == np.int64:
                # The first real numbers: remember that the numbers stored before count as integers.
                self.integers = self.written
                self.values = stored = stored.astype(np.float64)
            if stored.dtype == np.float64:
                self.integers = self.integers ^ (self.integers & agents) | integers & agents
        elif self.form is OBJECT and form is not OBJECT:
            data = to_objects(BatchValue(data, form, integers), self.agent_sets, agents)
        elif self.form is ROWS and np.shape(data)[1:] != stored.shape[1:]:
            self.values = stored = np.zeros((self.agent_sets.count, *np.shape(data)[1:]))
        # numpy copies without a mask faster than with a mask that is True for all agents.
        mask: Any = True if agents == self.agent_sets.all_agents else self.agent_sets.mask(agents)
        if self.form is ROWS and mask is not True:
            mask = mask.reshape((-1,) + (1,) * (stored.ndim - 1))
        np.copyto(stored, data, where=mask, casting="unsafe")
        self.exists |= agents
        self.written |= agents

    def _release_view(self) -> None:
        """Before a write, replace the array by a copy if leaves may hold a view of it."""
        if self._view is not None and not self.is_shared and self.values is not None:
            self.values = self.values.copy()
        self._view = None

    def put_objects(self, agents: AgentSet, objects: Values) -> None:
        """Store Python objects for *agents*. If all are numbers, all bools or all texts, use that form."""
        if not agents:
            return
        mask = self.agent_sets.mask(agents)
        selected = objects[mask].tolist()
        types = {type(item) for item in selected}
        if types <= {int, float} and all(type(item) is float or abs(item) <= MAX_EXACT for item in selected):
            data = np.zeros(self.agent_sets.count, np.float64 if float in types else np.int64)
            data[mask] = selected
            integers = np.array([type(item) is int for item in objects])
            self.put(agents, data, NUMBER, self.agent_sets.from_mask(integers) & agents)
        elif types == {bool}:
            self.put(agents, np.equal(objects, True).astype(np.bool_), TRUTH)
        else:
            self.put(agents, objects, TEXT if types == {str} else OBJECT)

    def _allocate(self, agents: AgentSet, data: Any, form: Form, integers: int) -> None:
        """Create the array for the first values, or for values that replace all values."""
        if form is ROWS:
            if self.values is None or self.form is not ROWS:
                self.values = np.zeros((self.agent_sets.count, *np.shape(data)[1:]))
        else:
            if form is NUMBER:
                is_real = isinstance(self.declared, RealType) or integers & agents != agents
                dtype: Any = np.dtype(np.float64 if is_real else np.int64)
            else:
                dtype = np.dtype(np.bool_ if form is TRUTH else object)
            if self.values is None or self.values.dtype != dtype or self.values.ndim > 1:
                self.values = np.full(self.agent_sets.count, None if dtype.kind == "O" else 0, dtype)
        self.form = form
        self.integers = 0

    def _convert_to_objects(self) -> None:
        """Store Python objects from now on, because the values are of different forms."""
        assert self.values is not None
        if self.values.dtype != object:
            self.values = to_objects(self.value(-1), self.agent_sets, self.written)
        self.form = OBJECT

    def value(self, agents: AgentSet) -> BatchValue:
        """Return the values of *agents*, all of which have a value. The array is not copied."""
        return BatchValue(self.values, self.form, self.integers_among(agents))

    def objects(self, agents: AgentSet) -> Values:
        """Return the values of *agents* as Python objects; None for agents without a value."""
        result = np.full(self.agent_sets.count, None, dtype=object)
        agents &= self.written
        if agents:
            objects = to_objects(self.value(agents), self.agent_sets, agents)
            np.copyto(result, objects, where=self.agent_sets.mask(agents))
        return result


class ColumnTable:
    """The columns of a batch, by scope and key.

    The batch is compiled from an ordinary tree. The scopes are copies of that tree's blackboards, without
    values. So remapping, `@` and autoremap work as for a single agent. Each entry of a scope has one column,
    which starts with the entry's value for all agents.

    Attributes:
        scopes: The scopes, by the `id()` of the ordinary tree's blackboards.
        version: The number of entries that were created since the creation of the batch. A `Slot`
            caches its column until the version changes.
    """

    def __init__(self, tree: Tree, agent_sets: AgentSets, clock: Clock) -> None:
        self.agent_sets = agent_sets
        self.scopes: dict[int, Blackboard] = {}
        self.version = 0
        self._columns: dict[Entry, Column] = {}
        for subtree in tree.subtrees:
            self._copy_scope(subtree.blackboard, clock)

    def _copy_scope(self, board: Blackboard, clock: Clock) -> Blackboard:
        known = self.scopes.get(id(board))
        if known is not None:
            return known
        parent = None if board.parent is None else self._copy_scope(board.parent, clock)
        self.scopes[id(board)] = scope = Blackboard(parent, clock)
        for inner, outer in board.remappings().items():
            scope.remap(inner, outer)
        for key, entry in board.local_entries().items():
            scope.local_entries()[key] = copy = Entry(entry.declared, entry.inferred)
            column = self.column_of(copy, key, self.agent_sets.all_agents)
            if entry.value is not None:
                objects = np.empty(self.agent_sets.count, dtype=object)
                objects.fill(entry.value)  # unlike assignment, fill() does not unpack a list
                column.put_objects(self.agent_sets.all_agents, objects)
        scope.autoremap = board.autoremap
        return scope

    def column(self, board: Blackboard, key: str) -> Column | None:
        """Return the column of *key* in the scope *board*, or None."""
        entry = board.find(key)
        return None if entry is None else self.column_of(entry, key)

    def create(self, board: Blackboard, key: str, declared: ValueType = ANY) -> Column:
        """Return the column of *key*; if needed, create the entry in the last scope of its remappings.

        Raises:
            BlackboardError: The key cannot be created, or has another type.
        """
        before = board.find(key)
        entry = board.declare(key, declared)
        if before is None:
            self.version += 1
        return self.column_of(entry, key)

    def column_for_write(self, board: Blackboard, key: str) -> tuple[Column, bool]:
        """Return the column to which *key* is written, and whether it belongs to the scope *board* itself.

        An `@` in the key to which *key* is remapped is a part of that key, as in `Blackboard.set` and
        unlike in `column`.

        Raises:
            BlackboardError: The key cannot be created.
        """
        while key.startswith("@"):
            board, key = board.root, key[1:]
        entry = board.local_entries().get(key)
        if entry is not None:
            return self.column_of(entry, key), True
        entry = board.written_entry(key)
        if entry not in self._columns:
            self.version += 1
        return self.column_of(entry, key), False

    def refresh(self) -> None:
        """Discard the copies for leaves of all arrays that user code may have modified between two ticks."""
        for column in self._columns.values():
            column.refresh()

    def column_of(self, entry: Entry, key: str, exists: int = 0) -> Column:
        """Return the column of *entry*; a new column exists for the agents *exists*."""
        column = self._columns.get(entry)
        if column is None:
            self._columns[entry] = column = Column(key, entry, self.agent_sets, exists)
        return column


class Slot:
    """A key in one scope, which caches the column of the key until an entry is created anywhere."""

    def __init__(self, columns: ColumnTable, board: Blackboard, key: str) -> None:
        self.columns = columns
        self.board = board
        self.key = key
        self._column: Column | None = None
        self._version = -1
        self._for_write: tuple[Column, bool] | None = None
        self._version_for_write = -1

    @property
    def column(self) -> Column | None:
        """The column of the key, or None."""
        if self._version != self.columns.version:
            self._column = self.columns.column(self.board, self.key)
            self._version = self.columns.version
        return self._column

    def column_for_write(self) -> tuple[Column, bool]:
        """Call `ColumnTable.column_for_write`, cached."""
        if self._for_write is None or self._version_for_write != self.columns.version:
            self._for_write = self.columns.column_for_write(self.board, self.key)
            self._version_for_write = self.columns.version
        return self._for_write

    def get_or_create_column(self, declared: ValueType = ANY) -> Column:
        """Return the column; create it with the type *declared* if needed.

        Raises:
            BlackboardError: The key cannot be created, or has another type.
        """
        return self.column or self.columns.create(self.board, self.key, declared)
