"""Our navigation under the names and types of Nav2's servers, so that other programs' trees can use it."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import OccupancyGrid
from nav_msgs.srv import GetMap
from std_msgs.msg import Empty
from std_srvs.srv import Empty as EmptyService

from btcore_navigation.action import ActionServer
from btcore_navigation.navigation_servers import (
    CheckPath,
    ClearCostmap,
    ClearedArea,
    GetCosts,
    PathCheck,
    ReinitializeLocalization,
)
from btcore_navigation.stack import Navigation
from btcore_navigation.waypoint_follower import WaypointFollower
from btcore_robot.errors import RobotError
from btcore_robot.occupancy_map import MapError, MapImageError, load_map
from btcore_robot.robot import MAP_FRAME, Phase, Twist2D
from btcore_ros2.errors import RosError
from btcore_ros2.nav2.client import Nav2Client
from btcore_ros2.nav2.conversions import ACTIONS, nav2_type, path_from_message, pose_from_stamped
from btcore_ros2.nav2.lifecycle import LifecycleManager, ServedNode
from btcore_ros2.nav2.navigation_topics import costmap_message, occupancy_grid
from btcore_ros2.nav2.served_action import ServedAction
from btcore_ros2.session import RosSession

RATE = 100.0
"""The rate (Hz) at which goals, feedback and results are passed on."""

NODES = (
    "controller_server",
    "smoother_server",
    "planner_server",
    "behavior_server",
    "bt_navigator",
    "waypoint_follower",
)
"""Nav2's nodes with actions, in the order in which Nav2 starts them."""


class MapServer:
    """Nav2's `map_server`: the services that return the map of *navigation* and replace it.

    Attributes:
        is_active: Whether the map can be requested and replaced.

    Raises:
        RosError: nav2_msgs is missing.
    """

    def __init__(self, session: RosSession, navigation: Navigation) -> None:
        self.is_active = True
        self._node = session.node
        self._navigation = navigation
        session.node.create_service(GetMap, "map_server/map", self._answer_map)
        session.node.create_service(nav2_type("srv", "LoadMap"), "map_server/load_map", self._load)

    def _answer_map(self, request: object, response: Any) -> Any:
        if self.is_active:
            response.map = self._grid()
        return response

    def _load(self, request: Any, response: Any) -> Any:
        path = Path(request.map_url.removeprefix("file://")).expanduser()
        try:
            if not self.is_active:
                raise RobotError("map_server is not active")
            self._navigation.change_map(load_map(path))
        except RobotError as error:
            self._node.get_logger().error(f"load_map: {error}")
            response.result = _result_code(error, request.map_url, response)
        else:
            response.map, response.result = self._grid(), response.RESULT_SUCCESS
        return response

    def _grid(self) -> OccupancyGrid:
        known = self._navigation.map
        return occupancy_grid(known, known.cells, MAP_FRAME, self._node.get_clock().now().to_msg())


def _result_code(error: RobotError, map_url: str, response: Any) -> int:
    """Return the code of Nav2's map_server for an error."""
    if not map_url:
        return int(response.RESULT_MAP_DOES_NOT_EXIST)
    if isinstance(error, MapImageError):
        return int(response.RESULT_INVALID_MAP_DATA)
    if isinstance(error, MapError):
        return int(response.RESULT_INVALID_MAP_METADATA)
    return int(response.RESULT_UNDEFINED_FAILURE)


