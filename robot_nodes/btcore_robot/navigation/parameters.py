"""The parameters of the navigation servers, with Nav2's names and the book's values as defaults.

"The book" is *A Concise Introduction to Robot Programming with ROS2*; its files configure Nav2 for Tiago.
The name of a field is its key in a Nav2 parameter file; aliases are the keys of older and newer releases or
of other plug-ins for the same job. A plug-in's own keys are here without the plug-in's id. Some fields, such
as `laser_model_type` and `use_astar`, have no effect: they only accept common keys of Nav2.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from btcore_robot import time_limits
from btcore_robot.navigation.parameter_files import (
    ALIASES,
    EVERY_SERVER,
    MINIMUM,
    ParameterError,
    ParameterOverlay,
    read_settings,
)

__all__ = [
    "AmclParameters",
    "BehaviourParameters",
    "ControllerParameters",
    "CostmapParameters",
    "NavigationParameters",
    "NavigatorParameters",
    "PlannerParameters",
    "load_parameters",
]


def number_field(default: float, *aliases: str, minimum: float | None = None) -> Any:
    """Return a dataclass field for a number, with its rules for parameter files as metadata.

    Args:
        default: The value without a parameter file.
        aliases: Other names of the parameter in parameter files.
        minimum: The least valid value; None if every number is valid.
    """
    return field(default=default, metadata={ALIASES: aliases, MINIMUM: minimum})


@dataclass(frozen=True, slots=True)
class AmclParameters:
    """The localiser: `amcl`. Lengths in m, angles in rad, times in s.

    The names and meanings are those of nav2_amcl: motion noise (`alpha…`), likelihood field (`sigma_hit`,
    `z_…`), KLD sampling (`pf_…`) and the filter's updates (`update_min_…`).
    """

    alpha1: float = number_field(0.2, minimum=0.0)
    alpha2: float = number_field(0.2, minimum=0.0)
    alpha3: float = number_field(0.2, minimum=0.0)
    alpha4: float = number_field(0.2, minimum=0.0)
    alpha5: float = number_field(0.2, minimum=0.0)
    base_frame_id: str = "base_footprint"
    odom_frame_id: str = "odom"
    global_frame_id: str = "map"
    scan_topic: str = "/scan_raw"
    laser_model_type: str = "likelihood_field"
    robot_model_type: str = "nav2_amcl::DifferentialMotionModel"
    laser_likelihood_max_dist: float = number_field(2.0, minimum=0.0)
    laser_max_range: float = 100.0
    laser_min_range: float = -1.0
    max_beams: int = number_field(60, minimum=2)
    max_particles: int = number_field(2000, minimum=1)
    min_particles: int = number_field(500, minimum=1)
    pf_err: float = number_field(0.05, minimum=0.0)
    pf_z: float = number_field(0.99, minimum=0.0)
    recovery_alpha_fast: float = number_field(0.0, minimum=0.0)
    recovery_alpha_slow: float = number_field(0.0, minimum=0.0)
    resample_interval: int = number_field(1, minimum=1)
    sigma_hit: float = number_field(0.2, minimum=0.0)
    lambda_short: float = 0.1
    z_hit: float = number_field(0.5, minimum=0.0)
    z_max: float = number_field(0.05, minimum=0.0)
    z_rand: float = number_field(0.5, minimum=0.0)
    z_short: float = number_field(0.05, minimum=0.0)
    do_beamskip: bool = False
    tf_broadcast: bool = True
    transform_tolerance: float = number_field(time_limits.MAP_TRANSFORM, minimum=0.0)
    update_min_a: float = number_field(0.2, minimum=0.0)
    update_min_d: float = number_field(0.25, minimum=0.0)
    set_initial_pose: bool = True
    initial_pose_x: float = number_field(0.0, "initial_pose.x")
    initial_pose_y: float = number_field(0.0, "initial_pose.y")
    initial_pose_yaw: float = number_field(0.0, "initial_pose.yaw")


@dataclass(frozen=True, slots=True)
class CostmapParameters:
    """A costmap: `local_costmap` or `global_costmap`. Lengths in m, frequencies in Hz.

    The book's file has a robot radius of 0.2 m for the global costmap. The default here is the radius of the
    local costmap, so that every planned path is wide enough for the controller (Tiago's footprint is a circle
    with a radius of 0.27 m).
    """

    global_frame: str = "map"
    robot_base_frame: str = "base_link"
    update_frequency: float = number_field(1.0, minimum=0.0)
    resolution: float = number_field(0.05, minimum=0.005)
    rolling_window: bool = False
    width: float = number_field(3.0, minimum=0.0)
    height: float = number_field(3.0, minimum=0.0)
    robot_radius: float = number_field(0.3, minimum=0.0)
    track_unknown_space: bool = True
    inflation_radius: float = number_field(0.55, minimum=0.0)
    cost_scaling_factor: float = number_field(3.0, minimum=0.0)
    obstacle_max_range: float = number_field(2.5, "obstacle_range", minimum=0.0)
    obstacle_min_range: float = number_field(0.0, minimum=0.0)
    raytrace_max_range: float = number_field(3.0, "raytrace_range", minimum=0.0)
    raytrace_min_range: float = number_field(0.0, minimum=0.0)
    marking: bool = True
    clearing: bool = True
    plugins: tuple[str, ...] = ("static_layer", "obstacle_layer", "inflation_layer")


@dataclass(frozen=True, slots=True)
class PlannerParameters:
    """The planner: `planner_server` and its plug-in (`GridBased`).

    *tolerance* (m) is the distance from an unreachable goal at which the path may end. It is 0, unlike the
    0.5 of Nav2's and the book's files, so that a goal in a wall fails with the error code for that reason.
    """

    planner_plugins: tuple[str, ...] = ("GridBased",)
    expected_planner_frequency: float = number_field(20.0, minimum=0.0)
    tolerance: float = number_field(0.0, minimum=0.0)
    use_astar: bool = False
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
    """

    controller_plugins: tuple[str, ...] = ("FollowPath",)
    controller_frequency: float = number_field(20.0, minimum=1.0)
    failure_tolerance: float = number_field(6.0, minimum=-1.0)
    required_movement_radius: float = number_field(0.5, minimum=0.0)
    required_movement_angle: float = number_field(0.5, minimum=0.0)
    movement_time_allowance: float = number_field(10.0, minimum=0.0)
    xy_goal_tolerance: float = number_field(0.25, minimum=0.01)
    yaw_goal_tolerance: float = number_field(0.25, minimum=0.01)
    stateful: bool = True
    max_vel_x: float = number_field(0.3, "desired_linear_vel", "vx_max", minimum=0.0)
    max_vel_theta: float = number_field(0.5, "wz_max", minimum=0.0)
    acc_lim_x: float = number_field(1.5, "ax_max", minimum=0.01)
    acc_lim_theta: float = number_field(2.2, "az_max", "max_angular_accel", minimum=0.01)
    decel_lim_x: float = number_field(-2.5, "ax_min")
    decel_lim_theta: float = number_field(-3.2)
    lookahead_dist: float = number_field(0.6, "max_lookahead_dist", minimum=0.1)
    min_lookahead_dist: float = number_field(0.35, minimum=0.1)
    rotate_to_heading_min_angle: float = number_field(0.785, minimum=0.1)
    approach_velocity_scaling_dist: float = number_field(0.6, minimum=0.0)
    min_approach_linear_velocity: float = number_field(0.05, minimum=0.01)
    time_to_collision: float = number_field(1.2, "max_allowed_time_to_collision_up_to_carrot", minimum=0.1)
    scan_timeout: float = number_field(time_limits.SCAN, minimum=0.1)
    odometry_timeout: float = number_field(time_limits.ODOMETRY, minimum=0.05)


