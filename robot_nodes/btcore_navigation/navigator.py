"""The navigator: runs a behavior tree of Nav2's nodes for every goal, like Nav2's `bt_navigator`."""

import logging
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import btcore
from btcore import BtcoreError, Clock, NodeExecutionError, Registry, Status, Tree
from btcore.clock import NS_PER_S
from btcore_navigation import nodes as nav2_nodes
from btcore_navigation.action import ActionResult, ActionServer, GoalStatus
from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_navigation.navigate_goal import (
    NavigateFeedback,
    NavigateGoal,
    NavigateHandle,
    WaypointState,
    WaypointStatus,
)
from btcore_navigation.navigation_servers import AnyGoalHandle, NavigationServers
from btcore_navigation.nodes.action_node import RECOVERIES, ServerNode
from btcore_navigation.nodes.decorators import GoalUpdater
from btcore_navigation.path import NavPath, empty_path
from btcore_navigation.planner import THROUGH_OFFSET, PlannerError
from btcore_robot.robot import GoalOutcome, Pose2D

__all__ = ["NavigateFeedback", "NavigateGoal", "NavigateHandle", "Navigator"]

NAV2_PLUGIN = "nav2_"
"""The prefix of Nav2's own plug-ins, whose nodes are built in."""

MIN_SPEED = 0.01
"""The speed (m/s) from which on the remaining time is estimated, as in Nav2."""
MIN_REMAINING = 0.1
"""The remaining distance (m) from which on the remaining time is estimated, as in Nav2."""

STATUSES = "waypoint_statuses"
"""The entry with the states of the poses of navigate_through_poses."""

CHECK_PERIOD_NS = NS_PER_S // 2
"""The time (ns) between two checks of the progress."""
MIN_PROGRESS_SPEED = 0.15
"""The average speed (m/s) of a detour from which on it is progress: half of the default `max_vel_x`."""

_ELSEWHERE = "the robot reached the goal by its estimated pose, but its scans contradict that pose"

log = logging.getLogger(__name__)


PROGRESS = 2.5
"""The distance (m) that counts as progress: the default `obstacle_max_range`.

At each attempt the robot notices a closed door at another distance, up to this range. A smaller value would
take these differences for progress.
"""

MAX_STALL_S = 60.0
"""The time (s) without progress after which a goal fails, in addition to the time for a detour.

It is longer than the recoveries of the default trees, and than people usually stand in a doorway.
"""


class GoalProgress:
    """A check whether a robot comes closer to its goal.

    The robot makes progress when the rest of its path is shorter by `PROGRESS` than ever before, and while
    the rest is at most *tolerance* (m). A detour is longer than the path before. Without progress the robot
    may therefore take `MAX_STALL_S` and the time in which it drives the longest path since the last progress
    at *speed* (m/s). By this rule a robot that drives back and forth between two closed doors fails, but a
    robot that drives a detour at more than *speed* does not.
    """

    def __init__(self, tolerance: float, speed: float) -> None:
        self._tolerance = tolerance
        self._speed = speed
        self.begin(0)

    def begin(self, now: int) -> None:
        """Begin a goal at *now* (ns)."""
        self.last = now
        """The time (ns) of the last progress."""
        self.nearest = math.inf
        """The least rest of a path (m) that was progress; inf before the first path."""
        self._longest = 0.0
        self._paused = 0

    def pause(self, duration: int) -> None:
        """Exclude the last *duration* (ns), in which the robot had to stand."""
        self._paused += duration

    def update(self, rest: float, now: int) -> bool:
        """Take the rest of the robot's present path, and return whether the robot has made progress.

        Args:
            rest: The distance along the path to its end (m); 0 without a path.
            now: The time (ns).
        """
        self._longest = max(self._longest, rest)
        is_closer = rest <= max(self.nearest - PROGRESS, self._tolerance) or math.isinf(self.nearest)
        if rest <= 0 or not is_closer:
            return False
        self.last, self.nearest, self._longest, self._paused = now, rest, rest, 0
        return True

    def stalled(self, now: int) -> float:
        """Return the time (s) since the last progress, or 0 if the robot may try further.

        Args:
            now: The time (ns).
        """
        seconds = (now - self.last - self._paused) / NS_PER_S
        return seconds if seconds > MAX_STALL_S + self._longest / self._speed else 0.0


