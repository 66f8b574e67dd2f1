"""Base classes of the tree nodes that use the navigation servers, such as Nav2's `BtActionNode`."""

import logging
from typing import Annotated, Any

from btcore import Blackboard, In, Out, StatefulAction, Status, SyncAction
from btcore_robot.navigation.action import ActionServer, GoalStatus
from btcore_robot.navigation.error_codes import Nav2ErrorCode
from btcore_robot.navigation.nodes.port_access import OPTIONAL, optional_input, write_outputs
from btcore_robot.navigation.servers import AnyGoalHandle, Servers

RECOVERIES = "number_recoveries"
"""The blackboard entry that counts recoveries; the navigator reports it in its feedback."""

NS_PER_MS = 1_000_000
MIN_ACCEPTANCE_MS = 1_000
"""The minimum time (ms) that a server has to accept a goal, whatever `server_timeout` says."""

log = logging.getLogger(__name__)

ServerName = Annotated[In[str], "Action server name; not used here: there is one server of each kind."]
ServerTimeout = Annotated[In[int], "Server timeout (ms): the time to accept the goal."]
ErrorCode = Annotated[Out[int], "Nav2's error code; 0 when there was no error."]
ErrorMsg = Annotated[Out[str], "The error message; empty when there was no error."]


class ServersAction(SyncAction):
    """Base of the actions that call the navigation servers and end within a tick."""

    state_fields = ()

    def __init__(self, servers: Servers) -> None:
        self.servers = servers


class BtActionNode(StatefulAction):
    """Send a goal to a server: RUNNING while the server works, then SUCCESS or FAILURE.

    A halt cancels the goal. A goal that was cancelled elsewhere (by a Cancel node or by a newer goal)
    is a SUCCESS. The reason of a failure is logged once, until the reason changes. A subclass provides
    `server` and `make_goal`.
    """

    server_name: ServerName = ""
    server_timeout: ServerTimeout = 20
    error_code_id: ErrorCode = OPTIONAL
    error_msg: ErrorMsg = OPTIONAL

    handle: AnyGoalHandle | None = None
    sent = 0
    level = logging.WARNING
    """The level at which failures are logged."""
    logged = ""

    state_fields = None  # the goal and its handle belong to the server

    def __init__(self, servers: Servers) -> None:
        self.servers = servers

    def server(self) -> ActionServer[Any, Any, Any]:
        """Return the server that works on the goal."""
        raise NotImplementedError

    def make_goal(self) -> object:
        """Return the goal to send."""
        raise NotImplementedError

    def on_completion(self, handle: AnyGoalHandle) -> None:
        """Write the output ports when the goal has ended."""

    def on_wait_for_result(self, handle: AnyGoalHandle) -> None:
        """React to a goal that has not ended yet: write feedback, or send an updated goal."""

    def on_start(self) -> Status:
        """Send the goal."""
        self.sent = self.now()
        self.handle = self.server().send_goal(self.make_goal())
        return Status.RUNNING

    def on_running(self) -> Status:
        """Check whether the server accepted or ended the goal."""
        handle = self.handle
        if handle is None:
            return Status.FAILURE
        if not handle.done:
            # UNKNOWN: the server has not accepted the goal yet.
            if handle.status is GoalStatus.UNKNOWN and self.acceptance_timed_out():
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
        """Write the connected error ports, and log the message if it differs from the previous message.

        Args:
            code: Nav2's error code; 0 without an error.
            message: The error message. An empty message is not logged.
        """
        write_outputs(self, error_code_id=code, error_msg=message)
        if message and message != self.logged:
            log.log(self.level, "%s: %s", self.path, message)
        self.logged = message

    def acceptance_timed_out(self) -> bool:
        """Return whether the server's time to accept the goal is over.

        The time is at least `MIN_ACCEPTANCE_MS`: servers step less often here than Nav2's threads do,
        and Nav2's default of 20 ms would fail.
        """
        timeout = optional_input(self, "server_timeout")
        timeout_ms = max(MIN_ACCEPTANCE_MS, int(timeout) if isinstance(timeout, int | float) else 0)
        return self.now() - self.sent > timeout_ms * NS_PER_MS


def count_recovery(board: Blackboard) -> None:
    """Increment the blackboard's counter of recoveries."""
    entry = board.find(RECOVERIES)
    count = entry.value if entry is not None else 0
    board.set(RECOVERIES, int(count) + 1 if isinstance(count, int | float) else 1)
