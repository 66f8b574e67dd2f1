"""A goal on an action server: sent, watched and cancelled without waiting."""

import logging
import uuid
from collections import deque
from collections.abc import Callable
from typing import Any, Final

from btcore.clock import NS_PER_S
from btcore_navigation.action import ENDED, GoalStatus
from btcore_ros2.session import RosSession

CHECK_NS: Final = NS_PER_S
"""The time (ns, tree's clock) between two checks: whether the server still exists, and has answered."""

FOLLOW_UP_S: Final = 30
"""How long (s, session's clock) a goal is watched after it was cancelled or its server has disappeared."""

MAX_FEEDBACK: Final = 1000
"""How many messages of feedback are kept for the leaf; older messages are dropped."""

UNKNOWN_GOAL: Final = 2  # of action_msgs/srv/CancelGoal
GOAL_ENDED: Final = 3  # also the answer if the goal is being cancelled

log = logging.getLogger(__name__)


def _new_id() -> Any:
    from unique_identifier_msgs.msg import UUID

    return UUID(uuid=list(uuid.uuid4().bytes))


def _do_nothing() -> None:
    pass


class ClientGoal:
    """A goal that was sent to an action server.

    The goal makes progress whenever the session takes messages. It is watched until it has ended. After
    `cancel`, this happens in the background: a goal that the server has not accepted yet is cancelled when it
    is accepted. If no answer arrives, the goal is cancelled by its ID, because the answer may be lost: a
    server that has not discovered the client completely accepts a goal, but cannot answer. The cancellation
    and the request of the result are repeated every second until they are answered. The outcome of the
    cancellation is logged once.

    A goal whose server has disappeared is lost. If the server is visible again within `FOLLOW_UP_S`, as after
    a failure of the network, the goal is cancelled, because the server may still work on it.

    Args:
        client: The `rclpy.action.ActionClient`, whose server is ready.
        server: The name of the action.
        message: The goal message.
        sender: The path of the leaf, for the log.
        on_progress: Called when the server has accepted, rejected or ended the goal, and when the server has
            disappeared.

    Attributes:
        accepted: Whether the server has accepted the goal; None before its answer.
        status: The state of the goal.
        feedback: The messages of feedback that the leaf has not taken yet, oldest first.
        result: The result message, or None before the goal has ended.
        is_lost: Whether the server has disappeared, or no longer knows the goal. It stays true.
        cancel_requested: Whether `cancel` was called.
    """

    def __init__(
        self,
        session: RosSession,
        client: Any,
        server: str,
        message: Any,
        sender: str,
        on_progress: Callable[[], None],
    ) -> None:
        from btcore_ros2.direct_take import send_goal

        self.accepted: bool | None = None
        self.status = GoalStatus.UNKNOWN
        self.feedback: deque[Any] = deque(maxlen=MAX_FEEDBACK)
        self.result: Any = None
        self.is_lost = False
        self.cancel_requested = False
        self._session = session
        self._client = client
        self._server = server
        self._sender = sender
        self._on_progress = on_progress
        self._handle: Any = None
        self._results: list[Any] = []
        self._cancellations: list[Any] = []
        self._open_cancellations: list[Any] = []  # those whose answers were not read
        self._is_cancellation_known = False
        self._is_unknown = False  # to the server, when it last answered a cancellation
        self._is_watched = True
        self._server_count = 0
        self._next_check = session.clock.now() + CHECK_NS
        self._follow_until = 0
        self._id = _new_id()
        self._shared = session.entities.find(client)
        if self._shared is not None:
            self._shared.add(self)
        self._acceptance = send_goal(client, message, self._id, self._take_feedback)
        self._ignore: Callable[[], None] = session.after_drain(self._advance)

    @property
    def done(self) -> bool:
        """Whether nothing more is expected: the goal was rejected, has ended, or its server disappeared."""
        return self.accepted is False or self.status in ENDED or self.is_lost

    def cancel(self) -> None:
        """Request the server to end the goal, and return at once. The outcome is logged."""
        if self.done or self.cancel_requested:
            return
        self._session.unfinished.add(self)
        self._follow_up()
        if self._handle is not None:
            self._send_cancellation()

    def _follow_up(self) -> None:
        """Watch the goal, which the leaf no longer needs, until it is cancelled."""
        self.cancel_requested = True
        now = self._session.clock.now()
        self._next_check = now + CHECK_NS
        self._follow_until = now + FOLLOW_UP_S * NS_PER_S
        self._on_progress = _do_nothing

    def _take_feedback(self, message: Any) -> None:
        if not self.cancel_requested:
            self.feedback.append(message.feedback)

    def _advance(self) -> None:
        """Read the answers that have arrived."""
        if self.accepted is None:
            if self._acceptance.done():
                self._accept(self._acceptance.result())
        else:
            self._read_results()
        answered = next((future for future in self._open_cancellations if future.done()), None)
        if self._is_watched and answered is not None:
            self._open_cancellations.remove(answered)
            self._read_cancellation(answered.result())
        if self._is_watched:
            self._check(self._session.clock.now())

    def _accept(self, handle: Any) -> None:
        """Process the server's answer to the goal."""
        self.accepted = handle.accepted
        if not handle.accepted:
            self._finish()
            return
        self._watch_result(handle)
        if self.cancel_requested:
            self._send_cancellation()
        self._on_progress()

    def _watch_result(self, handle: Any) -> None:
        self.accepted = True
        self._handle = handle
        self.status = GoalStatus.EXECUTING
        self._results.append(handle.get_result_async())
        self._server_count = self._count_servers()

    def _read_results(self) -> None:
        for future in self._results:
            if future.done():
                answer = future.result()
                status = GoalStatus(answer.status)
                if status in ENDED:
                    self.status = status
                    self.result = answer.result
                else:
                    self.is_lost = True
                self._finish()
                return

    def _send_cancellation(self) -> None:
        handle = self._handle if self._handle is not None else self._handle_by_id()
        self._cancellations.append(handle.cancel_goal_async())
        self._open_cancellations.append(self._cancellations[-1])

    def _read_cancellation(self, answer: Any) -> None:
        if answer.goals_canceling or answer.return_code == GOAL_ENDED:
            self._is_cancellation_known = True
            self._open_cancellations.clear()
            if self.accepted is None:  # the server's answer was lost
                self._watch_result(self._handle_by_id())
            if answer.goals_canceling:
                self.status = GoalStatus.CANCELING
            self._session.unfinished.discard(self)
        elif answer.return_code != UNKNOWN_GOAL:
            log.warning(
                "%s: the action server '%s' refused to cancel the goal, and continues to work on it",
                self._sender,
                self._server,
            )
            self._stop_watching()
        elif self.accepted:
            self._end_watch()
        else:  # the server has rejected the goal, or gets it later
            self._is_unknown = True

    def _check(self, now: int) -> None:
        """Check from time to time whether the server still exists, and whether the cancelled goal has ended.

        A server that was killed is visible for 20 s, until its DDS lease ends. If it was started again in the
        meantime, the number of servers has changed: the new server answers that it does not know the goal.

        The first check requests the result once more, because the answer to the first request may be lost:
        the goal may have ended before the server had discovered the client completely.
        """
        if self.cancel_requested and now > self._follow_until:
            self._give_up()
        elif now >= self._next_check:
            self._next_check = now + CHECK_NS
            if not self._client.server_is_ready():
                self._miss_server()
                return
            if self.cancel_requested and not self._is_cancellation_known:
                self._send_cancellation()
            if self._handle is not None:
                count = self._count_servers()
                if count != self._server_count or len(self._results) == 1 or self.cancel_requested:
                    self._server_count = count
                    self._results.append(self._handle.get_result_async())

    def _give_up(self) -> None:
        """Stop watching a cancelled goal that has not ended."""
        if self.is_lost or (self._handle is None and self._is_unknown):
            self._end_watch()
            return
        log.warning(
            "%s: the goal was cancelled %d s ago, but the action server '%s' has not %s the goal; "
            "it may still work on it",
            self._sender,
            FOLLOW_UP_S,
            self._server,
            "answered" if self._handle is None else "ended",
        )
        self._stop_watching()

    def _miss_server(self) -> None:
        """Report that the server has disappeared; cancel the goal if the server is visible again."""
        if not self.is_lost:
            self.is_lost = True
            self._session.unfinished.discard(self)
            self._on_progress()
            self._follow_up()

    def _end_watch(self) -> None:
        """End the watch of a goal whose server has disappeared or does not know the goal."""
        self.is_lost = True
        self._finish()

    def _handle_by_id(self) -> Any:
        """Return a handle of the goal, for a server that accepted the goal, but whose answer was lost."""
        from rclpy.action.client import ClientGoalHandle

        # To cancel and to request the result, a handle uses the ID only, and not the answer.
        return ClientGoalHandle(self._client, self._id, None)

    def _count_servers(self) -> int:
        name = self._session.node.resolve_service_name(self._server)
        count: int = self._session.node.count_publishers(f"{name}/_action/status")
        return count

    def _finish(self) -> None:
        if self.cancel_requested:
            if self.accepted is False:
                outcome = "the server had rejected it"
            elif self.status in ENDED:
                outcome = f"it ended as {self.status.name}"
            else:
                outcome = "its server disappeared, or does not know it"
            log.info("%s: the goal on '%s' was cancelled: %s", self._sender, self._server, outcome)
        self._stop_watching()
        self._on_progress()

    def _stop_watching(self) -> None:
        self._is_watched = False
        self._session.unfinished.discard(self)
        self._ignore()
        self._ignore = self._session.after_drain(self._forget)
        self._next_check = self._session.clock.now() + CHECK_NS
        self._forget()

    def _forget(self) -> None:
        """Remove what the client keeps of the goal, when all requests are answered, or after `CHECK_NS`."""
        from btcore_ros2.direct_take import forget_goal

        requests = [self._acceptance, *self._results, *self._cancellations]
        if self._session.clock.now() > self._next_check or all(request.done() for request in requests):
            self._ignore()
            self._ignore = _do_nothing
            forget_goal(self._client, self._id, requests)
            if self._shared is not None:
                self._shared.users.discard(self)
