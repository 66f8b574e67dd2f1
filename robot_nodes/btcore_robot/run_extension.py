"""Navigation, mapping and the head tracker for ``btcore run``: options, and what they offer to leaves."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from btcore.run_extension import RunExtension
from btcore_robot.leaves.explore import Explorer, MapFile
from btcore_robot.leaves.locate import ObjectLocatorProtocol
from btcore_robot.leaves.navigate import PoseNavigator
from btcore_robot.leaves.track import HeadTrackerProtocol
from btcore_robot.leaves.waypoint import GetWaypoint
from btcore_robot.robot import Robot

if TYPE_CHECKING:
    import numpy as np

    from btcore_robot.control.head_tracker import HeadTracker
    from btcore_robot.navigation.mapping.exploration import Exploration
    from btcore_robot.navigation.occupancy_map import OccupancyMap
    from btcore_robot.navigation.parameters import NavigationParameters
    from btcore_robot.navigation.stack import Navigation
    from btcore_robot.perception.object_locator import ObjectLocator


class NavigationExtension(RunExtension):
    """Offers navigation on the robot's map, or while one is made, and a head tracker, to trees that ask."""

    used_by = "leaf that navigates, makes a map, tracks or locates"
    options: Sequence[click.Option] = (
        click.Option(
            ["--map", "map_file"],
            type=click.Path(path_type=Path),
            metavar="FILE.yaml",
            help="The map to navigate on, as map_server has them; else one drawn from the world's walls.",
        ),
        click.Option(
            ["--nav-params"],
            type=click.Path(path_type=Path),
            metavar="FILE.yaml",
            help="Parameters of the navigation, in Nav2's form.",
        ),
        click.Option(
            ["--save-map"],
            type=click.Path(dir_okay=False, path_type=Path),
            metavar="FILE.yaml",
            help="Where a tree that makes a map saves it, at the latest when the run ends.",
        ),
    )

    single_run_options = ("save_map",)

    def __init__(self) -> None:
        self._navigation: Navigation | None = None
        self._exploration: Exploration | None = None
        self._file = MapFile()
        self._tracker: HeadTracker | None = None
        self._locator: ObjectLocator | None = None

    def requires(self, wanted: Sequence[type]) -> Sequence[type]:
        """A robot, and its map, where leaves want to navigate or to track."""
        navigates, explores, tracks = _asked(wanted)
        if not (navigates or explores or tracks):
            return ()
        if not (navigates or explores):
            return (Robot,)
        from btcore_robot.navigation.occupancy_map import OccupancyMap

        return (Robot, OccupancyMap)

    def provide(
        self, settings: Mapping[str, Any], wanted: Sequence[type], provided: Sequence[object]
    ) -> Sequence[object]:
        """What leaves want of it; a user's mistake is a `click.UsageError`."""
        navigates, explores, tracks = _asked(wanted)
        robot = next((one for one in provided if isinstance(one, Robot)), None)
        if robot is None:
            return ()
        given: list[object] = []
        if explores:
            self._file = MapFile(_writable(settings.get("save_map")))
            exploration = self._exploration = _exploration(robot, settings, provided)
            given += [exploration, exploration.servers, exploration.mapper, self._file]
        elif navigates:
            navigation = self._navigation = _navigation(robot, settings, provided)
            given += [navigation, navigation.servers]
        if tracks:
            from btcore_robot.control.head_tracker import HeadTracker

            self._tracker = HeadTracker(robot)
            self._tracker.configure()
            given.append(self._tracker)
        if ObjectLocatorProtocol in wanted:
            # After the tracker: whoever asks for one takes the first that has its states, and this has them.
            self._locator = _locator(robot, given)
            given.append(self._locator)
        return given

    @contextmanager
    def attach(
        self, tree: object, resources: Sequence[object], settings: Mapping[str, Any]
    ) -> Iterator[None]:
        """When the run ends, stop what still looks, and save the map that was made if the tree hasn't."""
        _check_waypoints(getattr(tree, "nodes", ()))
        try:
            yield
        finally:
            for component in (self._tracker, self._locator):
                if component is not None:
                    component.shutdown()
            if self._exploration is not None and self._file.path is not None and not self._file.saved:
                _save(self._exploration, self._file.path)


def _asked(wanted: Sequence[type]) -> tuple[bool, bool, bool]:
    """Whether leaves want to navigate, to explore, and to track."""
    names = {f"{kind.__module__}.{kind.__qualname__}" for kind in wanted}
    explores = Explorer in wanted or bool(names & {_EXPLORATION, _MAPPER})
    navigates = PoseNavigator in wanted or bool(names & {_NAVIGATION, _SERVERS})
    # Who tells where things are in the map has to know where the robot is.
    navigates = navigates or (ObjectLocatorProtocol in wanted and not explores)
    return navigates, explores, HeadTrackerProtocol in wanted or _TRACKER in names


