"""Sequences, fallbacks, and TryCatch, for a batch."""

from collections.abc import Mapping
from typing import ClassVar

from btcore.batch.context import BatchContext
from btcore.batch.counters import Counters
from btcore.batch.node import NO_RESULTS, BatchNode, Results
from btcore.batch.ports import BatchInput
from btcore.engine.node import TreeNode
from btcore.errors import NodeError


class OrderedNode(BatchNode):
    """Ticks its children in order, and remembers for each agent where it was."""

    goes_on_success: ClassVar[bool] = True
    yields: ClassVar[bool] = False

    def __init__(self, plan: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(plan, context, children)
        # Whose next child is that of this index; of agents in no set it is the first.
        self._next = [0] * len(children)
        self._skips = Counters()

    def tick(self, agents: int) -> Results:
        """Tick the children that are due."""
        success = failure = running = 0
        goes_on_success, yields = self.goes_on_success, self.yields
        children, due = self.children, self._next
        count = len(children)
        if self._skips.planes:
            self._skips.clear(agents ^ self.not_idle(agents))
        self.set_running(agents)
        waiting: list[tuple[int, int]] = []
        active = agents
        for index in range(1, count):
            here = due[index]
            if here:
                active ^= active & here
        for index in range(count):
            here = due[index]
            if index and here:
                here &= agents
                active |= here
                due[index] ^= here
            if not active:
                continue
            child = children[index]
            fresh = active ^ child.not_idle(active) if yields else 0
            succeeded, failed, runs, skipped = child.execute(active)
            goes, stops = (succeeded, failed) if goes_on_success else (failed, succeeded)
            self._stay(index, active, goes | skipped, runs)
            running |= runs
            if stops:
                self._end_early(index, stops)
                if goes_on_success:
                    failure |= stops
                else:
                    success |= stops
            if fresh and index + 1 < count:
                waits = goes & fresh
                if waits:
                    self.context.woken |= waits
                    waiting.append((index + 1, waits))
                    running |= waits
                    goes ^= waits
            if skipped:
                self._skips.add(skipped)
            active = goes | skipped
        for index, waits in waiting:
            due[index] |= waits
        if not active:
            return success, failure, running, 0
        skipped = self._skips.equal(count, active) if count and self._skips.planes else 0
        if self._skips.planes:
            self._skips.clear(active)
        self.reset_children(active)
        done = active ^ skipped
        if goes_on_success:
            success |= done
        else:
            failure |= done
        return success, failure, running, skipped

    def _stay(self, index: int, ticked: int, goes_on: int, running: int) -> None:
        """Remember who is still at child *index*."""
        if index:
            self._next[index] |= running

    def _end_early(self, index: int, agents: int) -> None:
        """Clean up after child *index* has ended the node for *agents*."""
        self.reset_children(agents)

    def _forget(self, agents: int) -> None:
        """Begin at the first child next time."""
        for index, here in enumerate(self._next):
            if here:
                self._next[index] = here ^ (here & agents)
        if self._skips.planes:
            self._skips.clear(agents)

    def halt(self, agents: int) -> None:
        """Halt the children, and begin at the first next time."""
        self._forget(agents)
        self.reset_children(agents)
        self.reset(agents)


class Sequence(OrderedNode):
    """Every child has to succeed."""


class AsyncSequence(OrderedNode):
    """A Sequence that returns RUNNING after a child that succeeded within one tick."""

    yields = True


class Fallback(OrderedNode):
    """One child has to succeed."""

    goes_on_success = False


class AsyncFallback(OrderedNode):
    """A Fallback that returns RUNNING after a child that failed within one tick."""

    goes_on_success = False
    yields = True


class SequenceWithMemory(OrderedNode):
    """A Sequence that goes on at the child that failed, even after a halt."""

    yields = True

    def _stay(self, index: int, ticked: int, goes_on: int, running: int) -> None:
        if index:
            self._next[index] |= ticked ^ (ticked & goes_on)

    def _end_early(self, index: int, agents: int) -> None:
        for child in self.children[index:]:
            child.reset_by_parent(agents)

    def halt(self, agents: int) -> None:
        """Halt the children; where it was is remembered."""
        self.reset_children(agents)
        self.reset(agents)


class ReactiveNode(BatchNode):
    """Ticks its children from the first one on every tick, and lets only one of them run."""

    goes_on_success: ClassVar[bool] = True

    def tick(self, agents: int) -> Results:
        """Tick from the first child."""
        success = failure = running = completed = 0
        goes_on_success = self.goes_on_success
        self.set_running(agents)
        active = agents
        for child in self.children:
            succeeded, failed, runs, skipped = child.execute(active)
            goes, stops = (succeeded, failed) if goes_on_success else (failed, succeeded)
            if runs:
                running |= runs
                for other in self.children:
                    if other is not child and (other.running | other.success | other.failure) & runs:
                        other.reset_by_parent(runs)
            if stops:
                self.reset_children(stops)
                if goes_on_success:
                    failure |= stops
                else:
                    success |= stops
            completed |= goes
            if skipped:
                child.reset_by_parent(skipped)
            active = self.drop_failed(goes | skipped)
            if not active:
                return success, failure, running, 0
        self.reset_children(active)
        done = active & completed if self.children else active
        if goes_on_success:
            success |= done
        else:
            failure |= done
        return success, failure, running, active ^ done


class ReactiveSequence(ReactiveNode):
    """A Sequence that asks every child anew on every tick."""


class ReactiveFallback(ReactiveNode):
    """A Fallback that asks every child anew on every tick."""

    goes_on_success = False


class TryCatch(BatchNode):
    """A sequence whose last child handles its failure."""

    input_ports: ClassVar[Mapping[str, str]] = {"catch_on_halt": "catch_on_halt"}
    catch_on_halt: BatchInput

    def __init__(self, plan: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(plan, context, children)
        self._next = [0] * len(children)
        self._skips = Counters()
        self._catching = 0

    def tick(self, agents: int) -> Results:
        """Tick the children that are due, or the handler."""
        children, due = self.children, self._next
        if len(children) < 2:
            fault = NodeError("<TryCatch> takes at least one child to try and a handler")
            self.context.fail(self, agents, fault)
            return NO_RESULTS
        idle = agents ^ self.not_idle(agents)
        self._skips.clear(idle)
        self._catching ^= self._catching & idle
        self.set_running(agents)
        last = len(children) - 1
        running = 0
        active = agents ^ (agents & self._catching)
        for index in range(1, last):
            active ^= active & due[index]
        for index in range(last):
            if index:
                here = due[index] & agents
                active |= here
                due[index] ^= here
            if not active:
                continue
            success, failure, runs, skipped = children[index].execute(active)
            running |= runs
            if index:
                due[index] |= runs
            if failure:
                self._catching |= failure
                self.reset_children(failure)
            if skipped:
                self._skips.add(skipped)
            active = success | skipped
        skipped = self._skips.equal(last, active) if active else 0
        if active:
            self._begin(active)
            self.reset_children(active)
        failure = 0
        catching = self.drop_failed(self._catching & agents)
        if catching:
            one, other, runs, third = children[last].execute(catching)
            running |= runs
            failure = one | other | third
            self._catching ^= self._catching & failure
            self.reset_children(failure)
        return active ^ skipped, failure, running, skipped

    def _begin(self, agents: int) -> None:
        for index, here in enumerate(self._next):
            self._next[index] = here ^ (here & agents)
        self._skips.clear(agents)
        self._catching ^= self._catching & agents

    def halt(self, agents: int) -> None:
        """Halt the children, after the handler's one tick where `catch_on_halt` asks for it."""
        last = len(self.children) - 1
        wanted = self.not_idle(agents)
        wanted ^= wanted & self._catching
        if wanted and last > 0:
            for catches, some in self.catch_on_halt.groups_or(wanted, False):
                if catches is True:
                    for child in self.children[:last]:
                        child.reset_by_parent(some)
                    running = self.children[last].execute(some)[2]
                    if running:
                        self.children[last].reset_by_parent(running)
        self._begin(agents)
        self.reset_children(agents)
        self.reset(agents)
