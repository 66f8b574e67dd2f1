"""Going to a place: an action client of whoever navigates."""

import logging
from typing import Annotated, Protocol, runtime_checkable

from btcore import In, Out, StatefulAction, Status
from btcore_robot.navigation.action import GoalHandle, GoalStatus
from btcore_robot.robot import Pose2D, Robot

SERVER_TIMEOUT = 1_000_000_000
"""How long (ns) a server may take to accept a goal."""

log = logging.getLogger(__name__)


@runtime_checkable
class PoseNavigator(Protocol):
    """Whoever drives a robot to a pose in the frame ``map``."""

    def go_to(self, goal: Pose2D) -> GoalHandle[object, object, object]:
        """Send a goal; a goal that runs is given up for it."""
        ...


class Move(StatefulAction):
    """Navigate to *goal*: RUNNING on the way; SUCCESS there, FAILURE when navigation gives up.

    A halt cancels the goal; one that somebody else cancelled is a SUCCESS, as in the book.
    """

    goal: Annotated[In[Pose2D], "Where to, in the frame map: x;y or x;y;yaw (m, rad), or an entry."]
    error_code: Annotated[Out[int | None], "Nav2's number of what went wrong; 0 when nothing did."] = None
    error: Annotated[Out[str | None], "What went wrong, in words."] = None

    def __init__(self, navigator: PoseNavigator, robot: Robot) -> None:
        self.navigator = navigator
        self.clock = robot.clock
        self.handle: GoalHandle[object, object, object] | None = None
        self.sent = 0

    def on_start(self) -> Status:
        """Send the goal."""
        self.sent = self.clock.now()
        self.handle = self.navigator.go_to(self.goal)
        return Status.RUNNING

    def on_running(self) -> Status:
        """See how far it is."""
        handle = self.handle
        if handle is None:
            return Status.FAILURE
        if handle.status is GoalStatus.UNKNOWN and self.clock.now() - self.sent > SERVER_TIMEOUT:
            handle.cancel()
            return self.failed(9000, "the navigator didn't accept the goal within 1 s")
        if not handle.done:
            return Status.RUNNING
        self.handle = None
        if handle.status is GoalStatus.ABORTED:
            result = handle.result
            return self.failed(result.code if result else 0, result.message if result else "it was aborted")
        self.tell(0, "")
        return Status.SUCCESS

    def on_halted(self) -> None:
        """Cancel the goal."""
        if self.handle is not None:
            self.handle.cancel()
            self.handle = None

    def failed(self, code: int, message: str) -> Status:
        """Say why, and fail."""
        goal = self.goal
        log.warning("%s: can't go to (%.2f, %.2f): %s", self.path, goal.x, goal.y, message)
        self.tell(code, message)
        return Status.FAILURE

    def tell(self, code: int, message: str) -> None:
        """Write the outputs, where the tree connects them."""
        outputs = self.config.outputs
        if "error_code" in outputs:
            self.error_code = code
        if "error" in outputs:
            self.error = message
