"""Navigation in a run: maps and waypoints, navigation, exploration, and tracking and locating of objects."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

from btcore import Report, RunSettings, Settings, option, provider
from btcore.errors import SettingsError

if TYPE_CHECKING:
    import numpy as np

    import btcore_navigation.leaves.explore
    import btcore_navigation.mapping.exploration
    import btcore_navigation.mapping.mapper
    import btcore_navigation.parameters
    import btcore_navigation.servers
    import btcore_navigation.stack
    import btcore_robot.control.head_tracker
    import btcore_robot.occupancy_map
    import btcore_robot.perception.object_locator
    import btcore_robot.robot

_EXAMPLE: Final = (
    "'waypoints: {recharge: [3.7, -0.2, 0.0], wp1: [1.1, -12.4, 1.57]}', in m and rad on the map"
)


class MapSettings(Settings):
    """The settings of a known map."""

    map: Annotated[
        Path,
        option(
            "Map to navigate on, as YAML of map_server, with waypoints in FILE.waypoints.yaml; by default "
            "drawn from the world's walls.",
            metavar="FILE.yaml",
        ),
    ]


class NavigationSettings(Settings):
    """The settings of navigation and exploration."""

    nav_params: (
        Annotated[Path, option("Parameters of the navigation, in Nav2's format.", metavar="FILE.yaml")] | None
    ) = None


class ExplorationSettings(Settings):
    """The settings of exploration."""

    save_map: (
        Annotated[
            Path,
            option(
                "File for the map that a tree makes; written at the end of the run at the latest.",
                metavar="FILE.yaml",
                one_run_only=True,
            ),
        ]
        | None
    ) = None

    def __post_init__(self) -> None:
        # Checked before the run, so that a long exploration does not end without its map.
        if self.save_map is not None and not self.save_map.resolve().parent.is_dir():
            raise SettingsError(
                f"--save-map {self.save_map}: there is no folder {self.save_map.resolve().parent}"
            )


@provider
def map_file(settings: MapSettings) -> "btcore_robot.occupancy_map.OccupancyMap":
    """Return the map of `--map`.

    Raises:
        MapError: The map cannot be read.
    """
    from btcore_robot.occupancy_map import load_map

    return load_map(settings.map)


@provider
def waypoints(
    settings: MapSettings | None, places: "btcore_robot.robot.WorldPlaces | None"
) -> "btcore_robot.robot.Waypoints":
    """Return the waypoints in the file beside the map; without such a file, those of the world.

    Raises:
        MapError: The file cannot be read.
    """
    from btcore_robot.robot import Waypoints
    from btcore_robot.waypoint_file import load_waypoints, waypoints_path

    found = Waypoints({}, source="the robot's map") if places is None else places.waypoints
    if settings is None:
        remedy = (
            "the houses have some: --world house; for a robot, name its map with --map FILE.yaml, and write "
            f"the waypoints to FILE.waypoints.yaml: {_EXAMPLE}"
        )
        return replace(found, remedy=remedy)
    file = waypoints_path(settings.map)
    if not file.exists():
        return replace(found, remedy=f"write them to the file {file}: {_EXAMPLE}")
    return replace(
        load_waypoints(file), remedy="add '{name}: [x, y, yaw]' to the file, in m and rad on the map"
    )


@provider
def navigation(
    robot: "btcore_robot.robot.Robot",
    map: "btcore_robot.occupancy_map.OccupancyMap | None",
    waypoints: "btcore_robot.robot.Waypoints | None",
    places: "btcore_robot.robot.WorldPlaces | None",
    settings: NavigationSettings,
    run_settings: RunSettings,
    report: Report,
) -> "tuple[btcore_navigation.stack.Navigation, btcore_navigation.servers.Servers]":
    """Return the navigation of the robot on the map, and its servers.

    Args:
        map: The map; None is an error.
        waypoints: The places that messages name.
        places: The start pose of the robot, unless the parameters contain another pose.
        run_settings: The settings of the run.
        report: Gets warnings about the parameters.

    Raises:
        SettingsError: The map cannot be used.
        ParameterError: The parameters cannot be used.
    """
    from btcore.bundled_trees import folder
    from btcore_navigation.stack import Navigation

    if map is None:
        raise SettingsError("there is no map to navigate on: use --map FILE.yaml")
    for cells, missing in ((map.free, "free floor"), (map.occupied, "wall")):
        if not cells.any():
            raise SettingsError(f"there is no {missing} on the map, so navigation is not possible")
    parameters = _load_parameters(settings.nav_params, places, report)
    with _report_plugin_errors(settings):
        navigation = Navigation(robot, map, _random(run_settings), folder(), parameters, waypoints)
    return navigation, navigation.servers


# Navigation and exploration provide further objects, also if leaves navigate by Nav2. Therefore what leaves
# navigate by is provided separately.


@provider(provides=("btcore_navigation.leaves.navigate.PoseNavigator",))
def navigator(navigation: "btcore_navigation.stack.Navigation") -> object:
    """Return the navigation or the exploration, for leaves that navigate on a map."""
    return navigation


@provider(provides=("btcore_navigation.navigation_servers.NavigationServers",))
def navigation_servers(servers: "btcore_navigation.servers.Servers") -> object:
    """Return the servers of the navigation or the exploration, for Nav2's tree nodes."""
    return servers


