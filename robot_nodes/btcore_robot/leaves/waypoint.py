"""Where to go next: the waypoints of the book's patrol (chapter 6.3)."""

from typing import Annotated

from btcore import In, NodeError, Out, SyncAction, TreeState
from btcore.suggestions import join_names
from btcore_robot.robot import Pose2D, Waypoints

RECHARGE = "recharge"
ROUND = ("wp1", "wp2", "wp3")
"""The waypoints of a round, in order."""

BOOK = Waypoints(
    {
        RECHARGE: Pose2D(3.67, -0.24, 0.0),
        "wp1": Pose2D(1.07, -12.38, 0.0),
        "wp2": Pose2D(-5.32, -8.85, 0.0),
        "wp3": Pose2D(-0.56, 0.24, 0.0),
    }
)
"""The book's own house, for a robot that nobody tells of another."""


class Round(TreeState):
    """How many waypoints of the round were given out, in one tree."""

    def __init__(self) -> None:
        self.given = 0


class GetWaypoint(SyncAction):
    """Write a waypoint: the charger for ``recharge``, the next one of wp1, wp2, wp3, wp1 … for any other ID.

    All GetWaypoints of a tree count together, and a waypoint is counted when it is given out: one that is
    interrupted on the way is skipped, as in the book.
    """

    wp_id: Annotated[In[str], "'recharge', or anything else for the next waypoint of the round."] = "next"
    waypoint: Annotated[Out[Pose2D], "The place, in the frame map."]

    def __init__(self, round_: Round, waypoints: Waypoints = BOOK) -> None:
        self.round = round_
        self.places = waypoints.places

    def tick(self) -> bool:
        """Give one out."""
        if self.wp_id == RECHARGE:
            self.waypoint = self.find(RECHARGE)
        else:
            name = ROUND[self.round.given % len(ROUND)]
            self.round.given += 1
            self.waypoint = self.find(name)
        return True

    def find(self, name: str) -> Pose2D:
        """The place called *name*; raises NodeError where the world has none."""
        if name not in self.places:
            known = join_names(self.places) if self.places else "none at all"
            raise NodeError(f"this world has no waypoint '{name}'; its waypoints are {known}")
        return self.places[name]
