"""Nav2's decorators, which tick the child at a rate, after a distance, or when the goal changes."""

import math
from collections import deque
from copy import copy
from typing import Annotated

from btcore import FAILURE, RUNNING, SKIPPED, SUCCESS, DecoratorNode, In, NodeError, NodeSpec, Out, Status
from btcore.clock import NS_PER_S
from btcore.engine.node import read_clock
from btcore_navigation.navigation_servers import NavigationServers
from btcore_navigation.nodes.port_access import (
    OPTIONAL,
    Goal,
    GoalList,
    Goals,
    blackboard_default,
    goal_inputs,
    is_first_tick,
    path_input,
    path_port,
    pose_input,
    poses_input,
    write_outputs,
)
from btcore_navigation.path import NavPath
from btcore_robot.leaves.pose_types import Poses
from btcore_robot.robot import Pose2D


class RateController(DecoratorNode):
    """Ticks the child at *hz*, and on every tick while the child is RUNNING; returns RUNNING in between.

    The period starts again when the child succeeds.
    """

    hz: Annotated[In[float], "Rate (Hz)."] = 10.0

    spec = NodeSpec(state_fields=("due",), time_fields=("due",))

    def __init__(self) -> None:
        self.due = 0

    def tick(self) -> Status:
        """Tick the child if its period is over."""
        # Before `set_status`, because `is_first_tick` reads the status.
        first = is_first_tick(self)
        if first:
            self.due = _period_end(self, self.hz)
        self.set_status(RUNNING)
        if not (first or self.child.status is RUNNING or self.has_passed(self.due)):
            return RUNNING
        status = self.child.execute_tick()
        if status is SUCCESS:
            self.due = _period_end(self, self.hz)
        return status


class DistanceController(DecoratorNode):
    """Ticks the child when the robot is *distance* (m) away from its position at the child's last SUCCESS."""

    distance: Annotated[In[float], "Distance (m) between two starts of the child."] = 1.0
    global_frame: Annotated[In[str], "Global frame; always map here."] = "map"
    robot_base_frame: Annotated[In[str], "Robot base frame; always base_footprint here."] = "base_footprint"

    spec = NodeSpec(state_fields=("start",), results_without_child=frozenset({FAILURE, RUNNING}))

    def __init__(self, servers: NavigationServers) -> None:
        self.servers = servers
        self.start: Pose2D | None = None

    def tick(self) -> Status:
        """Tick the child if the distance is reached; return FAILURE while the robot's pose is unknown."""
        if is_first_tick(self):
            self.start = None
        self.set_status(RUNNING)
        here = self.servers.pose()
        if here is None:
            return FAILURE
        is_first = self.start is None
        start = self.start = self.start or here
        is_far = math.hypot(here.x - start.x, here.y - start.y) >= self.distance
        if not (is_first or is_far or self.child.status is RUNNING):
            return RUNNING
        status = self.child.execute_tick()
        if status is SUCCESS:
            self.start = here
        return status


