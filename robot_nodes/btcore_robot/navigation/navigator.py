"""Going to a place: a behaviour tree of Nav2's nodes, run for every goal (Nav2's ``bt_navigator``)."""

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import btcore
from btcore import BtcoreError, NodeExecutionError, Registry, Status, Tree
from btcore_robot.navigation import nodes as nav2_nodes
from btcore_robot.navigation.action import ActionServer, GoalHandle, GoalStatus
from btcore_robot.navigation.error_codes import Nav2ErrorCode
from btcore_robot.navigation.nodes.action_node import RECOVERIES, BtActionNode
from btcore_robot.navigation.nodes.goals import WaypointStatus
from btcore_robot.navigation.path import NavPath, empty_path
from btcore_robot.navigation.servers import Servers
from btcore_robot.robot import NS_PER_S, GoalOutcome, Pose2D

NAV2_PLUGIN = "nav2_"
"""How the names of Nav2's own plug-ins begin, whose nodes are here."""

_ELSEWHERE = "the robot has come to where it takes the goal to be, but sees what can't be seen from there"

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class NavigateGoal:
    """Where to go: through *goals* (map) to the last of them, by the tree in the file *behavior_tree*."""

    goals: tuple[Pose2D, ...]
    behavior_tree: str = ""


@dataclass(frozen=True, slots=True)
class NavigateFeedback:
    """How far it is: *navigation_time* in s, *distance_remaining* in m along the path."""

    current_pose: Pose2D | None
    navigation_time: float
    number_of_recoveries: int
    distance_remaining: float
    number_of_poses_remaining: int


NavigateHandle = GoalHandle[NavigateGoal, NavigateFeedback, None]


