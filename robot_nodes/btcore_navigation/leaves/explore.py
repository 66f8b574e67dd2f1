"""Leaves that make a map: explore unknown space and save the map."""

import logging
import math
from pathlib import Path
from typing import Annotated, Protocol, runtime_checkable

from btcore import FAILURE, RUNNING, SUCCESS, In, NodeSpec, Out, Status, SyncAction
from btcore_navigation.action import GoalHandle, GoalStatus
from btcore_navigation.leaves.goal_leaf import GoalLeaf
from btcore_robot.robot import Pose2D, Robot

LOOKING_TIME_NS = 1_000_000_000
"""The time (ns) for which the robot stays at a goal to see the unknown area beside it.

If the area is then still unknown, the goal is excluded.
"""
CHECK_PERIOD_NS = 1_000_000_000
"""The period (ns) of the check whether the area at the goal is still unknown during the drive."""
DEFAULT_FILE = "map.yaml"

log = logging.getLogger(__name__)


@runtime_checkable
class Explorer(Protocol):
    """A component that navigates while it makes a map."""

    def go_to(self, goal: Pose2D) -> GoalHandle[object, object, object]:
        """Send a goal in the frame `map`; it replaces a goal that is still running."""

    def must_wait(self) -> bool:
        """Return whether the robot has to stand because its pose is not known yet."""

    def goals_wait(self) -> bool:
        """Return whether the robot cannot drive to any goal at present.

        Its pose is not known, a sensor has no readings, or the battery is empty.
        """

    def keep_waiting(self, began: int) -> tuple[int, str] | None:
        """Wait on and return None, or return why waiting has no purpose: Nav2's error code, and a message.

        Args:
            began: The time (ns) at which the wait began.
        """

    def estimate(self) -> Pose2D | None:
        """Return the robot's pose in the frame `map`, or None while it is not known."""

    def next_goal(self) -> Pose2D | None:
        """Return the next goal in the frame `map`, or None if there is nothing left to explore."""

    def is_goal_unknown(self) -> bool:
        """Return whether the area around the last goal of `next_goal` is still unknown."""

    def is_goal_free(self) -> bool:
        """Return whether the robot can stand at the last goal of `next_goal`."""

    def exclude_goal(self) -> None:
        """Exclude the area around the last goal of `next_goal` from further exploration."""

    def save(self, path: Path) -> None:
        """Write the current map to *path*.

        Raises:
            MapError: The files cannot be written.
        """


class MapFile:
    """The default *path* of SaveMap, and whether a map has been *saved* there."""

    def __init__(self, path: Path | None = None) -> None:
        self.path = path
        self.saved = False


class Explore(GoalLeaf):
    """Drives to all borders of the known floor, one after another: RUNNING, then SUCCESS if none is left.

    Goals that cannot be reached, or from which no unknown area becomes visible, are excluded. FAILURE when a
    goal fails because the robot cannot drive at all, for example with an empty battery, and when the robot
    has waited for its pose or its sensors for too long. A halt cancels the drive; the next start continues
    the exploration and keeps *start*.
    """

    start: Annotated[
        Out[Pose2D | None], "The robot's pose when the exploration began, in the frame map: the way back."
    ] = None

    spec = NodeSpec(hands_over=True, writes_early=True)  # a halt cancels the goal of this leaf only

    def __init__(self, explorer: Explorer, robot: Robot) -> None:
        self.explorer = explorer
        self.clock = robot.clock
        self.last_check = 0
        self.waits_since: int | None = None
        self.arrived: int | None = None
        self.goal: Pose2D | None = None
        self.failed_goal: Pose2D | None = None
        self.is_start_written = False

    def on_start(self) -> Status:
        """Send the first goal."""
        return self.send_next_goal()

    def on_running(self) -> Status:
        """Send the next goal when the current goal has ended or is no longer worth driving to."""
        now = self.clock.now()
        if self.handle is None:
            return self.send_next_goal()
        if not self.handle.poll():
            return self.check_goal(now)
        if self.handle.status is GoalStatus.ABORTED:
            result = self.handle.result
            return self.handle_abort(result.message if result else "the goal was aborted")
        if self.arrived is None:
            self.arrived = now
        if now - self.arrived < LOOKING_TIME_NS:
            return RUNNING
        if self.explorer.is_goal_unknown():
            self.explorer.exclude_goal()
        return self.send_next_goal()

    def check_goal(self, now: int) -> Status:
        """Check at *now* (ns), but not more often than once a period, whether the goal is still useful."""
        if now - self.last_check < CHECK_PERIOD_NS:
            return RUNNING
        self.last_check = now
        is_useful = self.explorer.is_goal_unknown() and self.explorer.is_goal_free()
        return RUNNING if is_useful else self.send_next_goal()

    def handle_abort(self, reason: str) -> Status:
        """Send the next goal after a goal that was aborted, or end if goals have to wait."""
        if self.explorer.goals_wait():
            log.warning("%s: the exploration ends: %s", self.config.path, reason)
            return self.end(FAILURE)
        log.info("%s: can't get there: %s", self.config.path, reason)
        # An obstacle may have closed the way; a second failure means that there is no other way.
        if are_near(self.failed_goal, self.goal):
            self.explorer.exclude_goal()
        self.failed_goal = self.goal
        return self.send_next_goal()

    def send_next_goal(self) -> Status:
        """Send the next goal, or return SUCCESS if there is no goal left."""
        now = self.clock.now()
        self.last_check, self.arrived = now, None
        if self.explorer.must_wait():
            self.waits_since = now if self.waits_since is None else self.waits_since
            reason = self.explorer.keep_waiting(self.waits_since)
            if reason is None:
                return RUNNING
            log.warning("%s: the exploration ends: %s", self.config.path, reason[1])
            return self.end(FAILURE)
        self.waits_since = None
        if not self.is_start_written and "start" in self.config.outputs:
            self.start = self.explorer.estimate()
        self.is_start_written = True
        self.goal = self.explorer.next_goal()
        if self.goal is None:
            return self.end(SUCCESS)
        self.handle = self.explorer.go_to(self.goal)
        return RUNNING

    def end(self, status: Status) -> Status:
        """Cancel the drive, so that the next start begins a new exploration, and return *status*."""
        self.on_halted()
        self.is_start_written = False
        self.waits_since = None
        return status


def are_near(first: Pose2D | None, second: Pose2D | None) -> bool:
    """Return whether both poses are known and less than 0.5 m apart."""
    return (
        first is not None and second is not None and math.hypot(first.x - second.x, first.y - second.y) < 0.5
    )


class SaveMap(SyncAction):
    """Writes the map: FAILURE when the files cannot be written."""

    file: Annotated[In[str], "The map's YAML file; empty: the file of --save-map, or map.yaml."] = ""

    spec = NodeSpec(state_fields=())

    def __init__(self, explorer: Explorer, map_file: MapFile) -> None:
        self.explorer = explorer
        self.map_file = map_file

    def tick(self) -> bool:
        """Write the files."""
        # Imported here because maps need libraries that the other leaves do without.
        from btcore_robot.occupancy_map import MapError

        path = Path(self.file) if self.file else self.map_file.path or Path(DEFAULT_FILE)
        try:
            self.explorer.save(path)
        except MapError as error:
            log.warning("%s: %s", self.config.path, error)
            return False
        self.map_file.saved = self.map_file.saved or path == self.map_file.path
        return True
