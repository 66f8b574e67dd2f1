"""The conditions around the ticks of a node: ``_skipIf``, ``_while``, ``_onSuccess`` and their kin."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from btcore.batch.node import BatchNode, Results
    from btcore.batch.script import BatchProgram


class BatchConditions:
    """The compiled conditions of one node, in the order of :mod:`btcore.engine.conditions`."""

    def __init__(self, programs: "Mapping[str, BatchProgram]") -> None:
        self.failure_if = programs.get("_failureIf")
        self.success_if = programs.get("_successIf")
        self.skip_if = programs.get("_skipIf")
        self.while_true = programs.get("_while")
        self.on_halted = programs.get("_onHalted")
        self.on_failure = programs.get("_onFailure")
        self.on_success = programs.get("_onSuccess")
        self.post = programs.get("_post")

    def execute(self, node: "BatchNode", agents: int) -> "Results":
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

    def check_preconditions(self, node: "BatchNode", agents: int) -> tuple[int, int, int, int]:
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

    def run_postconditions(self, node: "BatchNode", success: int, failure: int) -> None:
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
