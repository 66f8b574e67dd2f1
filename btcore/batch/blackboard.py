"""A scope of a batch's blackboard, as its user sees it: columns by key."""

from collections.abc import Iterator
from typing import Any

from btcore.batch.agent_sets import Mask
from btcore.batch.column import Column, Values
from btcore.batch.column_table import ColumnTable, Slot
from btcore.batch.conversion import normalise_values
from btcore.batch.ports import store
from btcore.blackboard.blackboard import Blackboard
from btcore.errors import BlackboardError, BtcoreError, ConversionError


class BatchBlackboard:
    """The entries of one scope, each an array with one value an agent.

    ``board["battery"]`` is the array itself, of shape (agents,): float64, int64, bool, or object for texts
    and all else; what is written into it is written. An entry of shape (agents, …) is of float64.
    ``board["battery"] = …`` takes such an array, or one value for all.
    """

    def __init__(self, schema: ColumnTable, scope: Blackboard) -> None:
        self.schema = schema
        self.scope = scope

    def __getitem__(self, key: str) -> Values:
        column = self._column(key)
        if column is None or column.values is None:
            what = "was never written" if column is not None else f"is not there{self.scope.hint(key)}"
            raise BlackboardError(f"the entry '{key}' of the blackboard {what}")
        return column.shared_array()

    def __setitem__(self, key: str, values: Any) -> None:
        self.set(key, values)

    def set(self, key: str, values: Any, mask: Mask | None = None) -> None:
        """Write *values* for the agents of *mask* (None: all).

        An array of shape (agents,) or (agents, …), or one value for all of them. Raises BlackboardError
        when the entry has another type, or the array another shape.
        """
        self._set(key, values, mask, True)

    def initialise(self, key: str, values: Any) -> None:
        """Write what *key* holds at the beginning, of the plan's type. Raises as :meth:`set`."""
        self._set(key, values, None, False)

    def _set(self, key: str, values: Any, mask: Mask | None, types: bool) -> None:
        crowd = self.schema.crowd
        agents = crowd.from_user_mask(mask)
        faults: list[BtcoreError] = []
        try:
            data, form, whole = normalise_values(values, crowd)
            slot = Slot(self.schema, self.scope, key)
            store(slot, agents, data, form, whole, lambda _, fault: faults.append(fault), types)
        except ConversionError as fault:
            faults.append(fault)
        if faults:
            raise BlackboardError(f"the entry '{key}' can't take the values: {faults[0]}") from faults[0]

    def has(self, key: str) -> Mask:
        """For whom *key* holds a value."""
        column = self._column(key)
        return self.schema.crowd.mask(0 if column is None else column.written)

    def __contains__(self, key: object) -> bool:
        column = self._column(key) if isinstance(key, str) else None
        return column is not None and column.written != 0

    def __iter__(self) -> Iterator[str]:
        return iter([key for key in self.scope.local_entries() if key in self])

    def _column(self, key: str) -> Column | None:
        return self.schema.column(self.scope, key)
