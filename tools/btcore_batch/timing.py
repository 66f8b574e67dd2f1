"""Nodes of a batch that wait; each agent has its own deadline."""

from btcore.engine.node import TreeNode
from btcore_batch.agent_sets import AgentSet
from btcore_batch.context import BatchContext
from btcore_batch.node import BatchDecorator, BatchNode, Results
from btcore_batch.ports import BatchInput


class TimedDecorator(BatchDecorator):
    """The base class of decorators with a timer."""

    def __init__(self, node: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(node, context, children)
        self._timer = context.add_timer()

    def halt(self, agents: AgentSet) -> None:
        """Cancel the deadlines, and halt the child."""
        self._stop(agents)
        super().halt(agents)

    def _stop(self, agents: AgentSet) -> None:
        self._timer.stop(agents)


class Timeout(TimedDecorator):
    """Halts its child and fails if the child is still RUNNING `msec` milliseconds after the start."""

    def __init__(self, node: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(node, context, children)
        self.msec = BatchInput(self, "msec")
        self._started = 0

    def tick(self, agents: AgentSet) -> Results:
        """Tick the child, unless the time has passed."""
        context, timer = self.context, self._timer
        late = active = 0
        for allowed, group in self.msec.groups(agents):
            starting = group ^ (group & self._started)
            if starting:
                self.set_running(starting)
                self._started |= starting
                if allowed > 0:
                    timer.start(starting, context.clock.now(), allowed)
            active |= group
            going = group ^ starting
            due = timer.due(going, context.tick_start) if going else 0
            if due:
                # BehaviorTree.CPP's timer fires once, and has no effect if the child is not RUNNING then.
                timer.forget(due)
                stopped = due & self.child.running
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

    def _stop(self, agents: AgentSet) -> None:
        super()._stop(agents)
        self._started ^= self._started & agents


class Delay(TimedDecorator):
    """Is RUNNING for `delay_msec` milliseconds, then ticks its child."""

    def __init__(self, node: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(node, context, children)
        self.delay_msec = BatchInput(self, "delay_msec")

    def tick(self, agents: AgentSet) -> Results:
        """Wait, then tick the child."""
        context, timer = self.context, self._timer
        waiting = active = 0
        for delay, group in self.delay_msec.groups(agents):
            # An agent that waits for no deadline has not started.
            starting = group ^ (group & timer.waiting)
            going = group ^ starting
            due = timer.due(going, context.tick_start) if going else 0
            if starting:
                self.set_running(starting)
                timer.start(starting, context.clock.now(), delay)
            waiting |= group ^ due
            active |= due
        if not active:
            return 0, 0, waiting, 0
        success, failure, running, skipped = self.child.execute(active)
        completed = success | failure
        if completed:
            # The wake-up stays, as in the ordinary engine, which cancels it only in a halt.
            timer.forget(completed)
            self.child.reset_by_parent(completed)
        return success, failure, running | waiting, skipped


class Sleep(BatchNode):
    """Is RUNNING for `msec` milliseconds, then succeeds."""

    def __init__(self, node: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(node, context, children)
        self.msec = BatchInput(self, "msec")
        self._timer = context.add_timer()

    def tick(self, agents: AgentSet) -> Results:
        """Start the timer, or check it."""
        context, timer = self.context, self._timer
        going = self.running & agents
        # Agents that have completed and were not reset keep their result.
        success, failure = self.success & agents, self.failure & agents
        running = 0
        if going:
            due = timer.due(going, context.tick_start)
            success |= due
            running = going ^ due
        starting = agents ^ self.not_idle(agents)
        if starting:
            for duration, group in self.msec.groups(starting):
                if duration <= 0:
                    success |= group
                else:
                    timer.start(group, context.clock.now(), duration)
                    running |= group
        return success, failure, running, 0

    def halt(self, agents: AgentSet) -> None:
        """Cancel the deadlines."""
        self._timer.stop(agents & self.running)
        super().halt(agents)
