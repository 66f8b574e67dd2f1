"""Base classes of the tree nodes that use the navigation servers, such as Nav2's `BtActionNode`."""

import logging
from typing import Annotated, Any, ClassVar

from btcore import (
    FAILURE,
    RUNNING,
    SUCCESS,
    Blackboard,
    In,
    NodeSpec,
    Out,
    Status,
    SyncAction,
)
from btcore.clock import NS_PER_MS
from btcore.engine.node import read_clock
from btcore_navigation.action import GoalStatus
from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_navigation.leaves.goal_leaf import GoalLeaf
from btcore_navigation.navigation_servers import AnyGoalHandle, NavigationServers
from btcore_navigation.nodes.port_access import OPTIONAL, optional_input, write_outputs

RECOVERIES = "number_recoveries"
"""The blackboard entry that counts recoveries; the navigator reports it in its feedback."""

MIN_ACCEPTANCE_MS = 1_000
"""The minimum time (ms) that a server has to accept a goal or to answer, for a shorter `server_timeout`."""

log = logging.getLogger(__name__)

ServerName = Annotated[
    In[str], "Action server name; empty: Nav2's default. Navigation in this process ignores it."
]
ServerTimeout = Annotated[In[int], "Server timeout (ms): the time to accept the goal; at least 1000."]
ServiceName = Annotated[
    In[str], "Service name; navigation in this process only selects the costmap by 'local' or 'global' in it."
]
ServiceTimeout = Annotated[In[int], "Server timeout (ms): the time to answer; at least 1000."]
ErrorCode = Annotated[Out[int], "Nav2's error code; 0 when there was no error."]
ErrorMsg = Annotated[Out[str], "The error message; empty when there was no error."]


class ServersAction(SyncAction):
    """Base of the actions that call the navigation servers and end within a tick."""

    spec = NodeSpec(state_fields=(), uses=frozenset())

    def __init__(self, servers: NavigationServers) -> None:
        self.servers = servers


class ServerNode(GoalLeaf):
    """Base of the nodes that wait for a server. The reason of a failure is logged once, until it changes.

    Attributes:
        sent: The time (ns) at which the goal or the request was sent.
        level: The level at which failures are logged.
        logged: The reason that was logged last.
    """

    spec = NodeSpec(uses=frozenset())

    sent = 0
    level = logging.WARNING
    logged = ""

    def __init__(self, servers: NavigationServers) -> None:
        self.servers = servers

    def has_timed_out(self, handle: AnyGoalHandle) -> bool:
        """Return whether the server's time to accept the goal of *handle*, or to answer it, is over.

        The time is at least `MIN_ACCEPTANCE_MS`: servers step less often here than Nav2's threads do,
        acceptance over ROS 2 takes Python some time, and Nav2's default of 20 ms would fail.
        """
        timeout = optional_input(self, "server_timeout")
        timeout_ms = max(MIN_ACCEPTANCE_MS, int(timeout) if isinstance(timeout, int | float) else 0)
        return self.has_passed(self.sent + timeout_ms * NS_PER_MS + handle.discovery_ns + 1)

    def log_failure(self, message: str) -> None:
        """Log *message* if it is not empty, and differs from the previous message."""
        if message and message != self.logged:
            log.log(self.level, "%s: %s", self.config.path, message)
        self.logged = message


