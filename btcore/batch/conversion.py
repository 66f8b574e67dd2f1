"""Values of one type as another, for all agents at once: ``ValueType.cast`` on arrays.

What arrays can't tell exactly is left to the ordinary engine's conversion, agent by agent.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from btcore.batch.agent_sets import AgentSets
from btcore.batch.column import (
    NUMBER,
    OBJECT,
    ROWS,
    TEXT,
    TRUTH,
    Column,
    Form,
    Values,
    dtype_of,
    fits_exactly,
    to_objects,
)
from btcore.errors import BtcoreError, ConversionError
from btcore.values.types import (
    FLOAT,
    INT64,
    MAX_EXACT,
    STRING,
    UINT64,
    BoolType,
    IntegerType,
    RealType,
    ValueType,
)

FailureCallback = Callable[[int, BtcoreError], None]
"""Notes that a fault has befallen these agents."""


def cast(
    values: Any, form: Form, whole: int, kind: ValueType, crowd: AgentSets, agents: int, fail: FailureCallback
) -> Any:
    """*values* (an array, or one value for all) of *agents* as *kind* has them.

    Agents whose value doesn't fit go to *fail*. The result is an array of the kind's dtype, or one value.
    """
    if not kind.strong:
        return values
    if isinstance(kind, RealType) and form in (NUMBER, TRUTH):
        reals = np.asarray(values, dtype=np.float64)
        return reals.astype(np.float32).astype(np.float64) if kind is FLOAT else reals
    if isinstance(kind, BoolType) and form is TRUTH:
        return values
    if isinstance(kind, BoolType) and form is NUMBER:
        array = np.asarray(values)
        bad = (array < 0.0) | ((array > 1) & crowd.mask(whole & crowd.all_agents))
        if not np.any(bad):
            return array != 0
    if isinstance(kind, IntegerType) and kind is not UINT64 and form in (NUMBER, TRUTH):
        array = np.asarray(values)
        if array.dtype == np.int64 and kind is INT64:
            return array
        fits = (array >= kind.low) & (array <= kind.high)
        if array.dtype == np.float64:
            fits &= np.rint(array) == array
        if fits.all() or not crowd.from_mask(~np.broadcast_to(fits, crowd.count)) & agents:
            return np.where(fits, array, 0).astype(np.int64)
    if kind is STRING and form is TEXT:
        return values
    return cast_each(values, form, whole, kind, crowd, agents, fail)


def cast_each(
    values: Any, form: Form, whole: int, kind: ValueType, crowd: AgentSets, agents: int, fail: FailureCallback
) -> Values:
    """:func:`cast` agent by agent, by the ordinary engine's conversion."""
    held = to_objects(values, form, crowd, agents, whole)
    found = np.zeros(crowd.count, dtype_of(kind))
    for at in crowd.indices(agents):
        try:
            one = held[at]
            if isinstance(one, str) and kind is not STRING:
                one = kind.from_text(one)
            found[at] = kind.cast(one)
        except ConversionError as fault:
            fail(1 << int(at), fault)
    return found


def array_of(value: Any) -> Values:
    """*value* as an array; one of no dimension is one value for all. Raises ConversionError."""
    try:
        return np.asarray(value)
    except ValueError as fault:
        raise ConversionError(f"an array is wanted, or one value for all: {fault}") from None


def normalise_values(value: Any, crowd: AgentSets) -> tuple[Any, Form, int]:
    """What a leaf or a user gives: the values, their form, and whose are whole.

    One value for all, or an array with one an agent. Raises ConversionError for anything else.
    """
    array = array_of(value)
    if array.ndim == 0:
        one = value.item() if isinstance(value, (np.generic, np.ndarray)) else value
        if isinstance(one, bool):
            return one, TRUTH, 0
        if isinstance(one, (int, float)) and type(one) in (int, float):
            if isinstance(one, int) and abs(one) > MAX_EXACT:
                return one, OBJECT, 0
            return one, NUMBER, crowd.all_agents if isinstance(one, int) else 0
        return one, TEXT if isinstance(one, str) else OBJECT, 0
    if array.shape[0] != crowd.count:
        raise ConversionError(
            f"one value for each of the {crowd.count} agents is wanted, not an array of shape {array.shape}"
        )
    if array.ndim > 1:
        return array.astype(np.float64), ROWS, 0
    if array.dtype == np.bool_:
        return array, TRUTH, 0
    if array.dtype.kind in "iu":
        if array.dtype.itemsize > 4 and not fits_exactly(array):
            return np.array([*array.tolist(), None], dtype=object)[:-1], OBJECT, 0
        return array.astype(np.int64, copy=False), NUMBER, crowd.all_agents
    if array.dtype.kind == "f":
        return array.astype(np.float64, copy=False), NUMBER, 0
    array = np.array([*array.tolist(), None], dtype=object)[:-1]
    return array, TEXT if all(isinstance(one, str) for one in array) else OBJECT, 0


def read_column(column: Column, kind: ValueType, agents: int, fail: FailureCallback) -> Values:
    """What a leaf sees of *column* through a port of *kind*; *agents* all have a value."""
    values = column.readonly_view()
    if column.form is NUMBER and values.dtype == dtype_of(kind) and kind is not FLOAT:
        if not isinstance(kind, IntegerType) or column.kind is kind or kind is INT64:
            return values
    elif not kind.strong and column.form is not NUMBER:
        return values
    whole = column.integers_among(agents)
    array: Values = cast(values, column.form, whole, kind, column.crowd, agents, fail)
    return array
