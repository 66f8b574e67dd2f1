"""An action server of our navigation, offered under the name and the types of Nav2's action."""

from typing import Any

from btcore.clock import NS_PER_S
from btcore_navigation.action import ActionServer, GoalHandle, GoalStatus
from btcore_navigation.navigate_goal import NavigateGoal
from btcore_navigation.navigator import Navigator, tree_file
from btcore_ros2.action_server import RosActionServer, ServerGoal
from btcore_ros2.errors import RosError
from btcore_ros2.nav2.conversions import ActionConverter, FrameError, seconds_to_duration
from btcore_ros2.session import RosSession

FEEDBACK_PERIOD_NS = NS_PER_S // 10
"""The time (ns) between two messages of feedback."""

ENDED = "the server was ended"
"""The message of goals that have not ended when the program ends."""


class ServedAction:
    """Passes goals of ROS 2 clients to *server*, and its feedback and results back.

    Call `step` before each step of *server*. A newer goal replaces the goal in progress, as in Nav2: the
    previous goal is aborted, unless its client has cancelled it.

    Args:
        other: A server that excludes this one: while it has a goal, goals are rejected. The goals of a server
            that is not active are rejected, too.
    """

    def __init__(
        self,
        session: RosSession,
        converter: ActionConverter,
        server: ActionServer[Any, Any, Any],
        other: ActionServer[Any, Any, Any] | None = None,
    ) -> None:
        self._session = session
        self._converter = converter
        self._server = server
        self._other = other
        self._type = converter.type
        self._ros: RosActionServer[Any, Any, Any] = RosActionServer(
            session, self._type, converter.name, reject_reason=self._reject_reason
        )
        self._goals: list[tuple[ServerGoal[Any, Any, Any], GoalHandle[Any, Any, Any], int]] = []
        """The goals and the times (ns) at which they began."""
        self._now = self._next_feedback = 0

    @property
    def is_active(self) -> bool:
        """Whether a goal waits or is in progress."""
        return bool(self._goals or self._ros.waiting)

    def step(self, now: int) -> None:
        """Pass on goals, cancellations, feedback and results that are new at *now* (ns)."""
        self._now = now
        while (ros := self._ros.take()) is not None:
            self._start(ros)
        for ros, handle, _ in self._goals:
            if ros.cancel_requested and not handle.cancel_requested:
                handle.cancel()
        self._goals = [goal for goal in self._goals if not self._end(*goal)]
        if self._goals and now >= self._next_feedback:
            self._next_feedback = now + FEEDBACK_PERIOD_NS
            self._send_feedback(*self._goals[-1][:2])

    def cancel_all(self) -> None:
        """Cancel all goals; the next step of the server stops its work."""
        for _, handle, _ in self._goals:
            handle.cancel()

    def close(self) -> None:
        """Send the results of goals that have ended, abort the others, and destroy the server."""
        for ros, handle, began in self._goals:
            was_stopped = handle.status is GoalStatus.CANCELED and not ros.cancel_requested
            if was_stopped or not self._end(ros, handle, began):
                ros.canceled(self._result(self._type.Result.UNKNOWN, ENDED))
        while (waiting := self._ros.take()) is not None:
            waiting.canceled(self._result(self._type.Result.UNKNOWN, ENDED))
        self._ros.close()

    def _reject_reason(self, request: Any) -> str:
        if not self._server.is_active:
            return f"{self._server.node} is not active"
        other = self._other
        return f"{other.name} has a goal in progress" if other is not None and other.is_busy else ""

    def _start(self, ros: ServerGoal[Any, Any, Any]) -> None:
        try:
            goal = self._converter.read_goal(ros.request)
        except RosError as error:
            code = self._type.Result.UNKNOWN
            if isinstance(error, FrameError):
                code = getattr(self._type.Result, "TF_ERROR", code)
            self._abort(ros, self._result(code, str(error)))
            return
        reason = refusal_reason(self._server, goal) if isinstance(self._server, Navigator) else ""
        if reason:
            self._abort(ros, self._result(self._type.Result.UNKNOWN, reason))
            return
        self._goals.append((ros, self._server.send_goal(goal), self._now))

    def _send_feedback(self, ros: ServerGoal[Any, Any, Any], handle: GoalHandle[Any, Any, Any]) -> None:
        if handle.feedback is not None:
            message = self._type.Feedback()
            self._converter.write_feedback(handle.feedback, message)
            if hasattr(message, "current_pose"):
                message.current_pose.header.stamp = self._stamp()
            ros.publish_feedback(message)

    def _end(self, ros: ServerGoal[Any, Any, Any], handle: GoalHandle[Any, Any, Any], began: int) -> bool:
        """Send the result if *handle* has ended, and return whether it has."""
        if not handle.done:
            return False
        self._send_feedback(ros, handle)
        outcome = handle.result
        code = self._converter.error_code(outcome.code) if outcome is not None and outcome.code else 0
        result = self._result(code, outcome.message if outcome is not None else "")
        if outcome is not None:
            self._converter.write_result(outcome.value, result)
        if hasattr(result, "path"):
            result.path.header.stamp = self._stamp()
        if hasattr(result, "total_elapsed_time"):
            result.total_elapsed_time = seconds_to_duration((self._now - began) / NS_PER_S)
        if handle.status is GoalStatus.SUCCEEDED:
            ros.succeed(result)
        elif handle.status is GoalStatus.CANCELED:
            ros.canceled(result)
        else:
            self._abort(ros, result)
        return True

    def _abort(self, ros: ServerGoal[Any, Any, Any], result: Any) -> None:
        """Abort a goal that has failed, and log the reason."""
        reason = getattr(result, "error_msg", "")
        logger = self._session.node.get_logger()
        logger.warning(f"goal of {self._ros.name} failed with error {result.error_code}: {reason}")
        ros.abort(result)

    def _stamp(self) -> Any:
        return self._session.node.get_clock().now().to_msg()

    def _result(self, code: int, message: str) -> Any:
        result = self._type.Result()
        result.error_code = code
        if hasattr(result, "error_msg"):
            result.error_msg = message
        return result


def refusal_reason(navigator: Navigator, goal: NavigateGoal) -> str:
    """Return why *goal* can't replace the goal in progress, or ""."""
    current = navigator.current
    if current is None or current.done:
        return ""
    running = tree_file(current.goal.behavior_tree, navigator.default_tree)
    if tree_file(goal.behavior_tree, navigator.default_tree) == running:
        return ""
    return f"the goal in progress uses another tree, {running}: cancel it first"
