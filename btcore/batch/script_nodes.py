"""Scripts, conditions on them, and SetBlackboard, for a batch; and the leaves whose result is fixed."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from btcore.batch.column import OBJECT
from btcore.batch.column_table import ColumnTable, Slot
from btcore.batch.context import BatchContext
from btcore.batch.conversion import normalise_values
from btcore.batch.node import BatchDecorator, BatchNode, Results
from btcore.batch.ports import BatchInput, store
from btcore.batch.script import BatchProgram
from btcore.blackboard.blackboard import Blackboard
from btcore.engine.node import TreeNode
from btcore.errors import BlackboardError, BtcoreError, ConversionError, NodeError
from btcore.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS


class AlwaysSuccess(BatchNode):
    """Succeeds."""

    def tick(self, agents: int) -> Results:
        """SUCCESS."""
        return agents, 0, 0, 0


class AlwaysFailure(BatchNode):
    """Fails."""

    def tick(self, agents: int) -> Results:
        """FAILURE."""
        return 0, agents, 0, 0


class SubTree(BatchDecorator):
    """Ticks the root of the inner tree."""

    def tick(self, agents: int) -> Results:
        """Tick the root of the inner tree."""
        idle = agents ^ self.not_idle(agents)
        if idle:
            self.set_running(idle)
        results = self.child.execute(agents)
        completed = results[0] | results[1]
        if completed:
            self.child.reset_by_parent(completed)
        return results


class Script(BatchNode):
    """Runs a script, and succeeds."""

    script_port: ClassVar[str] = "code"
    program: BatchProgram

    def tick(self, agents: int) -> Results:
        """Run the script."""
        return self.program.run(agents), 0, 0, 0


class ScriptCondition(BatchNode):
    """Succeeds if a script is true."""

    script_port: ClassVar[str] = "code"
    program: BatchProgram

    def tick(self, agents: int) -> Results:
        """Ask the script."""
        true, false = self.program.split(agents)
        return true, false, 0, 0


class Precondition(BatchDecorator):
    """Ticks its child if a script is true."""

    input_ports: ClassVar[Mapping[str, str]] = {"else": "otherwise"}
    script_port: ClassVar[str] = "if"
    program: BatchProgram
    otherwise: BatchInput

    def __init__(self, plan: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(plan, context, children)
        self._going = 0

    def tick(self, agents: int) -> Results:
        """Ask the script, then tick the child."""
        found = {SUCCESS: 0, FAILURE: 0, RUNNING: 0, SKIPPED: 0, IDLE: 0}
        groups = self.otherwise.groups(agents)
        agents = self.drop_failed(agents)
        asking = agents ^ (agents & self._going)
        if asking:
            true, refused = self.program.split(asking)
            self._going |= true
            agents ^= asking ^ true
            for status, some in groups:
                found[status] |= some & refused
            if found[IDLE]:
                self.context.fail(
                    self, found[IDLE], NodeError("a tick ends in no IDLE, as its port [else] says")
                )
        if agents:
            success, failure, running, skipped = self.child.execute(agents)
            completed = success | failure
            if completed:
                self._going ^= self._going & completed
                self.child.reset_by_parent(completed)
            found[SUCCESS] |= success
            found[FAILURE] |= failure
            found[RUNNING] |= running
            found[SKIPPED] |= skipped
        return found[SUCCESS], found[FAILURE], found[RUNNING], found[SKIPPED]


class SetBlackboard(BatchNode):
    """Writes a text, or copies an entry."""

    text: str
    source: Slot | None
    target: Slot

    def __init__(self, plan: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(plan, context, children)
        self.source = None

    def connect(
        self, schema: ColumnTable, board: Blackboard, text: str, source: str | None, target: str
    ) -> None:
        """Write to *target* the *text*, or what *source* holds."""
        self.text = text
        self.source = None if source is None else Slot(schema, board, source)
        self.target = Slot(schema, board, target)

    def tick(self, agents: int) -> Results:
        """Write the entry."""
        if self.source is None:
            self._write_text(agents)
            return self.drop_failed(agents), 0, 0, 0
        source = self.source.column
        missing = agents if source is None else agents ^ (agents & source.exists)
        if missing or source is None:
            said = f"port [value] reads {{{self.source.key}}}, which is not on the blackboard"
            self.context.fail(self, missing, BlackboardError(said))
            agents ^= missing
        if source is None or not agents:
            return 0, 0, 0, 0
        try:
            target = self.target.column
            if target is None:
                target = self.target.schema.create(self.target.board, self.target.key, source.kind)
        except BlackboardError as fault:
            self.context.fail(self, agents, fault)
            return 0, 0, 0, 0
        if not target.exists and not target.kind.strong:
            target.entry.declared = source.kind
        target.exists |= agents
        empty = agents ^ (agents & source.written)
        agents ^= empty
        if agents:
            assert source.values is not None
            whole = source.integers_among(agents)
            store(self.target, agents, source.values, source.form, whole, self._fail)
        return self.drop_failed(agents), empty, 0, 0

    def _write_text(self, agents: int) -> None:
        column = self.target.column
        kind = None if column is None else column.kind
        value: Any = self.text
        if kind is not None and kind.strong:
            try:
                value = kind.from_text(self.text)
            except ConversionError as fault:
                self.context.fail(self, agents, fault)
                return
        crowd = self.context.agent_sets
        if isinstance(value, (str, int, float)):
            value, form, whole = normalise_values(value, crowd)
        else:
            form, whole = OBJECT, 0
            held = np.full(crowd.count, None, dtype=object)
            for at in crowd.indices(agents):
                held[at] = value
            value = held
        try:
            store(self.target, agents, value, form, whole, self._fail)
        except BlackboardError as fault:
            self.context.fail(self, agents, fault)

    def _fail(self, agents: int, fault: BtcoreError) -> None:
        self.context.fail(self, agents, BlackboardError(str(fault)))