@dataclass(frozen=True, slots=True)
class BehaviourParameters:
    """The recoveries: `behavior_server` (`recoveries_server` in foxy). Units are Hz, s, rad/s, rad/s²."""

    cycle_frequency: float = number_field(10.0, minimum=1.0)
    simulate_ahead_time: float = number_field(2.0, "projection_time", minimum=0.0)
    max_rotational_vel: float = number_field(1.0, minimum=0.0)
    min_rotational_vel: float = number_field(0.4, minimum=0.0)
    rotational_acc_lim: float = number_field(3.2, minimum=0.01)


@dataclass(frozen=True, slots=True)
class NavigatorParameters:
    """The navigator: `bt_navigator`. Durations and timeouts are in ms, *goal_reached_tol* in m.

    An empty file name stands for this package's own tree. *plugin_lib_names* are further node libraries, as
    for `btcore run --plugin`. Nav2's own libraries (`nav2_…`) are built in.
    """

    global_frame: str = "map"
    robot_base_frame: str = "base_link"
    bt_loop_duration: int = number_field(10, minimum=1)
    default_server_timeout: int = number_field(20, minimum=1)
    default_nav_to_pose_bt_xml: str = field(
        default="", metadata={ALIASES: ("default_bt_xml_filename", "default_bt_xml_file")}
    )
    default_nav_through_poses_bt_xml: str = ""
    plugin_lib_names: tuple[str, ...] = ()
    goal_reached_tol: float = number_field(0.25, minimum=0.0)


