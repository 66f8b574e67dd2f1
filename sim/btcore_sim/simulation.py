"""A robot in a simulated world during a run, with its report.

This module can be imported without pybullet, to find out whether the robot of a run is simulated.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from btcore_robot.robot import Pose2D
from btcore_sim.run_metrics import RunMetrics

if TYPE_CHECKING:
    from btcore_sim.events import EventRunner
    from btcore_sim.simulated_robot import SimulatedRobot
    from btcore_sim.world_description import WorldDescription


class Simulation:
    """The simulated robot of a run in its world, with what happens there, and what is measured.

    Args:
        description: The world without the people, obstacles and boxes that the run adds.
        events: The runner of events, if the world of the run has people, events or spare boxes.
        resources: The objects of the run; see `RunMetrics`.
        known_start: The start pose; None if the navigation has to find it itself.
    """

    def __init__(
        self,
        robot: "SimulatedRobot",
        description: "WorldDescription",
        events: "EventRunner | None",
        resources: Sequence[object],
        known_start: Pose2D | None,
    ) -> None:
        self.robot = robot
        self.description = description
        self.events = events
        self.metrics = RunMetrics(robot, resources)
        self.known_start = known_start

    def report(self) -> dict[str, object]:
        """Return `{"robot": {"distance_m", "collisions", "grazes", "pose", …}}`, also during the run.

        `RunMetrics.figures` documents the other values. With people or events the report also contains
        `"events"`, a list of the events with time (s) and place (m).
        """
        robot, pose = self.robot, self.robot.true_pose()
        figures = {
            "distance_m": round(robot.distance, 4),
            "collisions": robot.contacts.collisions,
            "grazes": robot.contacts.grazes,
            "pose": {"x": round(pose.x, 4), "y": round(pose.y, 4), "yaw": round(pose.yaw, 4)},
            **self.metrics.figures(),
        }
        return {"robot": figures} | ({} if self.events is None else {"events": self.events.event_log})
