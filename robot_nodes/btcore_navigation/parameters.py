"""The parameters of the navigation servers, with Nav2's names and the book's values as defaults.

"The book" is *A Concise Introduction to Robot Programming with ROS2*; its files configure Nav2 for Tiago.
The name of a field is its key in a Nav2 parameter file; the texts in its annotation are the keys of older and
newer releases or of other plug-ins for the same job. A plug-in's own keys are here without the plug-in's id.

Every field has an effect. Keys of a file that have no field here have no effect; a warning lists them.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, TypeVar

from msgspec import Meta

from btcore.typed_data import NotNegative
from btcore_robot import time_limits
from btcore_robot.parameter_files import (
    EVERY_SERVER,
    ParameterError,
    ParameterOverlay,
    Setting,
    read_settings,
)
from btcore_robot.robot import BaseInfo

__all__ = [
    "AmclParameters",
    "BehaviourParameters",
    "ControllerParameters",
    "CostmapParameters",
    "NavigationParameters",
    "NavigatorParameters",
    "PlannerParameters",
    "WaypointFollowerParameters",
    "load_parameters",
]


HULL_MARGIN = 0.03
"""The distance (m) that the hull of a robot keeps from obstacles."""

AnyCostmap = TypeVar("AnyCostmap", "GlobalCostmapParameters", "LocalCostmapParameters")


@dataclass(frozen=True, slots=True)
class AmclParameters:
    """The localiser: `amcl`. Lengths in m, angles in rad, times in s.

    The names and meanings are those of nav2_amcl: motion noise (`alpha…`), likelihood field (`sigma_hit`,
    `z_…`), KLD sampling (`pf_…`) and the filter's updates (`update_min_…`).
    """

    alpha1: NotNegative = 0.2
    alpha2: NotNegative = 0.2
    alpha3: NotNegative = 0.2
    alpha4: NotNegative = 0.2
    laser_likelihood_max_dist: NotNegative = 2.0
    laser_max_range: float = 100.0
    laser_min_range: float = -1.0
    max_beams: Annotated[int, Meta(ge=2)] = 60
    max_particles: Annotated[int, Meta(ge=1)] = 2000
    min_particles: Annotated[int, Meta(ge=1)] = 500
    pf_err: NotNegative = 0.05
    pf_z: NotNegative = 0.99
    resample_interval: Annotated[int, Meta(ge=1)] = 1
    sigma_hit: NotNegative = 0.2
    z_hit: NotNegative = 0.5
    z_rand: NotNegative = 0.5
    tf_broadcast: bool = True
    transform_tolerance: NotNegative = time_limits.MAP_TRANSFORM_VALIDITY_S
    update_min_a: NotNegative = 0.2
    update_min_d: NotNegative = 0.25
    set_initial_pose: bool = True
    initial_pose_x: Annotated[float, "initial_pose.x"] = 0.0
    initial_pose_y: Annotated[float, "initial_pose.y"] = 0.0
    initial_pose_yaw: Annotated[float, "initial_pose.yaw"] = 0.0


@dataclass(frozen=True, slots=True)
class CostmapParameters:
    """The parameters that both costmaps have. Lengths in m, frequencies in Hz.

    *footprint* is a list of points `[[x, y], …]` in a string, as in Nav2; the robot counts as the smallest
    circle around its centre that contains them. Without a footprint, *robot_radius* is this circle's radius.
    The least radius is that of the robot and a margin of 3 cm, so that every planned path is wide enough for
    the controller: 0.3 m for Tiago. (The book's file has 0.2 m for the global costmap.)

    *publish_frequency* and *always_send_full_costmap* are for the topics of ROS 2: how often a costmap is
    published, and whether completely each time, or only the part that has changed.
    """

    update_frequency: NotNegative = 1.0
    publish_frequency: NotNegative = 1.0
    always_send_full_costmap: bool = False
    resolution: Annotated[float, Meta(ge=0.005)] = 0.05
    robot_radius: NotNegative = 0.0
    footprint: str = ""
    inflation_radius: NotNegative = 0.55
    cost_scaling_factor: NotNegative = 3.0
    obstacle_max_range: Annotated[NotNegative, "obstacle_range"] = 2.5
    obstacle_min_range: NotNegative = 0.0
    raytrace_max_range: Annotated[NotNegative, "raytrace_range"] = 3.0

    @property
    def given_radius(self) -> float:
        """The radius (m) by *footprint* or *robot_radius*; 0 = the radius of the robot."""
        return footprint_radius(self.footprint) or self.robot_radius


@dataclass(frozen=True, slots=True)
class GlobalCostmapParameters(CostmapParameters):
    """The costmap of the whole map: `global_costmap`.

    *resolution* (m) is that of a map that the robot makes; a costmap of a known map has the map's resolution.
    """

    track_unknown_space: bool = True


@dataclass(frozen=True, slots=True)
class LocalCostmapParameters(CostmapParameters):
    """The costmap around the robot, in the frame odom: `local_costmap`.

    *width* (m) is the side of the costmap, which is a square.
    """

    update_frequency: NotNegative = 5.0
    width: NotNegative = 3.0


@dataclass(frozen=True, slots=True)
class PlannerParameters:
    """The planner: `planner_server` and its plug-in (`GridBased`).

    *tolerance* (m) is the distance from an unreachable goal at which the path may end. It is 0, unlike the
    0.5 of Nav2's and the book's files, so that a goal in a wall fails with the error code for that reason.
    """

    tolerance: NotNegative = 0.0
    allow_unknown: bool = True


@dataclass(frozen=True, slots=True)
class ControllerParameters:
    """The controller: `controller_server`, its checkers and its plug-in (`FollowPath`).

    Velocities in m/s and rad/s, accelerations in m/s² and rad/s² (`decel_…` are negative), times in s,
    lengths in m. The controller is a regulated pure pursuit. Limits of the robot have the names of the
    plug-in DWB; parameters that DWB lacks have the names of Nav2's regulated pure pursuit. The limits of MPPI
    are aliases.

    *failure_tolerance* is the time without a way to move after which a goal fails (0: at once, -1: never).
    Nav2's files have 0.3 s; the default here is long enough for people who stop in front of the robot and
    then walk on. After *scan_timeout* without a scan, or *odometry_timeout* without odometry, the robot
    stops; both hold for the recoveries, too. The speed is limited so that the robot needs at least
    *time_to_collision* to reach an obstacle ahead.

    *controller_plugins*, *goal_checker_plugins* and *progress_checker_plugins* are the names that goals may
    use. All names of a list stand for the same plug-in. Without a file, the names are those of Nav2.
    """

    controller_plugins: tuple[str, ...] = ("FollowPath",)
    goal_checker_plugins: Annotated[tuple[str, ...], "goal_checker_plugin"] = (
        "general_goal_checker",
        "goal_checker",
    )
    progress_checker_plugins: Annotated[tuple[str, ...], "progress_checker_plugin"] = ("progress_checker",)
    controller_frequency: Annotated[float, Meta(ge=1.0)] = 20.0
    failure_tolerance: Annotated[float, Meta(ge=-1.0)] = 6.0
    required_movement_radius: NotNegative = 0.5
    required_movement_angle: NotNegative = 0.5
    movement_time_allowance: NotNegative = 10.0
    xy_goal_tolerance: Annotated[float, Meta(ge=0.01)] = 0.25
    yaw_goal_tolerance: Annotated[float, Meta(ge=0.01)] = 0.25
    stateful: bool = True
    max_vel_x: Annotated[NotNegative, "desired_linear_vel", "vx_max"] = 0.3
    max_vel_theta: Annotated[NotNegative, "wz_max"] = 0.5
    acc_lim_x: Annotated[float, Meta(ge=0.01), "ax_max"] = 1.5
    acc_lim_theta: Annotated[float, Meta(ge=0.01), "az_max", "max_angular_accel"] = 2.2
    decel_lim_x: Annotated[float, "ax_min"] = -2.5
    decel_lim_theta: float = -3.2
    lookahead_dist: Annotated[float, Meta(ge=0.1), "max_lookahead_dist"] = 0.6
    min_lookahead_dist: Annotated[float, Meta(ge=0.1)] = 0.35
    rotate_to_heading_min_angle: Annotated[float, Meta(ge=0.1)] = 0.785
    approach_velocity_scaling_dist: NotNegative = 0.6
    min_approach_linear_velocity: Annotated[float, Meta(ge=0.01)] = 0.05
    time_to_collision: Annotated[float, Meta(ge=0.1), "max_allowed_time_to_collision_up_to_carrot"] = 1.2
    scan_timeout: Annotated[float, Meta(ge=0.1)] = time_limits.MAX_SCAN_AGE_S
    odometry_timeout: Annotated[float, Meta(ge=0.05)] = time_limits.MAX_ODOMETRY_AGE_S


@dataclass(frozen=True, slots=True)
class BehaviourParameters:
    """The recoveries: `behavior_server` (`recoveries_server` in foxy). Units are Hz, s, rad/s, rad/s²."""

    cycle_frequency: Annotated[float, Meta(ge=1.0)] = 10.0
    simulate_ahead_time: Annotated[NotNegative, "projection_time"] = 2.0
    max_rotational_vel: NotNegative = 1.0
    min_rotational_vel: NotNegative = 0.4
    rotational_acc_lim: Annotated[float, Meta(ge=0.01)] = 3.2


@dataclass(frozen=True, slots=True)
class NavigatorParameters:
    """The navigator: `bt_navigator`. Durations and timeouts are in ms, *goal_reached_tol* in m.

    An empty file name stands for this package's own tree. *plugin_lib_names* are further node libraries, as
    for `btcore run --plugin`. Nav2's own libraries (`nav2_…`) are built in.
    """

    bt_loop_duration: Annotated[int, Meta(ge=1)] = 10
    default_nav_to_pose_bt_xml: Annotated[str, "default_bt_xml_filename", "default_bt_xml_file"] = ""
    default_nav_through_poses_bt_xml: str = ""
    plugin_lib_names: tuple[str, ...] = ()
    goal_reached_tol: NotNegative = 0.25


@dataclass(frozen=True, slots=True)
class WaypointFollowerParameters:
    """The waypoint follower: `waypoint_follower`.

    With *stop_on_failure* a goal ends at the first pose that is not reached. The robot stays at each pose for
    *waypoint_pause_duration* (ms).
    """

    stop_on_failure: bool = True
    waypoint_pause_duration: Annotated[int, Meta(ge=0)] = 0


@dataclass(frozen=True, slots=True)
class NavigationParameters:
    """The parameters of every server.

    *unknown* contains the settings of a file that have no effect, by full name (for instance
    `controller_server.FollowPath.short_circuit`). *warnings* are sentences for the author of the file.
    """

    amcl: AmclParameters = AmclParameters()
    global_costmap: GlobalCostmapParameters = GlobalCostmapParameters()
    local_costmap: LocalCostmapParameters = LocalCostmapParameters()
    planner: PlannerParameters = PlannerParameters()
    controller: ControllerParameters = ControllerParameters()
    behaviours: BehaviourParameters = BehaviourParameters()
    navigator: NavigatorParameters = NavigatorParameters()
    waypoints: WaypointFollowerParameters = WaypointFollowerParameters()
    unknown: Mapping[str, object] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    def for_robot(self, base: BaseInfo) -> "NavigationParameters":
        """Return parameters in which the costmaps have a `robot_radius`: at least that of *base*."""
        return replace(
            self,
            global_costmap=_with_radius(self.global_costmap, base),
            local_costmap=_with_radius(self.local_costmap, base),
        )


def min_clearance(base: BaseInfo, robot_radius: float) -> float:
    """Return the distance (m) that the centre of a robot keeps from obstacles while it drives.

    Args:
        base: The size of the robot.
        robot_radius: The radius (m) in the parameters of the navigation; 0 = not given. A smaller radius than
            that of the robot, with its margin, has no effect.
    """
    return max(robot_radius, round(base.radius + HULL_MARGIN, 6))


def _with_radius(costmap: AnyCostmap, base: BaseInfo) -> AnyCostmap:
    return replace(costmap, robot_radius=min_clearance(base, costmap.given_radius))


def footprint_radius(footprint: str) -> float:
    """Return the radius (m) of the circle around the origin that contains a footprint; 0 without points.

    Args:
        footprint: A list of points `[[x, y], …]` (m), or "".

    Raises:
        ValueError: *footprint* has another form.
    """
    try:
        points = json.loads(footprint) if footprint else []
        radius = max((math.hypot(float(x), float(y)) for x, y in points), default=0.0)
    except (TypeError, ValueError, RecursionError):
        radius = math.nan
    if not math.isfinite(radius):
        raise ValueError(f"must be a list of points [[x, y], …] in m, not {footprint!r}")
    return radius


USE_SIM_TIME = "use_sim_time"
"""The key that Nav2's files repeat for every server; here the robot has the clock."""

_SERVERS = {
    "amcl": "amcl",
    "global_costmap": "global_costmap",
    "local_costmap": "local_costmap",
    "planner_server": "planner",
    "controller_server": "controller",
    "behavior_server": "behaviours",
    "recoveries_server": "behaviours",
    "bt_navigator": "navigator",
    "waypoint_follower": "waypoints",
}
"""The server's name in Nav2's files, and the attribute of `NavigationParameters` for this server."""


def load_parameters(path: Path) -> NavigationParameters:
    """Return the parameters in a Nav2 parameter file of any release from foxy to the branch main.

    Missing values have the book's defaults. Keys that have no effect here are collected in `unknown`, and a
    warning lists them. A key that looks misspelt gets a warning of its own.

    Raises:
        ParameterError: The file can't be read, or a value has the wrong type or is out of range.

    Examples:
        >>> from pathlib import Path
        >>> from btcore_navigation.parameters import load_parameters
        >>> _ = Path("nav2.yaml").write_text("{amcl: {ros__parameters: {max_particles: 1000}}}")
        >>> load_parameters(Path("nav2.yaml")).amcl.max_particles
        1000
    """
    servers = read_settings(path)
    everywhere = servers.pop(EVERY_SERVER, {})
    chosen: dict[str, Any] = {}
    errors: list[str] = []
    warnings: list[str] = []
    unused: dict[str, list[Setting]] = {}
    defaults = NavigationParameters()
    for server, settings in servers.items():
        attribute = _SERVERS.get(server)
        if attribute is None:
            unused[server] = list(settings.values())
            continue
        overlay = ParameterOverlay(path, chosen.get(attribute, getattr(defaults, attribute)))
        chosen[attribute] = overlay.apply(settings)
        errors += overlay.errors
        warnings += overlay.typo_warnings
        unused[server] = overlay.unused
    # A key for all servers has no effect only if every server lacks it.
    unused[EVERY_SERVER] = list(everywhere.values())
    for attribute in dict.fromkeys(_SERVERS.values()):
        overlay = ParameterOverlay(path, chosen.get(attribute, getattr(defaults, attribute)))
        chosen[attribute] = overlay.apply(everywhere)
        errors += [error for error in overlay.errors if error not in errors]
        unused[EVERY_SERVER] = [
            parameter for parameter in unused[EVERY_SERVER] if parameter in overlay.unused
        ]
    for server, parameters in {**servers, EVERY_SERVER: everywhere}.items():
        footprint = parameters.get("footprint")
        if footprint is None or not isinstance(footprint.value, str):
            continue
        try:
            if footprint_radius(footprint.value) and "robot_radius" in parameters:
                unused[server].append(parameters["robot_radius"])
        except ValueError as error:
            errors.append(f"{path}:{footprint.line}: {footprint.name} {error}")
    if errors:
        raise ParameterError("\n".join(errors))
    listed = _without_effect(unused)
    if listed:
        warnings.append(f"{path}: no effect here: {listed}")
    unknown = {setting.name: setting.value for settings in unused.values() for setting in settings}
    return NavigationParameters(unknown=unknown, warnings=tuple(warnings), **chosen)


def _without_effect(unused: Mapping[str, list[Setting]]) -> str:
    """Return a list of settings without effect by server; whole servers and `use_sim_time` are joined."""
    parts = []
    for server, settings in unused.items():
        keys = [setting.name.partition(".")[2] for setting in settings]
        keys = [key for key in keys if key != USE_SIM_TIME]
        if keys and (server in _SERVERS or server == EVERY_SERVER):
            parts.append(f"{server}: {', '.join(keys)}")
    unknown_servers = [server for server in unused if server not in _SERVERS and server != EVERY_SERVER]
    if unknown_servers:
        parts.append(f"all keys of {', '.join(unknown_servers)}")
    if any(setting.name.endswith(f".{USE_SIM_TIME}") for settings in unused.values() for setting in settings):
        parts.append(f"{USE_SIM_TIME} of all servers")
    return "; ".join(parts)
