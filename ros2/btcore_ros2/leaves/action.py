"""The base class of leaves that send a goal to an action server."""

import enum
import logging
from typing import Annotated, Any

from btcore import FAILURE, RUNNING, SUCCESS, In, NodeError
from btcore_navigation.action import GoalStatus
from btcore_ros2.interfaces import interface_name
from btcore_ros2.leaves.endpoint import Endpoint, interface_of
from btcore_ros2.leaves.goal import ClientGoal
from btcore_ros2.leaves.results import completed
from btcore_ros2.leaves.server_leaf import ServerLeaf
from btcore_ros2.leaves.visible_names import hint_for_action
from btcore_ros2.session import RosSession

log = logging.getLogger(__name__)


class ActionErrorCode(enum.Enum):
    """Why a goal failed. The names are those of BehaviorTree.ROS2's `ActionNodeErrorCode`."""

    SERVER_UNREACHABLE = enum.auto()
    """No server offers the action, or the server disappeared while it worked on the goal."""
    SEND_GOAL_TIMEOUT = enum.auto()
    """The server has neither accepted nor rejected the goal in time."""
    GOAL_REJECTED_BY_SERVER = enum.auto()
    """The server rejected the goal."""
    ACTION_ABORTED = enum.auto()
    """The server aborted the goal."""
    ACTION_CANCELLED = enum.auto()
    """The goal was cancelled, but not by this leaf."""
    INVALID_GOAL = enum.auto()
    """`make_goal` returned None."""


