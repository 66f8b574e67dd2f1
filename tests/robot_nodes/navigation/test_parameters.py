"""Parameter files of Nav2: which keys are read, and what is reported of the others."""

import json
import threading
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from textwrap import dedent
from typing import Any, get_type_hints

import numpy as np
import pytest

from btcore.bundled_trees import folder
from btcore_navigation.behaviours import BackUpGoal, SpinGoal
from btcore_navigation.controller import FollowPathGoal
from btcore_navigation.error_codes import CONTROLLER_RECOVERY_HELPS, PLANNER_RECOVERY_HELPS, Nav2ErrorCode
from btcore_navigation.parameters import NavigationParameters, load_parameters
from btcore_navigation.stack import Navigation
from btcore_robot.occupancy_map import OccupancyMap
from btcore_robot.parameter_files import ParameterError, aliases_of
from btcore_robot.robot import BaseInfo, Pose2D
from tests.robot_nodes.navigation.conftest import polyline_path, rig_on_floor


@pytest.fixture
def written(tmp_path: Path) -> Callable[..., Any]:
    def write(text: str) -> Path:
        path = tmp_path / "nav.yaml"
        path.write_text(dedent(text), encoding="utf-8")
        return path

    return write


def test_the_default_parameters_are_the_books() -> None:
    figures = NavigationParameters()
    assert (figures.controller.max_vel_x, figures.controller.max_vel_theta) == (0.3, 0.5)
    assert (figures.controller.acc_lim_x, figures.controller.acc_lim_theta) == (1.5, 2.2)
    assert (figures.controller.xy_goal_tolerance, figures.controller.yaw_goal_tolerance) == (0.25, 0.25)
    assert (figures.amcl.max_beams, figures.amcl.min_particles, figures.amcl.max_particles) == (60, 500, 2000)
    assert (figures.local_costmap.inflation_radius, figures.local_costmap.cost_scaling_factor) == (0.55, 3.0)
    assert (figures.local_costmap.update_frequency, figures.global_costmap.update_frequency) == (5.0, 1.0)
    assert (figures.behaviours.max_rotational_vel, figures.behaviours.min_rotational_vel) == (1.0, 0.4)


def test_the_default_tolerance_of_the_planner_is_zero() -> None:
    assert NavigationParameters().planner.tolerance == 0.0


def test_parameters_of_plugins_are_found_below_any_plugin_id(written: Callable[..., Any]) -> None:
    figures = load_parameters(
        written("""
        controller_server:
          ros__parameters:
            controller_frequency: 10.0
            progress_checker_plugins: ["moves"]
            goal_checker_plugin: "there"
            controller_plugins: ["Drive"]
            moves: {required_movement_radius: 0.7}
            there: {xy_goal_tolerance: 0.15}
            Drive:
              max_vel_x: 0.2
        planner_server:
          ros__parameters:
            planner_plugins: [Grid]
            Grid: {tolerance: 0.5}
        """)
    )
    assert figures.controller.controller_frequency == 10.0
    assert figures.controller.required_movement_radius == 0.7
    assert figures.controller.xy_goal_tolerance == 0.15
    assert figures.controller.max_vel_x == 0.2
    assert figures.controller.controller_plugins == ("Drive",)
    assert figures.controller.goal_checker_plugins == ("there",)
    assert figures.planner.tolerance == 0.5
    assert figures.warnings == ()


def test_parameters_of_nested_costmaps_and_layers_are_found(written: Callable[..., Any]) -> None:
    figures = load_parameters(
        written("""
        local_costmap:
          local_costmap:
            ros__parameters:
              width: 4
              robot_radius: 0.3
              plugins: ["voxel_layer", "inflation_layer"]
              inflation_layer: {inflation_radius: 0.7}
              voxel_layer:
                observation_sources: scan
                scan: {obstacle_max_range: 2.0, raytrace_max_range: 2.2}
        global_costmap:
          global_costmap:
            ros__parameters:
              obstacle_layer: {observation_sources: laser, laser: {obstacle_range: 1.5}}
        """)
    )
    local = figures.local_costmap
    assert (local.width, local.inflation_radius, local.obstacle_max_range) == (4.0, 0.7, 2.0)
    assert local.raytrace_max_range == 2.2
    assert figures.warnings == ()
    assert figures.global_costmap.obstacle_max_range == 1.5
    assert figures.global_costmap.inflation_radius == 0.55


