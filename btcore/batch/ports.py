"""The ports of a batch's nodes: a column that is read through a type, or written."""

from typing import Any

import numpy as np

from btcore.batch.agent_sets import AgentSets
from btcore.batch.column import (
    NUMBER,
    ROWS,
    TEXT,
    TRUTH,
    Column,
    Form,
    Values,
    dtype_of,
    infer_type,
    to_objects,
)
from btcore.batch.column_table import ColumnTable, Slot
from btcore.batch.context import BatchContext, Located
from btcore.batch.conversion import FailureCallback, cast, normalise_values, read_column
from btcore.blackboard.blackboard import Blackboard
from btcore.blackboard.ports import Input, Output, Port
from btcore.errors import BlackboardError, BtcoreError, ConversionError, NodeError
from btcore.values import ANY, DOUBLE, INT64, STRING, UINT64, ValueType, type_of
from btcore.values.types import BoolType, IntegerType, RealType


class BatchInput:
    """An input port of one node. A literal is one value for all, and never written."""

    def __init__(
        self,
        node: Located,
        context: BatchContext,
        schema: ColumnTable,
        board: Blackboard,
        name: str,
        bound: Input | None,
        port: Port | None = None,
    ) -> None:
        self.node = node
        self.context = context
        self.name = name
        declared = port if port is not None or bound is None else bound.port
        self.kind = ANY if declared is None else declared.type
        self.fault: BtcoreError | None = None
        self.slot: Slot | None = None
        self.agents = 0
        self.literal: Any = None
        self._values: Values | None = None
        self._is_quiet = False
        self._lost = 0
        if bound is None:
            self.fault = NodeError(f"<{node.id}> needs port [{name}], which the tree does not give")
        elif bound.key is not None:
            self.slot = Slot(schema, board, bound.key)
        else:
            try:
                self.literal = bound.read()
            except ConversionError as fault:
                self.fault = fault

    @property
    def is_literal(self) -> bool:
        """Whether all agents have the same value, for ever."""
        return self.slot is None and self.fault is None

    def available(self, agents: int) -> int:
        """Those of *agents* who have a value; the others' tick fails."""
        if self.fault is not None:
            self._report(agents, self.fault)
            return 0
        if self.slot is None:
            return agents
        column = self.slot.column
        if column is None:
            self._missing(agents, "is not on the blackboard")
            return 0
        found = agents & column.written
        if found != agents:
            left = agents ^ found
            self._missing(left & column.exists, "has never been written")
            self._missing(left ^ (left & column.exists), "is not on the blackboard")
        return found

    def _missing(self, agents: int, what: str) -> None:
        if agents and self.slot is not None:
            said = f"port [{self.name}] reads {{{self.slot.key}}}, which {what}"
            self._report(agents, BlackboardError(said))

    def _report(self, agents: int, fault: BtcoreError) -> None:
        if self._is_quiet:
            self._lost |= agents
        else:
            self.context.fail(self.node, agents, fault)

    def read(self, agents: int) -> Values:
        """The values of *agents*, all of whom have one: an array of shape (agents,), not to be written.

        Those whose value doesn't convert fail: ask the context who is left.
        """
        if self.slot is None:
            if self._values is None:
                self._values = self._constant()
            return self._values
        column = self.slot.column
        assert column is not None
        if self.kind is DOUBLE and column.form is NUMBER:
            values = column.readonly_view()
            if values.dtype == np.float64:
                return values
        return read_column(column, self.kind, agents, self._fail)

    def current(self) -> Values:
        """The values of those who are ticked just now; who has none fails."""
        agents = self.available(self.agents)
        if agents:
            return self.read(agents)
        return np.zeros(self.context.agent_sets.count, dtype_of(self.kind))

    def _constant(self) -> Values:
        count = self.context.agent_sets.count
        dtype = dtype_of(self.kind)
        if dtype.kind == "O":
            values: Values = np.empty(count, dtype)
            values[...] = [self.literal] * count
            values.flags.writeable = False
            return values
        return np.broadcast_to(np.asarray(self.literal, dtype=dtype), count)

    def _fail(self, agents: int, fault: BtcoreError) -> None:
        key = "" if self.slot is None else self.slot.key
        said = f"port [{self.name}] reads {{{key}}} as {self.kind.name}: {fault}"
        self._report(agents, ConversionError(said))

    def groups_or(self, agents: int, otherwise: Any) -> list[tuple[Any, int]]:
        """As :meth:`groups`, but who has no value takes *otherwise*."""
        if self.is_literal:
            return [(self.literal, agents)]
        self._is_quiet, self._lost = True, 0
        try:
            found = self.groups(agents)
        finally:
            self._is_quiet = False
        lost = self._lost & agents
        return [*found, (otherwise, lost)] if lost else found

    def groups(self, agents: int) -> list[tuple[Any, int]]:
        """The values that *agents* have, each with those who have it; the others' tick fails."""
        self._lost &= -self._is_quiet
        agents = self.available(agents)
        if self.slot is None:
            return [(self.literal, agents)] if agents else []
        if not agents:
            return []
        crowd = self.context.agent_sets
        values = self.read(agents)
        agents ^= agents & (self.context.raised | self._lost)
        if not agents:
            return []
        held = values[crowd.mask(agents)]
        if values.dtype == object:
            distinct: list[Any] = list(dict.fromkeys(held.tolist()))
        else:
            distinct = np.unique(held).tolist()
        if len(distinct) == 1:
            return [(distinct[0], agents)]
        return [(one, crowd.from_mask(np.equal(values, one).astype(np.bool_)) & agents) for one in distinct]