class Navigator(ActionServer[NavigateGoal, NavigateFeedback, tuple[WaypointStatus, ...]]):
    """The action server `navigate_to_pose`; with *through*, the server `navigate_through_poses`.

    The tree finds the goal in the blackboard entry `goal` (with *through*: `goals`). A new goal for the
    running tree replaces this entry without a halt, and the tree's nodes notice the change. A cancelled goal
    halts the tree. If the tree succeeds while the scans contradict the robot's pose, the goal is aborted. The
    goal is also aborted when the robot comes no closer to it (see `GoalProgress`), unless the tree contains a
    `GoalUpdater`, whose goal may move.

    Args:
        servers: The servers of the robot, which are a resource of the nodes.
        default_tree: The file of the tree for goals that name no other file.
        nodes: The nodes for the trees, the result of `navigation_nodes`.
        clock: The clock of the trees.
        resources: Further resources of the nodes, such as the `Robot`.
        through: Whether goals have several poses.
        on_end: A function that is called with the outcome of every goal.
        hold: A function that returns whether goals have to wait; the tree is not ticked in this time.
        keep_waiting: A function that is called in each period in which a goal waits, with the time (ns) at
            which the goal began. It returns the error code and the message of a goal to abort, or None.
        check_goal: A function that is called with each pose of a new goal. It raises a PlannerError to reject
            the goal.
        slowest: The average speed (m/s) from which on a detour is progress.
    """

    node = "bt_navigator"

    def __init__(
        self,
        servers: NavigationServers,
        default_tree: Path,
        nodes: Registry,
        *,
        clock: Clock,
        resources: Sequence[object] = (),
        through: bool = False,
        on_end: Callable[[GoalOutcome], None] | None = None,
        hold: Callable[[], bool] | None = None,
        keep_waiting: Callable[[int], tuple[Nav2ErrorCode, str] | None] | None = None,
        check_goal: Callable[[Pose2D], None] | None = None,
        slowest: float = MIN_PROGRESS_SPEED,
    ) -> None:
        super().__init__()
        self.name = "navigate_through_poses" if through else "navigate_to_pose"
        self.servers = servers
        self.default_tree = default_tree
        self.through = through
        self.tree: Tree | None = None
        """The tree of the last accepted goal."""
        self._clock = clock
        self._resources = resources
        self._nodes = nodes
        self._on_end = on_end
        self._hold = hold
        self._keep_waiting = keep_waiting
        self._check_goal = check_goal
        self._progress = GoalProgress(servers.goal_tolerance, slowest)
        self._plan_failure: ActionResult[object] | None = None
        self._last = self._next_check = 0
        self._judges_progress = True
        self._trees: dict[Path, Tree] = {}
        self._began = 0
        self._earlier_goals: Mapping[str, AnyGoalHandle] = {}
        self._inherited: Sequence[AnyGoalHandle] | None = None
        """The servers' goals that were in progress when the running tree got its present goal.

        None for a tree that began with its present goal.
        """

    def start(self, handle: NavigateHandle, now: int, previous: NavigateHandle | None) -> None:
        """Write the goal to the blackboard of its tree."""
        if not handle.goal.goals:
            self._end(handle, Nav2ErrorCode.GOAL_REJECTED, "the list of goals is empty", now)
            return
        if previous is not None:
            self._report_outcome(previous, now, GoalStatus.CANCELED)
        self._began = self._last = now
        self._progress.begin(now)
        self._plan_failure = None
        self._earlier_goals = self.servers.last_goals()
        before = self.tree
        if self._check_goal is not None:
            try:
                for goal in handle.goal.goals:
                    self._check_goal(goal)
            except PlannerError as error:
                self._halt()
                self._end(handle, error.code + (THROUGH_OFFSET if self.through else 0), str(error), now)
                return
        try:
            tree = self._load_tree(handle.goal.behavior_tree)
        except (BtcoreError, OSError) as error:
            self._halt()
            self._end(handle, Nav2ErrorCode.FAILED_TO_LOAD_BEHAVIOR_TREE, str(error), now)
            return
        board = tree.blackboard
        # A tree in a recovery has stopped driving, and would notice the new goal only after the recovery.
        continues = previous is not None and before is tree and not self.servers.is_recovering
        if before is not None and not continues:
            before.halt()
        if not continues:
            board["path"] = empty_path(now)
        in_progress = [sent for sent in self._earlier_goals.values() if not sent.done]
        self._inherited = in_progress if continues else None
        self.tree = tree
        self._judges_progress = next(iter(tree.find(GoalUpdater)), None) is None
        if self.through:
            board["goals"] = list(handle.goal.goals)
            statuses = [WaypointStatus(goal, index) for index, goal in enumerate(handle.goal.goals)]
            board[STATUSES] = statuses
        else:
            board["goal"] = handle.goal.goals[-1]
        board[RECOVERIES] = 0

    def work(self, handle: NavigateHandle, now: int) -> None:
        """Tick the tree; end the goal when the tree ends."""
        tree = self.tree
        elapsed, self._last = now - self._last, now
        if tree is None:
            return
        if self._hold is not None and self._hold():
            self._progress.pause(elapsed)
            self._defer_feedback(handle, tree, now)
            reason = self._keep_waiting(self._began) if self._keep_waiting is not None else None
            if reason is not None:
                self._give_up(handle, *reason, now)
            return
        try:
            status = tree.tick_exactly_once()
        except NodeExecutionError as error:
            self._halt()
            self._end(handle, Nav2ErrorCode.NAVIGATE_UNKNOWN, str(error), now)
            return
        self._defer_feedback(handle, tree, now)
        if status is Status.SUCCESS and self._reached_the_previous_goal():
            self._inherited = None
            self.restart_goal()
        elif status is Status.SUCCESS and self.servers.is_pose_contradicted:
            self._end(handle, Nav2ErrorCode.NAVIGATE_TF_ERROR, _ELSEWHERE, now)
        elif status is Status.SUCCESS:
            handle.succeed(self._final_statuses(WaypointState.COMPLETED))
            self._report_outcome(handle, now)
        elif status is not Status.RUNNING:
            tree.halt()
            code, message = self._failure_reason()
            self._end(handle, code, message, now)
        elif self._judges_progress:
            self._check_progress(handle, now)

    def _reached_the_previous_goal(self) -> bool:
        """Return whether the tree succeeded before it followed a path to the present goal.

        The trees notice a new goal once a second. In this time the robot may reach the previous goal.
        """
        if self._inherited is None:
            return False
        if not self._new_goals():
            return True
        latest = self.servers.last_goals().values()
        return any(goal in latest and goal.status is GoalStatus.SUCCEEDED for goal in self._inherited)

    def _new_goals(self) -> dict[str, AnyGoalHandle]:
        """Return the last goals by action, without those from before the present goal."""
        latest, earlier = self.servers.last_goals(), self._earlier_goals
        return {action: goal for action, goal in latest.items() if goal is not earlier.get(action)}

    def stop(self, handle: NavigateHandle, now: int) -> None:
        """Halt the tree, which cancels the goals that its nodes have sent."""
        self._halt()
        self._report_outcome(handle, now, GoalStatus.CANCELED)

    def restart_goal(self) -> None:
        """Restart the present goal: halt the tree and discard the path, so that a new path is planned."""
        if self.tree is not None and self.current is not None and not self.current.done:
            self.tree.halt()
            self.tree.blackboard["path"] = empty_path(self._clock.now())

    def _halt(self) -> None:
        if self.tree is not None:
            self.tree.halt()

    def _load_tree(self, file: str) -> Tree:
        path = tree_file(file, self.default_tree)
        if path not in self._trees:
            resources = [self.servers, *self._resources]
            tree = btcore.load(path, nodes=self._nodes, resources=resources, clock=self._clock)
            # No warning for a failure that a retry may resolve; the final reason is in the goal's result.
            for node in tree.find(ServerNode):
                node.level = logging.INFO
            self._trees[path] = tree
        return self._trees[path]

    def _defer_feedback(self, handle: NavigateHandle, tree: Tree, now: int) -> None:
        """Set the feedback of this tick; its distance along the path is computed when it is read."""
        path = _entry(tree, "path")
        recoveries = _entry(tree, RECOVERIES)
        goals = _entry(tree, "goals")
        number_of_poses = len(goals) if isinstance(goals, list) else 0
        statuses = self._statuses()
        pose, odometry = self.servers.pose(), self.servers.odometry()
        elapsed = (now - self._began) / NS_PER_S

        def compute() -> NavigateFeedback:
            remaining = 0.0
            if pose is not None and isinstance(path, NavPath):
                remaining = path.remaining(pose.x, pose.y)
            speed = abs(odometry.twist.v) if odometry is not None else 0.0
            return NavigateFeedback(
                pose,
                elapsed,
                recoveries if isinstance(recoveries, int) else 0,
                remaining,
                number_of_poses,
                remaining / speed if speed > MIN_SPEED and remaining > MIN_REMAINING else 0.0,
                statuses,
            )

        handle.defer_feedback(compute)

    def _statuses(self) -> tuple[WaypointStatus, ...]:
        """Return the states of the poses of the present goal of navigate_through_poses."""
        statuses = _entry(self.tree, STATUSES) if self.through and self.tree is not None else None
        return tuple(statuses) if isinstance(statuses, list) else ()

    def _final_statuses(self, state: WaypointState) -> tuple[WaypointStatus, ...]:
        """Return the states at the end of a goal: *state* for each pose that is still pending."""
        return tuple(
            replace(status, state=state) if status.state is WaypointState.PENDING else status
            for status in self._statuses()
        )

    def _check_progress(self, handle: NavigateHandle, now: int) -> None:
        """Abort the goal if the robot has come no closer to it for too long."""
        for action, goal in self._new_goals().items():
            if action.startswith("compute_path") and goal.status is GoalStatus.ABORTED:
                self._plan_failure = goal.result
        if now < self._next_check or handle.feedback is None:
            return
        self._next_check = now + CHECK_PERIOD_NS
        if self._progress.update(handle.feedback.distance_remaining, now):
            self._plan_failure = None
        seconds, nearest = self._progress.stalled(now), self._progress.nearest
        failure = self._plan_failure
        if not seconds or (failure is None and math.isinf(nearest)):
            return  # without a failure and a path, the tree has another task before it drives
        distance = "" if math.isinf(nearest) else f" than {nearest:.1f} m"
        message = f"the robot has come no closer{distance} for {seconds:.0f} s"
        self._give_up(handle, Nav2ErrorCode.FAILED_TO_MAKE_PROGRESS, message, now)

    def _give_up(self, handle: NavigateHandle, code: int, message: str, now: int) -> None:
        """Halt the tree and end the goal; if there was no path last, this is the first part of the cause."""
        self._halt()
        failure = self._plan_failure
        if failure is not None:
            code, message = failure.code, f"{failure.message}; {message}"
        self._end(handle, code, message, now)

    def _failure_reason(self) -> tuple[int, str]:
        """Return code and message of the first server whose last goal since the start was aborted."""
        for goal in self._new_goals().values():
            if goal.status is GoalStatus.ABORTED and goal.result is not None:
                return goal.result.code, goal.result.message
        return int(Nav2ErrorCode.NAVIGATE_UNKNOWN), "the behavior tree failed"

    def _end(self, handle: NavigateHandle, code: int, message: str, now: int) -> None:
        statuses = self._final_statuses(WaypointState.FAILED)
        handle.abort(int(code), f"{_code_name(code)}: {message}" if code else message, statuses)
        self._report_outcome(handle, now)

    def _report_outcome(self, handle: NavigateHandle, now: int, status: GoalStatus | None = None) -> None:
        if self._on_end is not None and handle.goal.goals:
            final = status if status is not None else handle.status
            cause = handle.result.message if handle.result is not None else ""
            self._on_end(GoalOutcome(handle.goal.goals[-1], final.name, now, cause))


