"""The ports of a batch's nodes, which read and write columns."""

from typing import Any

import numpy as np

from btcore.blackboard.ports import UNSET, Port
from btcore.errors import BlackboardError, BtcoreError, ConversionError, NodeError
from btcore.values import ANY, DOUBLE
from btcore_batch.agent_sets import AgentSet
from btcore_batch.columns import NUMBER, Slot, Values, dtype_of
from btcore_batch.conversion import FailureCallback, cast, normalise_values, read_column, store
from btcore_batch.node import BatchNode


class BatchInput:
    """An input port of one node, bound to a literal or to a key.

    Args:
        name: The name of the port.
        port: The declaration of the port; None for the declaration of the ordinary node.

    Attributes:
        literal: The value for all agents, if `is_literal`.
        agents: The agents whose values `current` returns.
    """

    def __init__(self, node: BatchNode, name: str, port: Port | None = None) -> None:
        self.node = node
        self.context = node.context
        self.name = name
        self.error: BtcoreError | None = None
        self.slot: Slot | None = None
        self.agents = 0
        self.literal: Any = None
        self._constant: Values | None = None
        bound = node.config.inputs.get(name)
        declared = port if port is not None or bound is None else bound.port
        self.type = ANY if declared is None else declared.type
        if bound is None:
            self.error = NodeError(f"<{node.id}> has no value for port [{name}]: set it in the tree")
        elif bound.key is not None:
            self.slot = Slot(node.context.columns, node.board, bound.key)
        else:
            try:
                self.literal = bound.read()
            except ConversionError as error:
                self.error = error

    @property
    def is_literal(self) -> bool:
        """Whether all agents always have the same value."""
        return self.slot is None and self.error is None

    def available(self, agents: AgentSet, fail: FailureCallback | None = None) -> AgentSet:
        """Return those of *agents* that have a value; call *fail* for the others, or record an error."""
        fail = fail or self._record
        if self.error is not None:
            fail(agents, self.error)
            return 0
        if self.slot is None:
            return agents
        column = self.slot.column
        written = 0 if column is None else agents & column.written
        if written != agents:
            exists = 0 if column is None else agents & column.exists
            reads = f"port [{self.name}] reads {{{self.slot.key}}}, which"
            if unwritten := exists ^ written:
                fail(unwritten, BlackboardError(f"{reads} has never been written"))
            if absent := agents ^ exists:
                fail(absent, BlackboardError(f"{reads} is not on the blackboard"))
        return written

    def _record(self, agents: AgentSet, error: BtcoreError) -> None:
        self.context.fail(self.node, agents, error)

    def read(self, agents: AgentSet, fail: FailureCallback | None = None) -> Values:
        """Return the values of *agents*, which all have a value, in a read-only array of shape (agents,).

        For agents whose value cannot be converted, *fail* is called. By default an error is recorded:
        use `drop_failed` afterwards.
        """
        if self.slot is None:
            if self._constant is None:
                single = np.empty((), dtype_of(self.type))
                single.fill(self.literal)  # unlike assignment, fill() does not unpack a list
                self._constant = np.broadcast_to(single, self.context.agent_sets.count)
            return self._constant
        column = self.slot.column
        assert column is not None
        if self.type is DOUBLE and column.form is NUMBER:
            values = column.readonly_view()
            if values.dtype == np.float64:
                return values
        key = self.slot.key

        def fail_to_convert(agents: AgentSet, error: BtcoreError) -> None:
            message = f"port [{self.name}] reads {{{key}}} as {self.type.name}: {error}"
            (fail or self._record)(agents, ConversionError(message))

        return read_column(column, self.type, agents, fail_to_convert)

    def current(self) -> Values:
        """Return the values of the agents that are being ticked; record an error for agents without value."""
        agents = self.available(self.agents)
        if agents:
            return self.read(agents)
        return np.zeros(self.context.agent_sets.count, dtype_of(self.type))

    def groups(self, agents: AgentSet, default: Any = UNSET) -> list[tuple[Any, AgentSet]]:
        """Return the distinct values, each with its agents.

        Agents without a value have *default*; without a default, an error is recorded for them.
        """
        if self.is_literal:
            return [(self.literal, agents)]
        groups: list[tuple[Any, AgentSet]] = []
        without_value: AgentSet = 0

        def fail(agents: AgentSet, error: BtcoreError) -> None:
            nonlocal without_value
            without_value |= agents
            if default is UNSET:
                self._record(agents, error)

        if available := self.available(agents, fail):
            values = self.read(available, fail)
            groups = self._distinct(values, available ^ (available & without_value))
        return groups if default is UNSET or not without_value else [*groups, (default, without_value)]

    def _distinct(self, values: Values, agents: AgentSet) -> list[tuple[Any, AgentSet]]:
        if not agents:
            return []
        agent_sets = self.context.agent_sets
        selected = values[agent_sets.mask(agents)]
        if values.dtype == object:
            # np.unique() sorts, but objects of different types cannot be compared.
            distinct: list[Any] = list(dict.fromkeys(selected.tolist()))
        else:
            distinct = np.unique(selected).tolist()
        if len(distinct) == 1:
            return [(distinct[0], agents)]
        return [
            (value, agent_sets.from_mask(np.equal(values, value).astype(np.bool_)) & agents)
            for value in distinct
        ]


class BatchOutput:
    """An output port of one node. The attribute *agents* is the set of the agents to write for."""

    def __init__(self, node: BatchNode, name: str) -> None:
        self.node = node
        self.context = node.context
        self.name = name
        self.agents = 0
        self._shape = (node.context.agent_sets.count,)
        bound = node.config.outputs.get(name)
        self.type = None if bound is None else bound.type
        self.slot: Slot | None = None
        if bound is not None and bound.key is not None:
            self.slot = Slot(node.context.columns, node.board, bound.key)
        self.text = "" if bound is None else bound.text

    def __call__(self, values: Any) -> None:
        """Write an array of shape (agents,), or a single value, for the agents that are being ticked.

        Raises:
            NodeError: The tree does not give the port.
            BlackboardError: The port is not bound to a key.
            ConversionError: *values* is an array of another length.
        """
        if self.type is None:
            raise NodeError(f"<{self.node.id}> has no entry for port [{self.name}]: set it in the tree")
        if self.slot is None:
            raise BlackboardError(
                f"port [{self.name}] is an output, but '{self.text}' is not a blackboard entry: "
                "write the key in braces, {like_this}"
            )
        agents = self.agents
        if self.type is DOUBLE and self._put_doubles(self.slot, agents, values):
            return
        agent_sets = self.context.agent_sets
        value = normalise_values(values, agent_sets)
        if self.type.strong:
            data, agents = cast(value, self.type, agent_sets, agents, self._fail)
            value = normalise_values(data, agent_sets)
        agents ^= agents & self.context.raised
        store(self.slot, agents, value, self._fail, self.type.strong)

    def _put_doubles(self, slot: Slot, agents: AgentSet, values: Any) -> bool:
        """Write *values* without conversion, if they are doubles for a DOUBLE entry. Return False if not."""
        if type(values) is not np.ndarray or values.shape != self._shape or values.dtype != np.float64:
            return False
        column, _ = slot.column_for_write()
        if column.entry.declared is not DOUBLE:
            return False
        column.put(agents, values, NUMBER)
        return True

    def _fail(self, agents: AgentSet, error: BtcoreError) -> None:
        message = f"port [{self.name}] takes {self.type.name if self.type else '?'}: {error}"
        self.context.fail(self.node, agents, ConversionError(message))
