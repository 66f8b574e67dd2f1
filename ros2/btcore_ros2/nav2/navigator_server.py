"""The navigator in place of Nav2's bt_navigator: it runs our trees on the servers of a running Nav2."""

import logging
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from btcore import Registry, Tree
from btcore.bundled_trees import folder
from btcore.clock import NS_PER_S
from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_navigation.navigate_goal import NavigateGoal
from btcore_navigation.navigator import Navigator, navigation_nodes
from btcore_navigation.stack import THROUGH_POSES, TO_POSE, TREES
from btcore_robot.robot import Phase
from btcore_ros2.errors import RosError
from btcore_ros2.nav2.client import Nav2Client
from btcore_ros2.nav2.conversions import ACTIONS, pose_from_stamped
from btcore_ros2.nav2.lifecycle import LifecycleManager, ServedNode
from btcore_ros2.nav2.pose_listener import POSE_IS_UNKNOWN
from btcore_ros2.nav2.served_action import ServedAction, refusal_reason
from btcore_ros2.session import RosSession

ROS_NODES = "btcore_ros2.nav2.nodes"
"""The module of Nav2's nodes that btcore_robot does not have."""

POSE_PATIENCE_S = 2.0
"""The time (s) after which a goal fails if the robot's pose is unknown."""

FIRST_POSE_PATIENCE_S = 15.0
"""The same before the first pose: on a slow computer, DDS takes seconds to find the publishers of tf."""

log = logging.getLogger(__name__)


class NavigatorServer:
    """Nav2's actions `navigate_to_pose` and `navigate_through_poses`, and its topic `goal_pose`.

    Goals run while a thread waits on the clock of the session. As in Nav2, one of both actions is active at
    a time; a newer goal of the same tree replaces the goal in progress without a halt, and a goal of another
    tree is aborted while a goal is in progress.

    Args:
        to_pose: The file of the tree for goals without a file; None = btcore's tree of Nav2's default name.
        through_poses: The same for `navigate_through_poses`.
        plugins: Libraries with further nodes for the trees.
        rate: The rate (Hz) of ticks.

    Raises:
        RegistrationError: A library of *plugins* can't be used.
        RosError: The package nav2_msgs is missing.
    """

    def __init__(
        self,
        session: RosSession,
        to_pose: Path | None = None,
        through_poses: Path | None = None,
        *,
        plugins: Iterable[str] = (),
        rate: float = 100.0,
    ) -> None:
        from geometry_msgs.msg import PoseStamped

        self.session = session
        self._client = Nav2Client(session)
        self._was_pose_known = False
        nodes = navigation_nodes((ROS_NODES, *plugins))
        trees = folder() / TREES
        self._to_pose = self._navigator(to_pose or trees / TO_POSE, nodes, through=False)
        self._through_poses = self._navigator(through_poses or trees / THROUGH_POSES, nodes, through=True)
        both = (self._to_pose, self._through_poses)
        self._served = [
            ServedAction(session, ACTIONS[navigator.name], navigator, other)
            for navigator, other in zip(both, reversed(both), strict=True)
        ]
        self._manager = LifecycleManager(
            session, "lifecycle_manager_navigator", {"bt_navigator": ServedNode(self._set_active)}
        )
        session.node.create_subscription(PoseStamped, "goal_pose", self._take_goal_pose, 1)
        session.clock.schedule.add_task(rate, Phase.CONTROLLER, self._step)

    @property
    def is_shut_down(self) -> bool:
        """Whether a client has shut down the lifecycle node."""
        return self._manager.is_shut_down

    @property
    def tree(self) -> Tree | None:
        """The tree of the goal in progress, or of the last goal of `navigate_to_pose`."""
        busy = self._through_poses.is_busy
        return self._through_poses.tree if busy or self._to_pose.tree is None else self._to_pose.tree

    def close(self) -> None:
        """Cancel all goals, halt the trees, and destroy the servers."""
        for served, navigator in zip(self._served, (self._to_pose, self._through_poses), strict=True):
            served.cancel_all()
            if navigator.is_busy and navigator.current is not None:
                navigator.current.cancel()
            navigator.step(self.session.clock.now())
            served.close()

    def _navigator(self, default: Path, nodes: Registry, *, through: bool) -> Navigator:
        return Navigator(
            self._client,
            default,
            nodes,
            clock=self.session.clock,
            resources=[self.session],
            through=through,
            hold=self._must_wait,
            keep_waiting=self._keep_waiting,
        )

    def _set_active(self, active: bool) -> None:
        self._to_pose.is_active = self._through_poses.is_active = active

    def _step(self, now: int) -> None:
        for served, navigator in zip(self._served, (self._to_pose, self._through_poses), strict=True):
            served.step(now)
            navigator.step(now)

    def _take_goal_pose(self, message: Any) -> None:
        try:
            goal = NavigateGoal((pose_from_stamped(message),))
        except RosError as error:
            log.warning("the goal of the topic goal_pose is ignored: %s", error)
            return
        reason = f"{self._through_poses.name} has a goal in progress" if self._through_poses.is_busy else ""
        reason = reason or refusal_reason(self._to_pose, goal)
        if reason:
            log.warning("the goal of the topic goal_pose is ignored: %s", reason)
        else:
            self._to_pose.send_goal(goal)

    def _must_wait(self) -> bool:
        known = self._client.pose() is not None
        self._was_pose_known |= known
        return not known

    def _keep_waiting(self, began: int) -> tuple[Nav2ErrorCode, str] | None:
        patience = POSE_PATIENCE_S if self._was_pose_known else FIRST_POSE_PATIENCE_S
        if self.session.clock.now() - began < patience * NS_PER_S:
            return None
        return Nav2ErrorCode.NAVIGATE_TF_ERROR, POSE_IS_UNKNOWN
