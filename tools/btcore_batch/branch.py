"""IfThenElse, WhileDoElse and Switch of a batch."""

from typing import Any, Final

from btcore.engine.node import TreeNode
from btcore.errors import NodeError
from btcore.nodes.switch import values_equal
from btcore_batch.agent_sets import AgentSet
from btcore_batch.context import BatchContext
from btcore_batch.node import NO_RESULTS, BatchNode, Results, merge_results
from btcore_batch.ports import BatchInput

_MAX_CHOICES: Final = 1000
"""The number of remembered choices of a Switch after which it forgets them."""


class BranchNode(BatchNode):
    """The base class of nodes with a condition and one or two branches."""

    def check_child_count(self, agents: AgentSet) -> bool:
        """Return whether there are two or three children; if not, record an error for *agents*."""
        count = len(self.children)
        if count in (2, 3):
            return True
        message = f"<{self.id}> takes a condition and one or two branches, not {count} children"
        self.context.fail(self, agents, NodeError(message))
        return False


class IfThenElse(BranchNode):
    """Ticks the condition once, then the branch that it has chosen."""

    def __init__(self, node: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(node, context, children)
        # For each child, the agents for which the condition has chosen it. Element 0, the condition, stays 0.
        self._chosen = [0, 0, 0]

    def tick(self, agents: AgentSet) -> Results:
        """Tick the condition for agents that have not chosen a branch, then the branches."""
        if not self.check_child_count(agents):
            return NO_RESULTS
        results = NO_RESULTS
        self.set_running(agents)
        chosen = self._chosen
        undecided = agents ^ (agents & (chosen[1] | chosen[2]))
        if undecided:
            true, false, running, skipped = self.children[0].execute(undecided)
            if skipped:
                error = NodeError("the condition was skipped, so that no branch can be chosen")
                self.context.fail(self, skipped, error)
            chosen[1] |= true
            if len(self.children) == 3:
                chosen[2] |= false
                false = 0
            results = (0, false, running, 0)
        for index in range(1, len(self.children)):
            going = chosen[index] & agents
            if going:
                branch_results = self.children[index].execute(going)
                success, failure, _, skipped = branch_results
                ended = success | failure | skipped
                chosen[index] ^= chosen[index] & ended
                self.reset_children(ended)
                results = merge_results(results, branch_results)
        return results

    def halt(self, agents: AgentSet) -> None:
        """Halt the children, and forget the choice: the next tick starts with the condition."""
        for index in (1, 2):
            self._chosen[index] ^= self._chosen[index] & agents
        super().halt(agents)


class WhileDoElse(BranchNode):
    """Ticks the condition in every tick, and the branch that it chooses."""

    def tick(self, agents: AgentSet) -> Results:
        """Tick the condition, and the branches that it chooses."""
        if not self.check_child_count(agents):
            return NO_RESULTS
        self.set_running(agents)
        children = self.children
        true, false, running, skipped = children[0].execute(agents)
        if skipped:
            self.reset_children(skipped)
            error = NodeError("the condition was skipped, so that no branch can be ticked")
            self.context.fail(self, skipped, error)
        results: Results = (0, 0, running, 0)
        if true:
            if len(children) == 3:
                children[2].reset_by_parent(true)
                true = self.drop_failed(true)
            results = merge_results(results, children[1].execute(true))
        if false and len(children) == 3:
            children[1].reset_by_parent(false)
            results = merge_results(results, children[2].execute(self.drop_failed(false)))
        else:
            results = merge_results(results, (0, false, 0, 0))
        success, failure, _, skipped = results
        if ended := success | failure | skipped:
            self.reset_children(ended)
        return results


class Switch(BatchNode):
    """Ticks the child whose case equals the variable, else the last child."""

    def __init__(self, node: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(node, context, children)
        self.variable = BatchInput(self, "variable")
        self.cases = [BatchInput(self, f"case_{number}") for number in range(1, node.spec.child_count[0])]
        self._running = [0] * len(children)
        # The index of the chosen child, by the values of the variable and the cases.
        self._choices: dict[tuple[Any, ...], int] = {}

    def tick(self, agents: AgentSet) -> Results:
        """Tick the child that each agent's values choose. If another child is RUNNING, halt it before."""
        children = self.children
        if len(children) != len(self.cases) + 1:
            message = f"<{self.id}> takes {len(self.cases)} cases and a default, not {len(children)} children"
            self.context.fail(self, agents, NodeError(message))
            return NO_RESULTS
        results = NO_RESULTS
        for index, due in enumerate(self._chosen(agents)):
            if not due:
                continue
            for other, running in enumerate(self._running):
                stopped = running & due
                if stopped and other != index:
                    children[other].reset_by_parent(stopped)
                    self._running[other] ^= stopped
            # A halt may have raised.
            due = self.drop_failed(due)
            success, failure, running, skipped = children[index].execute(due)
            self._running[index] = self._running[index] ^ (self._running[index] & due) | running
            self.reset_children(success | failure)
            results = merge_results(results, (success, failure, running, skipped))
        return results

    def _chosen(self, agents: AgentSet) -> list[AgentSet]:
        """Return, for each child, those of *agents* for which it is chosen."""
        chosen = [0] * len(self.children)
        groups: list[tuple[tuple[Any, ...], AgentSet]] = [((), agents)]
        for port in (self.variable, *self.cases):
            groups = [
                ((*values, value), subgroup)
                for values, group in groups
                for value, subgroup in port.groups(group, None)
            ]
        for values, group in groups:
            index = self._choices.get(values)
            if index is None:
                # The values may be different in every tick, for example coordinates.
                if len(self._choices) > _MAX_CHOICES:
                    self._choices.clear()
                self._choices[values] = index = self._choose(values)
            chosen[index] |= group
        return chosen

    def _choose(self, values: tuple[Any, ...]) -> int:
        """Return the index of the first case that equals the variable, else of the last child."""
        variable, *cases = values
        if variable is not None:
            for index, case in enumerate(cases):
                if case is not None and values_equal(variable, case, self.config.enums):
                    return index
        return len(cases)

    def halt(self, agents: AgentSet) -> None:
        """Halt the children."""
        for index, running in enumerate(self._running):
            self._running[index] = running ^ (running & agents)
        super().halt(agents)
