"""Nav2's decorators: they tick their child at a rate, after a way, or when the goal is another."""

import math
from collections import deque
from typing import Annotated

from btcore import DecoratorNode, In, NodeError, Out, Port, Status
from btcore_robot.leaves.poses import Poses
from btcore_robot.navigation.nodes.port_access import (
    OPTIONAL,
    Goals,
    blackboard_default,
    goals_of,
    is_first_tick,
    path_input,
    path_input_port,
    pose_input,
    poses_input,
    write_outputs,
)
from btcore_robot.navigation.path import NavPath
from btcore_robot.navigation.servers import Servers
from btcore_robot.robot import NS_PER_S, Pose2D

RUNNING, SUCCESS, FAILURE = Status.RUNNING, Status.SUCCESS, Status.FAILURE

Goal = Annotated[In[Pose2D], "The goal."]
Several = Annotated[In[Poses], "The goals."]


class RateController(DecoratorNode):
    """Ticks its child at *hz*, and whenever it is RUNNING; otherwise RUNNING.

    The time begins anew when the child succeeds.
    """

    hz: Annotated[In[float], "How often a second the child begins."] = 10.0

    def __init__(self) -> None:
        self.since = 0

    def tick(self) -> Status:
        """Tick the child if it is time."""
        first = is_first_tick(self)
        if first:
            self.since = self.now()
        self.set_status(RUNNING)
        elapsed = self.now() - self.since
        if not (first or self.child.status is RUNNING or elapsed * self.hz >= NS_PER_S):
            return RUNNING
        status = self.child.execute_tick()
        if status is SUCCESS:
            self.since = self.now()
        return status


class DistanceController(DecoratorNode):
    """Ticks its child when the robot is *distance* (m) from where it was at the child's last SUCCESS."""

    distance: Annotated[In[float], "How far (m) the robot goes between two starts of the child."] = 1.0
    global_frame: Annotated[In[str], "The frame of the distance; map here."] = "map"
    robot_base_frame: Annotated[In[str], "The robot's frame."] = "base_footprint"

    def __init__(self, servers: Servers) -> None:
        self.servers = servers
        self.start: Pose2D | None = None

    def tick(self) -> Status:
        """Tick the child if it is far enough; FAILURE where the robot doesn't know where it is."""
        if is_first_tick(self):
            self.start = None
        self.set_status(RUNNING)
        here = self.servers.pose()
        if here is None:
            return FAILURE
        first = self.start is None
        start = self.start = self.start or here
        far = math.hypot(here.x - start.x, here.y - start.y) >= self.distance
        if not (first or far or self.child.status is RUNNING):
            return RUNNING
        status = self.child.execute_tick()
        if status is SUCCESS:
            self.start = here
        return status


class SpeedController(DecoratorNode):
    """Ticks its child the more often the faster the robot is; at once when the goal is another.

    Between *min_speed* and *max_speed* the rate goes from *min_rate* to *max_rate*. Each period is as long
    as the mean speed of *filter_duration* was when the one before ended.
    """

    min_rate: Annotated[In[float], "The least rate (Hz)."] = 0.1
    max_rate: Annotated[In[float], "The greatest rate (Hz)."] = 1.0
    min_speed: Annotated[In[float], "The speed (m/s) of the least rate."] = 0.0
    max_speed: Annotated[In[float], "The speed (m/s) of the greatest rate."] = 0.5
    filter_duration: Annotated[In[float], "Over how long (s) the speed is averaged."] = 0.3
    goal: Goal = blackboard_default("goal")
    goals: Several = blackboard_default("goals")

    def __init__(self, servers: Servers) -> None:
        self.servers = servers
        self.since = 0
        self.period = 0.0
        self.known: Goals = (None, ())
        self.fresh = True
        self.speeds: deque[tuple[int, float]] = deque()

    def tick(self) -> Status:
        """Tick the child if it is time."""
        now, goals = self.now(), goals_of(self)
        speed = self.speed()
        if is_first_tick(self) or goals != self.known:
            if min(self.min_rate, self.max_rate) <= 0.0:
                raise NodeError("<SpeedController> needs rates above 0, so that there is a time to wait")
            self.known, self.since, self.fresh = goals, now, True
            self.period = 1.0 / self.max_rate
        self.set_status(RUNNING)
        due = now - self.since >= self.period * NS_PER_S
        if not (self.fresh or due or self.child.status is RUNNING):
            return RUNNING
        self.fresh = False
        if due:
            self.since, self.period = now, 1.0 / self.rate(speed)
        return self.child.execute_tick()

    def speed(self) -> float:
        """The mean speed (m/s) that odometry told lately."""
        newest = self.servers.robot.odometry()
        if not self.speeds or newest.stamp > self.speeds[-1][0]:
            self.speeds.append((newest.stamp, newest.twist.v))
        oldest = newest.stamp - self.filter_duration * NS_PER_S
        while self.speeds[0][0] < oldest:
            self.speeds.popleft()
        return abs(sum(speed for _, speed in self.speeds) / len(self.speeds))

    def rate(self, speed: float) -> float:
        """The rate (Hz) at *speed* (m/s)."""
        share = (speed - self.min_speed) / max(self.max_speed - self.min_speed, 1e-9)
        least, most = self.min_rate, self.max_rate
        return max(least, min(most, least + share * (most - least)))


