"""Nav2's `map_server`: the services that return the map of a navigation and replace it."""

from pathlib import Path
from typing import Any

from nav_msgs.msg import OccupancyGrid
from nav_msgs.srv import GetMap

from btcore_navigation.stack import Navigation
from btcore_robot.errors import RobotError
from btcore_robot.occupancy_map import MapError, MapImageError, load_map
from btcore_ros2.nav2.conversions import MAP, nav2_type
from btcore_ros2.nav2.navigation_topics import occupancy_grid
from btcore_ros2.session import RosSession


class MapServer:
    """The services `map_server/map` and `map_server/load_map` of *navigation*.

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
        return occupancy_grid(known, known.cells, MAP, self._node.get_clock().now().to_msg())


def _result_code(error: RobotError, map_url: str, response: Any) -> int:
    """Return the code of Nav2's map_server for an error."""
    if not map_url:
        return int(response.RESULT_MAP_DOES_NOT_EXIST)
    if isinstance(error, MapImageError):
        return int(response.RESULT_INVALID_MAP_DATA)
    if isinstance(error, MapError):
        return int(response.RESULT_INVALID_MAP_METADATA)
    return int(response.RESULT_UNDEFINED_FAILURE)
