"""The extension of `btcore run` that provides navigation, mapping, and tracking and locating of objects."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from btcore.escaping import escape_controls
from btcore.run_extension import RunExtension
from btcore_navigation.leaves.explore import Explorer, MapFile
from btcore_navigation.leaves.navigate import PoseNavigator
from btcore_robot.leaves.lifecycle_leaves import HeadTrackerProtocol, ObjectLocatorProtocol
from btcore_robot.leaves.waypoint import GetWaypoint
from btcore_robot.robot import InitialPose, Robot, Waypoints

if TYPE_CHECKING:
    import numpy as np

    from btcore_navigation.mapping.exploration import Exploration
    from btcore_navigation.parameters import NavigationParameters
    from btcore_navigation.stack import Navigation
    from btcore_robot.control.head_tracker import HeadTracker
    from btcore_robot.occupancy_map import OccupancyMap
    from btcore_robot.perception.object_locator import ObjectLocator


class NavigationExtension(RunExtension):
    """Provides the navigation, exploration, head tracker and object locator that leaves require."""

    used_by = "leaf that navigates, makes a map, tracks or locates"
    options: Sequence[click.Option] = (
        click.Option(
            ["--map", "map_file"],
            type=click.Path(path_type=Path),
            metavar="FILE.yaml",
            help="Map to navigate on, as YAML of map_server, with waypoints in FILE.waypoints.yaml; by "
            "default drawn from the world's walls.",
        ),
        click.Option(
            ["--nav-params"],
            type=click.Path(path_type=Path),
            metavar="FILE.yaml",
            help="Parameters of the navigation, in Nav2's format.",
        ),
        click.Option(
            ["--save-map"],
            type=click.Path(dir_okay=False, path_type=Path),
            metavar="FILE.yaml",
            help="File for the map that a tree makes; written at the end of the run at the latest.",
        ),
    )

    single_run_options = ("save_map",)

    def __init__(self) -> None:
        self._navigation: Navigation | None = None
        self._exploration: Exploration | None = None
        self._file = MapFile()
        self._tracker: HeadTracker | None = None
        self._locator: ObjectLocator | None = None

    def takes_over(self, settings: Mapping[str, Any], wanted: Sequence[type]) -> Sequence[type]:
        """Return the type of waypoints if the map has some; see `RunExtension.takes_over`."""
        return (Waypoints,) if Waypoints in wanted and _find_waypoint_file(settings) is not None else ()

    def requires(self, wanted: Sequence[type]) -> Sequence[type]:
        """Return the types of the required resources.

        Leaves that navigate or explore require a robot, a map and, if it is available, the robot's initial
        pose. Leaves that only track require a robot.
        Waypoints are those of the simulated world, if there is one.
        """
        navigates, explores, tracks = _required_features(wanted)
        places = (Waypoints,) if Waypoints in wanted else ()
        if not (navigates or explores or tracks):
            return places
        if not (navigates or explores):
            return (Robot, *places)
        from btcore_robot.occupancy_map import OccupancyMap

        return (Robot, OccupancyMap, InitialPose, *places)

    def provide(
        self, settings: Mapping[str, Any], wanted: Sequence[type], provided: Sequence[object]
    ) -> Sequence[object]:
        """Create the waypoints, navigation, exploration, head tracker and object locator that leaves require.

        Raises:
            click.UsageError: The user's map, waypoints or parameters cannot be used.
        """
        created: list[object] = []
        if Waypoints in wanted and not any(isinstance(resource, Waypoints) for resource in provided):
            created.append(_load_map_waypoints(settings))
        navigates, explores, tracks = _required_features(wanted)
        robot = next((resource for resource in provided if isinstance(resource, Robot)), None)
        if robot is None or not (navigates or explores):
            _check_files(settings)
        if robot is None:
            return created
        if explores:
            self._file = MapFile(_check_folder(settings.get("save_map")))
            exploration = self._exploration = _create_exploration(robot, settings, provided)
            created += [exploration, exploration.servers, exploration.mapper, self._file]
        elif navigates:
            if settings.get("save_map") is not None:
                click.echo("warning: --save-map has no effect: the robot navigates on a known map", err=True)
            navigation = self._navigation = _create_navigation(robot, settings, (*provided, *created))
            created += [navigation, navigation.servers]
        if tracks:
            from btcore_robot.control.head_tracker import HeadTracker

            self._tracker = HeadTracker(robot)
            self._tracker.configure()
            created.append(self._tracker)
        if ObjectLocatorProtocol in wanted:
            # After the tracker: the locator satisfies its protocol too, and the first match is used.
            self._locator = _create_locator(robot, created)
            created.append(self._locator)
        return created

    @contextmanager
    def attach(
        self, tree: object, resources: Sequence[object], settings: Mapping[str, Any]
    ) -> Iterator[None]:
        """At the end of the run, stop tracker and locator, and save the map if the tree has not saved it."""
        _check_waypoints(getattr(tree, "nodes", ()), settings)
        try:
            yield
        finally:
            for component in (self._tracker, self._locator):
                if component is not None:
                    component.shutdown()
            if self._exploration is not None and self._file.path is not None and not self._file.saved:
                _save(self._exploration, self._file.path)

    def report(self) -> Mapping[str, object]:
        """Return `{"map": {"fit", "residual_m", "through_walls", "loops", "loop_error_m"}}` of a saved map.

        `MapQuality` documents the values. Without a saved map the report is empty.
        """
        quality = self._exploration.saved_quality if self._exploration is not None else None
        return {} if quality is None else {"map": asdict(quality)}


def _required_features(wanted: Sequence[type]) -> tuple[bool, bool, bool]:
    """Return whether leaves require navigation, exploration and tracking."""
    names = {f"{kind.__module__}.{kind.__qualname__}" for kind in wanted}
    explores = Explorer in wanted or bool(names & {_EXPLORATION, _MAPPER})
    navigates = PoseNavigator in wanted or bool(names & {_NAVIGATION, _SERVERS, _NAVIGATION_SERVERS})
    # Locating objects in the map needs the robot's pose on it.
    navigates = navigates or (ObjectLocatorProtocol in wanted and not explores)
    return navigates, explores, HeadTrackerProtocol in wanted or _TRACKER in names


# Class names as strings: these modules need libraries that a tree without navigation must not import.
_NAVIGATION = "btcore_navigation.stack.Navigation"
_SERVERS = "btcore_navigation.servers.Servers"
_NAVIGATION_SERVERS = "btcore_navigation.navigation_servers.NavigationServers"
_EXPLORATION = "btcore_navigation.mapping.exploration.Exploration"
_MAPPER = "btcore_navigation.mapping.mapper.Mapper"
_TRACKER = "btcore_robot.control.head_tracker.HeadTracker"


def _create_locator(robot: Robot, created: Sequence[object]) -> "ObjectLocator":
    from btcore_navigation.servers import Servers
    from btcore_robot.perception.object_locator import ObjectLocator

    servers = next(resource for resource in created if isinstance(resource, Servers))
    locator = ObjectLocator(robot, servers.transforms)
    locator.configure()
    return locator


def _create_navigation(robot: Robot, settings: Mapping[str, Any], provided: Sequence[object]) -> "Navigation":
    from btcore.bundled_trees import folder
    from btcore_navigation.stack import Navigation

    map, parameters = _load_map(settings, provided), _load_parameters(settings)
    waypoints = next((resource for resource in provided if isinstance(resource, Waypoints)), None)
    if map is None:
        raise click.UsageError("there is no map to navigate on: use --map FILE.yaml")
    for cells, missing in ((map.free, "free floor"), (map.occupied, "wall")):
        if not cells.any():
            raise click.UsageError(f"there is no {missing} on the map, so navigation is not possible")
    parameters = _add_initial_pose(parameters, settings, provided)
    with _report_plugin_errors(settings):
        return Navigation(robot, map, _create_random_generator(settings), folder(), parameters, waypoints)


def _create_exploration(
    robot: Robot, settings: Mapping[str, Any], provided: Sequence[object]
) -> "Exploration":
    from btcore.bundled_trees import folder
    from btcore_navigation.mapping.exploration import Exploration

    # Only the keep-out areas of an existing map are used: table tops, which the laser cannot detect.
    map, parameters = _load_map(settings, provided), _load_parameters(settings)
    keepout = map.keepout if map is not None else ()
    parameters = _add_initial_pose(parameters, settings, provided)
    with _report_plugin_errors(settings):
        return Exploration(robot, _create_random_generator(settings), folder(), parameters, keepout)


@contextmanager
def _report_plugin_errors(settings: Mapping[str, Any]) -> Iterator[None]:
    """Raise a usage error if a node library that the parameters name cannot be loaded."""
    from btcore import RegistrationError

    try:
        yield
    except RegistrationError as error:
        raise click.UsageError(f"--nav-params {settings.get('nav_params')}: {error}") from error


def _check_files(settings: Mapping[str, Any]) -> None:
    """Check the map and the parameters that this run does not use."""
    if settings.get("map_file") is not None:
        _load_map(settings, ())
    if settings.get("nav_params") is not None:
        _load_parameters(settings)


def _load_map(settings: Mapping[str, Any], provided: Sequence[object]) -> "OccupancyMap | None":
    """Return the map of `--map`; without the option, the world's map, or None."""
    from btcore_robot.occupancy_map import MapError, OccupancyMap, load_map

    file = settings.get("map_file")
    try:
        if file is not None:
            return load_map(file)
    except MapError as error:
        raise click.UsageError(str(error)) from error
    return next((resource for resource in provided if isinstance(resource, OccupancyMap)), None)