class GoalUpdatedController(DecoratorNode):
    """Ticks its child at first, when the goal is another, and while it is RUNNING; otherwise RUNNING."""

    goal: Goal = blackboard_default("goal")
    goals: Several = blackboard_default("goals")

    def __init__(self) -> None:
        self.known: Goals = (None, ())

    def tick(self) -> Status:
        """Tick the child if there is a reason."""
        first = is_first_tick(self)
        self.set_status(RUNNING)
        goals = goals_of(self)
        changed = goals != self.known
        self.known = goals
        if first or changed or self.child.status is RUNNING:
            return self.child.execute_tick()
        return RUNNING


class GoalUpdater(DecoratorNode):
    """Hands its child the newest goal: what it is given, or what the topic ``goal_update`` said since.

    The same with several goals, and the topic ``goals_update``.
    """

    input_goal: Annotated[In[Pose2D], "The goal to begin with."] = OPTIONAL
    input_goals: Annotated[In[Poses], "The goals to begin with."] = OPTIONAL
    output_goal: Annotated[Out[Pose2D], "The goal to follow."] = OPTIONAL
    output_goals: Annotated[Out[Poses], "The goals to follow."] = OPTIONAL

    def __init__(self, servers: Servers) -> None:
        self.topics = servers.topics
        self.single = Newest()
        self.several = Newest()

    def tick(self) -> Status:
        """Copy, and tick the child."""
        goal = self.single.of(pose_input(self, "input_goal"), self.topics.get("goal_update"))
        goals = self.several.of(list(poses_input(self, "input_goals")), self.topics.get("goals_update"))
        if goal is not None:
            write_outputs(self, output_goal=goal)
        if goals:
            write_outputs(self, output_goals=goals)
        return self.child.execute_tick()


class Newest:
    """Which of two sources has changed last: what a tree gives, or what a topic says."""

    def __init__(self) -> None:
        self.given: object = None
        self.said: object = None
        self.choice: object = None

    def of(self, given: object, said: object) -> object:
        """The one of the two that is newer."""
        if self.choice is None or given != self.given:
            self.choice = given
        if said and said is not self.said:
            self.choice = said
        self.given, self.said = given, said
        return self.choice


class SingleTrigger(DecoratorNode):
    """Ticks its child until it has ended once; FAILURE from then on."""

    def __init__(self) -> None:
        self.triggered = False

    def tick(self) -> Status:
        """Tick the child, the first time."""
        if is_first_tick(self):
            self.triggered = False
        self.set_status(RUNNING)
        if self.triggered:
            return FAILURE
        status = self.child.execute_tick()
        self.triggered = status in (SUCCESS, FAILURE)
        return status


class PathLongerOnApproach(DecoratorNode):
    """Ticks its child when, near the goal, the path to the same goal has become much longer; else SUCCESS.

    While the child is RUNNING, paths are compared with the one from before it began; when the newest is no
    longer that long, the child is halted.
    """

    prox_len: Annotated[In[float], "How long (m) the path may be at most to be near the goal."] = 3.0
    length_factor: Annotated[In[float], "How many times longer counts."] = 2.0

    @staticmethod
    def provided_ports() -> list[Port]:
        """The path; its name is taken in Python."""
        return [path_input_port("The path as it is planned now.")]

    def __init__(self) -> None:
        self.before: NavPath | None = None

    def tick(self) -> Status:
        """Compare, and tick the child if there is a reason."""
        self.set_status(RUNNING)
        path, status = path_input(self, "path"), SUCCESS
        if self.longer(path, self.before):
            status = self.child.execute_tick()
            if status in (RUNNING, Status.SKIPPED):
                return status
        self.reset_child()
        self.before = path
        return status

    def longer(self, path: NavPath | None, before: NavPath | None) -> bool:
        """Whether *path* is a longer one to the same goal, which is near."""
        if path is None or before is None or path == before or path.goal != before.goal:
            return False
        return before.length() < self.prox_len and path.length() > self.length_factor * before.length()
