"""A leaf that navigates to a pose: an action client of the navigator."""

import logging
from typing import Annotated, Protocol, runtime_checkable

from btcore import FAILURE, RUNNING, SUCCESS, In, NodeSpec, Out, Status
from btcore_navigation.action import GoalHandle, GoalStatus
from btcore_navigation.leaves.goal_leaf import GoalLeaf
from btcore_robot.robot import Pose2D, Robot

SERVER_TIMEOUT_NS = 1_000_000_000
"""The maximum time (ns) until a server that was found accepts a goal."""

log = logging.getLogger(__name__)


@runtime_checkable
class PoseNavigator(Protocol):
    """A component that drives a robot to poses in the frame `map`."""

    def go_to(self, goal: Pose2D) -> GoalHandle[object, object, object]:
        """Send a goal in the frame `map`; it replaces a goal that is still running."""


class Move(GoalLeaf):
    """Navigates to *goal*: RUNNING on the way, SUCCESS on arrival, FAILURE when navigation gives up.

    A halt cancels the goal. If another client cancels the goal, the result is SUCCESS, as in the book
    *A Concise Introduction to Robot Programming with ROS2*.
    """

    goal: Annotated[In[Pose2D], "The goal in the frame map: x;y or x;y;yaw (m, rad), or a blackboard entry."]
    error_code: Annotated[Out[int | None], "Nav2's error code; 0 when there was no error."] = None
    error: Annotated[Out[str | None], "The error message; empty when there was no error."] = None

    spec = NodeSpec(hands_over=True, may_complete_on_start=False)  # a halt cancels the goal of this leaf only

    def __init__(self, navigator: PoseNavigator, robot: Robot) -> None:
        self.navigator = navigator
        self.clock = robot.clock
        self.sent = 0

    def on_start(self) -> Status:
        """Send the goal."""
        self.sent = self.clock.now()
        self.handle = self.navigator.go_to(self.goal)
        return RUNNING

    def on_running(self) -> Status:
        """Check whether the goal was accepted or has ended."""
        handle = self.handle
        if handle is None:
            return FAILURE
        has_ended = handle.poll()
        limit = SERVER_TIMEOUT_NS + handle.discovery_ns
        if handle.status is GoalStatus.UNKNOWN and self.clock.now() - self.sent > limit:
            handle.cancel()
            # 9000 is UNKNOWN of Nav2's action NavigateToPose.
            return self.fail(9000, handle.missing_acceptance)
        if not has_ended:
            return RUNNING
        self.handle = None
        if handle.status is GoalStatus.ABORTED:
            result = handle.result
            return self.fail(
                result.code if result else 0, result.message if result else "the goal was aborted"
            )
        self.write_outputs(0, "")
        return SUCCESS

    def fail(self, code: int, message: str) -> Status:
        """Log the error, write it to the output ports, and return FAILURE.

        Args:
            code: Nav2's error code.
            message: The reason, as text for the log and the port `error`.
        """
        goal = self.goal
        log.warning("%s: can't go to (%.2f, %.2f): %s", self.config.path, goal.x, goal.y, message)
        self.write_outputs(code, message)
        return FAILURE

    def write_outputs(self, code: int, message: str) -> None:
        """Write the error code and the message to the output ports that the tree connects.

        Args:
            code: The value for the port `error_code`: Nav2's error code, or 0 without an error.
            message: The value for the port `error`: the error message, or "" without an error.
        """
        outputs = self.config.outputs
        if "error_code" in outputs:
            self.error_code = code
        if "error" in outputs:
            self.error = message