def _load_parameters(settings: Mapping[str, Any]) -> "NavigationParameters | None":
    from btcore_navigation.parameters import load_parameters
    from btcore_robot.parameter_files import ParameterError

    file = settings.get("nav_params")
    if file is None:
        return None
    try:
        parameters = load_parameters(file)
    except ParameterError as error:
        raise click.UsageError(str(error)) from error
    from btcore.bundled_trees import folder
    from btcore_navigation.stack import missing_trees

    missing = [f"{file}: {tree}" for tree in missing_trees(parameters.navigator, folder())]
    for warning in (*parameters.warnings, *missing):
        click.echo(f"warning: {escape_controls(warning)}", err=True)
    return parameters


def _add_initial_pose(
    parameters: "NavigationParameters | None", settings: Mapping[str, Any], provided: Sequence[object]
) -> "NavigationParameters | None":
    """Return *parameters* with the initial pose among *provided*, unless the user's file has another pose.

    If the initial pose is known to be unknown, the file has no effect on it.
    """
    from btcore_navigation.parameters import NavigationParameters

    initial = next((resource for resource in provided if isinstance(resource, InitialPose)), None)
    if initial is None or (initial.pose is not None and _has_initial_pose(settings.get("nav_params"))):
        return parameters
    parameters = parameters or NavigationParameters()
    if initial.pose is None:
        amcl = replace(parameters.amcl, set_initial_pose=False)
    else:
        x, y, yaw = initial.pose.x, initial.pose.y, initial.pose.yaw
        amcl = replace(parameters.amcl, initial_pose_x=x, initial_pose_y=y, initial_pose_yaw=yaw)
    return replace(parameters, amcl=amcl)


