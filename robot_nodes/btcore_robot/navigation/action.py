"""Actions: work that takes a while, asked for by a goal and watched by a handle, in ROS 2's words.

A server is a task on the robot's schedule. A goal that is sent is accepted at the server's next step; a new
one takes the place of the old (pre-emption); what has ended is seen by whoever looks at the handle.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Generic, TypeVar

Goal = TypeVar("Goal")
Feedback = TypeVar("Feedback")
Value = TypeVar("Value")


class GoalStatus(IntEnum):
    """The state of a goal; names and numbers are those of ``action_msgs/GoalStatus``."""

    UNKNOWN = 0
    ACCEPTED = 1
    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6


ENDED = frozenset({GoalStatus.SUCCEEDED, GoalStatus.CANCELED, GoalStatus.ABORTED})


@dataclass(frozen=True, slots=True)
class Result(Generic[Value]):
    """How an action ended: *code* 0 or one of Nav2's error codes, *message* for a person, and a value."""

    code: int = 0
    message: str = ""
    value: Value | None = None


class GoalHandle(Generic[Goal, Feedback, Value]):
    """One goal that was sent. Its server writes it; whoever sent it reads it, and may `cancel`."""

    def __init__(self, goal: Goal) -> None:
        self.goal = goal
        self.status = GoalStatus.UNKNOWN
        self.feedback: Feedback | None = None
        self.result: Result[Value] | None = None
        self.cancel_asked = False

    @property
    def done(self) -> bool:
        """Whether it has ended, one way or another."""
        return self.status in ENDED

    def cancel(self) -> None:
        """Ask the server to end this goal; an ended one stays as it is."""
        if not self.done:
            self.cancel_asked = True
            if self.status in (GoalStatus.ACCEPTED, GoalStatus.EXECUTING):
                self.status = GoalStatus.CANCELING

    def succeed(self, value: Value | None = None) -> None:
        """End it well."""
        self._end(GoalStatus.SUCCEEDED, Result(value=value))

    def abort(self, code: int, message: str, value: Value | None = None) -> None:
        """End it badly, with one of Nav2's error codes and a sentence."""
        self._end(GoalStatus.ABORTED, Result(code, message, value))

    def canceled(self, message: str = "the goal was cancelled") -> None:
        """End it because somebody asked for that, or because a newer goal took its place."""
        self._end(GoalStatus.CANCELED, Result(0, message))

    def _end(self, status: GoalStatus, result: Result[Value]) -> None:
        if not self.done:
            self.status = status
            self.result = result


class ActionServer(Generic[Goal, Feedback, Value]):
    """Serves one goal at a time. A subclass says what `start`, `work` and `stop` mean.

    `step` belongs on the schedule. What raises in a subclass is a bug, not a failed goal: abort the handle.
    """

    name = "action"

    def __init__(self) -> None:
        self._next: GoalHandle[Goal, Feedback, Value] | None = None
        self.current: GoalHandle[Goal, Feedback, Value] | None = None

    def send_goal(self, goal: Goal) -> GoalHandle[Goal, Feedback, Value]:
        """Ask for *goal*. An older one that runs or waits for its turn ends as CANCELED at the next step."""
        if self._next is not None:
            self._next.canceled("a newer goal took its place")
        self._next = GoalHandle(goal)
        return self._next

    @property
    def busy(self) -> bool:
        """Whether there is a goal that has not ended, accepted or not."""
        return self._next is not None or (self.current is not None and not self.current.done)

    def step(self, now: int) -> None:
        """One period at *now* (ns): cancel, accept, work."""
        current = self.current
        if current is not None and not current.done and current.cancel_asked:
            self.stop(current, now)
            current.canceled()
        coming, self._next = self._next, None
        if coming is not None:
            self._accept(coming, now)
        current = self.current
        if current is not None and not current.done:
            self.work(current, now)

    def _accept(self, coming: GoalHandle[Goal, Feedback, Value], now: int) -> None:
        if coming.cancel_asked:
            coming.canceled()
            return
        previous = self.current if self.current is not None and not self.current.done else None
        self.current = coming
        coming.status = GoalStatus.EXECUTING
        self.start(coming, now, previous)
        if previous is not None:
            previous.canceled("a newer goal took its place")

    def start(
        self,
        handle: GoalHandle[Goal, Feedback, Value],
        now: int,
        previous: GoalHandle[Goal, Feedback, Value] | None,
    ) -> None:
        """A goal was accepted; *previous* is one that still ran, and is pre-empted without a `stop`."""

    def work(self, handle: GoalHandle[Goal, Feedback, Value], now: int) -> None:
        """One period of work on the goal; called right after `start` too, and until the handle has ended."""
        raise NotImplementedError

    def stop(self, handle: GoalHandle[Goal, Feedback, Value], now: int) -> None:
        """The goal is about to end because somebody cancelled it."""