class ServedNavigation:
    """Nav2's actions and services of a navigation, as tasks on the robot's schedule.

    Goals of the two navigators exclude each other: a goal for one navigator is rejected while the other
    navigates.

    Args:
        navigates: Whether the actions of the navigators are offered.

    Raises:
        RosError: nav2_msgs is missing.
    """

    def __init__(self, session: RosSession, navigation: Navigation, *, navigates: bool = True) -> None:
        self._session = session
        self._servers = servers = navigation.servers
        served = servers.by_action if navigates else servers.without_navigators
        others = {
            "navigate_to_pose": navigation.navigate_through_poses,
            "navigate_through_poses": navigation.navigate_to_pose,
        }
        schedule = navigation.robot.schedule
        # Without our navigators, another program's navigator drives to the waypoints.
        navigator = servers if navigates else Nav2Client(session)
        follower = WaypointFollower(navigator, navigation.parameters.waypoints)
        served["follow_waypoints"] = follower
        schedule.add_task(follower.RATE, Phase.CONTROLLER, follower.step)
        self._actions = [
            ServedAction(session, ACTIONS[name], server, others.get(name)) for name, server in served.items()
        ]
        self._offer_services()
        # Before the servers take their steps, of which those of the planner come first.
        schedule.add_task(RATE, Phase.COSTMAPS, self._step)
        self._managers = self._offer_lifecycle(navigation, served)

    @property
    def is_shut_down(self) -> bool:
        """Whether clients have shut down all nodes."""
        return all(manager.is_shut_down for manager in self._managers)

    def close(self) -> None:
        """Abort the goals that have not ended, and remove the actions."""
        for action in self._actions:
            action.cancel_all()
        for action in self._actions:
            action.close()

    def _step(self, now: int) -> None:
        for action in self._actions:
            action.step(now)

    def _offer_lifecycle(
        self, navigation: Navigation, served: Mapping[str, ActionServer[Any, Any, Any]]
    ) -> list[LifecycleManager]:
        maps = MapServer(self._session, navigation)

        def set_map_server(active: bool) -> None:
            maps.is_active = active

        def set_localiser(active: bool) -> None:
            navigation.is_localising = active

        def node_of(servers: Sequence[ActionServer[Any, Any, Any]]) -> ServedNode:
            def set_active(active: bool) -> None:
                for server in servers:
                    server.is_active = active

            return ServedNode(set_active)

        localisation = {"map_server": ServedNode(set_map_server), "amcl": ServedNode(set_localiser)}
        navigating = {
            node: node_of([server for server in served.values() if server.node == node])
            for node in NODES
            if any(server.node == node for server in served.values())
        }
        return [
            LifecycleManager(self._session, "lifecycle_manager_localization", localisation),
            LifecycleManager(self._session, "lifecycle_manager_navigation", navigating),
        ]

    def _offer_services(self) -> None:
        node = self._session.node
        teleop = self._servers.assisted_teleop
        node.create_subscription(TwistStamped, "cmd_vel_teleop", self._take_command, 10)
        node.create_subscription(Empty, "preempt_teleop", lambda message: teleop.finish(), 10)
        for scope in ("global", "local"):
            for verb, type_name, area in (
                ("clear_entirely", "ClearEntireCostmap", ClearedArea.ENTIRE),
                ("clear_around", "ClearCostmapAroundRobot", ClearedArea.AROUND_ROBOT),
                ("clear_except", "ClearCostmapExceptRegion", ClearedArea.EXCEPT_REGION),
            ):
                names = [f"{scope}_costmap/{verb}_{scope}_costmap"]
                if scope == "local" and area is not ClearedArea.ENTIRE:
                    # nav2_simple_commander uses these names, which Nav2's own servers lack.
                    names.append(f"local_costmap/clear_costmap_{area.value.replace(' ', '_')}")
                for name in names:
                    node.create_service(nav2_type("srv", type_name), name, self._clearing(name, area))
            name = f"{scope}_costmap/get_costmap"
            node.create_service(nav2_type("srv", "GetCostmap"), name, self._returning_costmap(name))
        node.create_service(
            nav2_type("srv", "GetCosts"), "global_costmap/get_cost_global_costmap", self._answer_costs
        )
        node.create_service(nav2_type("srv", "IsPathValid"), "is_path_valid", self._answer_path_check)
        node.create_service(EmptyService, "reinitialize_global_localization", self._answer_reinitialize)

    def _clearing(self, name: str, area: ClearedArea) -> Callable[[Any, Any], Any]:
        def answer(request: Any, response: Any) -> Any:
            handle = self._servers.request(ClearCostmap(area, getattr(request, "reset_distance", 0.0)), name)
            if handle.result is not None and handle.result.message:
                self._warn(f"{name}: {handle.result.message}")
            return response

        return answer

    def _returning_costmap(self, name: str) -> Callable[[Any, Any], Any]:
        def answer(request: object, response: Any) -> Any:
            stamp = self._session.node.get_clock().now().to_msg()
            response.map = costmap_message(self._servers.costmap(name), stamp)
            return response

        return answer

    def _take_command(self, message: TwistStamped) -> None:
        self._servers.assisted_teleop.command(Twist2D(message.twist.linear.x, message.twist.angular.z))

    def _answer_costs(self, request: Any, response: Any) -> Any:
        try:
            poses = tuple(pose_from_stamped(pose) for pose in request.poses)
        except RosError as error:
            self._warn(f"get_cost_global_costmap: {error}")
            response.success = False
            return response
        costs = self._servers.request(GetCosts(poses, request.use_footprint)).result
        assert costs is not None
        response.costs, response.success = list(costs.value or ()), True
        return response

    def _answer_path_check(self, request: Any, response: Any) -> Any:
        try:
            path = path_from_message(request.path)
        except RosError as error:
            self._warn(f"is_path_valid: {error}")
            response.is_valid = False
            return response
        check = CheckPath(
            path,
            request.max_cost,
            request.consider_unknown_as_obstacle,
            stop_at_first_collision=False,
        )
        outcome = self._servers.request(check).result
        assert outcome is not None
        assert isinstance(outcome.value, PathCheck)
        response.is_valid = outcome.value.valid
        indices = [path.nearest(pose.x, pose.y) for pose in outcome.value.collisions]
        response.invalid_pose_indices = [int(index) for index in indices]
        return response

    def _answer_reinitialize(self, request: object, response: Any) -> Any:
        self._servers.request(ReinitializeLocalization())
        return response

    def _warn(self, message: str) -> None:
        self._session.node.get_logger().warning(message)
