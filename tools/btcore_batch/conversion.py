"""Conversion of values between leaves, user code and columns: the rules of `ValueType` on arrays.

Values for which arrays are not exact enough are converted agent by agent, by the ordinary engine's code.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from btcore.errors import BlackboardError, BtcoreError, ConversionError
from btcore.values import FLOAT, INT64, STRING, UINT64, ValueType
from btcore.values.types import MAX_EXACT, BoolType, IntegerType, RealType
from btcore_batch.agent_sets import AgentSet, AgentSets
from btcore_batch.columns import (
    NUMBER,
    OBJECT,
    ROWS,
    TEXT,
    TRUTH,
    BatchValue,
    Column,
    Form,
    Slot,
    Values,
    all_within,
    dtype_of,
    infer_type,
    to_objects,
)

FailureCallback = Callable[[AgentSet, BtcoreError], None]
"""A function that is called with the set of the agents whose value was rejected, and the error."""


def array_of(value: Any) -> Values:
    """Return *value* as an array; a single value for all agents becomes an array of shape ().

    Raises:
        ConversionError: *value* cannot be an array, for example because its rows differ in length.
    """
    try:
        return np.asarray(value)
    except ValueError as error:
        raise ConversionError(f"expected an array, or a single value for all agents: {error}") from None


def normalise_values(value: Any, agent_sets: AgentSets) -> BatchValue:
    """Return *value*, from a leaf or from user code, as a `BatchValue` of the fitting form.

    Args:
        value: An array with a value for each agent, or a single value for all agents.
        agent_sets: The agents of the batch.

    Raises:
        ConversionError: The length of the array is not the number of agents, or *value* cannot be an array.
    """
    array = array_of(value)
    if array.ndim == 0:
        scalar = value.item() if isinstance(value, (np.generic, np.ndarray)) else value
        if isinstance(scalar, bool):
            return BatchValue(scalar, TRUTH, 0)
        if type(scalar) is float:
            return BatchValue(scalar, NUMBER, 0)
        if type(scalar) is int and abs(scalar) <= MAX_EXACT:
            return BatchValue(scalar, NUMBER, agent_sets.all_agents)
        return BatchValue(scalar, TEXT if isinstance(scalar, str) else OBJECT, 0)
    if array.shape[0] != agent_sets.count:
        raise ConversionError(
            f"expected a value for each of the {agent_sets.count} agents, not an array of shape {array.shape}"
        )
    if array.ndim > 1:
        return BatchValue(array.astype(np.float64), ROWS, 0)
    if array.dtype == np.bool_:
        return BatchValue(array, TRUTH, 0)
    if array.dtype.kind in "iu" and (array.dtype.itemsize <= 4 or all_within(array, -MAX_EXACT, MAX_EXACT)):
        return BatchValue(array.astype(np.int64, copy=False), NUMBER, agent_sets.all_agents)
    if array.dtype.kind == "f":
        return BatchValue(array.astype(np.float64, copy=False), NUMBER, 0)
    # Numbers beyond the exact doubles, texts, and any other objects.
    objects = array.astype(object)
    is_text = all(isinstance(element, str) for element in objects)
    return BatchValue(objects, TEXT if is_text else OBJECT, 0)


def cast(
    value: BatchValue, value_type: ValueType, agent_sets: AgentSets, agents: AgentSet, fail: FailureCallback
) -> tuple[Any, int]:
    """Convert the values of *agents* to the type *value_type*, as `ValueType.cast` does.

    *fail* is called for the agents whose value cannot be converted.

    Returns:
        The converted values (an array, or a single value for all agents), and the agents whose value could
        be converted.
    """
    data, form, integers = value
    if (
        not value_type.strong
        or (value_type is STRING and form is TEXT)
        or (isinstance(value_type, BoolType) and form is TRUTH)
    ):
        return data, agents
    if form is NUMBER or form is TRUTH:
        array = np.asarray(data)
        if isinstance(value_type, RealType):
            reals = array.astype(np.float64, copy=False)
            if value_type is FLOAT:
                reals = reals.astype(np.float32).astype(np.float64)
            return reals, agents
        if isinstance(value_type, BoolType):
            # An integer must be 0 or 1; a real must not be negative.
            is_invalid = (array < 0.0) | ((array > 1) & agent_sets.mask(integers & agent_sets.all_agents))
            if not np.any(is_invalid):
                return array != 0, agents
        # The range of uint64_t does not fit into int64.
        if isinstance(value_type, IntegerType) and value_type is not UINT64:
            if array.dtype == np.int64 and value_type is INT64:
                return array, agents
            fits = (array >= value_type.low) & (array <= value_type.high)
            if array.dtype == np.float64:
                fits &= np.rint(array) == array
            if fits.all() or not agent_sets.from_mask(~np.broadcast_to(fits, agent_sets.count)) & agents:
                return np.where(fits, array, 0).astype(np.int64), agents
    objects = to_objects(value, agent_sets, agents)
    result = np.zeros(agent_sets.count, dtype_of(value_type))
    for index in agent_sets.indices(agents):
        try:
            single = objects[index]
            if isinstance(single, str) and value_type is not STRING:
                single = value_type.from_text(single)
            result[index] = value_type.cast(single)
        except ConversionError as error:
            fail(1 << int(index), error)
            agents ^= 1 << int(index)
    return result, agents


def read_column(column: Column, value_type: ValueType, agents: AgentSet, fail: FailureCallback) -> Values:
    """Return the values of *column* for a leaf's port of the type *value_type*; all *agents* need a value."""
    values = column.readonly_view()
    if column.form is NUMBER and values.dtype == dtype_of(value_type) and value_type is not FLOAT:
        if not isinstance(value_type, IntegerType) or column.declared is value_type or value_type is INT64:
            return values
    elif not value_type.strong and column.form is not NUMBER:
        return values
    value = BatchValue(values, column.form, column.integers_among(agents))
    array: Values = cast(value, value_type, column.agent_sets, agents, fail)[0]
    return array


