"""A leaf that selects the next waypoint of a patrol.

The patrol is from chapter 6.3 of the book *A Concise Introduction to Robot Programming with ROS2*.
"""

from contextlib import suppress
from itertools import count, takewhile
from typing import Annotated

from btcore import BtcoreError, In, NodeError, NodeSpec, Out, SyncAction, TreeResource
from btcore.suggestions import join_names
from btcore_robot.errors import RobotError
from btcore_robot.robot import Pose2D, Waypoints

RECHARGE = "recharge"
FIRST = "wp1"
"""The first waypoint of a patrol. The others are wp2, wp3 and so on, as far as they exist."""


class WaypointError(RobotError):
    """Raised when a tree is created whose `GetWaypoint` needs a waypoint that does not exist."""


class PatrolProgress(TreeResource):
    """The number of patrol waypoints that the GetWaypoint nodes of a tree have written so far."""

    def __init__(self) -> None:
        self.visited = 0


class GetWaypoint(SyncAction):
    """Writes a waypoint: the charger for `recharge`, otherwise wp1, wp2, wp3 … in turn, then wp1 again.

    All GetWaypoint nodes of a tree share the sequence. It advances when a waypoint is written. If the drive
    to a waypoint is interrupted, the waypoint is skipped, as in the book *A Concise Introduction to Robot
    Programming with ROS2*.
    """

    wp_id: Annotated[In[str], "'recharge', or any other text for the next waypoint of the patrol."] = "next"
    waypoint: Annotated[Out[Pose2D], "The waypoint, in the frame map."]

    spec = NodeSpec(state_fields=("progress",))  # the nodes of a restored tree share one copy

    def __init__(self, progress: PatrolProgress, waypoints: Waypoints) -> None:
        self.progress = progress
        self.waypoints = waypoints
        names = takewhile(waypoints.places.__contains__, (f"wp{number}" for number in count(1)))
        self.route = tuple(names) or (FIRST,)
        self._check_waypoints()

    def tick(self) -> bool:
        """Write the waypoint."""
        if self.wp_id == RECHARGE:
            self.waypoint = self.pose_of(RECHARGE)
        else:
            name = self.route[self.progress.visited % len(self.route)]
            self.progress.visited += 1
            self.waypoint = self.pose_of(name)
        return True

    def pose_of(self, name: str) -> Pose2D:
        """Return the waypoint *name*.

        Raises:
            NodeError: There is no such waypoint.
        """
        places, source = self.waypoints.places, self.waypoints.source
        if name not in places:
            known = join_names(places) if places else "none at all"
            raise NodeError(f"{source} has no waypoint '{name}'; its waypoints are {known}")
        return places[name]

    def _check_waypoints(self) -> None:
        """Raise WaypointError if the first waypoint that the node needs does not exist."""
        name = FIRST
        with suppress(BtcoreError):  # an entry that no node has written yet
            name = RECHARGE if self.wp_id == RECHARGE else FIRST
        found = self.waypoints
        if name in found.places:
            return
        needed = f"waypoint '{name}', but {self.config.path} needs it"
        if not found.places:
            needed = f"waypoints, but {self.config.path} needs them"
        remedy = f"; {found.remedy.replace('{name}', name)}" if found.remedy else ""
        raise WaypointError(f"{found.source} has no {needed}{remedy}")
