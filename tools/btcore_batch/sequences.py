"""Sequences, fallbacks and TryCatch of a batch."""

from typing import ClassVar

from btcore.engine.node import TreeNode
from btcore.errors import NodeError
from btcore_batch.agent_sets import AgentSet, Counters
from btcore_batch.context import BatchContext
from btcore_batch.node import NO_RESULTS, BatchNode, Results
from btcore_batch.ports import BatchInput


class OrderedNode(BatchNode):
    """The base class of nodes that tick their children in order, and store each agent's next child."""

    continues_on_success: ClassVar[bool] = True
    is_async: ClassVar[bool] = False
    """Whether the node returns RUNNING after a child that completes in its first tick."""

    def __init__(self, node: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(node, context, children)
        # The children that are ticked in order: those of TryCatch without the handler.
        self._steps = children
        # For each child, the agents for which it is next. For agents in no set, the first child is next.
        self._next: list[AgentSet] = [0] * len(children)
        self._skips = Counters()

    def tick(self, agents: AgentSet) -> Results:
        """Tick each agent's next child, and the children after it."""
        ended = running = 0
        continues_on_success, is_async = self.continues_on_success, self.is_async
        children, next_child = self._steps, self._next
        count = len(children)
        if self._skips.planes:
            self._skips.clear(agents ^ self.not_idle(agents))
        self.set_running(agents)
        waiting: list[tuple[int, AgentSet]] = []
        # Agents whose next child is not the first enter the loop at their next child.
        active = agents
        for index in range(1, count):
            starts_here = next_child[index]
            if starts_here:
                active ^= active & starts_here
        for index in range(count):
            starts_here = next_child[index]
            if index and starts_here:
                starts_here &= agents
                active |= starts_here
                next_child[index] ^= starts_here
            if not active:
                continue
            child = children[index]
            fresh = active ^ child.not_idle(active) if is_async else 0
            succeeded, failed, runs, skipped = child.execute(active)
            continues, stops = (succeeded, failed) if continues_on_success else (failed, succeeded)
            self._remember(index, active, continues | skipped, runs)
            running |= runs
            if stops:
                self._end_early(index, stops)
                ended |= stops
            if fresh and index + 1 < count:
                yielding = continues & fresh
                if yielding:
                    self.context.woken |= yielding
                    waiting.append((index + 1, yielding))
                    running |= yielding
                    continues ^= yielding
            if skipped:
                self._skips.add(skipped)
            active = continues | skipped
        # Set only now, because the loop would otherwise tick the next child in the same tick.
        for index, yielding in waiting:
            next_child[index] |= yielding
        skipped = 0
        if active:
            if self._skips.planes:
                skipped = self._skips.equal(count, active) if count else 0
                self._skips.clear(active)
            self.reset_children(active)
        completed = active ^ skipped
        if continues_on_success:
            return completed, ended, running, skipped
        return ended, completed, running, skipped

    def _remember(self, index: int, ticked: AgentSet, continues: AgentSet, running: AgentSet) -> None:
        """Make the child *index* the next child of the agents that stay at it."""
        if index:
            self._next[index] |= running

    def _end_early(self, index: int, agents: AgentSet) -> None:
        """Reset children for *agents*, for which the result of the child *index* has ended the node."""
        self.reset_children(agents)

    def _forget(self, agents: AgentSet) -> None:
        """Make the first child the next child of *agents*."""
        for index, starts_here in enumerate(self._next):
            if starts_here:
                self._next[index] = starts_here ^ (starts_here & agents)
        if self._skips.planes:
            self._skips.clear(agents)

    def halt(self, agents: AgentSet) -> None:
        """Halt the children, and start with the first child next time."""
        self._forget(agents)
        super().halt(agents)


class Sequence(OrderedNode):
    """Succeeds if all children succeed."""


class AsyncSequence(OrderedNode):
    """A Sequence that returns RUNNING after a child that succeeds in its first tick."""

    is_async = True


class Fallback(OrderedNode):
    """Succeeds if a child succeeds."""

    continues_on_success = False


class AsyncFallback(OrderedNode):
    """A Fallback that returns RUNNING after a child that fails in its first tick."""

    continues_on_success = False
    is_async = True


class SequenceWithMemory(OrderedNode):
    """A Sequence that continues with the child that failed, even after a halt."""

    is_async = True

    def _remember(self, index: int, ticked: AgentSet, continues: AgentSet, running: AgentSet) -> None:
        if index:
            self._next[index] |= ticked ^ (ticked & continues)

    def _end_early(self, index: int, agents: AgentSet) -> None:
        for child in self.children[index:]:
            child.reset_by_parent(agents)

    def halt(self, agents: AgentSet) -> None:
        """Halt the children, and remember the next child."""
        self.reset_children(agents)
        self.reset(agents)


class ReactiveNode(BatchNode):
    """The base class of nodes that start every tick with the first child. Only one child can be RUNNING."""

    continues_on_success: ClassVar[bool] = True

    def tick(self, agents: AgentSet) -> Results:
        """Tick the children from the first child."""
        ended = running = completed = 0
        continues_on_success = self.continues_on_success
        self.set_running(agents)
        active = agents
        for child in self.children:
            succeeded, failed, runs, skipped = child.execute(active)
            continues, stops = (succeeded, failed) if continues_on_success else (failed, succeeded)
            if runs:
                running |= runs
                for other in self.children:
                    if other is not child and (other.running | other.success | other.failure) & runs:
                        other.reset_by_parent(runs)
            if stops:
                self.reset_children(stops)
                ended |= stops
            completed |= continues
            if skipped:
                child.reset_by_parent(skipped)
            active = self.drop_failed(continues | skipped)
            if not active:
                break
        self.reset_children(active)
        # An agent is skipped if all its children were skipped.
        done = active & completed if self.children else active
        if continues_on_success:
            return done, ended, running, active ^ done
        return ended, done, running, active ^ done


class ReactiveSequence(ReactiveNode):
    """A Sequence that ticks all children again in every tick."""


class ReactiveFallback(ReactiveNode):
    """A Fallback that ticks all children again in every tick."""

    continues_on_success = False


class TryCatch(OrderedNode):
    """A Sequence whose last child, the handler, is ticked if another child fails."""

    def __init__(self, node: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(node, context, children)
        self.catch_on_halt = BatchInput(self, "catch_on_halt")
        self._steps = children[:-1]
        self._catching = 0

    def tick(self, agents: AgentSet) -> Results:
        """Tick each agent's next child and the children after it, or the handler."""
        if not self._steps:
            error = NodeError("<TryCatch> takes at least one child to try and a handler")
            self.context.fail(self, agents, error)
            return NO_RESULTS
        self._catching ^= self._catching & (agents ^ self.not_idle(agents))
        success, failed, running, skipped = super().tick(agents ^ (agents & self._catching))
        self._catching |= failed
        failure = 0
        catching = self.drop_failed(self._catching & agents)
        if catching:
            # The node fails, whatever the result of the handler is.
            handled = self.children[-1].execute(catching)
            running |= handled[2]
            failure = handled[0] | handled[1] | handled[3]
            self._catching ^= self._catching & failure
            self.reset_children(failure)
        return success, failure, running, skipped

    def _forget(self, agents: AgentSet) -> None:
        super()._forget(agents)
        self._catching ^= self._catching & agents

    def halt(self, agents: AgentSet) -> None:
        """Halt the children, after a single tick of the handler if `catch_on_halt` is true."""
        interrupted = self.not_idle(agents)
        interrupted ^= interrupted & self._catching
        if interrupted and self._steps:
            handler = self.children[-1]
            for catches, group in self.catch_on_halt.groups(interrupted, False):
                if catches is True:
                    for child in self._steps:
                        child.reset_by_parent(group)
                    running = handler.execute(group)[2]
                    if running:
                        handler.reset_by_parent(running)
        super().halt(agents)
