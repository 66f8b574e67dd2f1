"""Nav2's decorators: they tick their child at a rate, after a way, or when the goal is another."""

import math
from typing import Annotated

from btcore import DecoratorNode, In, Out, Port, Status
from robot_nodes.navigation.nodes.inputs import Goals, goals_of, path_at, path_in, pose_at, poses_at, tell
from robot_nodes.navigation.path import NavPath
from robot_nodes.navigation.servers import Servers
from robot_nodes.robot import Pose2D

NS_PER_S = 1_000_000_000
IDLE, RUNNING, SUCCESS, FAILURE = Status.IDLE, Status.RUNNING, Status.SUCCESS, Status.FAILURE

Goal = Annotated[In[Pose2D], "The goal; the entry {goal} where it isn't given."]
Several = Annotated[In[list[Pose2D]], "The goals; the entry {goals} where they aren't given."]


class RateController(DecoratorNode):
    """Ticks its child at *hz*, and whenever it is RUNNING; otherwise RUNNING.

    The time begins anew when the child succeeds.
    """

    hz: Annotated[In[float], "How often a second the child begins."] = 10.0

    def __init__(self) -> None:
        self.since = 0

    def tick(self) -> Status:
        """Tick the child if it is time."""
        first = self.status is IDLE
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
        first = self.status is IDLE
        self.set_status(RUNNING)
        here = self.servers.pose()
        if here is None:
            return FAILURE
        if first:
            self.start = here
        start = self.start if self.start is not None else here
        far = math.hypot(here.x - start.x, here.y - start.y) >= self.distance
        if not (first or far or self.child.status is RUNNING):
            return RUNNING
        status = self.child.execute_tick()
        if status is SUCCESS:
            self.start = here
        return status


class SpeedController(DecoratorNode):
    """Ticks its child the more often the faster the robot is; at once when the goal is another.

    Between *min_speed* and *max_speed* the rate goes from *min_rate* to *max_rate*.
    """

    min_rate: Annotated[In[float], "The least rate (Hz)."] = 0.1
    max_rate: Annotated[In[float], "The greatest rate (Hz)."] = 1.0
    min_speed: Annotated[In[float], "The speed (m/s) of the least rate."] = 0.0
    max_speed: Annotated[In[float], "The speed (m/s) of the greatest rate."] = 0.5
    goal: Goal
    goals: Several

    def __init__(self, servers: Servers) -> None:
        self.servers = servers
        self.since = 0
        self.period = 0.0
        self.known: Goals = (None, ())
        self.fresh = True

    def tick(self) -> Status:
        """Tick the child if it is time."""
        if self.status is IDLE:
            self.begin()
        self.set_status(RUNNING)
        goals = goals_of(self)
        if goals != self.known:
            self.known = goals
            self.begin()
        if not (self.fresh or self.now() - self.since >= self.period * NS_PER_S):
            if self.child.status is not RUNNING:
                return RUNNING
        elif not self.fresh:
            self.period = 1.0 / self.rate()
        self.fresh = False
        status = self.child.execute_tick()
        if status is SUCCESS:
            self.since = self.now()
        return status

    def begin(self) -> None:
        """Start anew, at the greatest rate."""
        self.known = goals_of(self)
        self.since = self.now()
        self.period = 1.0 / self.max_rate
        self.fresh = True

    def rate(self) -> float:
        """The rate (Hz) at the speed that odometry says."""
        twist = self.servers.robot.odometry().twist
        share = (abs(twist.v) - self.min_speed) / max(self.max_speed - self.min_speed, 1e-9)
        least, most = self.min_rate, self.max_rate
        return max(least, min(most, least + share * (most - least)))


class GoalUpdatedController(DecoratorNode):
    """Ticks its child at first, when the goal is another, and while it is RUNNING; otherwise RUNNING."""

    goal: Goal
    goals: Several

    def __init__(self) -> None:
        self.known: Goals = (None, ())

    def tick(self) -> Status:
        """Tick the child if there is a reason."""
        first = self.status is IDLE
        self.set_status(RUNNING)
        goals = goals_of(self)
        changed = goals != self.known
        self.known = goals
        if first or changed or self.child.status is RUNNING:
            return self.child.execute_tick()
        return RUNNING


class GoalUpdater(DecoratorNode):
    """Hands its child the goal to follow: the newest message of ``goal_update``, else the one it is given."""

    input_goal: Annotated[In[Pose2D], "The goal to begin with."]
    input_goals: Annotated[In[list[Pose2D]], "The goals to begin with."]
    output_goal: Annotated[Out[Pose2D], "The goal to follow."]
    output_goals: Annotated[Out[list[Pose2D]], "The goals to follow."]

    def __init__(self, servers: Servers) -> None:
        self.topics = servers.topics

    def tick(self) -> Status:
        """Copy, and tick the child."""
        self.set_status(RUNNING)
        goal = self.topics.get("goal_update", pose_at(self, "input_goal"))
        goals = self.topics.get("goals_update", list(poses_at(self, "input_goals")))
        if goal is not None:
            tell(self, output_goal=goal)
        if goals:
            tell(self, output_goals=goals)
        return self.child.execute_tick()


class SingleTrigger(DecoratorNode):
    """Ticks its child until it has ended once; FAILURE from then on."""

    def __init__(self) -> None:
        self.triggered = False

    def tick(self) -> Status:
        """Tick the child, the first time."""
        if self.status is IDLE:
            self.triggered = False
        self.set_status(RUNNING)
        if self.triggered:
            return FAILURE
        status = self.child.execute_tick()
        self.triggered = status in (SUCCESS, FAILURE)
        return status


class PathLongerOnApproach(DecoratorNode):
    """Ticks its child when, near the goal, the path to the same goal has become much longer; else SUCCESS."""

    prox_len: Annotated[In[float], "How long (m) the path may be at most to be near the goal."] = 3.0
    length_factor: Annotated[In[float], "How many times longer counts."] = 2.0

    @staticmethod
    def provided_ports() -> list[Port]:
        """The path; its name is taken in Python."""
        return [path_in("The path as it is planned now.")]

    def __init__(self) -> None:
        self.before: NavPath | None = None

    def tick(self) -> Status:
        """Compare, and tick the child if there is a reason."""
        if self.status is IDLE:
            self.before = None
        self.set_status(RUNNING)
        path, before = path_at(self, "path"), self.before
        if self.child.status is RUNNING or self.longer(path, before):
            status = self.child.execute_tick()
            if status is RUNNING:
                return RUNNING
            self.before = path
            return status
        self.before = path
        return SUCCESS

    def longer(self, path: NavPath | None, before: NavPath | None) -> bool:
        """Whether *path* is a longer one to the same goal, which is near."""
        if path is None or before is None or path is before or path.goal != before.goal:
            return False
        return before.length() < self.prox_len and path.length() > self.length_factor * before.length()