def tree_file(name: str, default: Path) -> Path:
    """Return the file of a tree.

    Paths of Nav2's own trees, such as `/opt/ros/…/navigate_w_replanning_time.xml`, stand for the trees of
    the same names in the folder of *default*.

    Args:
        name: The path from a goal or from the parameters. If no such file exists, a file of the same name in
            the folder of *default* is used.
        default: The file for an empty name.
    """
    if not name:
        return default
    path = Path(name)
    beside = default.parent / (path.name if path.suffix else f"{path.name}.xml")
    return beside if not path.is_file() and beside.is_file() else path


def navigation_nodes(plugins: Iterable[str]) -> Registry:
    """Return a registry of the standard nodes, Nav2's nodes and the nodes of *plugins*.

    Raises:
        RegistrationError: A library of *plugins* can't be used.
    """
    nodes = Registry.standard()
    nav2_nodes.register(nodes)
    for plugin in plugins:
        if not plugin.startswith(NAV2_PLUGIN):
            nodes.add_plugin(plugin)
    return nodes


def _code_name(code: int) -> str:
    try:
        return Nav2ErrorCode(code).name
    except ValueError:
        return f"error {code}"


def _entry(tree: Tree, key: str) -> object:
    entry = tree.blackboard.find(key)
    return None if entry is None else entry.value