def _has_initial_pose(file: Path | None) -> bool:
    """Return whether the parameters in *file* determine the initial pose of the localiser."""
    if file is None:
        return False
    from btcore_robot.parameter_files import EVERY_SERVER, read_settings

    servers = read_settings(file)
    names = {*servers.get("amcl", ()), *servers.get(EVERY_SERVER, ())}
    return any(name.startswith("initial_pose") for name in names)


def _create_random_generator(settings: Mapping[str, Any]) -> "np.random.Generator":
    import numpy as np

    return np.random.default_rng([settings.get("seed", 0), 4])


def _find_waypoint_file(settings: Mapping[str, Any]) -> Path | None:
    """Return the file with the waypoints of the user's map, or None if there is no such file."""
    if settings.get("map_file") is None:
        return None
    from btcore_robot.waypoint_file import waypoints_path

    path = waypoints_path(settings["map_file"])
    return path if path.exists() else None


def _load_map_waypoints(settings: Mapping[str, Any]) -> Waypoints:
    """Return the waypoints of the user's map; without any, the run ends with an error before it begins."""
    path = _find_waypoint_file(settings)
    if path is None:
        return Waypoints({}, source="the robot's map")
    from btcore_robot.occupancy_map import MapError
    from btcore_robot.waypoint_file import load_waypoints

    try:
        return load_waypoints(path)
    except MapError as error:
        raise click.UsageError(str(error)) from error


def _check_waypoints(nodes: Sequence[object], settings: Mapping[str, Any]) -> None:
    """Raise click.UsageError before the run if a leaf needs a waypoint that does not exist."""
    for node in nodes:
        missing = node.missing_waypoint() if isinstance(node, GetWaypoint) else None
        if isinstance(node, GetWaypoint) and missing is not None:
            needed = f"waypoint '{missing}', but {node.config.path} needs it"
            if not node.waypoints.places:
                needed = f"waypoints, but {node.config.path} needs them"
            remedy = _create_waypoint_remedy(missing, settings)
            raise click.UsageError(f"{node.waypoints.source} has no {needed}; {remedy}")


def _create_waypoint_remedy(missing: str, settings: Mapping[str, Any]) -> str:
    """Return a sentence about how to add the waypoint *missing*."""
    if _find_waypoint_file(settings) is not None:
        return f"add '{missing}: [x, y, yaw]' to the file, in m and rad on the map"
    example = "'waypoints: {recharge: [3.7, -0.2, 0.0], wp1: [1.1, -12.4, 1.57]}', in m and rad on the map"
    if settings.get("map_file") is None:
        return (
            "the houses have some: --world house; for a robot, name its map with --map FILE.yaml, and write "
            f"the waypoints to FILE.waypoints.yaml: {example}"
        )
    from btcore_robot.waypoint_file import waypoints_path

    return f"write them to the file {waypoints_path(settings['map_file'])}: {example}"


def _check_folder(path: Path | None) -> Path | None:
    """Return *path* if its folder exists, so that a long exploration does not end without its map."""
    if path is not None and not path.resolve().parent.is_dir():
        raise click.UsageError(f"--save-map {path}: there is no folder {path.resolve().parent}")
    return path


def _save(exploration: "Exploration", path: Path) -> None:
    from btcore_robot.occupancy_map import MapError

    try:
        exploration.save(path)
    except MapError as error:
        click.echo(f"warning: {escape_controls(str(error))}", err=True)