class BatchOutput:
    """An output port of one node, for the agents whom the node is ticked for just now."""

    def __init__(
        self, node: Located, context: BatchContext, schema: ColumnTable, board: Blackboard, name: str,
        bound: Output | None,
    ) -> None:  # fmt: skip
        self.node = node
        self.context = context
        self.name = name
        self.agents = 0
        self._shape = (context.agent_sets.count,)
        self.kind = bound.type if bound is not None else None
        self.slot = None if bound is None or bound.key is None else Slot(schema, board, bound.key)
        self.text = "" if bound is None else bound.text

    def __call__(self, values: Any) -> None:
        """Write *values*: an array of shape (agents,), or one value for all who are ticked."""
        self.write(self.agents, values)

    def write(self, agents: int, values: Any) -> None:
        """Write *values* for *agents*. Raises NodeError or BlackboardError if the port leads nowhere."""
        if self.kind is None:
            raise NodeError(f"<{self.node.id}> writes port [{self.name}], which the tree does not give")
        if self.slot is None:
            raise BlackboardError(
                f"port [{self.name}] is to be written, but '{self.text}' is no blackboard entry: "
                "name one in braces, {like_this}"
            )
        if self.kind is DOUBLE and self._put_doubles(self.slot, agents, values):
            return
        data, form, whole = normalise_values(values, self.context.agent_sets)
        if self.kind.strong:
            data = cast(data, form, whole, self.kind, self.context.agent_sets, agents, self._fail)
            data, form, whole = normalise_values(data, self.context.agent_sets)
        agents ^= agents & self.context.raised
        store(self.slot, agents, data, form, whole, self._fail)

    def _put_doubles(self, slot: Slot, agents: int, values: Any) -> bool:
        """Write *values* at once, if they are of the column's own type, as they are most of the time."""
        if type(values) is not np.ndarray or values.shape != self._shape or values.dtype != np.float64:
            return False
        column, _ = slot.column_for_write()
        if column.entry.declared is not DOUBLE:
            return False
        column.put(agents, values, NUMBER)
        return True

    def _fail(self, agents: int, fault: BtcoreError) -> None:
        said = f"port [{self.name}] takes {self.kind.name if self.kind else '?'}: {fault}"
        self.context.fail(self.node, agents, ConversionError(said))