class BtActionNode(ServerNode):
    """Sends a goal to a server: RUNNING while the server works, then SUCCESS or FAILURE.

    A halt cancels the goal. A goal that was cancelled elsewhere (by a Cancel node or by a newer goal)
    is a SUCCESS. A subclass provides `action` and `make_goal`.
    """

    action: ClassVar[str] = ""
    """Nav2's default name of the action."""

    server_name: ServerName = ""
    server_timeout: ServerTimeout = 20
    error_code_id: ErrorCode = OPTIONAL
    error_msg: ErrorMsg = OPTIONAL

    def make_goal(self) -> object:
        """Return the goal to send."""
        raise NotImplementedError

    def on_completion(self, handle: AnyGoalHandle) -> None:
        """Write the output ports when the goal has ended."""

    def on_wait_for_result(self, handle: AnyGoalHandle) -> None:
        """React to a goal that has not ended yet: write feedback, or send an updated goal."""

    def on_start(self) -> Status:
        """Send the goal."""
        handle = self.send(self.make_goal())
        return self.on_running() if handle.poll() else RUNNING

    def on_running(self) -> Status:
        """Check whether the server accepted or ended the goal."""
        handle = self.handle
        if handle is None:
            return FAILURE
        if not handle.poll():
            # UNKNOWN: the server has not accepted the goal yet.
            if handle.status is GoalStatus.UNKNOWN and self.has_timed_out(handle):
                handle.cancel()
                self.handle = None
                code = int(Nav2ErrorCode.SEND_GOAL_FAILURE)
                # The handle still holds the reason when the navigator looks for the cause of its failure.
                handle.abort(code, handle.missing_acceptance)
                self.report(code, handle.missing_acceptance)
                self.on_completion(handle)
                return FAILURE
            self.on_wait_for_result(handle)
            return RUNNING
        self.handle = None
        result = handle.result
        if result is not None:
            self.report(result.code, result.message if handle.status is GoalStatus.ABORTED else "")
        self.on_completion(handle)
        return FAILURE if handle.status is GoalStatus.ABORTED else SUCCESS

    def send(self, goal: object) -> AnyGoalHandle:
        """Send *goal* in place of the present goal, which is not cancelled, and return its handle."""
        self.sent = read_clock(self)
        self.handle = self.servers.send_goal(goal, self.action, self.server_name)
        return self.handle

    def report(self, code: int, message: str) -> None:
        """Write the connected error ports, and log the message.

        Args:
            code: Nav2's error code; 0 without an error.
            message: The error message. An empty message is not logged.
        """
        write_outputs(self, error_code_id=code, error_msg=message)
        self.log_failure(message)


class BtServiceNode(ServerNode):
    """Sends a request to a service: RUNNING until the response arrives, then SUCCESS or FAILURE.

    Navigation in this process answers at once. A halt ignores the response. A subclass provides `send`.
    """

    server_timeout: ServiceTimeout = 20

    spec = NodeSpec(may_complete_on_start=True)

    def send(self) -> AnyGoalHandle:
        """Send the request and return its handle."""
        raise NotImplementedError

    def on_response(self, value: Any) -> bool:
        """Write the outputs for the *value* of a response, and return whether the node succeeds."""
        return True

    def on_failure(self) -> None:
        """Write the outputs after a failed request."""

    def tick(self) -> Status:
        """Send the request, or check for the response. A completed node sends its request again."""
        return self.on_running() if self.status is RUNNING else self.on_start()

    def on_start(self) -> Status:
        """Send the request."""
        self.sent = read_clock(self)
        self.handle = self.send()
        return self.on_running()

    def on_running(self) -> Status:
        """Check for the response."""
        handle = self.handle
        if handle is None:
            return FAILURE
        if not handle.poll():
            if not self.has_timed_out(handle):
                return RUNNING
            handle.cancel()
            return self.fail(handle.missing_acceptance)
        if handle.status is not GoalStatus.SUCCEEDED:
            return self.fail(handle.result.message if handle.result is not None else "")
        self.handle = None
        self.logged = ""
        value = handle.result.value if handle.result is not None else None
        return SUCCESS if self.on_response(value) else FAILURE

    def fail(self, message: str) -> Status:
        """Log *message*, and return FAILURE."""
        self.handle = None
        self.log_failure(message)
        self.on_failure()
        return FAILURE


def count_recovery(board: Blackboard) -> None:
    """Increment the blackboard's counter of recoveries."""
    entry = board.find(RECOVERIES)
    count = entry.value if entry is not None else 0
    board.set(RECOVERIES, int(count) + 1 if isinstance(count, int | float) else 1)