LOCAL_COSTMAP = CostmapParameters(
    global_frame="odom",
    update_frequency=5.0,
    rolling_window=True,
    track_unknown_space=False,
    plugins=("obstacle_layer", "inflation_layer"),
)
"""The book's local costmap: 3 m × 3 m around the robot in the frame odom, updated five times a second."""


@dataclass(frozen=True, slots=True)
class NavigationParameters:
    """The parameters of every server.

    *unknown* contains the settings of a file that have no field here, by full name (for instance
    `controller_server.FollowPath.short_circuit`). *warnings* are sentences for the author of the file.
    """

    amcl: AmclParameters = AmclParameters()
    global_costmap: CostmapParameters = CostmapParameters()
    local_costmap: CostmapParameters = LOCAL_COSTMAP
    planner: PlannerParameters = PlannerParameters()
    controller: ControllerParameters = ControllerParameters()
    behaviours: BehaviourParameters = BehaviourParameters()
    navigator: NavigatorParameters = NavigatorParameters()
    unknown: Mapping[str, object] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


_SERVERS = {
    "amcl": "amcl",
    "global_costmap": "global_costmap",
    "local_costmap": "local_costmap",
    "planner_server": "planner",
    "controller_server": "controller",
    "behavior_server": "behaviours",
    "recoveries_server": "behaviours",
    "bt_navigator": "navigator",
}
"""The server's name in Nav2's files, and the attribute of `NavigationParameters` for this server."""


def load_parameters(path: Path) -> NavigationParameters:
    """Return the parameters in a Nav2 parameter file of any release from foxy to the branch main.

    Missing values have the book's defaults. Keys without a meaning here are collected in `unknown`, and a
    warning per server lists them. A key that looks misspelt gets a warning of its own.

    Raises:
        ParameterError: The file can't be read, or a value has the wrong type or is out of range.

    Examples:
        >>> from pathlib import Path
        >>> from btcore_robot.navigation.parameters import load_parameters
        >>> _ = Path("nav2.yaml").write_text("{amcl: {ros__parameters: {max_particles: 1000}}}")
        >>> load_parameters(Path("nav2.yaml")).amcl.max_particles
        1000
    """
    servers = read_settings(path)
    everywhere = servers.pop(EVERY_SERVER, {})
    chosen: dict[str, Any] = {}
    unknown: dict[str, object] = {}
    errors: list[str] = []
    warnings: list[str] = []
    unused: list[str] = []
    defaults = NavigationParameters()
    unknown_servers = []
    for server, settings in servers.items():
        if server not in _SERVERS:
            unknown_servers.append(server)
            unknown.update({setting.name: setting.value for setting in settings.values()})
            continue
        attribute = _SERVERS[server]
        overlay = ParameterOverlay(path, chosen.get(attribute, getattr(defaults, attribute)))
        chosen[attribute] = overlay.apply(settings)
        errors += overlay.errors
        warnings += overlay.typo_warnings
        unknown.update(overlay.unknown)
        unused += overlay.unknown
    # Settings for all servers can't be checked: a key that a server lacks may belong to another server.
    for attribute in dict.fromkeys(_SERVERS.values()):
        if everywhere:
            overlay = ParameterOverlay(path, chosen.get(attribute, getattr(defaults, attribute)))
            chosen[attribute] = overlay.apply(everywhere)
    unknown.update({s.name: s.value for s in everywhere.values()})
    if errors:
        raise ParameterError("\n".join(errors))
    for server in servers:
        keys = [name.partition(".")[2] for name in unused if name.startswith(f"{server}.")]
        if keys:
            warnings.append(f"{path}: these keys of {server} have no effect here: {', '.join(keys)}")
    if unknown_servers:
        warnings.append(f"{path}: these servers are not part of this stack: {', '.join(unknown_servers)}")
    return NavigationParameters(unknown=unknown, warnings=tuple(warnings), **chosen)
