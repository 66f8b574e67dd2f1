"""Decorators of a batch that change the result of their child, or tick it repeatedly; and SubTree."""

from typing import Any, ClassVar

import numpy as np

from btcore.engine.node import TreeNode
from btcore_batch.agent_sets import AgentSet, Counters
from btcore_batch.context import BatchContext
from btcore_batch.node import BatchDecorator, BatchNode, Results
from btcore_batch.ports import BatchInput


class SubTree(BatchDecorator):
    """Ticks the root of the inner tree."""

    def tick(self, agents: AgentSet) -> Results:
        """Tick the root of the inner tree."""
        idle = agents ^ self.not_idle(agents)
        if idle:
            self.set_running(idle)
        success, failure, running, skipped = self.child.execute(agents)
        if completed := success | failure:
            self.child.reset_by_parent(completed)
        return success, failure, running, skipped


class Inverter(BatchDecorator):
    """Returns FAILURE for SUCCESS, and SUCCESS for FAILURE."""

    def tick(self, agents: AgentSet) -> Results:
        """Tick the child, and exchange SUCCESS and FAILURE."""
        self.set_running(agents)
        success, failure, running, skipped = self.child.execute(agents)
        return failure, success, running, skipped


class ForceSuccess(BatchDecorator):
    """Succeeds when its child completes."""

    def tick(self, agents: AgentSet) -> Results:
        """Tick the child, and replace FAILURE by SUCCESS."""
        self.set_running(agents)
        success, failure, running, skipped = self.child.execute(agents)
        return success | failure, 0, running, skipped


class ForceFailure(BatchDecorator):
    """Fails when its child completes."""

    def tick(self, agents: AgentSet) -> Results:
        """Tick the child, and replace SUCCESS by FAILURE."""
        self.set_running(agents)
        success, failure, running, skipped = self.child.execute(agents)
        return 0, success | failure, running, skipped


class KeepRunningUntilFailure(BatchDecorator):
    """Is RUNNING until its child fails."""

    def tick(self, agents: AgentSet) -> Results:
        """Tick the child, and replace all results except FAILURE by RUNNING."""
        self.set_running(agents)
        success, failure, running, skipped = self.child.execute(agents)
        return 0, failure, success | running | skipped, 0


class RunOnce(BatchDecorator):
    """Ticks its child until the child completes, and never again for the same agent."""

    def __init__(self, node: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(node, context, children)
        self.then_skip = BatchInput(self, "then_skip")
        self._succeeded = 0
        self._failed = 0

    def tick(self, agents: AgentSet) -> Results:
        """Tick the child for an agent until it completes; then return the stored result or SKIPPED."""
        success = failure = running = skipped = 0
        completed = agents & (self._succeeded | self._failed)
        if completed:
            # A port that cannot be read counts as true, as in the ordinary engine.
            for skips, group in self.then_skip.groups(completed, True):
                if skips is False:
                    success |= group & self._succeeded
                    failure |= group & self._failed
                else:
                    skipped |= group
        agents ^= completed
        if not agents:
            return success, failure, 0, skipped
        self.set_running(agents)
        succeeded, failed, running, more_skipped = self.child.execute(agents)
        self._succeeded |= succeeded
        self._failed |= failed
        self.child.reset_by_parent(succeeded | failed)
        return success | succeeded, failure | failed, running, skipped | more_skipped


class RepeatedNode(BatchDecorator):
    """The base class of Repeat and RetryUntilSuccessful, which tick the child until a count reaches a limit.

    The count is the number of the child's successes if *continues_on_success*, else of its failures. The port
    *limit_port* contains the limit; −1 = no limit.
    """

    continues_on_success: ClassVar[bool] = True
    limit_port: ClassVar[str]

    def __init__(self, node: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(node, context, children)
        self.limit = BatchInput(self, self.limit_port)
        self._counts = Counters()
        # A number for all agents if the limit is a literal, else an array with the limit of each agent.
        self._limits: Any = None

    def tick(self, agents: AgentSet) -> Results:
        """Tick the child. If a RUNNING child completes below the limit, tick it again at once."""
        agents = self._read_limits(agents)
        if not agents:
            return 0, 0, 0, 0
        continues_on_success = self.continues_on_success
        self.set_running(agents)
        running = skipped = stopped = 0
        active = self._below_limit(agents)
        done = agents ^ active
        while active:
            fresh = active ^ self.child.not_idle(active)
            succeeded, failed, runs, skips = self.child.execute(active)
            continues, stops = (succeeded, failed) if continues_on_success else (failed, succeeded)
            running |= runs
            if continues:
                self._counts.add(continues)
                self._update_limits(continues)
                self.child.reset_by_parent(continues)
                continues = self.drop_failed(continues)
            if skips:
                self.child.reset_by_parent(skips)
                skipped |= skips
            if stops:
                self._counts.clear(stops)
                self.child.reset_by_parent(stops)
                stopped |= stops
            active = self._below_limit(continues)
            done |= continues ^ active
            # After a child that completed in its first tick, return RUNNING and request another tick.
            yielding = active & fresh
            if yielding:
                self.context.woken |= yielding
                running |= yielding
                active ^= yielding
        if done:
            self._counts.clear(done)
        return (
            (done, stopped, running, skipped) if continues_on_success else (stopped, done, running, skipped)
        )

    def _read_limits(self, agents: AgentSet) -> AgentSet:
        """Read the limits. Return those of *agents* that have a limit."""
        if self.limit.is_literal:
            self._limits = self.limit.literal
            return agents
        agents = self.limit.available(agents)
        if agents:
            # A copy, because read() returns a read-only view and _update_limits() writes.
            self._limits = np.array(self.limit.read(agents))
        return self.drop_failed(agents)

    def _update_limits(self, agents: AgentSet) -> None:
        """Read the limits of *agents* again after the child has completed. The default does nothing."""

    def _below_limit(self, agents: AgentSet) -> AgentSet:
        """Return those of *agents* whose count is below the limit."""
        if not agents:
            return 0
        if self.limit.is_literal:
            return agents if self._limits == -1 else self._counts.below(self._limits, agents)
        agent_sets = self.context.agent_sets
        counts = self._counts.numbers(agent_sets)
        return agent_sets.from_mask((counts < self._limits) | (self._limits == -1)) & agents

    def halt(self, agents: AgentSet) -> None:
        """Halt the child, and reset the counts."""
        self._counts.clear(agents)
        super().halt(agents)


class Repeat(RepeatedNode):
    """Ticks its child until the child has succeeded `num_cycles` times."""

    limit_port = "num_cycles"


class RetryUntilSuccessful(RepeatedNode):
    """Ticks its child until the child has failed `num_attempts` times."""

    continues_on_success = False
    limit_port = "num_attempts"

    def _update_limits(self, agents: AgentSet) -> None:
        if not self.limit.is_literal:
            for limit, group in self.limit.groups(agents, None):
                if limit is not None:
                    np.copyto(self._limits, limit, where=self.context.agent_sets.mask(group))
