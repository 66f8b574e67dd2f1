"""Parallels for a batch."""

from collections.abc import Mapping
from typing import ClassVar

from btcore.batch.context import BatchContext
from btcore.batch.node import NO_RESULTS, BatchNode, Results, merge_results
from btcore.batch.ports import BatchInput
from btcore.engine.node import TreeNode
from btcore.errors import NodeError
from btcore.nodes.parallel import threshold


class UnaryCounters:
    """How many of an agent's children ended in one way: level *k* holds those with more than *k*."""

    def __init__(self, most: int) -> None:
        self.levels = [0] * most

    def add(self, agents: int) -> None:
        """Count one more for *agents*."""
        for at, level in enumerate(self.levels):
            self.levels[at] = level | agents
            agents &= level
            if not agents:
                return

    def at_least(self, number: int) -> int:
        """Who has that many; -1 (all) for none."""
        return -1 if number <= 0 else self.levels[number - 1] if number <= len(self.levels) else 0

    def exactly(self, number: int, agents: int) -> int:
        """Who of *agents* has just that many."""
        least = agents & self.at_least(number)
        return least ^ (least & self.at_least(number + 1))

    def clear(self, agents: int) -> None:
        """Begin at none for *agents*."""
        for at, level in enumerate(self.levels):
            if level:
                self.levels[at] = level ^ (level & agents)


class ParallelNode(BatchNode):
    """Ticks the children that haven't completed, for each agent its own."""

    def __init__(self, plan: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(plan, context, children)
        self._completed = [0] * len(children)
        self._successes = UnaryCounters(len(children))
        self._failures = UnaryCounters(len(children))

    def _forget(self, agents: int) -> None:
        for index, completed in enumerate(self._completed):
            if completed:
                self._completed[index] = completed ^ (completed & agents)
        self._successes.clear(agents)
        self._failures.clear(agents)

    def refuse(self, agents: int, what: str) -> None:
        """Fail for more than there are children."""
        self.context.fail(self, agents, NodeError(f"{len(self.children)} children can never give {what}"))

    def halt(self, agents: int) -> None:
        """Halt the children; nothing is completed."""
        self._forget(agents)
        self.reset_children(agents)
        self.reset(agents)


class Parallel(ParallelNode):
    """Ends when enough of its children succeeded or failed."""

    input_ports: ClassVar[Mapping[str, str]] = {
        "success_count": "success_count",
        "failure_count": "failure_count",
    }
    success_count: BatchInput
    failure_count: BatchInput

    def tick(self, agents: int) -> Results:
        """Tick the children that haven't completed, by groups with the same counts."""
        results = NO_RESULTS
        for given, group in self.success_count.groups(agents):
            for allowed, some in self.failure_count.groups(group):
                results = merge_results(results, self._tick(some, given, allowed))
        return results

    def _tick(self, agents: int, given: int, given_failures: int) -> Results:
        count = len(self.children)
        needed, allowed = threshold(given, count), threshold(given_failures, count)
        if count < needed or count < allowed:
            self.refuse(agents, f"{needed} successes" if count < needed else f"{allowed} failures")
            return NO_RESULTS
        self.set_running(agents)
        success = failure = 0
        skips = UnaryCounters(count)
        active = agents
        all_skipped = agents
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
                if skipped:
                    skips.add(skipped)
                all_skipped &= skipped
            else:
                all_skipped = 0
            won = active & self._successes.at_least(needed)
            if given < 0 and skips.levels and skips.levels[0]:
                for with_successes in range(needed):
                    won |= (
                        active
                        & self._successes.at_least(with_successes)
                        & skips.at_least(needed - with_successes)
                    )
            if won:
                success |= won
                active ^= won
                self._forget(won)
                self.reset_children(won)
            lost = self._failures.exactly(allowed, active)
            lost |= active & self._failures.at_least(count - needed + 1)
            if lost:
                failure |= lost
                active ^= lost
                self._forget(lost)
                self.reset_children(lost)
            if not active:
                break
        active = self.drop_failed(active)
        all_skipped = active & all_skipped if count else active
        return success, failure, active ^ all_skipped, all_skipped


class ParallelAll(ParallelNode):
    """Ends when every child has completed."""

    input_ports: ClassVar[Mapping[str, str]] = {"max_failures": "max_failures"}
    max_failures: BatchInput

    def tick(self, agents: int) -> Results:
        """Tick the children that haven't completed, by groups with the same count."""
        results = NO_RESULTS
        for given, some in self.max_failures.groups(agents):
            results = merge_results(results, self._tick(some, given))
        return results

    def _tick(self, agents: int, given: int) -> Results:
        count = len(self.children)
        allowed = threshold(given, count)
        if count < allowed:
            self.refuse(agents, f"{allowed} failures")
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
