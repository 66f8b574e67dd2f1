"""The scripts that any node may carry: ``_skipIf``, ``_while``, ``_onSuccess`` and their kin.

Evaluated on the blackboard of the node's own scope; for a SubTree element that is the scope
around it.
"""

from collections.abc import Mapping

from btcore.blackboard.blackboard import Blackboard
from btcore.script.program import Program, compile_script, condition_result
from btcore.status import (
    FAILURE,
    IDLE,
    RUNNING,
    SKIPPED,
    SUCCESS,
    Status,
)


class ConditionScripts:
    """The compiled pre- and post-conditions of one node."""

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
        """What decides instead of a tick, for a node that stands at *status*; IDLE = nothing does.

        ``_failureIf``, ``_successIf`` and ``_skipIf`` are asked of a node that does not run;
        ``_while`` also of one that does, which is then to be halted.
        """
        if status is IDLE or status is SKIPPED:
            if self.failure_if is not None and condition_result(self.failure_if.run(self.blackboard)):
                return FAILURE
            if self.success_if is not None and condition_result(self.success_if.run(self.blackboard)):
                return SUCCESS
            if self.skip_if is not None and condition_result(self.skip_if.run(self.blackboard)):
                return SKIPPED
            if self.while_true is not None and not condition_result(self.while_true.run(self.blackboard)):
                return SKIPPED
        elif (
            status is RUNNING
            and self.while_true is not None
            and not condition_result(self.while_true.run(self.blackboard))
        ):
            return SKIPPED
        return IDLE

    def run_postconditions(self, status: Status) -> None:
        """Run what follows a completed *status*."""
        if status is SUCCESS:
            if self.on_success is not None:
                self.on_success.run(self.blackboard)
        elif self.on_failure is not None:
            self.on_failure.run(self.blackboard)
        if self.post is not None:
            self.post.run(self.blackboard)

    def run_on_halted(self) -> None:
        """Run what follows a halt."""
        if self.on_halted is not None:
            self.on_halted.run(self.blackboard)