@pytest.mark.parametrize(
    "head",
    [
        "amcl:\n  ros__parameters:",
        "amcl:",
        "/tiago/amcl:\n  ros__parameters:",
        "tiago:\n amcl:\n  ros__parameters:",
    ],
    ids=["with ros__parameters", "flat", "with a namespace", "below a namespace"],
)
def test_servers_are_found_in_every_form(written: Callable[..., Any], head: str) -> None:
    assert load_parameters(written(f"{head}\n    max_beams: 30\n")).amcl.max_beams == 30


def test_two_stars_apply_to_every_server(written: Callable[..., Any]) -> None:
    figures = load_parameters(
        written("/**:\n  ros__parameters:\n    robot_radius: 0.4\n    use_sim_time: true\n")
    )
    assert figures.local_costmap.robot_radius == figures.global_costmap.robot_radius == 0.4


def test_foxys_names_of_servers_and_keys_are_accepted(written: Callable[..., Any]) -> None:
    figures = load_parameters(
        written("""
        recoveries_server:
          ros__parameters: {max_rotational_vel: 0.8}
        bt_navigator:
          ros__parameters: {default_bt_xml_filename: "a.xml"}
        """)
    )
    assert figures.behaviours.max_rotational_vel == 0.8
    assert figures.navigator.default_nav_to_pose_bt_xml == "a.xml"


def test_the_limits_of_other_controllers_are_accepted(written: Callable[..., Any]) -> None:
    figures = load_parameters(
        written(
            "controller_server:\n  ros__parameters:\n    FollowPath: {vx_max: 0.4, wz_max: 1.9, ax_max: 3}\n"
        )
    )
    assert figures.controller.max_vel_x == 0.4
    assert figures.controller.max_vel_theta == 1.9
    assert figures.controller.acc_lim_x == 3.0


def test_of_two_plugins_the_first_listed_plugin_is_used(written: Callable[..., Any]) -> None:
    figures = load_parameters(
        written("""
        controller_server:
          ros__parameters:
            goal_checker_plugins: [precise, FollowPath]
            FollowPath: {xy_goal_tolerance: 0.5}
            precise: {xy_goal_tolerance: 0.1}
        """)
    )
    assert figures.controller.xy_goal_tolerance == 0.1


def test_unsupported_keys_are_kept_and_reported_once(written: Callable[..., Any]) -> None:
    path = written("""
    controller_server:
      ros__parameters:
        use_sim_time: true
        FollowPath: {critics: [PathDist], vy_samples: 5}
    map_saver:
      ros__parameters: {save_map_timeout: 5.0}
    """)
    figures = load_parameters(path)
    assert figures.unknown == {
        "controller_server.FollowPath.critics": ["PathDist"],
        "controller_server.FollowPath.vy_samples": 5,
        "controller_server.use_sim_time": True,
        "map_saver.save_map_timeout": 5.0,
    }
    assert figures.warnings == (
        f"{path}: no effect here: controller_server: FollowPath.critics, FollowPath.vy_samples; "
        "all keys of map_saver; use_sim_time of all servers",
    )


def test_a_misspelled_key_is_reported_with_a_suggestion(written: Callable[..., Any]) -> None:
    path = written("amcl:\n  ros__parameters:\n    max_particels: 100\n")
    assert load_parameters(path).warnings[0] == (
        f"{path}:3: amcl.max_particels has no effect; did you mean max_particles?"
    )


@pytest.mark.parametrize("key", ["initial_pose.z", "FollowPath.acc_lim_y", "voxel_layer.z_resolution"])
def test_nav2s_own_keys_are_not_reported_as_misspelled(written: Callable[..., Any], key: str) -> None:
    server = "amcl" if "pose" in key else "local_costmap" if "voxel" in key else "controller_server"
    figures = load_parameters(written(f"{server}:\n  ros__parameters:\n    {key}: 0.1\n"))
    assert not any("did you mean" in warning for warning in figures.warnings)


@pytest.mark.parametrize(
    ("value", "sentence"),
    [
        ("max_beams: 1", "amcl.max_beams is 1, and a whole number of at least 2 is expected"),
        ("tf_broadcast: 1", "amcl.tf_broadcast is 1, and true or false is expected"),
    ],
)
def test_invalid_value_raises_with_line(written: Callable[..., Any], value: str, sentence: str) -> None:
    path = written(f"amcl:\n  ros__parameters:\n    {value}\n")
    with pytest.raises(ParameterError) as raised:
        load_parameters(path)
    assert str(raised.value) == f"{path}:3: {sentence}"