# By name: these modules need libraries that a tree without navigation must not load.
_NAVIGATION = "btcore_robot.navigation.stack.Navigation"
_SERVERS = "btcore_robot.navigation.servers.Servers"
_EXPLORATION = "btcore_robot.navigation.mapping.exploration.Exploration"
_MAPPER = "btcore_robot.navigation.mapping.mapper.Mapper"
_TRACKER = "btcore_robot.control.head_tracker.HeadTracker"


def _locator(robot: Robot, given: Sequence[object]) -> "ObjectLocator":
    from btcore_robot.navigation.servers import Servers
    from btcore_robot.perception.object_locator import ObjectLocator

    servers = next(one for one in given if isinstance(one, Servers))
    locator = ObjectLocator(robot, servers.transforms)
    locator.configure()
    return locator


def _navigation(robot: Robot, settings: Mapping[str, Any], provided: Sequence[object]) -> "Navigation":
    from btcore.bundled_trees import folder
    from btcore_robot.navigation.stack import Navigation

    map, parameters = _map(settings, provided), _parameters(settings)
    if map is None:
        raise click.UsageError("there is no map to navigate on: --map FILE.yaml names one")
    for cells, missing in ((map.free, "free floor"), (map.occupied, "wall")):
        if not cells.any():
            raise click.UsageError(f"there is no {missing} on the map, so nobody can find a way by it")
    with _plugins_minded(settings):
        return Navigation(robot, map, _random(settings), folder(), parameters)


def _exploration(robot: Robot, settings: Mapping[str, Any], provided: Sequence[object]) -> "Exploration":
    from btcore.bundled_trees import folder
    from btcore_robot.navigation.mapping.exploration import Exploration

    # Of a map that there is already only the keep-outs count: table tops, which no laser at the floor sees.
    map, parameters = _map(settings, provided), _parameters(settings)
    keepout = map.keepout if map is not None else ()
    with _plugins_minded(settings):
        return Exploration(robot, _random(settings), folder(), parameters, keepout)


@contextmanager
def _plugins_minded(settings: Mapping[str, Any]) -> Iterator[None]:
    """Tell of a node library that the parameters name and that is no good as the user's mistake."""
    from btcore import RegistrationError

    try:
        yield
    except RegistrationError as fault:
        raise click.UsageError(f"--nav-params {settings.get('nav_params')}: {fault}") from fault


def _map(settings: Mapping[str, Any], provided: Sequence[object]) -> "OccupancyMap | None":
    """The map that the user names, or else that the world brings."""
    from btcore_robot.navigation.occupancy_map import MapError, OccupancyMap, load_map

    file = settings.get("map_file")
    try:
        if file is not None:
            return load_map(file)
    except MapError as fault:
        raise click.UsageError(str(fault)) from fault
    return next((one for one in provided if isinstance(one, OccupancyMap)), None)


def _parameters(settings: Mapping[str, Any]) -> "NavigationParameters | None":
    from btcore_robot.navigation.parameters import ParameterError, load_parameters

    file = settings.get("nav_params")
    if file is None:
        return None
    try:
        parameters = load_parameters(file)
    except ParameterError as fault:
        raise click.UsageError(str(fault)) from fault
    from btcore.bundled_trees import folder
    from btcore_robot.navigation.stack import missing_trees

    missing = [f"{file}: {one}" for one in missing_trees(parameters.navigator, folder())]
    for warning in (*parameters.warnings, *missing):
        click.echo(f"warning: {warning}", err=True)
    return parameters


def _random(settings: Mapping[str, Any]) -> "np.random.Generator":
    import numpy as np

    return np.random.default_rng([settings.get("seed", 0), 4])


def _check_waypoints(nodes: Sequence[object]) -> None:
    """Say before the run that it has nowhere to go, and not in the middle of it."""
    for node in nodes:
        if isinstance(node, GetWaypoint) and not node.places:
            raise click.UsageError(
                f"this world has no waypoints, and {node.path} sends the robot to one; "
                "the houses have some: --world house"
            )


def _writable(path: Path | None) -> Path | None:
    """*path*, if its folder is there: nobody drives for a quarter of an hour to be told that it isn't."""
    if path is not None and not path.resolve().parent.is_dir():
        raise click.UsageError(f"--save-map {path}: there is no folder {path.resolve().parent}")
    return path


def _save(exploration: "Exploration", path: Path) -> None:
    from btcore_robot.navigation.occupancy_map import MapError

    try:
        exploration.save(path)
    except MapError as fault:
        click.echo(f"warning: {fault}", err=True)
