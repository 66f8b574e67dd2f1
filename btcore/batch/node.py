"""What every node of a batch is: stored statuses as sets of agents, ticks, and halts.

The order of what happens to one agent is that of :mod:`btcore.engine.node`, line by line; what happens to
different agents in between doesn't matter to it.
"""

from collections.abc import Mapping
from typing import ClassVar, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from btcore.batch.context import BatchContext, Located
from btcore.batch.script import BatchProgram
from btcore.engine.node import TreeNode
from btcore.engine.node_config import NodeConfig
from btcore.status import NodeType

Results: TypeAlias = tuple[int, int, int, int]
"""Who succeeded, who failed, who runs and who was skipped; those that raised are in none."""

NO_RESULTS: Final[Results] = (0, 0, 0, 0)


def merge_results(one: Results, other: Results) -> Results:
    """The results of two groups of agents."""
    return one[0] | other[0], one[1] | other[1], one[2] | other[2], one[3] | other[3]


class BatchNode:
    """A node of a batch.

    *success*, *failure* and *running* are the agents for whom that status is stored, all others are
    IDLE; SKIPPED is never stored, as in the ordinary engine.
    """

    children: list["BatchNode"]
    input_ports: ClassVar[Mapping[str, str]] = {}
    """The attribute for each input port that the node reads, by the port's name."""
    script_port: ClassVar[str] = ""
    """The port whose script becomes the attribute *program*."""

    def __init__(self, plan: TreeNode, context: BatchContext, children: list["BatchNode"]) -> None:
        config: NodeConfig = plan.config
        self.config = config
        self.name = config.name
        self.id = config.id
        self.uid = config.uid
        self.path = config.path
        self.where = config.where
        self.type: NodeType = plan.type
        self.parent: Located | None = None
        self.context = context
        self.children = children
        for child in children:
            child.parent = self
        self.conditions: BatchConditions | None = None
        self.success = 0
        self.failure = 0
        self.running = 0

    @property
    def status(self) -> NDArray[np.uint8]:
        """The stored status of each agent, as a Status is numbered."""
        return status_array(self.context, self.success, self.failure, self.running, 0)

    def __repr__(self) -> str:
        return f"<{self.id} '{self.path}' for {self.context.agent_sets.count} agents>"

    # --- ticking

    def tick(self, agents: int) -> Results:
        """Do what the node is for, for *agents*."""
        raise NotImplementedError

    def execute(self, agents: int) -> Results:
        """Tick the node for *agents* as its parent does: with conditions, and with the results stored."""
        guard = self.conditions
        if guard is None:
            results = self.tick(agents)
        else:
            results = guard.execute(self, agents)
        if self.context.raised:
            raised = self.context.raised
            success, failure, running, skipped = results
            results = (
                success ^ (success & raised),
                failure ^ (failure & raised),
                running ^ (running & raised),
                skipped ^ (skipped & raised),
            )
        self.store(results[0], results[1], results[2])
        return results

    def store(self, success: int, failure: int, running: int) -> None:
        """Store these results; all other agents keep what they had."""
        done = success | failure | running
        before = self.success
        self.success = before ^ (before & done) | success if before else success
        before = self.failure
        self.failure = before ^ (before & done) | failure if before else failure
        before = self.running
        self.running = before ^ (before & done) | running if before else running

    def set_running(self, agents: int) -> None:
        """Store RUNNING for *agents*."""
        self.running |= agents
        if self.success:
            self.success ^= self.success & agents
        if self.failure:
            self.failure ^= self.failure & agents

    def not_idle(self, agents: int) -> int:
        """Those of *agents* for whom the node isn't IDLE."""
        return agents & (self.running | self.success | self.failure)

    def drop_failed(self, agents: int) -> int:
        """Those of *agents* for whom nothing has raised in this tick."""
        raised = self.context.raised
        return agents ^ (agents & raised) if raised else agents

    # --- halting

    def reset(self, agents: int) -> None:
        """Be IDLE for *agents*."""
        if self.success:
            self.success ^= self.success & agents
        if self.failure:
            self.failure ^= self.failure & agents
        if self.running:
            self.running ^= self.running & agents

    def halt(self, agents: int) -> None:
        """Stop what runs for *agents*, and be IDLE for them."""
        for child in self.children:
            child.reset_by_parent(agents)
        self.reset(agents)

    def halt_node(self, agents: int) -> None:
        """Halt as a parent does: with ``_onHalted``."""
        self.halt(agents)
        if self.conditions is not None:
            self.conditions.run_on_halted(agents)

    def reset_by_parent(self, agents: int) -> None:
        """Halt the node for those of *agents* for whom it runs, and be IDLE for all of them."""
        running = self.running & agents
        if running:
            self.halt_node(running)
        self.reset(agents)

    def reset_children(self, agents: int) -> None:
        """Halt the children that run for *agents*, and reset all, in order."""
        for child in self.children:
            if (child.running | child.success | child.failure) & agents:
                child.reset_by_parent(agents)


