"""The shape of a tree node that has a server do its work: Nav2's action client as a node."""

import logging
from typing import Annotated, Any

from btcore import Blackboard, In, Out, StatefulAction, Status
from btcore_robot.navigation.action import ActionServer, GoalStatus
from btcore_robot.navigation.error_codes import Nav2ErrorCode
from btcore_robot.navigation.nodes.port_access import optional_input, write_outputs
from btcore_robot.navigation.servers import AnyGoalHandle

RECOVERIES = "number_recoveries"
"""The entry of the blackboard that counts recoveries; the navigator gives it as feedback."""

NS_PER_MS = 1_000_000
ACCEPTANCE = 1_000
"""How long (ms) a server may take to accept a goal, where the tree doesn't say."""

log = logging.getLogger(__name__)

ServerName = Annotated[In[str], "The server; there is one of each kind here."]
ServerTimeout = Annotated[In[int], "How long (ms) the server may take to accept the goal."]
ErrorCode = Annotated[Out[int], "Nav2's number of what went wrong; 0 when nothing did."]
ErrorMsg = Annotated[Out[str], "What went wrong, in words."]


class BtActionNode(StatefulAction):
    """Sends a goal: RUNNING while the server works; SUCCESS or FAILURE as it ends; a halt cancels it.

    A goal that somebody else cancelled is a SUCCESS. Why one fails is logged, but not again for the same
    reason. A subclass says which `server` and which `goal`.
    """

    handle: AnyGoalHandle | None = None
    sent = 0
    level = logging.WARNING
    """How its failures are logged."""
    logged = ""

    def server(self) -> ActionServer[Any, Any, Any]:
        """Who does the work."""
        raise NotImplementedError

    def make_goal(self) -> object:
        """What is asked for."""
        raise NotImplementedError

    def on_completion(self, handle: AnyGoalHandle) -> None:
        """The goal has ended: write outputs."""

    def on_wait_for_result(self, handle: AnyGoalHandle) -> None:
        """The goal has not ended: perhaps send another."""

    def on_start(self) -> Status:
        """Send the goal."""
        self.sent = self.now()
        self.handle = self.server().send_goal(self.make_goal())
        return Status.RUNNING

    def on_running(self) -> Status:
        """Look at it."""
        handle = self.handle
        if handle is None:
            return Status.FAILURE
        if not handle.done:
            if handle.status is GoalStatus.UNKNOWN and self.too_late():
                handle.cancel()
                self.report(int(Nav2ErrorCode.SEND_GOAL_FAILURE), "no server accepted the goal")
                return Status.FAILURE
            self.on_wait_for_result(handle)
            return Status.RUNNING
        self.handle = None
        result = handle.result
        if result is not None:
            self.report(result.code, result.message if handle.status is GoalStatus.ABORTED else "")
        self.on_completion(handle)
        return Status.FAILURE if handle.status is GoalStatus.ABORTED else Status.SUCCESS

    def on_halted(self) -> None:
        """Cancel the goal."""
        if self.handle is not None:
            self.handle.cancel()
            self.handle = None

    def report(self, code: int, message: str) -> None:
        """Write the error ports, and log a *message* that is news."""
        write_outputs(self, error_code_id=code, error_msg=message)
        if message and message != self.logged:
            log.log(self.level, "%s: %s", self.path, message)
        self.logged = message

    def too_late(self) -> bool:
        """Whether the server has had its time to accept the goal.

        Servers step less often here than Nav2's threads do, so that it is at least one second.
        """
        asked = optional_input(self, "server_timeout")
        allowed = max(ACCEPTANCE, int(asked) if isinstance(asked, int | float) else 0)
        return self.now() - self.sent > allowed * NS_PER_MS


def count_recovery(board: Blackboard) -> None:
    """Count one more recovery."""
    found = board.find(RECOVERIES)
    before = found.value if found is not None else 0
    board.set(RECOVERIES, int(before) + 1 if isinstance(before, int | float) else 1)
