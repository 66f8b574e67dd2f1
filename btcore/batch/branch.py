"""Branches and switches for a batch."""

from collections.abc import Mapping
from typing import ClassVar

from btcore.batch.context import BatchContext
from btcore.batch.node import NO_RESULTS, BatchNode, Results, merge_results
from btcore.batch.ports import BatchInput
from btcore.engine.node import TreeNode
from btcore.errors import NodeError
from btcore.nodes.switch import values_equal


class BranchNode(BatchNode):
    """A node of two or three children: a condition, then, and else."""

    def are_enough(self, agents: int) -> bool:
        """Whether there are two or three children; if not, the tick of *agents* fails."""
        count = len(self.children)
        if count in (2, 3):
            return True
        said = f"<{self.id}> takes a condition and one or two branches, not {count} children"
        self.context.fail(self, agents, NodeError(said))
        return False


class IfThenElse(BranchNode):
    """Ticks the condition once, then the branch that it chose."""

    def __init__(self, plan: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(plan, context, children)
        self._chosen = [0, 0, 0]

    def tick(self, agents: int) -> Results:
        """Choose a branch for whom none is chosen, and tick it."""
        if not self.are_enough(agents):
            return NO_RESULTS
        results = NO_RESULTS
        self.set_running(agents)
        chosen = self._chosen
        asking = agents ^ (agents & (chosen[1] | chosen[2]))
        if asking:
            true, false, running, none = self.children[0].execute(asking)
            if none:
                fault = NodeError("the condition was skipped, so that no branch can be chosen")
                self.context.fail(self, none, fault)
            chosen[1] |= true
            if len(self.children) == 3:
                chosen[2] |= false
                false = 0
            results = (0, false, running, 0)
        for branch in range(1, len(self.children)):
            going = chosen[branch] & agents
            if going:
                found = self.children[branch].execute(going)
                ended = found[0] | found[1] | found[3]
                chosen[branch] ^= chosen[branch] & ended
                self.reset_children(ended)
                results = merge_results(results, found)
        return results

    def halt(self, agents: int) -> None:
        """Halt the children; the condition decides anew next time."""
        for branch in (1, 2):
            self._chosen[branch] ^= self._chosen[branch] & agents
        self.reset_children(agents)
        self.reset(agents)


class WhileDoElse(BranchNode):
    """Ticks the condition on every tick, and the branch that it asks for."""

    def tick(self, agents: int) -> Results:
        """Tick the condition, and the branch that it asks for."""
        if not self.are_enough(agents):
            return NO_RESULTS
        self.set_running(agents)
        children = self.children
        three = len(children) == 3
        true, false, running, none = children[0].execute(agents)
        success = failure = skipped = 0
        if none:
            self.reset_children(none)
            fault = NodeError("the condition was skipped, so that no branch can be ticked")
            self.context.fail(self, none, fault)
        if true:
            if three:
                children[2].reset_by_parent(true)
                true = self.drop_failed(true)
            success, failure, runs, skipped = children[1].execute(true)
            running |= runs
        if false and three:
            children[1].reset_by_parent(false)
            succeeded, failed, runs, more = children[2].execute(self.drop_failed(false))
            success |= succeeded
            failure |= failed
            running |= runs
            skipped |= more
        elif false:
            failure |= false
        ended = success | failure | skipped
        if ended:
            self.reset_children(ended)
        return success, failure, running, skipped


class Switch(BatchNode):
    """Ticks the child whose case equals the variable, else the last child."""

    input_ports: ClassVar[Mapping[str, str]] = {"variable": "variable"}
    variable: BatchInput
    cases: list[BatchInput]

    def __init__(self, plan: TreeNode, context: BatchContext, children: list[BatchNode]) -> None:
        super().__init__(plan, context, children)
        self._running = [0] * len(children)
        self._known: dict[tuple[str | None, ...], int] = {}

    def tick(self, agents: int) -> Results:
        """Tick the child that is due."""
        children = self.children
        if len(children) != len(self.cases) + 1:
            said = f"<{self.id}> takes {len(self.cases)} cases and a default, not {len(children)} children"
            self.context.fail(self, agents, NodeError(said))
            return NO_RESULTS
        results = NO_RESULTS
        for index, due in enumerate(self._chosen(agents)):
            if not due:
                continue
            for other, before in enumerate(self._running):
                stopped = before & due
                if stopped and other != index:
                    children[other].reset_by_parent(stopped)
                    self._running[other] ^= stopped
            due = self.drop_failed(due)
            found = children[index].execute(due)
            self._running[index] = self._running[index] ^ (self._running[index] & due) | found[2]
            self.reset_children(found[0] | found[1])
            results = merge_results(results, found)
        return results

    def _chosen(self, agents: int) -> list[int]:
        """For each child, who is to tick it."""
        chosen = [0] * len(self.children)
        groups: list[tuple[tuple[str | None, ...], int]] = [((), agents)]
        for port in (self.variable, *self.cases):
            groups = [
                ((*texts, text), some)
                for texts, group in groups
                for text, some in port.groups_or(group, None)
            ]
        for texts, some in groups:
            index = self._known.get(texts)
            if index is None:
                if len(self._known) > 1000:
                    self._known.clear()
                self._known[texts] = index = self._choose(texts)
            chosen[index] |= some
        return chosen

    def _choose(self, texts: tuple[str | None, ...]) -> int:
        variable, *cases = texts
        if variable is not None:
            for index, case in enumerate(cases):
                if case is not None and values_equal(variable, case, self.config.enums):
                    return index
        return len(cases)

    def halt(self, agents: int) -> None:
        """Halt the children; nothing runs."""
        for index, running in enumerate(self._running):
            self._running[index] = running ^ (running & agents)
        self.reset_children(agents)
        self.reset(agents)