def store(slot: Slot, agents: AgentSet, value: BatchValue, fail: FailureCallback, infer: bool = True) -> None:
    """Write values as `Blackboard.set` does: the first values determine the type of an untyped entry.

    Args:
        slot: The key, in the scope of the node that writes.
        agents: The agents whose values are written.
        fail: Called with the agents whose value does not fit the entry's type, and the error.
        infer: Whether the values determine the type of an untyped entry that is stored in the scope itself.

    Raises:
        BlackboardError: The entry cannot be created.
    """
    if not agents:
        return
    column, is_local = slot.column_for_write()
    entry = column.entry
    agent_sets = column.agent_sets
    data, form, _ = value
    if not is_local:
        # An entry that is reached by a remapping accepts texts and values of its type, and converts nothing.
        if not column.exists and not isinstance(data, str):
            entry.declared = infer_type(data)
            entry.inferred = True
        elif form is not TEXT and entry.declared.strong and not _is_of(entry.declared, value, agents):
            agents = _reject_other_types(column, to_objects(value, agent_sets, agents), agents, fail)
    elif not entry.declared.strong:
        if infer and (not isinstance(data, str) or column.exists & agents):
            entry.declared = infer_type(data)
            entry.inferred = True
    elif not _accepts(entry.declared, form):
        objects = to_objects(value, agent_sets, agents)
        column.put_objects(_adapt(objects, entry.declared, agent_sets, agents, fail), objects)
        return
    elif form is NUMBER or form is TRUTH:
        data, agents = cast(value, entry.declared, agent_sets, agents, fail)
        value = normalise_values(data, agent_sets)
    column.put(agents, *value)


def _is_of(value_type: ValueType, value: BatchValue, agents: AgentSet) -> bool:
    """Return whether all values are certainly of *value_type*, without a check of each value."""
    data, form, integers = value
    if form is NUMBER and isinstance(value_type, RealType):
        return not integers & agents
    if form is NUMBER and isinstance(value_type, IntegerType) and integers & agents == agents:
        return value_type is INT64 or bool(np.min(data) >= value_type.low and np.max(data) <= value_type.high)
    return (form is TRUTH and isinstance(value_type, BoolType)) or (
        form is ROWS and value_type.python_type is np.ndarray
    )


def _reject_other_types(column: Column, objects: Values, agents: AgentSet, fail: FailureCallback) -> AgentSet:
    """Return those of *agents* whose value is of the column's type; call *fail* for the others."""
    declared = column.declared
    for index in column.agent_sets.indices(agents):
        if not declared.accepts(objects[index]):
            message = f"the entry '{column.name}' has the type {declared.name}, which cannot change"
            fail(1 << int(index), BlackboardError(message))
            agents ^= 1 << int(index)
    return agents


def _accepts(entry_type: ValueType, form: Form) -> bool:
    """Return whether an entry of *entry_type* takes values of *form* without a check of each value."""
    if form is ROWS:
        return entry_type.python_type is np.ndarray
    if form is NUMBER:
        return isinstance(entry_type, (RealType, IntegerType)) and entry_type is not UINT64
    if form is TRUTH:
        return isinstance(entry_type, (RealType, IntegerType, BoolType)) and entry_type is not UINT64
    return form is TEXT and entry_type is STRING


def _adapt(
    objects: Values, entry_type: ValueType, agent_sets: AgentSets, agents: AgentSet, fail: FailureCallback
) -> int:
    """Convert *objects* in place to values of an entry of *entry_type*. Return the agents without error."""
    for index in agent_sets.indices(agents):
        value = objects[index]
        try:
            if not entry_type.accepts(value):
                is_text = isinstance(value, str) and entry_type.converts
                objects[index] = entry_type.from_text(value) if is_text else entry_type.adapt(value)
        except ConversionError as error:
            fail(1 << int(index), error)
            agents ^= 1 << int(index)
    return agents
