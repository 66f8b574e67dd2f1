"""Decorators that change their child's result, and those that tick it again, for a batch."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from btcore.batch.context import BatchContext
from btcore.batch.counters import Counters
from btcore.batch.node import BatchDecorator, BatchNode, Results
from btcore.batch.ports import BatchInput
from btcore.engine.node import TreeNode


class ResultDecorator(BatchDecorator):
    """Ticks its child, and changes what it came to."""

    def tick(self, agents: int) -> Results:
        """Tick the child."""
        self.set_running(agents)
        return self.map_results(*self.child.execute(agents))

    def map_results(self, success: int, failure: int, running: int, skipped: int) -> Results:
        """The node's results, by those of its child."""
        raise NotImplementedError


class Inverter(ResultDecorator):
    """Turns SUCCESS into FAILURE and FAILURE into SUCCESS."""

    def map_results(self, success: int, failure: int, running: int, skipped: int) -> Results:
        """Who failed, succeeds."""
        return failure, success, running, skipped


class ForceSuccess(ResultDecorator):
    """Succeeds when its child completes."""

    def map_results(self, success: int, failure: int, running: int, skipped: int) -> Results:
        """Who completed, succeeds."""
        return success | failure, 0, running, skipped


class ForceFailure(ResultDecorator):
    """Fails when its child completes."""

    def map_results(self, success: int, failure: int, running: int, skipped: int) -> Results:
        """Who completed, fails."""
        return 0, success | failure, running, skipped


class KeepRunningUntilFailure(ResultDecorator):
    """Keeps RUNNING until its child fails."""

    def map_results(self, success: int, failure: int, running: int, skipped: int) -> Results:
        """Who didn't fail, runs."""
        return 0, failure, success | running | skipped, 0


class RunOnce(BatchDecorator):
    """Ticks its child until it completes once in an agent's life."""

    input_ports: ClassVar[Mapping[str, str]] = {"then_skip": "then_skip"}
    then_skip: BatchInput

    def __init__(self, plan: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(plan, context, children)
        self._succeeded = 0
        self._failed = 0

    def tick(self, agents: int) -> Results:
        """Tick the child, or give what is remembered."""
        success = failure = running = skipped = 0
        known = agents & (self._succeeded | self._failed)
        if known:
            for skips, some in self.then_skip.groups_or(known, True):
                if skips is False:
                    success |= some & self._succeeded
                    failure |= some & self._failed
                else:
                    skipped |= some
        agents ^= known
        if not agents:
            return success, failure, 0, skipped
        self.set_running(agents)
        succeeded, failed, running, more = self.child.execute(agents)
        self._succeeded |= succeeded
        self._failed |= failed
        self.child.reset_by_parent(succeeded | failed)
        return success | succeeded, failure | failed, running, skipped | more


class RepeatedNode(BatchDecorator):
    """Ticks its child until it completed as often as *limit* says, −1 = for ever."""

    goes_on_success: ClassVar[bool] = True
    limit: BatchInput

    def __init__(self, plan: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(plan, context, children)
        self._counts = Counters()
        self._limits: Any = None

    def tick(self, agents: int) -> Results:
        """Tick the child, again and again."""
        agents = self._read(agents)
        if not agents:
            return 0, 0, 0, 0
        goes_on_success = self.goes_on_success
        self.set_running(agents)
        running = skipped = stopped = done = 0
        active = self._below(agents)
        done = agents ^ active
        while active:
            fresh = active ^ self.child.not_idle(active)
            succeeded, failed, runs, none = self.child.execute(active)
            goes, stops = (succeeded, failed) if goes_on_success else (failed, succeeded)
            running |= runs
            if goes:
                self._counts.add(goes)
                self._read_again(goes)
                self.child.reset_by_parent(goes)
                goes = self.drop_failed(goes)
            if none:
                self.child.reset_by_parent(none)
                skipped |= none
            if stops:
                self._counts.clear(stops)
                self.child.reset_by_parent(stops)
                stopped |= stops
            active = self._below(goes)
            done |= goes ^ active
            waits = active & fresh
            if waits:
                self.context.woken |= waits
                running |= waits
                active ^= waits
        if done:
            self._counts.clear(done)
        return (done, stopped, running, skipped) if goes_on_success else (stopped, done, running, skipped)

    def _read(self, agents: int) -> int:
        """Read the limits; who has one."""
        if self.limit.is_literal:
            self._limits = self.limit.literal
            return agents
        agents = self.limit.available(agents)
        if agents:
            self._limits = np.array(self.limit.read(agents))
        return self.drop_failed(agents)

    def _read_again(self, agents: int) -> None:
        """Read the limits that a tick of the child may have changed, where the node does so."""

    def _below(self, agents: int) -> int:
        """Those of *agents* who haven't reached their limit."""
        if not agents:
            return 0
        if self.limit.is_literal:
            return agents if self._limits == -1 else self._counts.below(self._limits, agents)
        crowd = self.context.agent_sets
        counts = self._counts.numbers(crowd)
        return crowd.from_mask((counts < self._limits) | (self._limits == -1)) & agents

    def halt(self, agents: int) -> None:
        """Halt the child; nothing is counted."""
        self._counts.clear(agents)
        self.child.reset_by_parent(agents)
        self.reset(agents)


class Repeat(RepeatedNode):
    """Ticks its child until it succeeded often enough."""

    input_ports: ClassVar[Mapping[str, str]] = {"num_cycles": "limit"}


class RetryUntilSuccessful(RepeatedNode):
    """Ticks its child until it failed too often."""

    goes_on_success = False
    input_ports: ClassVar[Mapping[str, str]] = {"num_attempts": "limit"}

    def _read_again(self, agents: int) -> None:
        if not self.limit.is_literal:
            for number, some in self.limit.groups_or(agents, None):
                if number is not None:
                    np.copyto(self._limits, number, where=self.context.agent_sets.mask(some))
