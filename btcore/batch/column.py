"""One entry of a blackboard for all agents: an array of their values, and who has one."""

from enum import IntEnum
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from btcore.batch.agent_sets import AgentSets
from btcore.blackboard.blackboard import Entry
from btcore.values import to_builtin_number, type_of
from btcore.values.enums import EnumType
from btcore.values.types import (
    BOOL,
    DOUBLE,
    INT,
    INT64,
    MAX_EXACT,
    UINT64,
    BoolType,
    IntegerType,
    RealType,
    ValueType,
)

Values: TypeAlias = NDArray[Any]


class Form(IntEnum):
    """What an array of values is made of."""

    NUMBER = 0  # int64 or float64; which of them are whole a set tells
    TRUTH = 1  # bools
    TEXT = 2  # Python's texts
    OBJECT = 3  # whatever Python has, None for no value
    ROWS = 4  # a row of numbers for each agent


NUMBER: Final = Form.NUMBER
TRUTH: Final = Form.TRUTH
TEXT: Final = Form.TEXT
OBJECT: Final = Form.OBJECT
ROWS: Final = Form.ROWS


def dtype_of(kind: ValueType) -> "np.dtype[Any]":
    """The dtype in which leaves see values of *kind*."""
    if isinstance(kind, BoolType):
        return np.dtype(np.bool_)
    if isinstance(kind, EnumType) or kind is UINT64:
        return np.dtype(object)
    if isinstance(kind, IntegerType):
        return np.dtype(np.int64)
    return np.dtype(np.float64 if isinstance(kind, RealType) else object)


def infer_type(values: Values) -> ValueType:
    """The type that an entry takes from its first values; that of each for Python's objects."""
    if values.ndim > 1:
        return type_of(values)
    if values.dtype == object:
        return type_of(to_builtin_number(values[0]))
    if values.dtype == np.bool_:
        return BOOL
    if values.dtype.kind == "f":
        return DOUBLE
    small = bool((np.abs(values) < 2**31).all())
    return INT if small else INT64