@pytest.mark.parametrize("footprint", ["[[0.1], [0.2]]", "circle", "[[.inf, 0]]", "[[1e999, 0]]", "7"])
def test_an_invalid_footprint_raises_with_its_line(written: Callable[..., Any], footprint: str) -> None:
    path = written(f"local_costmap:\n  ros__parameters:\n    footprint: '{footprint}'\n")
    with pytest.raises(ParameterError, match=r"nav.yaml:3: local_costmap.footprint must be a list of points"):
        load_parameters(path)


def test_all_invalid_values_are_reported_at_once(written: Callable[..., Any]) -> None:
    path = written(
        """
        amcl: {ros__parameters: {max_beams: x}}
        bt_navigator: {ros__parameters: {bt_loop_duration: y}}
        """
    )
    with pytest.raises(ParameterError) as raised:
        load_parameters(path)
    assert str(raised.value).count("\n") == 1


def test_numbers_may_have_an_exponent(written: Callable[..., Any]) -> None:
    assert load_parameters(written("amcl:\n  ros__parameters:\n    sigma_hit: 2e-1\n")).amcl.sigma_hit == 0.2


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("amcl: [", "not valid YAML"),
        ("- amcl", ":1: expected names of servers with parameters below them"),
        ("amcl: 3", ":1: amcl must have parameters below it, not a single value"),
    ],
)
def test_file_with_invalid_structure_raises(written: Callable[..., Any], text: str, sentence: str) -> None:
    with pytest.raises(ParameterError, match=sentence):
        load_parameters(written(text))


def test_a_missing_file_raises(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=r"none.yaml: no such file"):
        load_parameters(tmp_path / "none.yaml")


def test_an_empty_file_gives_the_default_parameters(written: Callable[..., Any]) -> None:
    assert load_parameters(written("")) == NavigationParameters()


SECTIONS = {
    "amcl": "amcl",
    "global_costmap": "global_costmap",
    "local_costmap": "local_costmap",
    "planner_server": "planner",
    "controller_server": "controller",
    "behavior_server": "behaviours",
    "bt_navigator": "navigator",
}


@pytest.mark.parametrize("server", SECTIONS)
def test_every_field_changes_parameter_and_is_not_reported(written: Callable[..., Any], server: str) -> None:
    defaults = getattr(NavigationParameters(), SECTIONS[server])
    hints = get_type_hints(type(defaults), include_extras=True)
    for field in fields(defaults):
        default = getattr(defaults, field.name)
        other = {bool: not default, str: "[[0.2, 0.0]]", tuple: ["a"]}.get(type(default), 3)
        for name in (field.name, *aliases_of(hints[field.name])):
            read = load_parameters(written(json.dumps({server: {"ros__parameters": {name: other}}})))
            value = getattr(getattr(read, SECTIONS[server]), field.name)
            assert value == (tuple(other) if isinstance(other, list) else other), name
            assert read.warnings == (), name


def test_every_field_is_read_by_the_navigation() -> None:
    """A field that nothing reads would have no effect, without a warning."""
    unread: dict[str, set[str]] = {}

    def recorded(section: str, parameters: Any):
        names = unread[section] = {field.name for field in fields(parameters)}

        def read(self, name: str):
            names.discard(name)
            return object.__getattribute__(self, name)

        kind = type("Recorded", (type(parameters),), {"__getattribute__": read})
        values = {field.name: getattr(parameters, field.name) for field in fields(parameters)}
        names.clear()
        recording = kind(**values)
        names.update(values)
        return recording

    robot = rig_on_floor((1.5, -2.0, 1.6, 2.0), (-1.6, -2.0, -1.5, 2.0)).robot
    defaults = NavigationParameters().for_robot(robot.base_info)
    sections = {name: recorded(name, getattr(defaults, name)) for name in SECTIONS.values()}
    # The footprint is read when the radius is determined, by the line above. btcore_ros2 reads the others.
    for costmap in ("global_costmap", "local_costmap"):
        unread[costmap] -= {"footprint", "publish_frequency", "always_send_full_costmap"}

    class Known(NavigationParameters):
        def for_robot(self, base: object):
            return self

    cells = np.zeros((80, 80), dtype=np.int8)
    cells[:, [10, 70]] = 100
    map = OccupancyMap(cells, 0.05, (-2.0, -2.0))
    navigation = Navigation(robot, map, np.random.default_rng(1), folder(), Known(**sections))
    # Read by `Exploration` only, for a new map.
    unread["global_costmap"].discard("resolution")

    def run(seconds: float):
        robot.clock.wait_until(robot.clock.now() + int(seconds * 1e9), threading.Event())

    run(1.0)
    navigation.go_to(Pose2D(0.0, 1.0, 1.0))
    run(8.0)
    navigation.servers.spin.send_goal(SpinGoal(1.0))
    run(2.0)
    navigation.servers.back_up.send_goal(BackUpGoal(0.3, 0.2))
    run(2.0)
    navigation.servers.follow_path.send_goal(
        FollowPathGoal(polyline_path((0.0, 0.0), (1.0, 0.0), frame="nowhere"))
    )
    run(0.2)
    assert {section: names for section, names in unread.items() if names} == {}


