"""Conversions between requests of Nav2's tree nodes and the services of Nav2."""

from importlib import import_module
from typing import Any

from btcore_navigation.navigation_servers import (
    CheckPath,
    ClearCostmap,
    ClearedArea,
    GetCosts,
    PathCheck,
    ReinitializeLocalization,
)
from btcore_ros2.errors import RosError
from btcore_ros2.nav2.conversions import nav2_type, path_to_message, pose_to_stamped

_CLEARING = {
    ClearedArea.ENTIRE: "ClearEntireCostmap",
    ClearedArea.EXCEPT_REGION: "ClearCostmapExceptRegion",
    ClearedArea.AROUND_ROBOT: "ClearCostmapAroundRobot",
    ClearedArea.AROUND_POSE: "ClearCostmapAroundPose",
}


def service_of(request: object) -> tuple[Any, str]:
    """Return the class of the service for *request*, and Nav2's default name, "" if there is none.

    Raises:
        RosError: The class is missing, or Nav2 has no such service.
    """
    match request:
        case ClearCostmap():
            return nav2_type("srv", _CLEARING[request.area]), ""
        case CheckPath():
            return nav2_type("srv", "IsPathValid"), "is_path_valid"
        case GetCosts():
            return nav2_type("srv", "GetCosts"), "global_costmap/get_cost_global_costmap"
        case ReinitializeLocalization():
            return import_module("std_srvs.srv").Empty, "reinitialize_global_localization"
    raise RosError(f"Nav2 has no service for a {type(request).__name__}")


def write_request(request: object, message: Any) -> None:
    """Copy *request* into the request message. Fields that the release of Nav2 lacks are left out."""
    match request:
        case ClearCostmap():
            if hasattr(message, "reset_distance"):
                message.reset_distance = request.reset_distance
            if hasattr(message, "pose") and request.pose is not None:
                message.pose = pose_to_stamped(request.pose)
            if hasattr(message, "plugins"):
                message.plugins = list(request.plugins)
        case CheckPath():
            message.path = path_to_message(request.path)
            message.max_cost = request.max_cost
            message.consider_unknown_as_obstacle = request.unknown_is_obstacle
            optional = (
                ("layer_name", request.layer_name),
                ("footprint", request.footprint),
                ("stop_at_first_collision", request.stop_at_first_collision),
                ("max_lookahead_distance", request.max_lookahead_distance),
            )
            for field, value in optional:
                if hasattr(message, field):
                    setattr(message, field, value)
        case GetCosts():
            message.use_footprint = request.use_footprint
            message.poses = [pose_to_stamped(pose) for pose in request.poses]


def read_response(request: object, message: Any) -> Any:
    """Return the value of the response to *request*.

    Raises:
        RosError: The service reports a failure.
    """
    if not getattr(message, "success", True):
        raise RosError("the service reported a failure")
    match request:
        case CheckPath():
            count = len(request.path)
            invalid = [int(index) for index in message.invalid_pose_indices if 0 <= index < count]
            if request.stop_at_first_collision:
                invalid = invalid[:1]
            return PathCheck(message.is_valid, tuple(request.path[index] for index in invalid))
        case GetCosts():
            if len(message.costs) != len(request.poses):
                raise RosError(f"{len(message.costs)} costs were received for {len(request.poses)} poses")
            return tuple(float(cost) for cost in message.costs)
    return None
