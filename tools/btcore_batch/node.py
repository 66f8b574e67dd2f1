"""The base classes of all nodes of a batch: ticking, halting and stored statuses.

A parameter *agents* is a set of agents (see `btcore_batch.agent_sets`), and so are stored statuses. For
each agent, the order within a tick is the same as in `btcore.engine.node`. The order among agents does
not matter, because agents share no state.
"""

from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from btcore.diagnostic_codes import NOT_FOR_A_BATCH
from btcore.diagnostics import Diagnostic
from btcore.engine.node import TreeNode
from btcore.engine.node_config import NodeConfig
from btcore.errors import TreeError
from btcore_batch.agent_sets import AgentSet
from btcore_batch.context import BatchContext, NodeLike
from btcore_batch.script import BatchProgram

Results: TypeAlias = tuple[AgentSet, AgentSet, AgentSet, AgentSet]
"""The sets of the agents with the results SUCCESS, FAILURE, RUNNING and SKIPPED, in this order.

Agents for which a node has raised an exception are in no set.
"""

NO_RESULTS: Final[Results] = (0, 0, 0, 0)


def merge_results(first: Results, second: Results) -> Results:
    """Return the results of two groups of agents in one tuple."""
    return first[0] | second[0], first[1] | second[1], first[2] | second[2], first[3] | second[3]


def unsupported(config: NodeConfig, message: str, hint: str = "") -> TreeError:
    """Return the error about a node that the batch engine cannot run."""
    return TreeError([Diagnostic(NOT_FOR_A_BATCH, message, config.file, config.line, hint=hint)])


class BatchNode:
    """A node of a batch.

    Constructors raise TreeError if the batch engine cannot run the node as it is used in the tree.

    Args:
        node: The node of the ordinary tree that this node replaces.
        context: The shared state of the batch.
        children: The children, in order.

    Attributes:
        board: The blackboard of the node's scope.
        success: The agents for which SUCCESS is stored. An agent in none of the sets is IDLE. SKIPPED is
            never stored, as in the ordinary engine.
        failure: The agents for which FAILURE is stored.
        running: The agents for which RUNNING is stored.
        config: The place of the node in the tree, its ports and its scripts.
        name: The name of the instance.
        id: The ID of the node's class.
        uid: The number of the node in the tree, from 1.
        path: The path of the node.
        parent: The parent, or None for the root.
        conditions: The pre- and postconditions, or None without any.
    """

    children: list["BatchNode"]

    def __init__(self, node: TreeNode, context: BatchContext, children: list["BatchNode"]) -> None:
        config: NodeConfig = node.config
        self.config = config
        self.name = config.name
        self.id = config.id
        self.uid = config.uid
        self.path = config.path
        self.parent: NodeLike | None = None
        self.context = context
        self.board = context.columns.scopes[id(node._blackboard)]
        self.children = children
        for child in children:
            child.parent = self
        self.conditions: BatchConditions | None = BatchConditions(self) if config.conditions else None
        self.success = 0
        self.failure = 0
        self.running = 0

    @property
    def status(self) -> NDArray[np.uint8]:
        """The stored status of each agent, as the integer value of its `Status`, shape (agents,)."""
        return status_array(self.context, self.success, self.failure, self.running, 0)

    def __repr__(self) -> str:
        return f"<{self.id} '{self.path}' for {self.context.agent_sets.count} agents>"

    # --- ticking

    def tick(self, agents: AgentSet) -> Results:
        """Execute the node's own behavior for *agents*, without its conditions.

        Returns:
            The agents by result.
        """
        raise NotImplementedError

    def execute(self, agents: AgentSet) -> Results:
        """Tick the node for *agents*, with its conditions, and store the results. Called by the parent.

        Returns:
            The agents by result.
        """
        conditions = self.conditions
        results = self.tick(agents) if conditions is None else conditions.execute(self, agents)
        success, failure, running, skipped = results
        if self.context.raised:
            # Agents for which this node or a node below it has raised are in no result.
            drop = self.drop_failed
            success, failure, running, skipped = drop(success), drop(failure), drop(running), drop(skipped)
        self.store(success, failure, running)
        return success, failure, running, skipped

    def store(self, success: AgentSet, failure: AgentSet, running: AgentSet) -> None:
        """Store the results of a tick. The statuses of agents in none of the sets do not change.

        Args:
            success: The set of agents whose result is SUCCESS.
            failure: The set of agents whose result is FAILURE.
            running: The set of agents whose result is RUNNING.
        """
        done = success | failure | running
        # Most sets are empty in most ticks, so the tests save operations.
        before = self.success
        self.success = before ^ (before & done) | success if before else success
        before = self.failure
        self.failure = before ^ (before & done) | failure if before else failure
        before = self.running
        self.running = before ^ (before & done) | running if before else running

    def set_running(self, agents: AgentSet) -> None:
        """Store RUNNING for *agents*."""
        self.running |= agents
        if self.success:
            self.success ^= self.success & agents
        if self.failure:
            self.failure ^= self.failure & agents

    def not_idle(self, agents: AgentSet) -> AgentSet:
        """Return those of *agents* for which the node is not IDLE."""
        return agents & (self.running | self.success | self.failure)

    def drop_failed(self, agents: AgentSet) -> AgentSet:
        """Return those of *agents* for which no node has raised in this tick."""
        raised = self.context.raised
        return agents ^ (agents & raised) if raised else agents

    # --- halting

    def reset(self, agents: AgentSet) -> None:
        """Store IDLE for *agents*."""
        if self.success:
            self.success ^= self.success & agents
        if self.failure:
            self.failure ^= self.failure & agents
        if self.running:
            self.running ^= self.running & agents

    def halt(self, agents: AgentSet) -> None:
        """Halt the RUNNING children for *agents*, and store IDLE."""
        self.reset_children(agents)
        self.reset(agents)

    def halt_node(self, agents: AgentSet) -> None:
        """Halt the node for *agents*, and run `_onHalted`. Called by the parent."""
        self.halt(agents)
        if self.conditions is not None:
            self.conditions.run_on_halted(agents)

    def reset_by_parent(self, agents: AgentSet) -> None:
        """Halt the node for those of *agents* for which it is RUNNING, and store IDLE for all of them."""
        running = self.running & agents
        if running:
            self.halt_node(running)
        self.reset(agents)

    def reset_children(self, agents: AgentSet) -> None:
        """Reset all children for *agents*, in order, which halts RUNNING children."""
        for child in self.children:
            if (child.running | child.success | child.failure) & agents:
                child.reset_by_parent(agents)