class Column:
    """The values of one entry.

    *entry* is that of the plan, whose declared type holds for all agents. *exists* are the agents who
    have the entry, *written* those for whom it holds a value. Where *values* are reals, *whole* are the
    agents whose number counts as an integer all the same. Integers of more than 53 bits are Python's objects.

    What leaves were shown doesn't change. So the array itself moves on at the first write after it was
    shown, unless a user has got hold of it (*is_held*): then leaves are shown a copy.
    """

    __slots__ = (
        "_shown",
        "crowd",
        "entry",
        "exists",
        "form",
        "integer_agents",
        "is_shared",
        "name",
        "values",
        "written",
    )  # fmt: skip

    def __init__(self, name: str, entry: Entry, crowd: AgentSets, exists: int) -> None:
        self.name = name
        self.entry = entry
        self.crowd = crowd
        self.exists = exists
        self.written = 0
        self.integer_agents = 0
        self.form: Form = NUMBER
        self.values: Values | None = None
        self.is_shared = False
        self._shown: Values | None = None

    @property
    def kind(self) -> ValueType:
        """The declared type."""
        return self.entry.declared

    def integers_among(self, agents: int) -> int:
        """Those of *agents* whose number is an integer."""
        if self.values is not None and self.values.dtype == np.int64:
            return agents
        return self.integer_agents & agents

    def readonly_view(self) -> Values:
        """The values as leaves see them: not to be written, and what is written later doesn't change them."""
        if self._shown is None:
            assert self.values is not None
            self._shown = self.values.copy() if self.is_shared else self.values.view()
            self._shown.setflags(write=False)
        return self._shown

    def shared_array(self) -> Values:
        """The array itself, for a user who may keep it, and write into it between two ticks."""
        self._give_away()
        assert self.values is not None
        self.is_shared = True
        return self.values

    def refresh(self) -> None:
        """Show anew what the array holds, since its user may have written into it."""
        if self.is_shared:
            self._shown = None

    def put(self, agents: int, values: Any, form: Form, whole: int = 0) -> None:
        """Store *values* (an array, or one value for all) for *agents*; of numbers *whole* are integers."""
        if not agents:
            return
        self._give_away()
        if self.values is None or (self.form is not form and (self.written | agents) == agents):
            self._begin(agents, values, form, whole)
        if self.form is not form:
            self._as_objects()
        stored = self.values
        assert stored is not None
        if self.form is NUMBER:
            if whole & agents != agents and stored.dtype == np.int64:
                # Reals come in: the integers that are there already are kept in mind.
                self.integer_agents = self.written
                self.values = stored = stored.astype(np.float64)
            if stored.dtype == np.float64:
                self.integer_agents = self.integer_agents ^ (self.integer_agents & agents) | whole & agents
        elif self.form is OBJECT and form is not OBJECT:
            values = to_objects(values, form, self.crowd, agents, whole)
        if self.form is ROWS and np.shape(values)[1:] != stored.shape[1:]:
            stored = self._reshaped(values)
        mask: Any = True if agents == self.crowd.all_agents else self.crowd.mask(agents)
        if self.form is ROWS and mask is not True:
            mask = mask.reshape((-1,) + (1,) * (stored.ndim - 1))
        np.copyto(stored, values, where=mask, casting="unsafe")
        self.exists |= agents
        self.written |= agents

    def _give_away(self) -> None:
        """Leave the array to those whom it was shown to, if it is not a copy."""
        if self._shown is not None and not self.is_shared and self.values is not None:
            self.values = self.values.copy()
        self._shown = None

    def put_objects(self, agents: int, found: Values) -> None:
        """Store Python's own objects for *agents*, as numbers where they are such."""
        if not agents:
            return
        held = found[self.crowd.mask(agents)].tolist()
        kinds = {type(one) for one in held}
        if kinds <= {int, float} and all(type(one) is float or abs(one) <= MAX_EXACT for one in held):
            data = np.zeros(self.crowd.count, np.float64 if float in kinds else np.int64)
            data[self.crowd.mask(agents)] = held
            integers = np.array([type(one) is int for one in found])
            self.put(agents, data, NUMBER, self.crowd.from_mask(integers) & agents)
        elif kinds == {bool}:
            self.put(agents, np.equal(found, True).astype(np.bool_), TRUTH)
        else:
            self.put(agents, found, TEXT if kinds == {str} else OBJECT)

    def forget(self, agents: int) -> None:
        """Hold no value for *agents*."""
        self.written ^= self.written & agents
        self.integer_agents ^= self.integer_agents & agents

    def _begin(self, agents: int, values: Any, form: Form, whole: int) -> None:
        """Make room for the first values, or for those that replace all."""
        if form is ROWS:
            if self.values is None or self.form is not ROWS:
                self.values = np.zeros((self.crowd.count, *np.shape(values)[1:]))
        else:
            if form is NUMBER:
                reals = isinstance(self.kind, RealType) or whole & agents != agents
                dtype: Any = np.dtype(np.float64 if reals else np.int64)
            else:
                dtype = np.dtype(np.bool_ if form is TRUTH else object)
            if self.values is None or self.values.dtype != dtype or self.values.ndim > 1:
                self.values = np.zeros(self.crowd.count, dtype)
                if dtype.kind == "O":
                    self.values[...] = None
        self.form = form
        self.integer_agents = 0

    def _as_objects(self) -> None:
        """Hold Python's own objects from now on, since numbers alone don't tell them any more."""
        assert self.values is not None
        if self.values.dtype != object:
            self.values = to_objects(
                self.values, self.form, self.crowd, self.written, self.integers_among(-1)
            )
        self.form = OBJECT

    def _reshaped(self, values: Any) -> Values:
        self.values = np.zeros((self.crowd.count, *np.shape(values)[1:]))
        return self.values

    def objects(self, agents: int) -> Values:
        """Python's own objects for *agents*, None for those who have no value."""
        found = np.full(self.crowd.count, None, dtype=object)
        agents &= self.written
        if self.values is not None and agents:
            held = to_objects(self.values, self.form, self.crowd, agents, self.integers_among(agents))
            np.copyto(found, held, where=self.crowd.mask(agents))
        return found


def to_objects(values: Any, form: Form, crowd: AgentSets, agents: int, whole: int) -> Values:
    """*values* (one, or one an agent) as an array of Python's objects: those of *agents*."""
    found = np.full(crowd.count, None, dtype=object)
    if np.ndim(values) == 0:
        one = values.item() if isinstance(values, np.generic) else values
        if form is NUMBER:
            found[...] = float(one)
            if whole & agents:
                np.copyto(found, int(one), where=crowd.mask(whole & agents))
        else:
            found[...] = bool(one) if form is TRUTH else one
        return found
    if form is ROWS:
        for at in crowd.indices(agents):
            found[at] = values[at]
        return found
    if form is not NUMBER:
        found[...] = values.tolist()
        return found
    if values.dtype == np.float64:
        found[...] = values.tolist()
        for at in crowd.indices(whole & agents & crowd.all_agents):
            found[at] = int(found[at])
        return found
    found[...] = values.tolist()
    return found


def fits_exactly(values: Values) -> bool:
    """Whether every integer of *values* is a double exactly."""
    return bool((np.abs(values) <= MAX_EXACT).all())
