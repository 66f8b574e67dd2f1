"""Nodes that wait, for a batch: each agent for its own moment."""

from collections.abc import Mapping
from typing import ClassVar

from btcore.batch.context import BatchContext
from btcore.batch.node import BatchDecorator, BatchNode, Results
from btcore.batch.ports import BatchInput
from btcore.engine.node import TreeNode


class TimedDecorator(BatchDecorator):
    """A node with a moment for each agent, and one child."""

    def __init__(self, plan: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(plan, context, children)
        self._timer = context.timer()

    def halt(self, agents: int) -> None:
        """Halt the child and stop the clock."""
        self._stop(agents)
        self.child.reset_by_parent(agents)
        self.reset(agents)

    def _stop(self, agents: int) -> None:
        self._timer.stop(agents)


class Timeout(TimedDecorator):
    """Halts its child and fails when it still runs some time after the start."""

    input_ports: ClassVar[Mapping[str, str]] = {"msec": "msec"}
    msec: BatchInput

    def __init__(self, plan: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(plan, context, children)
        self._started = 0

    def tick(self, agents: int) -> Results:
        """Tick the child while there is time."""
        clock, timer = self.context.clock, self._timer
        late = active = 0
        for allowed, some in self.msec.groups(agents):
            starts = some ^ (some & self._started)
            if starts:
                self.set_running(starts)
                self._started |= starts
                if allowed > 0:
                    timer.start(starts, clock.now(), allowed)
            active |= some
            going = some ^ starts
            due = timer.due(going, clock.now()) if going else 0
            if due:
                stopped = due & self.child.running
                # The original's timer fires once, and finds nothing to halt.
                timer.forget(due)
                if stopped:
                    late |= stopped
                    self._stop(stopped)
                    self.child.reset_by_parent(stopped)
        active ^= late
        if not active:
            return 0, late, 0, 0
        success, failure, running, skipped = self.child.execute(self.drop_failed(active))
        completed = success | failure
        if completed:
            self._stop(completed)
            self.child.reset_by_parent(completed)
        return success, failure | late, running, skipped

    def _stop(self, agents: int) -> None:
        super()._stop(agents)
        self._started ^= self._started & agents


class Delay(TimedDecorator):
    """Ticks its child only when some time has passed since the start."""

    input_ports: ClassVar[Mapping[str, str]] = {"delay_msec": "delay_msec"}
    delay_msec: BatchInput

    def tick(self, agents: int) -> Results:
        """Wait, then tick the child."""
        clock, timer = self.context.clock, self._timer
        waits = active = 0
        for delay, some in self.delay_msec.groups(agents):
            starts = some ^ (some & timer.waiting)
            going = some ^ starts
            due = timer.due(going, clock.now()) if going else 0
            if starts:
                self.set_running(starts)
                timer.start(starts, clock.now(), delay)
            waits |= some ^ due
            active |= due
        if not active:
            return 0, 0, waits, 0
        success, failure, running, skipped = self.child.execute(active)
        completed = success | failure
        if completed:
            timer.forget(completed)
            self.child.reset_by_parent(completed)
        return success, failure, running | waits, skipped


class Sleep(BatchNode):
    """Runs for some time, then succeeds."""

    input_ports: ClassVar[Mapping[str, str]] = {"msec": "msec"}
    msec: BatchInput

    def __init__(self, plan: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(plan, context, children)
        self._timer = context.timer()

    def tick(self, agents: int) -> Results:
        """Start the clock, or look at it."""
        clock, timer = self.context.clock, self._timer
        going = self.running & agents
        # Who has completed and was not reset keeps the result.
        success, failure = self.success & agents, self.failure & agents
        running = 0
        if going:
            due = timer.due(going, clock.now())
            success |= due
            running = going ^ due
        starts = agents ^ self.not_idle(agents)
        if starts:
            for duration, some in self.msec.groups(starts):
                if duration <= 0:
                    success |= some
                else:
                    timer.start(some, clock.now(), duration)
                    running |= some
        return success, failure, running, 0

    def halt(self, agents: int) -> None:
        """Stop the clock."""
        self._timer.stop(agents & self.running)
        self.reset(agents)
