"""The blackboard of a batch, as user code accesses it: the entries of one scope, by key."""

from collections.abc import Iterator
from typing import Any

from btcore.blackboard.blackboard import Blackboard
from btcore.errors import BlackboardError, BtcoreError, ConversionError
from btcore_batch.agent_sets import Mask
from btcore_batch.columns import ColumnTable, Slot, Values
from btcore_batch.conversion import normalise_values, store


class BatchBlackboard:
    """The entries of one scope (a subtree's blackboard); an entry is an array with the values of all agents.

    `board["battery"]` returns the stored array, not a copy, so that modifying the array modifies the entry.
    Its shape is (agents,), and its dtype float64, int64, bool, or object for texts and other values. An array
    of shape (agents, …), with several numbers for each agent, is float64. `board["battery"] = …` accepts
    an array of any of these types, or a single value for all agents.

    Attributes:
        columns: The arrays of all entries of the batch.
        scope: The blackboard of the ordinary tree that this blackboard replaces.
    """

    def __init__(self, columns: ColumnTable, scope: Blackboard) -> None:
        self.columns = columns
        self.scope = scope

    def __getitem__(self, key: str) -> Values:
        column = self.columns.column(self.scope, key)
        if column is None or column.values is None:
            problem = "was never written" if column is not None else f"does not exist{self.scope.hint(key)}"
            raise BlackboardError(f"the blackboard entry '{key}' {problem}")
        return column.shared_array()

    def __setitem__(self, key: str, values: Any) -> None:
        self.set(key, values)

    def set(self, key: str, values: Any, mask: Mask | None = None) -> None:
        """Write values.

        Args:
            key: The key.
            values: An array of shape (agents,) or (agents, …), or a single value for all agents.
            mask: The agents whose values are written; None = all agents.

        Raises:
            BlackboardError: The values do not fit the type of the entry, or the array has another shape.
            BtcoreError: *mask* is not an array of bools of shape (agents,).
        """
        self._set(key, values, mask, True)

    def initialise(self, key: str, values: Any) -> None:
        """Write the initial values of an entry for all agents, without determining its type.

        Loading the ordinary tree has determined the types already.

        Args:
            key: The key.
            values: An array of shape (agents,) or (agents, …), or a single value for all agents.

        Raises:
            BlackboardError: The values do not fit the type of the entry, or the array has another shape.
        """
        self._set(key, values, None, False)

    def _set(self, key: str, values: Any, mask: Mask | None, infer: bool) -> None:
        agent_sets = self.columns.agent_sets
        agents = agent_sets.from_user_mask(mask)
        errors: list[BtcoreError] = []
        try:
            value = normalise_values(values, agent_sets)
            slot = Slot(self.columns, self.scope, key)
            store(slot, agents, value, lambda _, error: errors.append(error), infer)
        except ConversionError as error:
            errors.append(error)
        # At this point the values of the agents without an error have been written.
        if errors:
            raise BlackboardError(f"cannot write the blackboard entry '{key}': {errors[0]}") from errors[0]

    def has(self, key: str) -> Mask:
        """Return the mask of the agents that have a value for *key*."""
        column = self.columns.column(self.scope, key)
        return self.columns.agent_sets.mask(0 if column is None else column.written)

    def __contains__(self, key: object) -> bool:
        return isinstance(key, str) and bool(self.has(key).any())

    def __iter__(self) -> Iterator[str]:
        return iter([key for key in self.scope.local_entries() if key in self])
