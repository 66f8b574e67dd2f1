"""Actions as in ROS 2: long-running work that a client requests by a goal and watches by a handle.

A server is a task on the robot's schedule. It accepts a goal at its next step; a new goal replaces the old
goal (pre-emption). There are no callbacks: clients poll the handle for feedback, status and result.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Generic, TypeVar

from btcore_navigation.error_codes import Nav2ErrorCode

Goal = TypeVar("Goal")
Feedback = TypeVar("Feedback")
Value = TypeVar("Value")


class GoalStatus(IntEnum):
    """The state of a goal; names and numbers are those of `action_msgs/GoalStatus`."""

    UNKNOWN = 0
    ACCEPTED = 1
    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6


ENDED = frozenset({GoalStatus.SUCCEEDED, GoalStatus.CANCELED, GoalStatus.ABORTED})
"""The statuses of a goal that has ended."""


@dataclass(frozen=True, slots=True)
class ActionResult(Generic[Value]):
    """The result of an action: *code* (0 or one of Nav2's error codes), *message* for people, *value*."""

    code: int = 0
    message: str = ""
    value: Value | None = None


class GoalHandle(Generic[Goal, Feedback, Value]):
    """A goal that was sent. The server writes the handle; the client reads it and may `cancel` the goal.

    Attributes:
        goal: The goal.
        status: The state of the goal.
        result: The result, or None before the goal has ended.
        cancel_requested: Whether the client has cancelled the goal.
        missing_acceptance: The reason to report if the goal is not accepted in time.
        discovery_ns: The time (ns) for finding the server, in addition to the time for the acceptance.
    """

    missing_acceptance = "no server accepted the goal"
    discovery_ns = 0

    def __init__(self, goal: Goal) -> None:
        self.goal = goal
        self.status = GoalStatus.UNKNOWN
        self.result: ActionResult[Value] | None = None
        self.cancel_requested = False
        self._feedback: Feedback | None = None
        self._compute_feedback: Callable[[], Feedback] | None = None

    @property
    def feedback(self) -> Feedback | None:
        """The last feedback, or None."""
        if self._compute_feedback is not None:
            self._feedback, self._compute_feedback = self._compute_feedback(), None
        return self._feedback

    @feedback.setter
    def feedback(self, feedback: Feedback | None) -> None:
        self._feedback, self._compute_feedback = feedback, None

    def defer_feedback(self, compute: Callable[[], Feedback]) -> None:
        """Set a function that computes the feedback when it is read first, because it is rarely read.

        *compute* must depend only on values that do not change after this call.
        """
        self._compute_feedback = compute

    @property
    def done(self) -> bool:
        """Whether the goal has ended, with any outcome."""
        return self.status in ENDED

    def poll(self) -> bool:
        """Take what has arrived from the server, and return whether the goal has ended. Clients call it."""
        return self.done

    def cancel(self) -> None:
        """Request the server to end this goal. A goal that has ended keeps its status."""
        if not self.done:
            self.cancel_requested = True
            if self.status in (GoalStatus.ACCEPTED, GoalStatus.EXECUTING):
                self.status = GoalStatus.CANCELING

    def succeed(self, value: Value | None = None) -> None:
        """End the goal as SUCCEEDED, with *value* as its result."""
        self._end(GoalStatus.SUCCEEDED, ActionResult(value=value))

    def abort(self, code: int, message: str, value: Value | None = None) -> None:
        """End the goal as ABORTED.

        Args:
            code: One of Nav2's error codes.
            message: The reason, as a sentence for people.
            value: A partial result.
        """
        self._end(GoalStatus.ABORTED, ActionResult(code, message, value))

    def canceled(self, message: str = "the goal was cancelled") -> None:
        """End the goal as CANCELED: the client cancelled it, or a newer goal replaced it."""
        self._end(GoalStatus.CANCELED, ActionResult(0, message))

    def _end(self, status: GoalStatus, result: ActionResult[Value]) -> None:
        if not self.done:
            self.status = status
            self.result = result


class ActionServer(Generic[Goal, Feedback, Value]):
    """A server of one goal at a time; subclasses implement `start`, `work` and `stop`.

    Call `step` periodically from the robot's schedule. An exception in a subclass is a programming error, not
    a failed goal: a subclass calls the handle's `abort` for goals that fail.

    Attributes:
        name: The name of the action.
        node: The name of Nav2's node that serves the action.
        is_active: Whether goals are accepted. While it is False, all goals are aborted.
        current: The handle of the goal that is being executed, or of the last goal, or None.
    """

    name = "action"
    node = "server"

    def __init__(self) -> None:
        self.is_active = True
        self._next: GoalHandle[Goal, Feedback, Value] | None = None
        self.current: GoalHandle[Goal, Feedback, Value] | None = None

    def send_goal(self, goal: Goal) -> GoalHandle[Goal, Feedback, Value]:
        """Send *goal* and return its handle.

        The new goal replaces other goals: a waiting goal becomes CANCELED at once, a running goal at the next
        step.
        """
        if not self.is_active:
            rejected: GoalHandle[Goal, Feedback, Value] = GoalHandle(goal)
            self._reject(rejected)
            return rejected
        if self._next is not None:
            self._next.canceled("a newer goal took its place")
        self._next = GoalHandle(goal)
        return self._next

    @property
    def is_busy(self) -> bool:
        """Whether a goal has not ended yet; a goal that is not accepted yet counts too."""
        return self._next is not None or (self.current is not None and not self.current.done)

    def step(self, now: int) -> None:
        """Run one period at *now* (ns): first cancel, then accept, then work."""
        current = self.current
        if current is not None and not current.done and current.cancel_requested:
            self.stop(current, now)
            current.canceled()
        new, self._next = self._next, None
        if not self.is_active:
            if current is not None and not current.done:
                self.stop(current, now)
                self._reject(current)
            if new is not None:
                self._reject(new)
        elif new is not None:
            self._accept(new, now)
        current = self.current
        if current is not None and not current.done:
            self.work(current, now)

    def _reject(self, handle: GoalHandle[Goal, Feedback, Value]) -> None:
        handle.abort(Nav2ErrorCode.GOAL_REJECTED, f"{self.node} is not active")
        if self.current is None or self.current.done:
            self.current = handle

    def _accept(self, new: GoalHandle[Goal, Feedback, Value], now: int) -> None:
        if new.cancel_requested:
            new.canceled()
            return
        previous = self.current if self.current is not None and not self.current.done else None
        self.current = new
        new.status = GoalStatus.EXECUTING
        self.start(new, now, previous)
        # Only now, so that `start` still sees the previous goal as running.
        if previous is not None:
            previous.canceled("a newer goal took its place")

    def start(
        self,
        handle: GoalHandle[Goal, Feedback, Value],
        now: int,
        previous: GoalHandle[Goal, Feedback, Value] | None,
    ) -> None:
        """Begin an accepted goal.

        Args:
            handle: The handle of the new goal.
            now: The time (ns).
            previous: The handle of a goal that is still running; it is pre-empted without a call of `stop`.
        """

    def work(self, handle: GoalHandle[Goal, Feedback, Value], now: int) -> None:
        """Work on the goal for one period.

        The first call follows `start` in the same step; calls continue until the handle has ended.

        Args:
            handle: The handle of the running goal.
            now: The time (ns).
        """
        raise NotImplementedError

    def stop(self, handle: GoalHandle[Goal, Feedback, Value], now: int) -> None:
        """Stop the work on a goal that is cancelled; its handle becomes CANCELED right after this call.

        Args:
            handle: The handle of the cancelled goal.
            now: The time (ns).
        """