class BatchDecorator(BatchNode):
    """A node with one child."""

    def __init__(self, plan: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(plan, context, children)
        self.child = children[0]

    def execute(self, agents: int) -> Results:
        """Tick as any node; a child that has completed is reset."""
        results = super().execute(agents)
        child = self.child
        completed = child.success | child.failure
        if completed:
            child.reset(completed & agents)
        return results


def status_array(
    context: BatchContext, success: int, failure: int, running: int, skipped: int
) -> NDArray[np.uint8]:
    """One status for each agent, as a Status is numbered; of those in no set IDLE."""
    crowd = context.agent_sets
    # RUNNING, SUCCESS, FAILURE and SKIPPED are 1, 2, 3 and 4.
    low = crowd.mask(running | failure).view(np.uint8)
    high = crowd.mask(success | failure).view(np.uint8)
    found: NDArray[np.uint8] = low + (high << 1)
    if skipped:
        found += crowd.mask(skipped).view(np.uint8) << 2
    return found


class BatchConditions:
    """The compiled conditions of one node, in the order of :mod:`btcore.engine.conditions`."""

    def __init__(self, programs: Mapping[str, BatchProgram]) -> None:
        self.failure_if = programs.get("_failureIf")
        self.success_if = programs.get("_successIf")
        self.skip_if = programs.get("_skipIf")
        self.while_true = programs.get("_while")
        self.on_halted = programs.get("_onHalted")
        self.on_failure = programs.get("_onFailure")
        self.on_success = programs.get("_onSuccess")
        self.post = programs.get("_post")

    def execute(self, node: BatchNode, agents: int) -> Results:
        """Ask before, tick who is left, and run what follows."""
        success, failure, skipped, left = self.check_preconditions(node, agents)
        running = 0
        if left:
            ticked = node.tick(left)
            success |= node.drop_failed(ticked[0])
            failure |= node.drop_failed(ticked[1])
            running, more = ticked[2], ticked[3]
            skipped |= more
        self.run_postconditions(node, success, failure)
        return success, failure, running, skipped

    def check_preconditions(self, node: BatchNode, agents: int) -> tuple[int, int, int, int]:
        """Who succeeds, who fails and who is skipped without a tick, and who is to be ticked."""
        success = failure = skipped = 0
        idle = agents ^ node.not_idle(agents)
        left = agents ^ idle
        going = node.running & agents
        if idle and self.failure_if is not None:
            failure, idle = self.failure_if.split(idle)
        if idle and self.success_if is not None:
            success, idle = self.success_if.split(idle)
        if idle and self.skip_if is not None:
            skipped, idle = self.skip_if.split(idle)
        if self.while_true is not None:
            if idle:
                idle, stopped = self.while_true.split(idle)
                skipped |= stopped
            if going:
                goes_on, stopped = self.while_true.split(going)
                left ^= going ^ goes_on
                if stopped:
                    node.halt_node(stopped)
                    skipped |= node.drop_failed(stopped)
        return success, failure, skipped, left | idle

    def run_postconditions(self, node: BatchNode, success: int, failure: int) -> None:
        """Run what follows a completion."""
        if success and self.on_success is not None:
            self.on_success.run(success)
        if failure and self.on_failure is not None:
            self.on_failure.run(failure)
        if self.post is not None:
            ended = node.drop_failed(success | failure)
            if ended:
                self.post.run(ended)

    def run_on_halted(self, agents: int) -> None:
        """Run what follows a halt."""
        if self.on_halted is not None:
            self.on_halted.run(agents, "being halted")