class SpeedController(DecoratorNode):
    """Ticks the child at a rate that grows with the robot's speed, and at once when the goal changes.

    Between *min_speed* and *max_speed* the rate grows linearly from *min_rate* to *max_rate*. The mean speed
    over *filter_duration*, at the end of a period, determines the length of the next period.
    """

    min_rate: Annotated[In[float], "Minimum rate (Hz)."] = 0.1
    max_rate: Annotated[In[float], "Maximum rate (Hz)."] = 1.0
    min_speed: Annotated[In[float], "Minimum speed (m/s): at or below it the rate is min_rate."] = 0.0
    max_speed: Annotated[In[float], "Maximum speed (m/s): at or above it the rate is max_rate."] = 0.5
    filter_duration: Annotated[In[float], "Duration (s) over which the speed is averaged."] = 0.3
    goal: Goal = blackboard_default("goal")
    goals: GoalList = blackboard_default("goals")

    spec = NodeSpec(state_fields=("due", "goal_changed", "previous_goals", "speeds"), time_fields=("due",))

    def __init__(self, servers: NavigationServers) -> None:
        self.servers = servers
        self.due = 0
        self.previous_goals: Goals = (None, ())
        self.goal_changed = True
        self.speeds: deque[tuple[int, float]] = deque()

    def tick(self) -> Status:
        """Tick the child if its period is over or the goal has changed.

        Raises:
            NodeError: A rate is not above 0.
        """
        goals = goal_inputs(self)
        speed = self.measure_speed()
        if is_first_tick(self) or goals != self.previous_goals:
            if min(self.min_rate, self.max_rate) <= 0.0:
                raise NodeError("<SpeedController> needs rates above 0 in min_rate and max_rate")
            self.previous_goals, self.goal_changed = goals, True
            self.due = _period_end(self, self.max_rate)
        self.set_status(RUNNING)
        is_due = self.has_passed(self.due)
        if not (self.goal_changed or is_due or self.child.status is RUNNING):
            return RUNNING
        self.goal_changed = False
        if is_due:
            self.due = _period_end(self, self.rate(speed))
        return self.child.execute_tick()

    def measure_speed(self) -> float:
        """Return the mean speed (m/s) that odometry reported over the last *filter_duration*."""
        newest = self.servers.odometry()
        if newest is None:
            return 0.0
        if not self.speeds or newest.stamp > self.speeds[-1][0]:
            self.speeds.append((newest.stamp, newest.twist.v))
        oldest = newest.stamp - self.filter_duration * NS_PER_S
        while self.speeds[0][0] < oldest:
            self.speeds.popleft()
        return abs(sum(speed for _, speed in self.speeds) / len(self.speeds))

    def rate(self, speed: float) -> float:
        """Return the rate (Hz) at *speed* (m/s)."""
        fraction = (speed - self.min_speed) / max(self.max_speed - self.min_speed, 1e-9)
        lowest, highest = self.min_rate, self.max_rate
        return max(lowest, min(highest, lowest + fraction * (highest - lowest)))


class GoalUpdatedController(DecoratorNode):
    """Ticks the child on the first tick, when the goal changes, and while RUNNING; else returns RUNNING."""

    goal: Goal = blackboard_default("goal")
    goals: GoalList = blackboard_default("goals")

    spec = NodeSpec(state_fields=("previous_goals",))

    def __init__(self) -> None:
        self.previous_goals: Goals = (None, ())

    def tick(self) -> Status:
        """Tick the child on the first tick, after a change of the goal, and while it is RUNNING."""
        first = is_first_tick(self)
        self.set_status(RUNNING)
        goals = goal_inputs(self)
        changed = goals != self.previous_goals
        self.previous_goals = goals
        if first or changed or self.child.status is RUNNING:
            return self.child.execute_tick()
        return RUNNING


class GoalUpdater(DecoratorNode):
    """Writes the newest goal for the child: the input, or a newer message of the topic `goal_update`.

    A list of goals is handled in the same way, with the topic `goals_update`.
    """

    input_goal: Annotated[In[Pose2D], "Original goal."] = OPTIONAL
    input_goals: Annotated[In[Poses], "Original goals."] = OPTIONAL
    output_goal: Annotated[Out[Pose2D], "Goal that the child receives."] = OPTIONAL
    output_goals: Annotated[Out[Poses], "Goals that the child receives."] = OPTIONAL

    spec = NodeSpec(state_fields=("several", "single"), results_without_child=frozenset())

    def __init__(self, servers: NavigationServers) -> None:
        self.servers = servers
        self.single = NewestSource()
        self.several = NewestSource()
        self.topic_values()

    def tick(self) -> Status:
        """Write the newest goals and tick the child."""
        newest_goal, newest_goals = self.topic_values()
        goal = self.single.select(pose_input(self, "input_goal"), newest_goal)
        goals = self.several.select(list(poses_input(self, "input_goals")), newest_goals)
        if goal is not None:
            write_outputs(self, output_goal=goal)
        if goals:
            write_outputs(self, output_goals=goals)
        return self.child.execute_tick()

    def topic_values(self) -> tuple[Pose2D | None, list[Pose2D] | None]:
        """Return the newest messages of the topics; the first call subscribes to them."""
        return self.servers.latest("goal_update", Pose2D), self.servers.latest("goals_update", list)


