"""Action servers on the thread of a session: goals are taken, answered and cancelled between two ticks.

rclpy executes each goal in a callback that returns the result. A tree lasts for many ticks on the thread
that also drains the session, so a callback cannot wait for its end. Here, a goal is an object: the program
takes it when it is ready to work on it, looks whether it is cancelled, and ends it.
"""

import functools
import math
import time
from collections import deque
from collections.abc import Callable
from typing import Any, Generic, TypeVar

from btcore_ros2.session import RosSession

Goal = TypeVar("Goal")
Result = TypeVar("Result")
Feedback = TypeVar("Feedback")

DELIVERY_S = 1.0
"""The time (s) before the end of a server in which clients can request the result of the last goal."""


class ServerGoal(Generic[Goal, Result, Feedback]):
    """An accepted goal. A goal that has ended keeps its status: ending it again has no effect.

    Attributes:
        request: The goal message.
    """

    def __init__(self, handle: Any, end: Callable[[Any, str, Result | None], None]) -> None:
        self._handle = handle
        self._end = end
        self.request: Goal = handle.request

    @property
    def cancel_requested(self) -> bool:
        """Whether a client has cancelled the goal, and the goal has not ended."""
        return bool(self._handle.is_cancel_requested)

    @property
    def is_active(self) -> bool:
        """Whether the goal has not ended."""
        return bool(self._handle.is_active)

    def publish_feedback(self, message: Feedback) -> None:
        """Send feedback to the clients."""
        if self.is_active:
            self._handle.publish_feedback(message)

    def succeed(self, result: Result | None = None) -> None:
        """End the goal as SUCCEEDED; without *result* with an empty result message."""
        self._end(self, "succeed", result)

    def abort(self, result: Result | None = None) -> None:
        """End the goal as ABORTED; without *result* with an empty result message."""
        self._end(self, "abort", result)

    def canceled(self, result: Result | None = None) -> None:
        """End the goal as CANCELED, or as ABORTED if no client has cancelled it, as for a replaced goal.

        Args:
            result: The result message; None = an empty message.
        """
        self._end(self, "canceled" if self.cancel_requested else "abort", result)


class RosActionServer(Generic[Goal, Result, Feedback]):
    """An action server whose goals are accepted and cancelled while the session drains.

    Accepted goals wait in `waiting`, with the status ACCEPTED, until `take` returns them. A waiting goal that
    is cancelled ends as CANCELED without being taken. A goal that was taken ends by its methods. Several
    goals may be in progress.

    Args:
        session: The session whose `drain` serves the clients.
        action_type: The class of the action, such as `nav2_msgs.action.Spin`.
        reject_reason: Called with the message of a new goal. It returns why the goal is rejected, or "" to
            accept it. The reason is logged, since a rejection contains no text.
        untaken_result: The result message of goals that end before they are taken; default an empty message.

    Attributes:
        name: The name of the action.
        waiting: The goals that were accepted and not taken, in order of arrival.
    """

    def __init__(
        self,
        session: RosSession,
        action_type: Any,
        name: str,
        *,
        reject_reason: Callable[[Goal], str] = lambda goal: "",
        untaken_result: Result | None = None,
    ) -> None:
        from rclpy.action import CancelResponse

        self.name = name
        self.waiting: deque[ServerGoal[Goal, Result, Feedback]] = deque()
        self._session = session
        self._action_type = action_type
        self._reject_reason = reject_reason
        self._untaken_result = untaken_result
        self._is_closed = False
        self._last_end = -math.inf
        self._taken: list[ServerGoal[Goal, Result, Feedback]] = []
        self._server = _server_class()(
            session.node,
            action_type,
            name,
            execute_callback=lambda handle: None,  # not used: see DeferredServer
            goal_callback=self._on_request,
            handle_accepted_callback=lambda handle: self.waiting.append(ServerGoal(handle, self._end)),
            cancel_callback=lambda handle: CancelResponse.ACCEPT,
            callback_group=session.callback_group,
        )
        self._stop_watching = session.after_drain(self._end_cancelled)

    def take(self) -> ServerGoal[Goal, Result, Feedback] | None:
        """Return the first waiting goal, which becomes EXECUTING, or None."""
        self._end_cancelled()
        if not self.waiting:
            return None
        goal = self.waiting.popleft()
        self._start(goal)
        return goal

    def close(self) -> None:
        """Abort the goals that have not ended, and destroy the server. Further calls have no effect."""
        if self._is_closed:
            return
        self._is_closed = True
        for goal in tuple(self._taken):
            goal.canceled()
        for goal in self.waiting:
            self._start(goal)
            goal.canceled(self._untaken_result)
        self.waiting.clear()
        self._stop_watching()
        remaining = self._last_end + DELIVERY_S - time.monotonic()
        if remaining > 0 and self._session.context.ok():
            self._session.wait_for(lambda: False, remaining)
        self._server.destroy()

    def _end(self, goal: ServerGoal[Goal, Result, Feedback], how: str, result: Result | None) -> None:
        """End *goal* with the method *how* of its handle, and send its result."""
        if goal in self._taken:
            self._taken.remove(goal)
        if goal.is_active:
            answer = result if result is not None else self._action_type.Result()
            self._last_end = time.monotonic()
            self._server.finish(goal._handle, getattr(goal._handle, how), answer)

    def _on_request(self, request: Goal) -> Any:
        from rclpy.action import GoalResponse

        reason = self._reject_reason(request)
        if reason:
            self._session.node.get_logger().warning(f"goal of {self.name} rejected: {reason}")
        return GoalResponse.REJECT if reason else GoalResponse.ACCEPT

    def _start(self, goal: ServerGoal[Goal, Result, Feedback]) -> None:
        goal._handle.execute()
        self._taken.append(goal)

    def _end_cancelled(self) -> None:
        """End the waiting goals that are cancelled."""
        for goal in [goal for goal in self.waiting if goal.cancel_requested]:
            self.waiting.remove(goal)
            goal.canceled(self._untaken_result)


@functools.cache
def _server_class() -> Any:
    """Return the subclass of rclpy's action server; a function, since rclpy is imported when it is used."""
    from rclpy.action import ActionServer

    class DeferredServer(ActionServer):  # type: ignore[misc]
        """An action server that sends the result of a goal when `finish` is called."""

        def notify_execute(self, goal_handle: Any, execute_callback: Any) -> None:
            """Do nothing, instead of calling a callback that returns the result."""

        def finish(self, handle: Any, end: Callable[[], None], result: object) -> None:
            """Call *end*, which sets the status of the goal, and send *result* to the clients."""

            def execute(_: object) -> object:
                end()
                return result

            # Not documented, but the only part of rclpy that sends results. With a callback that is not a
            # coroutine function, the coroutine ends at its first step.
            try:
                self._execute_goal(execute, handle).send(None)
            except StopIteration:
                self.remove_future(self._result_futures[bytes(handle.goal_id.uuid)])
                return
            raise AssertionError("rclpy did not send the result of a goal")

        def remove_future(self, future: object) -> None:
            """Remove *future* from those that get the executor for each request, when its goal ends.

            rclpy does so when the goal expires, 10 s after its end.
            """
            if future in self._futures:
                super().remove_future(future)

    return DeferredServer
