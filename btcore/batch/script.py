"""Scripts for all agents at once: the parsed script of :mod:`btcore.script`, evaluated on columns.

A value is an array with one number an agent, or one value for all. Of numbers a set tells which count as
integers: arithmetic gives reals, literals, copies and entries may be integers, and which it is matters to
``&&``, to conditions and to new entries. Where texts and other objects take part, the
ordinary engine's operators are asked agent by agent.
"""

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from btcore.batch.column import NUMBER, OBJECT, TEXT, TRUTH, Column, Form, Values, to_objects
from btcore.batch.column_table import ColumnTable, Slot
from btcore.batch.context import BatchContext, Located
from btcore.blackboard.blackboard import Blackboard
from btcore.errors import BtcoreError, ConversionError, ScriptError
from btcore.script.program import condition_result as truth_of_one


class ScriptValue(NamedTuple):
    """What a part of a script is worth: an array or one value for all, its form, and whose are integers."""

    data: Any
    form: Form
    integer_agents: int


NO_VALUE: Final = ScriptValue(0.0, NUMBER, 0)
"""What is computed for nobody."""


class ScriptRun:
    """One evaluation: for whom it goes on. Agents for whom it fails leave it, and the tick."""

    __slots__ = ("context", "doing", "failed", "node")

    def __init__(self, context: BatchContext, node: Located, doing: str) -> None:
        self.context = context
        self.node = node
        self.doing = doing
        self.failed = 0

    def fail(self, agents: int, fault: BtcoreError) -> None:
        """Let *agents* go, for whom *fault* was raised."""
        self.failed |= agents
        self.context.fail(self.node, agents, fault, self.doing)

    def drop_failed(self, agents: int) -> int:
        """Those of *agents* who are still there."""
        return agents ^ (agents & self.failed) if self.failed else agents


class BatchExpression:
    """A part of a script."""

    __slots__ = ()

    def evaluate(self, run: ScriptRun, agents: int) -> ScriptValue:
        """The value for *agents*; those who fail are lost to *run*."""
        raise NotImplementedError


class BatchProgram:
    """A script that was compiled for a batch. *text* is what it was compiled from.

    One that *computes* may divide by zero, which is no mistake there, or leave the doubles.
    """

    def __init__(
        self,
        text: str,
        statements: list[BatchExpression],
        computes: bool,
        node: Located,
        context: BatchContext,
    ) -> None:
        self.text = text
        self.has_arithmetic = computes
        self.node = node
        self.context = context
        self._statements = statements

    def run(self, agents: int, doing: str = "ticking") -> int:
        """Evaluate every statement for *agents*; those for whom none of them failed."""
        if not self.has_arithmetic:
            return self._run(agents, doing)
        with np.errstate(all="ignore"):
            return self._run(agents, doing)

    def split(self, agents: int) -> tuple[int, int]:
        """For whom of *agents* the last statement is true, and for whom it is false."""
        if not self.has_arithmetic:
            return self._split(agents)
        with np.errstate(all="ignore"):
            return self._split(agents)

    def _run(self, agents: int, doing: str) -> int:
        run = ScriptRun(self.context, self.node, doing)
        for statement in self._statements:
            agents = run.drop_failed(agents)
            if not agents:
                break
            statement.evaluate(run, agents)
        return run.drop_failed(agents)

    def _split(self, agents: int) -> tuple[int, int]:
        run = ScriptRun(self.context, self.node, "ticking")
        value = NO_VALUE
        for statement in self._statements:
            agents = run.drop_failed(agents)
            if not agents:
                return 0, 0
            value = statement.evaluate(run, agents)
        agents = run.drop_failed(agents)
        true = select_true(run, value, agents)
        if run.failed:
            true, agents = run.drop_failed(true), run.drop_failed(agents)
        return true, agents ^ true


class Scope(NamedTuple):
    """Where the names of a script lead, and which stand for numbers.

    With *copies* the values of entries are copied, since the same statement may change them.
    """

    schema: ColumnTable
    board: Blackboard
    enums: Mapping[str, int]
    copies: bool = False

    def slot(self, key: str) -> Slot:
        """The slot of *key*."""
        return Slot(self.schema, self.board, key)


def column_value(column: Column, agents: int, copies: bool) -> ScriptValue:
    """What *column* holds for *agents*; *copies* as in :class:`Scope`."""
    if not agents:
        return NO_VALUE
    if column.values is None or column.written & agents != agents:
        return ScriptValue(column.objects(agents), OBJECT, 0)
    values = column.values.copy() if copies else column.values
    return ScriptValue(values, column.form, column.integers_among(agents))


def select_true(run: ScriptRun, value: ScriptValue, agents: int) -> int:
    """Those of *agents* for whom *value*, a condition's result, is true; who has none is lost."""
    data, form, whole = value
    crowd = run.context.agent_sets
    if form is NUMBER or form is TRUTH:
        if not isinstance(data, np.ndarray):
            if data == 0 or data == 1 or (data > 0 and not whole & agents):
                return agents if data else 0
        elif data.dtype == np.bool_:
            return crowd.from_mask(data) & agents
        else:
            bad = crowd.from_mask(data < 0) & agents
            if whole & agents:
                bad |= crowd.from_mask(data > 1) & whole & agents
            if not bad:
                return crowd.from_mask(data != 0) & agents
    found = 0
    held = to_objects(data, form, crowd, agents, whole)
    for at in crowd.indices(agents):
        try:
            found |= truth_of_one(held[at]) << int(at)
        except ScriptError as fault:
            run.fail(1 << int(at), fault)
    return found


def to_doubles(value: ScriptValue) -> Any:
    """The numbers of *value* as doubles: an array or a float."""
    data = value.data
    if isinstance(data, np.ndarray):
        return data if data.dtype == np.float64 else data.astype(np.float64)
    return float(data)


def is_number(value: ScriptValue) -> bool:
    """Whether arithmetic on arrays is possible."""
    return value.form is NUMBER or value.form is TRUTH


def apply_each(
    run: ScriptRun, agents: int, function: Any, values: tuple[ScriptValue, ...], located: Any
) -> tuple[Values, int]:
    """``function(value, …)`` for each of *agents*: an array of objects, and for whom it didn't fail.

    *located* makes a ScriptError of a ConversionError.
    """
    crowd = run.context.agent_sets
    held = [to_objects(value.data, value.form, crowd, agents, value.integer_agents) for value in values]
    found = np.full(crowd.count, None, dtype=object)
    for at in crowd.indices(agents):
        try:
            found[at] = function(*(one[at] for one in held))
        except ConversionError as fault:
            run.fail(1 << int(at), located(str(fault)))
    return found, run.drop_failed(agents)


def value_from_objects(run: ScriptRun, found: Values, agents: int) -> ScriptValue:
    """An array of Python's objects as a value, of the simplest form that *agents* allow."""
    crowd = run.context.agent_sets
    held = found[crowd.mask(agents)]
    kinds = {type(one) for one in held}
    if kinds <= {float}:
        data = np.zeros(crowd.count)
        data[crowd.mask(agents)] = held
        return ScriptValue(data, NUMBER, 0)
    return ScriptValue(found, TEXT if kinds == {str} else OBJECT, 0)
