"""Leaves that make a map: going to where nobody has looked yet, and writing down what was seen."""

import logging
import math
from pathlib import Path
from typing import Annotated, Protocol, runtime_checkable

from btcore import In, StatefulAction, Status, SyncAction
from btcore_robot.navigation.action import GoalHandle, GoalStatus
from btcore_robot.robot import Pose2D, Robot

LOOKING = 1_000_000_000
"""How long (ns) the robot stands where it has come to look, before it gives up what it doesn't see."""
CHECKED = 1_000_000_000
"""How often (ns) it asks on its way whether what it wants to look at has been seen by now."""
DEFAULT_FILE = "map.yaml"

log = logging.getLogger(__name__)


@runtime_checkable
class Explorer(Protocol):
    """Whoever drives a robot about and makes a map on the way."""

    def go_to(self, goal: Pose2D) -> GoalHandle[object, object, object]:
        """Send a goal in the frame ``map``; a goal that runs is given up for it."""
        ...

    def must_wait(self) -> bool:
        """Whether the robot has to stand, since it doesn't know yet where it is."""
        ...

    def next_goal(self) -> Pose2D | None:
        """Where to go next in order to see more; None when there is no such place left."""
        ...

    def is_goal_unknown(self) -> bool:
        """Whether what was to be looked at, at the place of the last `next_goal`, still is unknown."""
        ...

    def exclude_goal(self) -> None:
        """Don't look there again."""
        ...

    def save(self, path: Path) -> None:
        """Write the map as it is now; raises `MapError` when that can't be."""
        ...


class MapFile:
    """Where a map is to be saved that has no name in its tree, and whether one was."""

    def __init__(self, path: Path | None = None) -> None:
        self.path = path
        self.saved = False


class Explore(StatefulAction):
    """Go to where the known floor ends, again and again: RUNNING; SUCCESS when all that can be seen is.

    What can't be reached, or shows nothing, is left out. A halt cancels the drive.
    """

    def __init__(self, explorer: Explorer, robot: Robot) -> None:
        self.explorer = explorer
        self.clock = robot.clock
        self.handle: GoalHandle[object, object, object] | None = None
        self.checked = 0
        self.arrived: int | None = None
        self.aim: Pose2D | None = None
        self.failed: Pose2D | None = None

    def on_start(self) -> Status:
        """Go to the first place."""
        return self.next()

    def on_running(self) -> Status:
        """See how far it is, and whether it is still worth it."""
        now = self.clock.now()
        if self.handle is None:
            return self.next()
        if not self.handle.done:
            if now - self.checked < CHECKED:
                return Status.RUNNING
            self.checked = now
            return Status.RUNNING if self.explorer.is_goal_unknown() else self.next()
        if self.handle.status is GoalStatus.ABORTED:
            result = self.handle.result
            log.info("%s: it can't get there: %s", self.path, result.message if result else "it was aborted")
            # What comes into sight on the way may close it; the second time there is no other.
            if near(self.failed, self.aim):
                self.explorer.exclude_goal()
            self.failed = self.aim
            return self.next()
        if self.arrived is None:
            self.arrived = now
        if now - self.arrived < LOOKING:
            return Status.RUNNING
        if self.explorer.is_goal_unknown():
            self.explorer.exclude_goal()
        return self.next()

    def on_halted(self) -> None:
        """Cancel the drive."""
        if self.handle is not None:
            self.handle.cancel()
            self.handle = None

    def next(self) -> Status:
        """Go to the next place, if there is one."""
        self.checked, self.arrived = self.clock.now(), None
        if self.explorer.must_wait():
            return Status.RUNNING
        self.aim = self.explorer.next_goal()
        if self.aim is None:
            self.on_halted()
            return Status.SUCCESS
        self.handle = self.explorer.go_to(self.aim)
        return Status.RUNNING


def near(one: Pose2D | None, other: Pose2D | None) -> bool:
    """Whether two places are known, and less than 0.5 m apart."""
    return one is not None and other is not None and math.hypot(one.x - other.x, one.y - other.y) < 0.5


class SaveMap(SyncAction):
    """Write the map: FAILURE where that can't be."""

    file: Annotated[In[str], "Where to, as map_server's YAML; empty: what --save-map names, or map.yaml."] = (
        ""
    )

    def __init__(self, explorer: Explorer, named: MapFile) -> None:
        self.explorer = explorer
        self.named = named

    def tick(self) -> bool:
        """Write it."""
        # Here and not above: maps need libraries that other leaves do without.
        from btcore_robot.navigation.map_yaml import MapError

        path = Path(self.file) if self.file else self.named.path or Path(DEFAULT_FILE)
        try:
            self.explorer.save(path)
        except MapError as fault:
            log.warning("%s: %s", self.path, fault)
            return False
        self.named.saved = self.named.saved or path == self.named.path
        return True
