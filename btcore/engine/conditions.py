"""The pre- and post-conditions of a node, such as `_skipIf` and `_onSuccess`."""

from collections.abc import Mapping
from typing import Final

from btcore.blackboard.blackboard import Blackboard
from btcore.script.program import Program, compile_script, condition_result
from btcore.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Status

UNDECIDED: Final = IDLE
"""Stands for a result that the pre-conditions leave to the node; a node returns IDLE only in format 3."""


class NodeConditions:
    """The compiled pre- and post-conditions of one node.

    The scripts run on the blackboard of the node's scope: for a SubTree node, the scope of the outer tree.
    """

    def __init__(self, scripts: Mapping[str, str], enums: Mapping[str, int], blackboard: Blackboard) -> None:
        programs = {key: compile_script(text, enums) for key, text in scripts.items()}
        self.blackboard = blackboard
        self.failure_if: Program | None = programs.get("_failureIf")
        self.success_if: Program | None = programs.get("_successIf")
        self.skip_if: Program | None = programs.get("_skipIf")
        self.while_true: Program | None = programs.get("_while")
        self.on_halted: Program | None = programs.get("_onHalted")
        self.on_failure: Program | None = programs.get("_onFailure")
        self.on_success: Program | None = programs.get("_onSuccess")
        self.post: Program | None = programs.get("_post")

    def check_preconditions(self, status: Status) -> Status:
        """Check the pre-conditions of a node before a tick.

        `_failureIf`, `_successIf` and `_skipIf` are evaluated before a node starts. `_while` is also
        evaluated while the node is RUNNING; if it is false then, the caller must halt the node.

        Args:
            status: The status of the node before the tick.

        Returns:
            The result of the node, which is then not ticked; UNDECIDED = the node must be ticked.
        """
        # A node that stores SKIPPED itself, by set_status(), is not active either, as in BehaviorTree.CPP.
        if status is IDLE or status is SKIPPED:
            if self.failure_if is not None and condition_result(self.failure_if.run(self.blackboard)):
                return FAILURE
            if self.success_if is not None and condition_result(self.success_if.run(self.blackboard)):
                return SUCCESS
            if self.skip_if is not None and condition_result(self.skip_if.run(self.blackboard)):
                return SKIPPED
        elif status is not RUNNING:
            # A node that has completed and was not reset is ticked without pre-conditions.
            return UNDECIDED
        if self.while_true is not None and not condition_result(self.while_true.run(self.blackboard)):
            return SKIPPED
        return UNDECIDED

    def run_postconditions(self, status: Status) -> None:
        """Run `_onSuccess` or `_onFailure`, depending on the result *status*, and then `_post`."""
        if status is SUCCESS:
            if self.on_success is not None:
                self.on_success.run(self.blackboard)
        elif self.on_failure is not None:
            self.on_failure.run(self.blackboard)
        if self.post is not None:
            self.post.run(self.blackboard)

    def run_on_halted(self) -> None:
        """Run `_onHalted`."""
        if self.on_halted is not None:
            self.on_halted.run(self.blackboard)
