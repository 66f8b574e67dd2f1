"""Handles of goals and requests that Nav2's servers work on, in the form of our navigation's handles."""

import time
from collections.abc import Callable
from typing import Any

from btcore_navigation.action import ActionResult, GoalHandle, GoalStatus
from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_ros2.errors import RosError
from btcore_ros2.leaves.goal import ClientGoal
from btcore_ros2.leaves.visible_names import hint_for_action, hint_for_service
from btcore_ros2.nav2.conversions import ActionConverter
from btcore_ros2.nav2.service_requests import read_response
from btcore_ros2.session import RosSession
from btcore_ros2.shared_entities import SharedEntity


class NamedClient:
    """An rclpy client and the name of its server.

    Attributes:
        client: The client of an action or of a service.
        name: The name of the server.
        created: The time (ns, of `time.monotonic_ns`) when this object was created.
        discovery_ns: The time (ns) in which the server may appear. Afterwards, a server that is missing
            counts as absent, and only the time-out of the node remains.
    """

    def __init__(self, shared: SharedEntity, name: str, discovery_ns: int) -> None:
        self.client = shared.entity
        self.name = name
        self.created = time.monotonic_ns()
        self.discovery_ns = discovery_ns
        self._shared = shared

    def is_visible(self) -> bool:
        """Return whether the server is visible."""
        client = self.client
        is_action = hasattr(client, "server_is_ready")
        return bool(client.server_is_ready() if is_action else client.service_is_ready())

    def is_ready(self) -> bool:
        """Return whether the server is visible, and has had the time to find the client."""
        is_visible = self.is_visible()
        return not self._shared.settling_time(is_visible=is_visible) and is_visible


class _SessionHandle(GoalHandle[Any, Any, Any]):
    """Base of the handles: `advance` is called after each drain of the session until the handle has ended."""

    def __init__(self, session: RosSession, named: NamedClient, goal: object) -> None:
        super().__init__(goal)
        self._session = session
        self._named = named
        self._client = named.client
        self._name = named.name
        self._began = time.monotonic_ns()
        self.discovery_ns = max(0, named.created + named.discovery_ns - self._began)
        self._stop_watching: Callable[[], None] | None = None

    def poll(self) -> bool:
        """Take what has arrived from the server, and return whether the goal has ended."""
        if not self.done:
            # For programs that tick a tree without waiting on the clock of the session.
            self._session.refresh()
        return self.done

    def on_server_found(self) -> None:
        """Let the time for the acceptance begin now."""
        self.discovery_ns = time.monotonic_ns() - self._began

    def watch(self) -> None:
        """Call `advance` after each drain, from now on."""
        if self._stop_watching is not None:
            self._stop_watching()
        self._stop_watching = None if self.done else self._session.after_drain(self._advance_until_end)

    def advance(self) -> None:
        """Process what has arrived."""
        raise NotImplementedError

    def _advance_until_end(self) -> None:
        if not self.done:
            self.advance()
        if self.done and self._stop_watching is not None:
            self._stop_watching()
            self._stop_watching = None


class Nav2GoalHandle(_SessionHandle):
    """A goal on a server of Nav2. It is sent when the server appears, unless it is cancelled before.

    Args:
        named: The client of the action.
        goal: Our goal.
    """

    def __init__(
        self, session: RosSession, named: NamedClient, goal: object, converter: ActionConverter
    ) -> None:
        super().__init__(session, named, goal)
        self._converter = converter
        self._sent: ClientGoal | None = None
        self._message = converter.type.Goal()
        try:
            converter.write_goal(goal, self._message)
        except RosError as error:
            self.abort(int(Nav2ErrorCode.SEND_GOAL_FAILURE), str(error))
            return
        if named.is_ready():
            self._send()
        elif not named.is_visible():
            type_name = f"nav2_msgs/action/{converter.type_name}"
            hint = hint_for_action(session.node, self._name, type_name)
            self.missing_acceptance = f"no action server '{self._name}' ({type_name}): {hint}"
        self.watch()

    def cancel(self) -> None:
        """Request the server to end the goal, in the background. A goal that was not sent stays unsent."""
        super().cancel()
        if self._sent is not None:
            self._sent.cancel()

    def advance(self) -> None:
        """Send the goal if its server has appeared, or read the answers of the server."""
        sent = self._sent
        if sent is None:
            if self.cancel_requested:
                self.canceled()
            elif self._named.is_ready():
                self._send()
                self.watch()
            return
        while sent.feedback:
            self.feedback = self._converter.read_feedback(sent.feedback.popleft())
        if not sent.done:
            if sent.accepted and self.status in (GoalStatus.UNKNOWN, GoalStatus.EXECUTING):
                self.status = sent.status
            return
        if sent.accepted is False:
            self.abort(
                int(Nav2ErrorCode.GOAL_REJECTED), f"the action server '{self._name}' rejected the goal"
            )
        elif sent.is_lost:
            self.abort(
                int(Nav2ErrorCode.SEND_GOAL_FAILURE),
                f"the action server '{self._name}' disappeared while it worked on the goal",
            )
        else:
            self._read_result(sent.status, sent.result)

    def _send(self) -> None:
        self.on_server_found()
        self.missing_acceptance = f"the action server '{self._name}' did not answer the goal in time"
        self._sent = ClientGoal(
            self._session, self._client, self._name, self._message, self._name, lambda: None
        )

    def _read_result(self, status: GoalStatus, message: Any) -> None:
        code, text = int(getattr(message, "error_code", 0)), str(getattr(message, "error_msg", ""))
        value = None
        try:
            value = self._converter.read_result(message)
        except RosError as error:
            if status is GoalStatus.SUCCEEDED:
                status, text = GoalStatus.ABORTED, f"the result of '{self._name}' cannot be used: {error}"
        if status is GoalStatus.ABORTED and not text:
            text = f"the action server '{self._name}' aborted the goal"
            text += f" with error code {code}" if code else "; its log may contain the reason"
        self.status = status
        self.result = ActionResult(code, text, value)


class Nav2RequestHandle(_SessionHandle):
    """A request to a service of Nav2. It is sent when the service appears, unless it is cancelled before.

    Args:
        named: The client of the service.
        request: Our request, by which the response is read.
        message: The request message.
    """

    def __init__(self, session: RosSession, named: NamedClient, request: object, message: Any) -> None:
        super().__init__(session, named, request)
        self._message = message
        self._response: Any = None
        if named.is_ready():
            self._send()
        elif not named.is_visible():
            service_type = self._client.srv_type
            type_name = f"{service_type.__module__.partition('.')[0]}/srv/{service_type.__name__}"
            hint = hint_for_service(session.node, self._name, type_name)
            self.missing_acceptance = f"no service '{self._name}' ({type_name}): {hint}"
        self.watch()

    def cancel(self) -> None:
        """Ignore the response when it arrives."""
        super().cancel()
        if not self.done:
            if self._response is not None:
                self._client.remove_pending_request(self._response)
            self.canceled()
            self.watch()

    def advance(self) -> None:
        """Send the request if its service has appeared, or read the response."""
        if self._response is None:
            if self._named.is_ready():
                self._send()
        elif self._response.done():
            try:
                self.succeed(read_response(self.goal, self._response.result()))
            except RosError as error:
                self.abort(0, f"{self._name}: {error}")

    def _send(self) -> None:
        self.on_server_found()
        self.missing_acceptance = f"the service '{self._name}' did not answer in time"
        self._response = self._client.call_async(self._message)
