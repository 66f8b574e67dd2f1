"""A leaf that selects the next waypoint of a patrol.

The patrol is from chapter 6.3 of the book *A Concise Introduction to Robot Programming with ROS2*.
"""

from typing import Annotated

from btcore import In, NodeError, Out, SyncAction, TreeState
from btcore.suggestions import join_names
from btcore_robot.robot import Pose2D, Waypoints

RECHARGE = "recharge"
PATROL_WAYPOINTS = ("wp1", "wp2", "wp3")
"""The waypoints of a patrol, in order."""

BOOK_WAYPOINTS = Waypoints(
    {
        RECHARGE: Pose2D(3.67, -0.24, 0.0),
        "wp1": Pose2D(1.07, -12.38, 0.0),
        "wp2": Pose2D(-5.32, -8.85, 0.0),
        "wp3": Pose2D(-0.56, 0.24, 0.0),
    }
)
"""The waypoints of the house in the book: the default when the world defines no waypoints."""


class PatrolProgress(TreeState):
    """The number of patrol waypoints that the GetWaypoint nodes of a tree have written so far."""

    def __init__(self) -> None:
        self.visited = 0


class GetWaypoint(SyncAction):
    """Write a waypoint: the charger for `recharge`, otherwise wp1, wp2, wp3, wp1 … in turn.

    All GetWaypoint nodes of a tree share the sequence. It advances when a waypoint is written. If the drive
    to a waypoint is interrupted, the waypoint is skipped, as in the book *A Concise Introduction to Robot
    Programming with ROS2*.
    """

    wp_id: Annotated[In[str], "'recharge', or any other text for the next waypoint of the patrol."] = "next"
    waypoint: Annotated[Out[Pose2D], "The waypoint, in the frame map."]

    state_fields = ("progress",)  # the nodes of a restored tree share one copy

    def __init__(self, progress: PatrolProgress, waypoints: Waypoints = BOOK_WAYPOINTS) -> None:
        self.progress = progress
        self.places = waypoints.places

    def tick(self) -> bool:
        """Write the waypoint."""
        if self.wp_id == RECHARGE:
            self.waypoint = self.pose_of(RECHARGE)
        else:
            name = PATROL_WAYPOINTS[self.progress.visited % len(PATROL_WAYPOINTS)]
            self.progress.visited += 1
            self.waypoint = self.pose_of(name)
        return True

    def pose_of(self, name: str) -> Pose2D:
        """Return the waypoint *name*.

        Raises:
            NodeError: The world does not define the waypoint.
        """
        if name not in self.places:
            known = join_names(self.places) if self.places else "none at all"
            raise NodeError(f"this world has no waypoint '{name}'; its waypoints are {known}")
        return self.places[name]