class Navigator(ActionServer[NavigateGoal, NavigateFeedback, None]):
    """Serves ``navigate_to_pose``, or with *through* ``navigate_through_poses``.

    The goal stands on the tree's blackboard as ``goal`` (``goals``). A new goal for the same tree is put
    there without a halt, and the tree sees that it is another; a cancelled one halts the tree. While *hold*
    says so, a goal waits, until *hopeless* has a reason for one that began then (ns). No goal succeeds while
    what is seen speaks against the robot's place. The trees are made of Nav2's nodes and those of *plugins*,
    which may ask for the `Servers` and the `Robot`.

    Raises RegistrationError where one of *plugins* can't be used.
    """

    def __init__(
        self,
        servers: Servers,
        default_tree: Path,
        *,
        through: bool = False,
        plugins: Iterable[str] = (),
        ended: Callable[[GoalOutcome], None] | None = None,
        hold: Callable[[], bool] | None = None,
        hopeless: Callable[[int], str] | None = None,
    ) -> None:
        super().__init__()
        self.name = "navigate_through_poses" if through else "navigate_to_pose"
        self.servers = servers
        self.default_tree = default_tree
        self.through = through
        self.tree: Tree | None = None
        """The tree of the goal that was accepted last."""
        self._nodes = _palette(plugins)
        self._ended = ended
        self._hold = hold
        self._hopeless = hopeless
        self._trees: dict[Path, Tree] = {}
        self._began = 0
        self._earlier: list[object] = []

    def start(self, handle: NavigateHandle, now: int, previous: NavigateHandle | None) -> None:
        """Put the goal on the blackboard of its tree."""
        if not handle.goal.goals:
            self._end(handle, Nav2ErrorCode.GOAL_REJECTED, "there is no goal to go to", now)
            return
        if previous is not None:
            self._tell(previous, now, GoalStatus.CANCELED)
        self._began = now
        self._earlier = [server.current for server in self._workers()]
        before = self.tree
        try:
            tree = self._tree_of(handle.goal.behavior_tree)
        except (BtcoreError, OSError) as fault:
            self._halt()
            self._end(handle, Nav2ErrorCode.FAILED_TO_LOAD_BEHAVIOR_TREE, str(fault), now)
            return
        board = tree.blackboard
        # A tree that recovers has stopped already, and would only see the new goal when it is done with that.
        drives = previous is not None and before is tree and not self._recovers()
        if before is not None and not drives:
            before.halt()
        if not drives:
            board["path"] = empty_path(now)
        self.tree = tree
        if self.through:
            board["goals"] = list(handle.goal.goals)
            board["waypoint_statuses"] = [WaypointStatus(*one[::-1]) for one in enumerate(handle.goal.goals)]
        else:
            board["goal"] = handle.goal.goals[-1]
        board[RECOVERIES] = 0

    def work(self, handle: NavigateHandle, now: int) -> None:
        """Tick the tree."""
        tree = self.tree
        if tree is None:
            return
        if self._hold is not None and self._hold():
            reason = self._hopeless(self._began) if self._hopeless is not None else ""
            if reason:
                self._halt()
                self._end(handle, Nav2ErrorCode.NAVIGATE_TF_ERROR, reason, now)
            return
        try:
            status = tree.tick_exactly_once()
        except NodeExecutionError as error:
            self._halt()
            self._end(handle, Nav2ErrorCode.NAVIGATE_UNKNOWN, str(error), now)
            return
        handle.feedback = self._feedback(tree, now)
        if status is Status.SUCCESS and self.servers.localiser.contradicted:
            self._end(handle, Nav2ErrorCode.NAVIGATE_TF_ERROR, _ELSEWHERE, now)
        elif status is Status.SUCCESS:
            handle.succeed()
            self._tell(handle, now)
        elif status is not Status.RUNNING:
            tree.halt()
            code, message = self._reason()
            self._end(handle, code, message, now)

    def stop(self, handle: NavigateHandle, now: int) -> None:
        """Halt the tree, which cancels what its nodes have asked for."""
        self._halt()
        self._tell(handle, now, GoalStatus.CANCELED)

    def start_over(self) -> None:
        """Begin anew with the goal that there is: halt the tree, forget its path."""
        if self.tree is not None and self.current is not None and not self.current.done:
            self.tree.halt()
            self.tree.blackboard["path"] = empty_path(self.servers.now())

    def _halt(self) -> None:
        if self.tree is not None:
            self.tree.halt()

    def _workers(self) -> tuple[ActionServer[Any, Any, Any], ...]:
        servers = self.servers
        return servers.compute_path, servers.follow_path, *self._recovering()

    def _recovering(self) -> tuple[ActionServer[Any, Any, Any], ...]:
        servers = self.servers
        return servers.spin, servers.back_up, servers.drive_on_heading, servers.wait

    def _recovers(self) -> bool:
        return any(server.busy for server in self._recovering())

    def _tree_of(self, file: str) -> Tree:
        path = tree_file(file, self.default_tree)
        if path not in self._trees:
            servers, robot = self.servers, self.servers.robot
            made = btcore.load(path, nodes=self._nodes, resources=[servers, robot], clock=robot.clock)
            for node in made.find(BtActionNode):
                node.level = logging.INFO  # another try may follow, and what ends the goal is in its result
            self._trees[path] = made
        return self._trees[path]

    def _feedback(self, tree: Tree, now: int) -> NavigateFeedback:
        path = _entry(tree, "path")
        recoveries = _entry(tree, RECOVERIES)
        goals = _entry(tree, "goals")
        return NavigateFeedback(
            self.servers.pose(),
            (now - self._began) / NS_PER_S,
            recoveries if isinstance(recoveries, int) else 0,
            self.servers.remaining(path) if isinstance(path, NavPath) and len(path) else 0.0,
            len(goals) if isinstance(goals, list) else 0,
        )

    def _reason(self) -> tuple[int, str]:
        """Why the tree failed: what the first server says whose last goal was aborted since it began."""
        for server, earlier in zip(self._workers(), self._earlier, strict=True):
            current = server.current
            if current is None or current is earlier or current.status is not GoalStatus.ABORTED:
                continue
            if current.result is not None:
                return current.result.code, current.result.message
        return int(Nav2ErrorCode.NAVIGATE_UNKNOWN), "its behaviour tree failed"

    def _end(self, handle: NavigateHandle, code: int, message: str, now: int) -> None:
        handle.abort(int(code), f"{_named(code)}: {message}" if code else message)
        self._tell(handle, now)

    def _tell(self, handle: NavigateHandle, now: int, status: GoalStatus | None = None) -> None:
        if self._ended is not None and handle.goal.goals:
            known = status if status is not None else handle.status
            self._ended(GoalOutcome(handle.goal.goals[-1], known.name, now))


def tree_file(named: str, default: Path) -> Path:
    """The file *named*, or the one of that name beside the *default*, which also stands for no name.

    So Nav2's own paths, such as ``/opt/ros/…/navigate_w_replanning_time.xml``, mean the trees that are here.
    """
    if not named:
        return default
    path = Path(named)
    beside = default.parent / (path.name if path.suffix else f"{path.name}.xml")
    return beside if not path.is_file() and beside.is_file() else path


def _palette(plugins: Iterable[str]) -> Registry:
    """Nav2's nodes, and those of *plugins*."""
    nodes = Registry.standard()
    nav2_nodes.register(nodes)
    for plugin in plugins:
        if not plugin.startswith(NAV2_PLUGIN):
            nodes.add_plugin(plugin)
    return nodes


def _named(code: int) -> str:
    try:
        return Nav2ErrorCode(code).name
    except ValueError:
        return f"error {code}"


def _entry(tree: Tree, key: str) -> object:
    found = tree.blackboard.find(key)
    return None if found is None else found.value
