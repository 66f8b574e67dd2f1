"""Script, ScriptCondition, Precondition, SetBlackboard, AlwaysSuccess and AlwaysFailure of a batch."""

from typing import Any

import numpy as np

from btcore.blackboard.ports import braced_key
from btcore.engine.node import TreeNode
from btcore.errors import BlackboardError, BtcoreError, ConversionError, NodeError
from btcore.nodes.blackboard_actions import copy_error
from btcore.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS
from btcore.values import DOUBLE, IntegerType, ValueType
from btcore_batch.agent_sets import AgentSet
from btcore_batch.columns import NUMBER, OBJECT, TEXT, BatchValue, Column, Slot
from btcore_batch.context import BatchContext
from btcore_batch.conversion import cast, normalise_values, store
from btcore_batch.node import BatchDecorator, BatchNode, Results, unsupported
from btcore_batch.ports import BatchInput
from btcore_batch.script import BatchProgram


class AlwaysSuccess(BatchNode):
    """Succeeds."""

    def tick(self, agents: AgentSet) -> Results:
        """Return SUCCESS."""
        return agents, 0, 0, 0


class AlwaysFailure(BatchNode):
    """Fails."""

    def tick(self, agents: AgentSet) -> Results:
        """Return FAILURE."""
        return 0, agents, 0, 0


def compile_port(node: BatchNode, port: str) -> BatchProgram:
    """Compile the script in *port*.

    Raises:
        TreeError: The port is empty, or bound to a blackboard entry instead of a literal.
    """
    bound = node.config.inputs[port]
    if bound.key is not None:
        message = f"the script of <{node.id}> is on the blackboard, where each agent may have another script"
        raise unsupported(node.config, message, f'write the script itself: {port}="…"')
    if not bound.text:
        raise unsupported(node.config, f"the script of <{node.id}> is empty", f'write a script: {port}="…"')
    return BatchProgram(str(bound.read()), node)


class Script(BatchNode):
    """Runs a script, and succeeds."""

    def __init__(self, node: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(node, context, children)
        self.program = compile_port(self, "code")

    def tick(self, agents: AgentSet) -> Results:
        """Run the script."""
        return self.program.run(agents), 0, 0, 0


class ScriptCondition(Script):
    """Succeeds if the value of a script is true."""

    def tick(self, agents: AgentSet) -> Results:
        """Evaluate the script."""
        true, false = self.program.split(agents)
        return true, false, 0, 0


class Precondition(BatchDecorator):
    """Ticks its child if the value of a script is true, else returns the status in the port `else`."""

    def __init__(self, node: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(node, context, children)
        self.program = compile_port(self, "if")
        self.otherwise = BatchInput(self, "else")
        # The agents for which the script was true and the child has not completed since.
        self._going = 0

    def tick(self, agents: AgentSet) -> Results:
        """Evaluate the script, then tick the child."""
        results = {SUCCESS: 0, FAILURE: 0, RUNNING: 0, SKIPPED: 0, IDLE: 0}
        groups = self.otherwise.groups(agents)
        agents = self.drop_failed(agents)
        undecided = agents ^ (agents & self._going)
        if undecided:
            true, false = self.program.split(undecided)
            self._going |= true
            agents ^= undecided ^ true
            for status, group in groups:
                results[status] |= group & false
            if results[IDLE]:
                error = NodeError("the port [else] contains IDLE, which is not a result")
                self.context.fail(self, results[IDLE], error)
        success, failure, running, skipped = (
            results[SUCCESS],
            results[FAILURE],
            results[RUNNING],
            results[SKIPPED],
        )
        if not agents:
            return success, failure, running, skipped
        succeeded, failed, runs, skips = self.child.execute(agents)
        completed = succeeded | failed
        if completed:
            self._going ^= self._going & completed
            self.child.reset_by_parent(completed)
        return success | succeeded, failure | failed, running | runs, skipped | skips


class SetBlackboard(BatchNode):
    """Writes the text in `value` to an entry, or copies another entry to it."""

    def __init__(self, node: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(node, context, children)
        target, value = self.config.inputs.get("output_key"), self.config.inputs.get("value")
        if target is None or target.key is not None or value is None:
            message = '<SetBlackboard> of a batch needs value="…" and the name of an entry in output_key="…"'
            raise unsupported(self.config, message, "write the name itself, without braces")
        self.text = value.text
        source = braced_key(value.text)
        self.source = None if source is None else Slot(context.columns, self.board, source)
        self.target = Slot(context.columns, self.board, str(target.read()))

    def tick(self, agents: AgentSet) -> Results:
        """Write the entry."""
        try:
            if self.source is not None:
                return self._copy_entry(self.source, agents)
            self._write_text(agents)
        except (BlackboardError, ConversionError) as error:
            self.context.fail(self, agents, error)
        return self.drop_failed(agents), 0, 0, 0

    def _copy_entry(self, source_slot: Slot, agents: AgentSet) -> Results:
        source = source_slot.column
        missing = agents if source is None else agents ^ (agents & source.exists)
        if missing:
            message = f"port [value] reads {{{source_slot.key}}}, which is not on the blackboard"
            self.context.fail(self, missing, BlackboardError(message))
            agents ^= missing
        if source is None or not agents:
            return 0, 0, 0, 0
        target = self.target.get_or_create_column(source.declared)
        # An untyped entry that no agent has yet gets the type of the source.
        if not target.exists and not target.declared.strong:
            target.entry.declared = source.declared
            target.entry.value_type = source.entry.value_type
        elif refused := agents & target.exists & source.written:
            clashing = _clashing_type(source, target)
            if clashing is not None:
                self.context.fail(self, refused, copy_error(self.target.key, target.declared, clashing))
                agents ^= refused
        target.exists |= agents
        empty = agents ^ (agents & source.written)
        agents ^= empty
        if agents:
            value = source.value(agents)
            if value.form is TEXT and target.declared.strong:
                # store() would not convert texts for an entry behind a remapping.
                data, agents = cast(value, target.declared, self.context.agent_sets, agents, self._fail)
                value = normalise_values(data, self.context.agent_sets)
            store(self.target, agents, value, self._fail)
        return self.drop_failed(agents), empty, 0, 0

    def _write_text(self, agents: AgentSet) -> None:
        column = self.target.column
        value: Any = self.text
        if column is not None and column.declared.strong:
            value = column.declared.from_text(self.text)
        agent_sets = self.context.agent_sets
        if isinstance(value, (str, int, float)):
            values = normalise_values(value, agent_sets)
        else:
            objects = np.empty(agent_sets.count, dtype=object)
            objects.fill(value)  # unlike assignment, fill() does not unpack a list
            values = BatchValue(objects, OBJECT, 0)
        store(self.target, agents, values, self._fail)

    def _fail(self, agents: AgentSet, error: BtcoreError) -> None:
        self.context.fail(self, agents, BlackboardError(str(error)))


def _clashing_type(source: Column, target: Column) -> ValueType | None:
    """Return the type of the numbers of *source* if they cannot be copied to *target*, else None."""
    number_type = source.entry.value_type or source.declared
    if source.form is not NUMBER or not target.declared.strong:
        return None
    if not number_type.strong:
        if source.integers_among(source.written):
            return None
        number_type = DOUBLE
    if source.entry.value_type is None and source.entry.inferred and isinstance(target.declared, IntegerType):
        return None
    return None if target.declared.same(number_type) else number_type