@provider(
    provides=("btcore_navigation.leaves.explore.Explorer", "btcore_navigation.stack.Navigation"), default=True
)
def exploration(
    robot: "btcore_robot.robot.Robot",
    map: "btcore_robot.occupancy_map.OccupancyMap | None",
    places: "btcore_robot.robot.WorldPlaces | None",
    settings: NavigationSettings,
    own: ExplorationSettings,
    run_settings: RunSettings,
    report: Report,
) -> (
    "Iterator[tuple[btcore_navigation.mapping.exploration.Exploration, btcore_navigation.servers.Servers, "
    "btcore_navigation.mapping.mapper.Mapper, btcore_navigation.leaves.explore.MapFile]]"
):
    """Provide a navigation that makes a map; at the end, save the map if the tree has not saved it.

    The report of a saved map is `{"map": {"fit", "residual_m", "through_walls", "loops", "loop_error_m"}}`;
    `MapQuality` documents the values.

    Args:
        map: A map whose keep-out areas are used: table tops, which the laser cannot detect.
        places: The start pose of the robot, unless the parameters contain another pose.
        report: Gets the quality of the saved map.

    Raises:
        ParameterError: The parameters cannot be used.
    """
    from btcore.bundled_trees import folder
    from btcore_navigation.leaves.explore import MapFile
    from btcore_navigation.mapping.exploration import Exploration

    keepout = () if map is None else map.keepout
    parameters = _load_parameters(settings.nav_params, places, report)
    with _report_plugin_errors(settings):
        exploration = Exploration(robot, _random(run_settings), folder(), parameters, keepout)
    file = MapFile(own.save_map)
    try:
        yield exploration, exploration.servers, exploration.mapper, file
    finally:
        if file.path is not None and not file.saved:
            _save(exploration, file.path, report)
        if exploration.saved_quality is not None:
            report.add("map", asdict(exploration.saved_quality))


@provider(provides=("btcore_robot.leaves.lifecycle_leaves.HeadTrackerProtocol",))
def head_tracker(
    robot: "btcore_robot.robot.Robot",
) -> "Iterator[btcore_robot.control.head_tracker.HeadTracker]":
    """Provide the head tracker, inactive; stop it at the end."""
    from btcore_robot.control.head_tracker import HeadTracker

    tracker = HeadTracker(robot)
    tracker.configure()
    try:
        yield tracker
    finally:
        tracker.shutdown()


@provider(provides=("btcore_robot.leaves.lifecycle_leaves.ObjectLocatorProtocol",))
def object_locator(
    robot: "btcore_robot.robot.Robot", servers: "btcore_navigation.servers.Servers"
) -> "Iterator[btcore_robot.perception.object_locator.ObjectLocator]":
    """Provide the object locator, inactive; stop it at the end.

    Args:
        servers: The servers of the navigation, which knows the robot's pose on the map.
    """
    from btcore_robot.perception.object_locator import ObjectLocator

    locator = ObjectLocator(robot, servers.transforms)
    locator.configure()
    try:
        yield locator
    finally:
        locator.shutdown()


@contextmanager
def _report_plugin_errors(settings: NavigationSettings) -> Iterator[None]:
    """Raise a SettingsError if a node library that the parameters name cannot be loaded."""
    from btcore import RegistrationError

    try:
        yield
    except RegistrationError as error:
        raise SettingsError(f"--nav-params {settings.nav_params}: {error}") from error


def _load_parameters(
    file: Path | None, places: "btcore_robot.robot.WorldPlaces | None", report: Report
) -> "btcore_navigation.parameters.NavigationParameters | None":
    """Return the parameters in *file* with the start pose in *places*, unless the file has another pose.

    If the start pose is known to be unknown, the file has no effect on it.
    """
    from btcore.bundled_trees import folder
    from btcore_navigation.parameters import NavigationParameters, load_parameters
    from btcore_navigation.stack import missing_trees

    parameters = None
    if file is not None:
        parameters = load_parameters(file)
        missing = [f"{file}: {tree}" for tree in missing_trees(parameters.navigator, folder())]
        for warning in (*parameters.warnings, *missing):
            report.warn(warning)
    start = None if places is None else places.start
    if places is None or (start is not None and _has_initial_pose(file)):
        return parameters
    parameters = parameters or NavigationParameters()
    if start is None:
        amcl = replace(parameters.amcl, set_initial_pose=False)
    else:
        amcl = replace(
            parameters.amcl, initial_pose_x=start.x, initial_pose_y=start.y, initial_pose_yaw=start.yaw
        )
    return replace(parameters, amcl=amcl)


def _has_initial_pose(file: Path | None) -> bool:
    """Return whether the parameters in *file* determine the initial pose of the localiser."""
    if file is None:
        return False
    from btcore_robot.parameter_files import EVERY_SERVER, read_settings

    servers = read_settings(file)
    names = {*servers.get("amcl", ()), *servers.get(EVERY_SERVER, ())}
    return any(name.startswith("initial_pose") for name in names)


def _random(run_settings: RunSettings) -> "np.random.Generator":
    import numpy as np

    return np.random.default_rng([run_settings.seed, 4])


def _save(
    exploration: "btcore_navigation.mapping.exploration.Exploration", path: Path, report: Report
) -> None:
    from btcore_robot.occupancy_map import MapError

    try:
        exploration.save(path)
    except MapError as error:
        report.warn(str(error))
