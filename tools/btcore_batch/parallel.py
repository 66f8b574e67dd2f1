"""Parallel and ParallelAll of a batch."""

from btcore.engine.node import TreeNode
from btcore.errors import NodeError
from btcore.nodes.parallel import threshold
from btcore_batch.agent_sets import AgentSet, UnaryCounters
from btcore_batch.context import BatchContext
from btcore_batch.node import NO_RESULTS, BatchNode, Results, merge_results
from btcore_batch.ports import BatchInput


class ParallelNode(BatchNode):
    """The base class of parallels. It stores, for each child, the agents for which it has completed."""

    def __init__(self, node: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(node, context, children)
        self._completed = [0] * len(children)
        self._successes = UnaryCounters(len(children))
        self._failures = UnaryCounters(len(children))

    def _forget(self, agents: AgentSet) -> None:
        """Mark all children as not completed for *agents*."""
        for index, completed in enumerate(self._completed):
            if completed:
                self._completed[index] = completed ^ (completed & agents)
        self._successes.clear(agents)
        self._failures.clear(agents)

    def fail_impossible(self, agents: AgentSet, count: str) -> None:
        """Record for *agents* that the node has too few children for *count*, such as "3 failures"."""
        message = f"{len(self.children)} children can never give {count}"
        self.context.fail(self, agents, NodeError(message))

    def halt(self, agents: AgentSet) -> None:
        """Halt the children, and mark them as not completed."""
        self._forget(agents)
        super().halt(agents)


class Parallel(ParallelNode):
    """Ends when enough of its children have succeeded or failed."""

    def __init__(self, node: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(node, context, children)
        self.success_count = BatchInput(self, "success_count")
        self.failure_count = BatchInput(self, "failure_count")

    def tick(self, agents: AgentSet) -> Results:
        """Tick the children that have not completed, for each group of agents with the same port values."""
        results = NO_RESULTS
        for successes, group in self.success_count.groups(agents):
            for failures, subgroup in self.failure_count.groups(group):
                results = merge_results(results, self._tick(subgroup, successes, failures))
        return results

    def _tick(self, agents: AgentSet, success_count: int, failure_count: int) -> Results:
        count = len(self.children)
        needed, allowed = threshold(success_count, count), threshold(failure_count, count)
        if count < needed or count < allowed:
            self.fail_impossible(agents, f"{needed} successes" if count < needed else f"{allowed} failures")
            return NO_RESULTS
        self.set_running(agents)
        success = failure = 0
        active = all_skipped = agents
        counted = self._successes
        for index, child in enumerate(self.children):
            due = active ^ (active & self._completed[index])
            if due:
                succeeded, failed, running, skipped = child.execute(due)
                active ^= due ^ (succeeded | failed | running | skipped)
                if succeeded:
                    self._successes.add(succeeded)
                if failed:
                    self._failures.add(failed)
                self._completed[index] |= succeeded | failed
                if counted is not self._successes:
                    counted.add(succeeded | skipped)
                elif skipped and success_count < 0:
                    # With a negative count, children that are skipped in this tick count as successes.
                    counted = self._successes.copy()
                    counted.add(skipped)
                all_skipped &= skipped
            else:
                all_skipped = 0
            won = active & counted.at_least(needed)
            if won:
                success |= won
                active ^= won
                self._forget(won)
                self.reset_children(won)
            # BehaviorTree.CPP compares with ==: a number of failures above the threshold has no effect.
            lost = active & self._failures.at_least(allowed)
            lost ^= lost & self._failures.at_least(allowed + 1)
            lost |= active & self._failures.at_least(count - needed + 1)
            if lost:
                failure |= lost
                active ^= lost
                self._forget(lost)
                self.reset_children(lost)
            if not active:
                break
        # Agents that are still active are RUNNING, or SKIPPED if all children were skipped in this tick.
        active = self.drop_failed(active)
        all_skipped = active & all_skipped if count else active
        return success, failure, active ^ all_skipped, all_skipped


class ParallelAll(ParallelNode):
    """Ends when every child has completed."""

    def __init__(self, node: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(node, context, children)
        self.max_failures = BatchInput(self, "max_failures")

    def tick(self, agents: AgentSet) -> Results:
        """Tick the children that have not completed, for each group of agents with the same port value."""
        results = NO_RESULTS
        for max_failures, group in self.max_failures.groups(agents):
            results = merge_results(results, self._tick(group, max_failures))
        return results

    def _tick(self, agents: AgentSet, max_failures: int) -> Results:
        count = len(self.children)
        allowed = threshold(max_failures, count)
        if count < allowed:
            self.fail_impossible(agents, f"{allowed} failures")
            return NO_RESULTS
        self.set_running(agents)
        active = all_skipped = agents
        running = 0
        for index, child in enumerate(self.children):
            due = active ^ (active & self._completed[index])
            if not due:
                all_skipped = 0
                continue
            succeeded, failed, runs, skipped = child.execute(due)
            active ^= due ^ (succeeded | failed | runs | skipped)
            if failed:
                self._failures.add(failed)
            self._completed[index] |= succeeded | failed
            all_skipped &= skipped
            running |= runs
        active = self.drop_failed(active)
        all_skipped &= active
        running &= active
        done = active ^ (all_skipped | running)
        failed = done & self._failures.at_least(allowed)
        if done:
            self._forget(done)
            self.reset_children(done)
        return done ^ failed, failed, running, all_skipped