class BatchDecorator(BatchNode):
    """A node with one child."""

    def __init__(self, node: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(node, context, children)
        self.child = children[0]

    def execute(self, agents: AgentSet) -> Results:
        """Tick the node, then reset the child for the agents for which it has completed."""
        results = super().execute(agents)
        child = self.child
        completed = child.success | child.failure
        if completed:
            child.reset(completed & agents)
        return results


def status_array(
    context: BatchContext, success: AgentSet, failure: AgentSet, running: AgentSet, skipped: AgentSet
) -> NDArray[np.uint8]:
    """Return the status of each agent as an integer, shape (agents,); IDLE for agents in no set."""
    agent_sets = context.agent_sets
    # RUNNING, SUCCESS, FAILURE and SKIPPED are 1, 2, 3 and 4: each of the three bits is a set of agents.
    low = agent_sets.mask(running | failure).view(np.uint8)
    high = agent_sets.mask(success | failure).view(np.uint8)
    statuses: NDArray[np.uint8] = low + (high << 1)
    if skipped:
        statuses += agent_sets.mask(skipped).view(np.uint8) << 2
    return statuses


class BatchConditions:
    """The compiled pre- and post-conditions of one node, in the order of `btcore.engine.node`."""

    def __init__(self, node: BatchNode) -> None:
        programs = {key: BatchProgram(text, node) for key, text in node.config.conditions.items()}
        self.failure_if = programs.get("_failureIf")
        self.success_if = programs.get("_successIf")
        self.skip_if = programs.get("_skipIf")
        self.while_true = programs.get("_while")
        self.on_halted = programs.get("_onHalted")
        self.on_failure = programs.get("_onFailure")
        self.on_success = programs.get("_onSuccess")
        self.post = programs.get("_post")

    def execute(self, node: BatchNode, agents: AgentSet) -> Results:
        """Evaluate the pre-conditions, tick the node for the other agents, and run the post-conditions."""
        success, failure, skipped, remaining = self.check_preconditions(node, agents)
        running = 0
        if remaining:
            succeeded, failed, running, not_ticked = node.tick(remaining)
            success |= node.drop_failed(succeeded)
            failure |= node.drop_failed(failed)
            skipped |= not_ticked
        self.run_postconditions(node, success, failure)
        return success, failure, running, skipped

    def check_preconditions(
        self, node: BatchNode, agents: AgentSet
    ) -> tuple[AgentSet, AgentSet, AgentSet, AgentSet]:
        """Return the agents with SUCCESS, FAILURE and SKIPPED due to a pre-condition, and those to tick."""
        success = failure = skipped = 0
        idle = agents ^ node.not_idle(agents)
        remaining = agents ^ idle
        going = node.running & agents
        if idle and self.failure_if is not None:
            failure, idle = self.failure_if.split(idle)
        if idle and self.success_if is not None:
            success, idle = self.success_if.split(idle)
        if idle and self.skip_if is not None:
            skipped, idle = self.skip_if.split(idle)
        # The other pre-conditions are evaluated only before a node starts.
        if self.while_true is not None:
            if idle:
                idle, stopped = self.while_true.split(idle)
                skipped |= stopped
            if going:
                continues, stopped = self.while_true.split(going)
                remaining ^= going ^ continues
                if stopped:
                    node.halt_node(stopped)
                    skipped |= node.drop_failed(stopped)
        return success, failure, skipped, remaining | idle

    def run_postconditions(self, node: BatchNode, success: AgentSet, failure: AgentSet) -> None:
        """Run `_onSuccess`, `_onFailure` and `_post` for the agents with these results."""
        if success and self.on_success is not None:
            self.on_success.run(success)
        if failure and self.on_failure is not None:
            self.on_failure.run(failure)
        if self.post is not None:
            completed = node.drop_failed(success | failure)
            if completed:
                self.post.run(completed)

    def run_on_halted(self, agents: AgentSet) -> None:
        """Run `_onHalted` for *agents*, if the node has this script."""
        if self.on_halted is not None:
            self.on_halted.run(agents, "being halted")
