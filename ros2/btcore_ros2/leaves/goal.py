"""A goal on an action server: sent, watched and cancelled without waiting."""

import enum
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


class _Phase(enum.Enum):
    """What the client still needs of a goal. CANCELLED and UNKNOWN last for at most `FOLLOW_UP_S`."""

    WANTED = enum.auto()
    """The leaf waits for the goal."""
    CANCELLED = enum.auto()
    """The leaf no longer needs the goal, which is watched until it has ended."""
    UNKNOWN = enum.auto()
    """As CANCELLED, but the server does not know the goal: it has rejected the goal, or gets it later."""
    OVER = enum.auto()
    """Nothing is expected. Answers to open requests may still arrive, for at most `CHECK_NS`."""


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
            disappeared, unless the goal was cancelled before.

    Attributes:
        accepted: Whether the server has accepted the goal; None before its answer.
        status: The state of the goal.
        feedback: The messages of feedback that the leaf has not taken yet, oldest first.
        result: The result message, or None before the goal has ended.
        is_lost: Whether the server has disappeared, or no longer knows the goal. It stays true.
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
        from rclpy.action.client import ClientGoalHandle
        from unique_identifier_msgs.msg import UUID

        from btcore_ros2.direct_take import send_goal

        self.accepted: bool | None = None
        self.status = GoalStatus.UNKNOWN
        self.feedback: deque[Any] = deque(maxlen=MAX_FEEDBACK)
        self.result: Any = None
        self.is_lost = False
        self._session = session
        self._client = client
        self._server = server
        self._sender = sender
        self._on_progress = on_progress
        self._phase = _Phase.WANTED
        self._phase_end = 0  # of all phases except WANTED
        self._next_check = session.clock.now() + CHECK_NS
        self._server_count = 0  # in the last check
        self._id = UUID(uuid=list(uuid.uuid4().bytes))
        # To cancel and to request the result, a handle uses the ID only, and not the server's answer (None),
        # which may be lost.
        self._handle = ClientGoalHandle(client, self._id, None)
        self._shared = session.entities.find(client)
        if self._shared is not None:
            self._shared.add(self)
        sent = send_goal(client, message, self._id, self._take_feedback)
        self._open: list[tuple[Any, Callable[[Any], None]]] = [(sent, self._read_acceptance)]
        self._unsubscribe = session.after_drain(self._advance)

    @property
    def done(self) -> bool:
        """Whether nothing more is expected: the goal was rejected, has ended, or its server disappeared."""
        return self.accepted is False or self.status in ENDED or self.is_lost

    def cancel(self) -> None:
        """Request the server to end the goal, and return at once. The outcome is logged."""
        if self._phase is _Phase.WANTED:
            self._session.unfinished.add(self)
            self._follow_up()
            if self.accepted:
                self._send_cancellation()

    def _follow_up(self) -> None:
        """Watch the goal, which the leaf no longer needs, until it is cancelled."""
        self._phase = _Phase.CANCELLED
        now = self._session.clock.now()
        self._next_check = now + CHECK_NS
        self._phase_end = now + FOLLOW_UP_S * NS_PER_S

    def _advance(self) -> None:
        """Read the answers that have arrived, and check the goal if it is time to."""
        for answered in [request for request in self._open if request[0].done()]:
            self._open.remove(answered)
            if self._phase is not _Phase.OVER:
                future, read = answered
                read(future.result())
        now = self._session.clock.now()
        if self._phase is _Phase.OVER:
            if not self._open or now > self._phase_end:
                self._forget()
        elif self._phase is not _Phase.WANTED and now > self._phase_end:
            self._give_up()
        elif now >= self._next_check:
            self._next_check = now + CHECK_NS
            self._check()

    def _request_result(self) -> None:
        self._open.append((self._handle.get_result_async(), self._read_result))

    def _send_cancellation(self) -> None:
        self._open.append((self._handle.cancel_goal_async(), self._read_cancellation))

    def _take_feedback(self, message: Any) -> None:
        if self._phase is _Phase.WANTED:
            self.feedback.append(message.feedback)

    def _read_acceptance(self, answer: Any) -> None:
        if not answer.accepted:
            self.accepted = False
            self._finish()
            return
        self._accept()
        if self._phase is _Phase.WANTED:
            self._on_progress()
        else:
            self._phase = _Phase.CANCELLED
            self._send_cancellation()

    def _accept(self) -> None:
        """Wait for the result of the goal, which the server has accepted."""
        self.accepted = True
        self.status = GoalStatus.EXECUTING
        self._request_result()

    def _read_result(self, answer: Any) -> None:
        status = GoalStatus(answer.status)
        if status in ENDED:
            self.status = status
            self.result = answer.result
        self._finish()

    def _read_cancellation(self, answer: Any) -> None:
        if answer.goals_canceling or answer.return_code == GOAL_ENDED:
            if not self.accepted:  # the server's answer was lost
                self._accept()
            self._phase = _Phase.CANCELLED
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
            self._finish()
        else:
            self._phase = _Phase.UNKNOWN

    def _check(self) -> None:
        """Check whether the server still exists, and whether the cancelled goal has ended.

        A server that was killed is visible for 20 s, until its DDS lease ends. If it was started again in the
        meantime, the number of servers has changed: the new server answers that it does not know the goal.

        The first check requests the result once more, because the answer to the first request may be lost:
        the goal may have ended before the server had discovered the client completely.
        """
        if not self._client.server_is_ready():
            if not self.is_lost:
                self.is_lost = True
                self._session.unfinished.discard(self)
                if self._phase is _Phase.WANTED:
                    self._on_progress()
                self._follow_up()  # cancel the goal if the server is visible again
            return
        is_cancelled = self._phase is not _Phase.WANTED
        if is_cancelled and self.status is not GoalStatus.CANCELING:
            self._send_cancellation()
        if self.accepted:
            name = self._session.node.resolve_service_name(self._server)
            count = self._session.node.count_publishers(f"{name}/_action/status")
            if count != self._server_count or is_cancelled:
                self._server_count = count
                self._request_result()

    def _give_up(self) -> None:
        """Stop watching a cancelled goal that has not ended."""
        if self.is_lost or self._phase is _Phase.UNKNOWN:
            self._finish()
            return
        log.warning(
            "%s: the goal was cancelled %d s ago, but the action server '%s' has not %s the goal; "
            "it may still work on it",
            self._sender,
            FOLLOW_UP_S,
            self._server,
            "ended" if self.accepted else "answered",
        )
        self._stop_watching()

    def _finish(self) -> None:
        """End the watch of a goal that was rejected or has ended, or else is lost."""
        self.is_lost = self.is_lost or not self.done
        was_wanted = self._phase is _Phase.WANTED
        self._stop_watching()
        if was_wanted:
            self._on_progress()
            return
        if self.accepted is False:
            outcome = "the server had rejected it"
        elif self.status in ENDED:
            outcome = f"it ended as {self.status.name}"
        else:
            outcome = "its server disappeared, or does not know it"
        log.info("%s: the goal on '%s' was cancelled: %s", self._sender, self._server, outcome)

    def _stop_watching(self) -> None:
        self._phase = _Phase.OVER
        self._phase_end = self._session.clock.now() + CHECK_NS
        self._session.unfinished.discard(self)

    def _forget(self) -> None:
        """Remove what the client keeps of the goal."""
        from btcore_ros2.direct_take import forget_goal

        self._unsubscribe()
        forget_goal(self._client, self._id, [request for request, _ in self._open])
        if self._shared is not None:
            self._shared.users.discard(self)
