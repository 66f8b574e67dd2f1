"""What the navigation servers can be told, named as Nav2 names it, with the book's figures as defaults.

A field's name is its key in a Nav2 parameter file; other spellings, of older and newer releases or of other
plug-ins for the same job, stand beside it. A plug-in's own keys are here without the plug-in's id.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from btcore_robot.navigation.parameter_files import EVERY_SERVER, ParameterError, read_settings
from btcore_robot.navigation.parameter_overlay import LOW, SPELLINGS, ParameterOverlay

__all__ = [
    "LOCAL_COSTMAP",
    "AmclParameters",
    "BehaviourParameters",
    "ControllerParameters",
    "CostmapParameters",
    "NavigationParameters",
    "NavigatorParameters",
    "ParameterError",
    "PlannerParameters",
    "load_parameters",
]


def figure(default: float, *spellings: str, low: float | None = None) -> Any:
    """A field that is a number, with its other names in parameter files and the least value it may have."""
    return field(default=default, metadata={SPELLINGS: spellings, LOW: low})


@dataclass(frozen=True, slots=True)
class AmclParameters:
    """The localiser: ``amcl``. Motion noise α1…α5, weights of the likelihood field, KLD sampling."""

    alpha1: float = figure(0.2, low=0.0)
    alpha2: float = figure(0.2, low=0.0)
    alpha3: float = figure(0.2, low=0.0)
    alpha4: float = figure(0.2, low=0.0)
    alpha5: float = figure(0.2, low=0.0)
    base_frame_id: str = "base_footprint"
    odom_frame_id: str = "odom"
    global_frame_id: str = "map"
    scan_topic: str = "/scan_raw"
    laser_model_type: str = "likelihood_field"
    robot_model_type: str = "nav2_amcl::DifferentialMotionModel"
    laser_likelihood_max_dist: float = figure(2.0, low=0.0)
    laser_max_range: float = 100.0
    laser_min_range: float = -1.0
    max_beams: int = figure(60, low=2)
    max_particles: int = figure(2000, low=1)
    min_particles: int = figure(500, low=1)
    pf_err: float = figure(0.05, low=0.0)
    pf_z: float = figure(0.99, low=0.0)
    recovery_alpha_fast: float = figure(0.0, low=0.0)
    recovery_alpha_slow: float = figure(0.0, low=0.0)
    resample_interval: int = figure(1, low=1)
    sigma_hit: float = figure(0.2, low=0.0)
    lambda_short: float = 0.1
    z_hit: float = figure(0.5, low=0.0)
    z_max: float = figure(0.05, low=0.0)
    z_rand: float = figure(0.5, low=0.0)
    z_short: float = figure(0.05, low=0.0)
    do_beamskip: bool = False
    tf_broadcast: bool = True
    transform_tolerance: float = figure(1.0, low=0.0)
    update_min_a: float = figure(0.2, low=0.0)
    update_min_d: float = figure(0.25, low=0.0)
    set_initial_pose: bool = True
    initial_pose_x: float = figure(0.0, "initial_pose.x")
    initial_pose_y: float = figure(0.0, "initial_pose.y")
    initial_pose_yaw: float = figure(0.0, "initial_pose.yaw")


@dataclass(frozen=True, slots=True)
class CostmapParameters:
    """One costmap: ``local_costmap`` or ``global_costmap``. Lengths in m, frequencies in Hz.

    The book's file has a robot radius of 0.2 m for the global one; the default is that of the local one, so
    that no path is planned that the controller refuses (Tiago's footprint is a circle of 0.27 m).
    """

    global_frame: str = "map"
    robot_base_frame: str = "base_link"
    update_frequency: float = figure(1.0, low=0.0)
    resolution: float = figure(0.05, low=0.005)
    rolling_window: bool = False
    width: float = figure(3.0, low=0.0)
    height: float = figure(3.0, low=0.0)
    robot_radius: float = figure(0.3, low=0.0)
    track_unknown_space: bool = True
    inflation_radius: float = figure(0.55, low=0.0)
    cost_scaling_factor: float = figure(3.0, low=0.0)
    obstacle_max_range: float = figure(2.5, "obstacle_range", low=0.0)
    obstacle_min_range: float = figure(0.0, low=0.0)
    raytrace_max_range: float = figure(3.0, "raytrace_range", low=0.0)
    raytrace_min_range: float = figure(0.0, low=0.0)
    marking: bool = True
    clearing: bool = True
    plugins: tuple[str, ...] = ("static_layer", "obstacle_layer", "inflation_layer")


@dataclass(frozen=True, slots=True)
class PlannerParameters:
    """The planner: ``planner_server`` and its plug-in (``GridBased``).

    *tolerance* (m) is how far from a goal that can't be reached the path may end. It is 0, where Nav2's and
    the book's files say 0.5, so that a goal in a wall fails by its name.
    """

    planner_plugins: tuple[str, ...] = ("GridBased",)
    expected_planner_frequency: float = figure(20.0, low=0.0)
    tolerance: float = figure(0.0, low=0.0)
    use_astar: bool = False
    allow_unknown: bool = True


@dataclass(frozen=True, slots=True)
class ControllerParameters:
    """The controller: ``controller_server``, its checkers and its plug-in (``FollowPath``).

    Velocities in m/s and rad/s, accelerations in m/s² and rad/s² (``decel_…`` are negative), times in s,
    lengths in m. The controller is a regulated pure pursuit and has that plug-in's names where DWB, whose
    names the robot's limits have, knows no such thing; of MPPI's it takes the limits.

    *failure_tolerance* is how long there may be no way to move before a goal fails (0 at once, -1 never).
    Nav2's files say 0.3 s; here it is as long as people take who stop before the robot and go on.
    Without a scan for *scan_timeout* the robot stands; it keeps *time_to_collision* from what it drives at.
    """

    controller_plugins: tuple[str, ...] = ("FollowPath",)
    controller_frequency: float = figure(20.0, low=1.0)
    failure_tolerance: float = figure(6.0, low=-1.0)
    required_movement_radius: float = figure(0.5, low=0.0)
    required_movement_angle: float = figure(0.5, low=0.0)
    movement_time_allowance: float = figure(10.0, low=0.0)
    xy_goal_tolerance: float = figure(0.25, low=0.01)
    yaw_goal_tolerance: float = figure(0.25, low=0.01)
    stateful: bool = True
    max_vel_x: float = figure(0.3, "desired_linear_vel", "vx_max", low=0.0)
    max_vel_theta: float = figure(0.5, "wz_max", low=0.0)
    acc_lim_x: float = figure(1.5, "ax_max", low=0.01)
    acc_lim_theta: float = figure(2.2, "az_max", "max_angular_accel", low=0.01)
    decel_lim_x: float = figure(-2.5, "ax_min")
    decel_lim_theta: float = figure(-3.2)
    lookahead_dist: float = figure(0.6, "max_lookahead_dist", low=0.1)
    min_lookahead_dist: float = figure(0.35, low=0.1)
    rotate_to_heading_min_angle: float = figure(0.785, low=0.1)
    approach_velocity_scaling_dist: float = figure(0.6, low=0.0)
    min_approach_linear_velocity: float = figure(0.05, low=0.01)
    time_to_collision: float = figure(1.2, "max_allowed_time_to_collision_up_to_carrot", low=0.1)
    scan_timeout: float = figure(0.5, low=0.1)


@dataclass(frozen=True, slots=True)
class BehaviourParameters:
    """The recoveries: ``behavior_server`` (``recoveries_server`` in foxy). Figures in rad/s and s."""

    cycle_frequency: float = figure(10.0, low=1.0)
    simulate_ahead_time: float = figure(2.0, "projection_time", low=0.0)
    max_rotational_vel: float = figure(1.0, low=0.0)
    min_rotational_vel: float = figure(0.4, low=0.0)
    rotational_acc_lim: float = figure(3.2, low=0.01)


@dataclass(frozen=True, slots=True)
class NavigatorParameters:
    """The navigator: ``bt_navigator``. *bt_loop_duration*, *default_server_timeout* in ms; "" is our tree.

    *plugin_lib_names* are further node libraries, as ``btcore run --plugin`` has them. Nav2's own, which are
    called ``nav2_…``, are here already.
    """

    global_frame: str = "map"
    robot_base_frame: str = "base_link"
    bt_loop_duration: int = figure(10, low=1)
    default_server_timeout: int = figure(20, low=1)
    default_nav_to_pose_bt_xml: str = field(
        default="", metadata={SPELLINGS: ("default_bt_xml_filename", "default_bt_xml_file")}
    )
    default_nav_through_poses_bt_xml: str = ""
    plugin_lib_names: tuple[str, ...] = ()
    goal_reached_tol: float = figure(0.25, low=0.0)


LOCAL_COSTMAP = CostmapParameters(
    global_frame="odom",
    update_frequency=5.0,
    rolling_window=True,
    track_unknown_space=False,
    plugins=("obstacle_layer", "inflation_layer"),
)
"""The book's local costmap: 3 m × 3 m about the robot in the frame odom, five times a second."""


@dataclass(frozen=True, slots=True)
class NavigationParameters:
    """The parameters of every server.

    *unknown* keeps what a file also says, by its full name (``controller_server.FollowPath.short_circuit``);
    *warnings* are sentences for whoever gave the file.
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
"""The attribute of `NavigationParameters` by the name of the server in Nav2's files."""


def load_parameters(path: Path) -> NavigationParameters:
    """The parameters in a file of Nav2's form, of foxy to main; what it doesn't tell has the book's figures.

    Keys without a meaning here are kept, and named in one warning; one that looks like a slip gets its own.

    Raises:
        ParameterError: the file can't be read, or a value has the wrong type or makes no sense.

    """
    servers = read_settings(path)
    everywhere = servers.pop(EVERY_SERVER, {})
    chosen: dict[str, Any] = {}
    unknown: dict[str, object] = {}
    mistakes: list[str] = []
    slips: list[str] = []
    idle: list[str] = []
    plain = NavigationParameters()
    strangers = []
    for server, settings in servers.items():
        if server not in _SERVERS:
            strangers.append(server)
            unknown.update({setting.name: setting.value for setting in settings.values()})
            continue
        attribute = _SERVERS[server]
        choice = ParameterOverlay(path, chosen.get(attribute, getattr(plain, attribute)))
        chosen[attribute] = choice.apply(settings)
        mistakes += choice.mistakes
        slips += choice.slips
        unknown.update(choice.unknown)
        idle += choice.unknown
    for attribute in dict.fromkeys(_SERVERS.values()):
        if everywhere:
            choice = ParameterOverlay(path, chosen.get(attribute, getattr(plain, attribute)))
            chosen[attribute] = choice.apply(everywhere)
    unknown.update({s.name: s.value for s in everywhere.values()})
    if mistakes:
        raise ParameterError("\n".join(mistakes))
    warnings = slips
    for server in servers:
        keys = [name.partition(".")[2] for name in idle if name.startswith(f"{server}.")]
        if keys:
            warnings.append(f"{path}: these keys of {server} have no effect here: {', '.join(keys)}")
    if strangers:
        warnings.append(f"{path}: these servers are not part of this stack: {', '.join(strangers)}")
    return NavigationParameters(unknown=unknown, warnings=tuple(warnings), **chosen)