class RosAction(ServerLeaf):
    """Sends a goal to an action server: RUNNING while the server works, then the result of a callback.

    A subclass sets `action_type`, a default for the port `action_name`, and implements `make_goal`. It may
    override `on_feedback`, `on_result` and `on_failure`. The callbacks run during ticks of the leaf.

    When the leaf is halted, the goal is cancelled. The halt does not wait for the server: the cancellation is
    followed up in the background, and its outcome is logged. To clean up, override `on_halted` and call
    `super().on_halted()`.

    The server has no time limit for its work. Set a limit with the decorator `<Timeout>`. If the server
    process disappears, the goal fails with SERVER_UNREACHABLE: immediately after a clean shutdown, and up to
    20 s after a crash, because DDS detects a crash by missing signs of life.

    Args:
        session: The session, a resource of the tree.

    Examples:
        >>> from btcore import In
        >>> from btcore_ros2.leaves import RosAction
        >>> class Count(RosAction):
        ...     action_name = "fibonacci"
        ...     action_type = "test_msgs/action/Fibonacci"
        ...     order: In[int]
        ...     def make_goal(self):
        ...         return self.action_type.Goal(order=self.order)
    """

    action_name: Annotated[In[str], "Action server name."] = ""

    action_type: Any = None
    """The class of the action, or its name, such as `nav2_msgs/action/NavigateToPose`.

    With a name, the file of the leaf needs no import of ROS 2.
    """
    last_result: Any = None
    """The result message of the last goal, also of an aborted goal; None before."""

    _goal: ClientGoal | None = None

    def __init__(self, session: RosSession) -> None:
        self.session = session
        self.action_type = interface_of(self, "action_type", "action")
        self._endpoint = Endpoint(self, session, "action_name", ("action", self.action_type), self._connect)

    def _connect(self, name: str) -> Any:
        from rclpy.action import ActionClient

        return ActionClient(
            self.session.node, self.action_type, name, callback_group=self.session.callback_group
        )

    # --- for subclasses

    def make_goal(self) -> Any:
        """Return the goal message, or None to fail with INVALID_GOAL. Called when the leaf starts.

        Raises:
            NodeError: The subclass does not implement the method.
        """
        raise NodeError(f"{type(self).__name__} has no make_goal()")

    def on_feedback(self, feedback: Any) -> Any:
        """Process a message of feedback. Called for each message, in order.

        Returns:
            RUNNING or None to continue. SUCCESS (True) or FAILURE (False) cancel the goal, and are the result
            of the leaf.
        """
        return RUNNING

    def on_result(self, result: Any) -> Any:
        """Process the result of a goal that succeeded.

        Args:
            result: The result message.

        Returns:
            SUCCESS (True) or FAILURE (False), the result of the leaf.
        """
        return SUCCESS

    def on_failure(self, error: ActionErrorCode) -> Any:
        """Process a failure. `error_message` describes it, and is logged already.

        Args:
            error: The kind of failure.

        Returns:
            SUCCESS (True) or FAILURE (False), the result of the leaf.
        """
        return FAILURE

    # --- the engine

    def on_start(self) -> Any:
        """Create the goal, and send it if the server is ready."""
        self.session.refresh()
        self._goal = None
        self._endpoint.get()
        return self._check_and_send(self.action_type, "Goal", self.make_goal(), ActionErrorCode.INVALID_GOAL)

    def on_running(self) -> Any:
        """Process the answers of the server that have arrived since the last tick."""
        self.session.refresh()
        goal = self._goal
        if goal is None:
            return self._send()
        server = self._endpoint.name
        if goal.accepted is None and not goal.is_lost:
            if not self._is_late():
                return RUNNING
            goal.cancel()
            return self._fail(
                ActionErrorCode.SEND_GOAL_TIMEOUT,
                f"the action server '{server}' did not answer the goal within {self.server_timeout} ms: "
                "check that it runs and is not blocked, or increase server_timeout",
            )
        if goal.accepted is False:
            return self._fail(
                ActionErrorCode.GOAL_REJECTED_BY_SERVER,
                f"the action server '{server}' rejected the goal: its log may contain the reason",
            )
        while goal.feedback:
            status = self.on_feedback(goal.feedback.popleft())
            if status is not None and status is not RUNNING:
                goal.cancel()
                self._end()
                return completed(status, "on_feedback()", "RUNNING, SUCCESS or FAILURE")
        if not goal.done:
            return RUNNING
        self.last_result = goal.result
        if goal.is_lost:
            return self._fail(
                ActionErrorCode.SERVER_UNREACHABLE,
                f"the action server '{server}' disappeared while it worked on the goal: its process ended or "
                "was started again, or the network failed",
            )
        if goal.status is GoalStatus.ABORTED:
            return self._fail(
                ActionErrorCode.ACTION_ABORTED,
                f"the action server '{server}' aborted the goal{_reason(goal.result)}",
            )
        if goal.status is GoalStatus.CANCELED:
            return self._fail(
                ActionErrorCode.ACTION_CANCELLED,
                f"the goal on '{server}' was cancelled by its server or by another client",
            )
        self.error_message = self._logged = ""
        self._end()
        return completed(self.on_result(goal.result), "on_result()")

    def on_halted(self) -> None:
        """Cancel the goal, without waiting for the server."""
        goal = self._goal
        self._end()
        if goal is not None:
            goal.cancel()

    def _is_ready(self, client: Any) -> bool:
        return bool(client.server_is_ready())

    def _unreachable(self, name: str) -> tuple[enum.Enum, str]:
        type_name = interface_name(self.action_type)
        return (
            ActionErrorCode.SERVER_UNREACHABLE,
            f"no action server '{name}' ({type_name}): {hint_for_action(self.session.node, name, type_name)}",
        )

    def _transmit(self, client: Any, message: Any) -> None:
        name = self._endpoint.name
        self._goal = ClientGoal(self.session, client, name, message, self.config.path, self.wake_up)

    def _end(self) -> None:
        super()._end()
        self._goal = None


def _reason(result: Any) -> str:
    """Return the error code and message of a result, which Nav2's results contain."""
    code = getattr(result, "error_code", 0)
    text = getattr(result, "error_msg", "")
    parts = [f"error_code {code}" if code else "", str(text)]
    reason = ", ".join(part for part in parts if part)
    return f": {reason}" if reason else ": its log may contain the reason"