def store(
    slot: Slot, agents: int, data: Any, form: Form, whole: int, fail: FailureCallback, types: bool = True
) -> None:
    """Write as ``Blackboard.set`` does: the entry's type is that of its first value, and stays.

    With *types* false an entry without a type stays so. Raises BlackboardError where no entry can be made.
    """
    if not agents:
        return
    column, is_own = slot.column_for_write()
    entry = column.entry
    crowd = column.crowd
    if not is_own:
        # What a route leads to takes what is of its type, or any text, and doesn't convert.
        if not column.exists and not isinstance(data, str):
            entry.declared = _kind_of(data)
            entry.inferred = True
        elif (
            form is not TEXT
            and entry.declared.strong
            and not _is_of(entry.declared, data, form, whole, agents)
        ):
            agents = _refused(column, to_objects(data, form, crowd, agents, whole), agents, fail)
    elif not entry.declared.strong:
        if types and (not isinstance(data, str) or column.exists & agents):
            entry.declared = _kind_of(data)
            entry.inferred = True
    elif not _accepts(entry.declared, form):
        found = to_objects(data, form, crowd, agents, whole)
        column.put_objects(_fitted(found, entry.declared, crowd, agents, fail), found)
        return
    elif form is NUMBER or form is TRUTH:
        lost: list[int] = []

        def note(some: int, fault: BtcoreError) -> None:
            lost.append(some)
            fail(some, fault)

        data = cast(data, form, whole, entry.declared, crowd, agents, note)
        data, form, whole = normalise_values(data, crowd)
        for some in lost:
            agents ^= agents & some
    column.put(agents, data, form, whole)


def _kind_of(data: Any) -> ValueType:
    return type_of(data) if np.ndim(data) == 0 else infer_type(data)


def _is_of(kind: ValueType, data: Any, form: Form, whole: int, agents: int) -> bool:
    """Whether *data* is surely of *kind*, without a look at each."""
    if form is NUMBER and isinstance(kind, RealType):
        return not whole & agents
    if form is NUMBER and kind is INT64:
        return whole & agents == agents
    if form is NUMBER and isinstance(kind, IntegerType) and whole & agents == agents:
        return bool(np.min(data) >= kind.low and np.max(data) <= kind.high)
    return (form is TRUTH and isinstance(kind, BoolType)) or (form is ROWS and kind.python_type is np.ndarray)


def _refused(column: Column, found: Values, agents: int, fail: FailureCallback) -> int:
    """Those of *agents* whose value is of the column's type; the others fail."""
    for at in column.crowd.indices(agents):
        if not column.kind.accepts(found[at]):
            said = (
                f"the entry '{column.name}' is of type {column.kind.name}, and once declared its type stays"
            )
            fail(1 << int(at), BlackboardError(said))
            agents ^= 1 << int(at)
    return agents


def _accepts(kind: ValueType, form: Form) -> bool:
    """Whether an entry of *kind* may take values of *form* without a look at each."""
    if form is ROWS:
        return kind.python_type is np.ndarray
    if form is NUMBER:
        return isinstance(kind, (RealType, IntegerType)) and kind is not UINT64
    if form is TRUTH:
        return isinstance(kind, (RealType, IntegerType, BoolType)) and kind is not UINT64
    return form is TEXT and kind is STRING


def _fitted(found: Values, kind: ValueType, crowd: AgentSets, agents: int, fail: FailureCallback) -> int:
    """Make *found* what an entry of *kind* takes, from texts or adapted; who of *agents* has such a value."""
    for at in crowd.indices(agents):
        one = found[at]
        try:
            if not kind.accepts(one):
                found[at] = kind.from_text(one) if isinstance(one, str) and kind.converts else kind.adapt(one)
        except ConversionError as fault:
            fail(1 << int(at), fault)
            agents ^= 1 << int(at)
    return agents