class NewestSource:
    """A choice between the value of a port and the value of a topic: the value that changed last wins."""

    def __init__(self) -> None:
        self.port_value: object = None
        self.topic_value: object = None
        self.choice: object = None

    def __deepcopy__(self, memo: object) -> "NewestSource":
        """Return a copy with the same values, for saved states: messages are compared by identity."""
        return copy(self)

    def select(self, port_value: object, topic_value: object) -> object:
        """Return the value that changed last.

        Args:
            port_value: The present value of the port. It counts as changed if it is not equal to the value of
                the previous call.
            topic_value: The present value of the topic; ignored if it is None or empty. It counts as changed
                if it is not the same object as in the previous call, even if both are equal.

        Returns:
            The changed value; the topic's value if both changed, the previous result if neither changed.
        """
        if self.choice is None or port_value != self.port_value:
            self.choice = port_value
        # Identity, not equality: publishing an equal goal again makes it the newest.
        if topic_value and topic_value is not self.topic_value:
            self.choice = topic_value
        self.port_value, self.topic_value = port_value, topic_value
        return self.choice


class SingleTrigger(DecoratorNode):
    """Ticks the child until it has returned SUCCESS or FAILURE once; returns FAILURE from then on."""

    spec = NodeSpec(state_fields=("triggered",))

    def __init__(self) -> None:
        self.triggered = False

    def tick(self) -> Status:
        """Tick the child until it has ended."""
        if is_first_tick(self):
            self.triggered = False
        self.set_status(RUNNING)
        if self.triggered:
            return FAILURE
        status = self.child.execute_tick()
        self.triggered = status in (SUCCESS, FAILURE)
        return status


class PathLongerOnApproach(DecoratorNode):
    """Ticks the child when, near the goal, the path to it has become much longer; else returns SUCCESS.

    While the child is RUNNING, each new path is compared with the path from before the child started. When
    the newest path is no longer much longer than that path, the child is halted.
    """

    prox_len: Annotated[In[float], "Proximity length (m): a shorter path is near the goal."] = 3.0
    length_factor: Annotated[In[float], "Factor by which the new path must be longer."] = 2.0

    provided_ports = path_port("Planned path.")

    spec = NodeSpec(state_fields=("previous",))

    def __init__(self) -> None:
        self.previous: NavPath | None = None

    def tick(self) -> Status:
        """Compare the paths and tick the child if the new path is much longer."""
        self.set_status(RUNNING)
        path, status = path_input(self, "path"), SUCCESS
        if self.is_longer(path, self.previous):
            status = self.child.execute_tick()
            if status in (RUNNING, SKIPPED):
                return status
        self.reset_child()
        self.previous = path
        return status

    def is_longer(self, path: NavPath | None, before: NavPath | None) -> bool:
        """Return whether a path to the same near goal has become much longer.

        Args:
            path: The new path; with None the result is False. It is much longer if its length is more than
                *length_factor* times the length of *before*.
            before: The previous path; with None the result is False. The goal is near if this path is shorter
                than *prox_len* (m).
        """
        if path is None or before is None or path == before or path.goal != before.goal:
            return False
        return before.length() < self.prox_len and path.length() > self.length_factor * before.length()


def _period_end(node: DecoratorNode, rate: float) -> int:
    """Return the end (ns) of a period that begins now, at *rate* (Hz)."""
    return read_clock(node) + math.ceil(NS_PER_S / rate)