NAV2_KEYS = {
    "amcl": "alpha5 base_frame_id beam_skip_distance beam_skip_error_threshold beam_skip_threshold "
    "do_beamskip global_frame_id lambda_short laser_model_type odom_frame_id recovery_alpha_fast "
    "recovery_alpha_slow robot_model_type save_pose_rate scan_topic z_max z_short",
    "global_costmap": "footprint_padding global_frame obstacle_layer.enabled "
    "obstacle_layer.plugin obstacle_layer.scan.clearing obstacle_layer.scan.marking "
    "obstacle_layer.scan.raytrace_min_range robot_base_frame width",
    "local_costmap": "height rolling_window track_unknown_space voxel_layer.z_voxels filters",
    "planner_server": "expected_planner_frequency GridBased.plugin GridBased.use_astar",
    "controller_server": "FollowPath.plugin FollowPath.critics min_x_velocity_threshold",
    "behavior_server": "local_frame robot_base_frame",
    "bt_navigator": "default_server_timeout global_frame",
}
"""Keys of Nav2's parameter files without effect here."""


def test_keys_of_nav2_without_effect_are_reported_in_one_warning(written: Callable[..., Any]) -> None:
    content = {
        server: {"ros__parameters": dict.fromkeys(keys.split(), 1)} for server, keys in NAV2_KEYS.items()
    }
    path = written(json.dumps(content))
    listed = "; ".join(f"{server}: {', '.join(keys.split())}" for server, keys in NAV2_KEYS.items())
    assert load_parameters(path).warnings == (f"{path}: no effect here: {listed}",)


def test_settings_that_others_override_are_reported(written: Callable[..., Any]) -> None:
    path = written("""
    /**: {ros__parameters: {max_beams: 30, nothing: 1}}
    controller_server:
      ros__parameters:
        goal_checker_plugins: [precise, rough]
        rough: {xy_goal_tolerance: 0.5}
        precise: {xy_goal_tolerance: 0.1}
    local_costmap: {ros__parameters: {robot_radius: 0.2, footprint: "[[0.3, 0.4], [-0.1, 0.0]]"}}
    """)
    figures = load_parameters(path)
    assert figures.warnings == (
        f"{path}: no effect here: controller_server: rough.xy_goal_tolerance; local_costmap: robot_radius; "
        "**: nothing",
    )
    tiago = BaseInfo(-0.2, 1.0, 2.09, 1.0, 2.09, 0.25, 0.27)
    resolved = figures.for_robot(tiago)
    assert (resolved.local_costmap.robot_radius, resolved.global_costmap.robot_radius) == (0.5, 0.3)


def test_the_error_codes_are_nav2s() -> None:
    assert (Nav2ErrorCode.GOAL_OCCUPIED, Nav2ErrorCode.NO_VALID_PATH) == (206, 208)
    assert (Nav2ErrorCode.FAILED_TO_MAKE_PROGRESS, Nav2ErrorCode.NO_VALID_CONTROL) == (105, 106)
    assert (Nav2ErrorCode.SPIN_COLLISION_AHEAD, Nav2ErrorCode.BACKUP_COLLISION_AHEAD) == (703, 714)
    assert {100, 104, 105, 106} == CONTROLLER_RECOVERY_HELPS
    assert {200, 207, 208, 300, 307, 308} == PLANNER_RECOVERY_HELPS
