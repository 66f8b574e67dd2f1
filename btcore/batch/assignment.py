"""Assignments of a script for a batch: what becomes of the value, and of the entry.

The kind of number that an entry holds stays: an entry with an integer accepts integers only, as in a script.
"""

from typing import Any

import numpy as np

from btcore.batch.column import NUMBER, OBJECT, TEXT, TRUTH, Column, to_objects
from btcore.batch.column_table import Slot
from btcore.batch.script import (
    NO_VALUE,
    BatchExpression,
    ScriptRun,
    ScriptValue,
    apply_each,
    column_value,
    is_number,
    to_doubles,
)
from btcore.blackboard.blackboard import Entry
from btcore.errors import BlackboardError
from btcore.script.expressions import Assignment, Name
from btcore.script.operators import compound_assigned_value
from btcore.values.types import MAX_EXACT


class BatchAssignment(BatchExpression):
    """``name := value``, and ``= += -= *= /=``, which need an entry that exists."""

    __slots__ = ("assignment", "copies", "slot", "value")

    def __init__(
        self, assignment: Assignment, slot: Slot | None, value: BatchExpression, copies: bool
    ) -> None:
        self.assignment = assignment
        self.copies = copies
        self.slot = slot
        self.value = value

    def evaluate(self, run: ScriptRun, agents: int) -> ScriptValue:
        """The value that was stored."""
        sign = self.assignment.operator
        if self.slot is None:
            said = f"only the name of an entry can stand before '{sign}'"
            run.fail(agents, self.assignment.fault(said))
            return NO_VALUE
        column = self._column(self.slot, run, agents)
        agents = run.drop_failed(agents)
        if column is None or not agents:
            return NO_VALUE
        value = self.value.evaluate(run, agents)
        agents = run.drop_failed(agents)
        if not agents:
            return NO_VALUE
        if is_number(value) and (column.values is None or column.form is NUMBER):
            if self._numbers(run, column, value, agents):
                return column_value(column, agents, self.copies)
        elif value.form is TEXT and sign in (":=", "=") and self._text(column, value, agents):
            return column_value(column, agents, self.copies)
        self._one_by_one(run, column, value, agents)
        return column_value(column, run.drop_failed(agents), self.copies)

    def _column(self, slot: Slot, run: ScriptRun, agents: int) -> Column | None:
        """The entry, made by ``:=`` for those who have none."""
        column = slot.column
        missing = agents if column is None else agents ^ (agents & column.exists)
        if not missing:
            return column
        target = self.assignment.target
        assert isinstance(target, Name)
        if self.assignment.operator != ":=":
            said = f"there is no entry '{target.name}' on the blackboard, and "
            said += f"'{self.assignment.operator}' makes none; ':=' makes a new one"
            run.fail(missing, target.fault(said))
            return column
        try:
            column = slot.get_or_create_column()
        except BlackboardError as fault:
            run.fail(missing, target.fault(str(fault)))
            return slot.column
        column.exists |= missing
        return column

    def _numbers(self, run: ScriptRun, column: Column, value: ScriptValue, agents: int) -> bool:
        """Store numbers, if that can be done for all at once."""
        sign = self.assignment.operator
        new = agents ^ (agents & column.written)
        data: Any = value.data
        form, whole = value.form, value.integer_agents & agents
        if sign not in (":=", "="):
            if new or column.values is None:
                return False
            left = to_doubles(ScriptValue(column.values, NUMBER, 0))
            data = _COMPOUND[sign](left, to_doubles(value))
            form, whole = NUMBER, 0
        if form is TRUTH:
            if new != agents:
                return False
            column.put(agents, data, TRUTH)
            return True
        if isinstance(data, np.ndarray) and data.dtype == np.bool_:
            data = data.astype(np.float64)
        known = agents ^ new
        as_whole = column.integers_among(known)
        if as_whole & ~whole:
            # Integers stay integers, where nothing is lost.
            fits = (np.rint(data) == data) & (np.abs(data) <= MAX_EXACT)
            if isinstance(fits, np.ndarray):
                if as_whole & ~whole & ~run.context.agent_sets.from_mask(fits):
                    return False
            elif not fits:
                return False
        column.put(agents, data, NUMBER, as_whole | whole & new)
        return True

    def _text(self, column: Column, value: ScriptValue, agents: int) -> bool:
        """Store texts, if nothing else is there."""
        kind = column.kind
        known = column.written & agents
        if known and column.form is not TEXT:
            return False
        if known != agents and kind.strong and kind.converts and kind.name != "std::string":
            return False
        if column.values is not None and column.form is not TEXT:
            return False
        column.put(agents, value.data, TEXT)
        return True

    def _one_by_one(self, run: ScriptRun, column: Column, value: ScriptValue, agents: int) -> None:
        """Store what the ordinary engine makes of each agent's value."""
        crowd = run.context.agent_sets
        assignment, target = self.assignment, self.assignment.target
        assert isinstance(target, Name)
        held = to_objects(value.data, value.form, crowd, agents, value.integer_agents)
        nothing = crowd.from_mask(np.array([one is None for one in held])) & agents
        if nothing:
            run.fail(nothing, assignment.fault(f"what stands after '{assignment.operator}' has no value"))
            agents = run.drop_failed(agents)
        entry = Entry(column.kind)

        def stored(new: object, old: object) -> object:
            if assignment.operator not in (":=", "="):
                return compound_assigned_value(assignment.operator, old, new, entry.declared)
            entry.value = old
            return assignment._assigned(entry, new)

        old = ScriptValue(column.objects(agents), OBJECT, 0)
        found, agents = apply_each(
            run,
            agents,
            stored,
            (value, old),
            lambda said: assignment.fault(f"'{target.name}' can't take the value: {said}"),
        )
        column.put_objects(agents, found)


_COMPOUND = {"+=": np.add, "-=": np.subtract, "*=": np.multiply, "/=": np.divide}
