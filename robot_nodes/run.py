"""Navigation and the head tracker for ``btcore run``: their options, and what they offer to leaves."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from robot_nodes.leaves.navigate import GoesToPoses
from robot_nodes.leaves.track import TracksObjects
from robot_nodes.robot import Robot

if TYPE_CHECKING:
    from robot_nodes.control.head_tracker import HeadTracker
    from robot_nodes.navigation.stack import Navigation


class NavigationMistake(click.ClickException):
    """A mistake in what was asked of the navigation."""

    exit_code = 2


class NavigationExtension:
    """Offers navigation on the robot's map, and a head tracker, to trees whose leaves ask for them."""

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
    )

    def __init__(self) -> None:
        self._navigation: Navigation | None = None
        self._tracker: HeadTracker | None = None

    def requires(self, wanted: Sequence[type]) -> Sequence[type]:
        """A robot, and its map, where leaves want to navigate or to track."""
        navigates, tracks = _asked(wanted)
        if not (navigates or tracks):
            return ()
        if not navigates:
            return (Robot,)
        from robot_nodes.navigation.map import OccupancyMap

        return (Robot, OccupancyMap)

    def provide(
        self, settings: Mapping[str, Any], wanted: Sequence[type], provided: Sequence[object]
    ) -> Sequence[object]:
        """What leaves want of it; a user's mistake is a `NavigationMistake`."""
        navigates, tracks = _asked(wanted)
        robot = next((one for one in provided if isinstance(one, Robot)), None)
        if robot is None:
            return ()
        given: list[object] = []
        if navigates:
            navigation = self._navigation = _navigation(robot, settings, provided)
            given += [navigation, navigation.servers]
        if tracks:
            from robot_nodes.control.head_tracker import HeadTracker

            self._tracker = HeadTracker(robot)
            self._tracker.configure()
            given.append(self._tracker)
        return given

    @contextmanager
    def attach(
        self, tree: object, resources: Sequence[object], settings: Mapping[str, Any]
    ) -> Iterator[None]:
        """Stop what still tracks when the run ends."""
        try:
            yield
        finally:
            if self._tracker is not None:
                self._tracker.shutdown()

    def report(self) -> dict[str, object]:
        """Nothing: who judges a run knows more than the robot does."""
        return {}


def _asked(wanted: Sequence[type]) -> tuple[bool, bool]:
    """Whether leaves want to navigate, and whether they want to track."""
    names = {f"{kind.__module__}.{kind.__qualname__}" for kind in wanted}
    navigates = GoesToPoses in wanted or bool(names & {_NAVIGATION, _SERVERS})
    return navigates, TracksObjects in wanted or _TRACKER in names


# By name: these modules need libraries that a tree without navigation must not load.
_NAVIGATION = "robot_nodes.navigation.stack.Navigation"
_SERVERS = "robot_nodes.navigation.servers.Servers"
_TRACKER = "robot_nodes.control.head_tracker.HeadTracker"


def _navigation(robot: Robot, settings: Mapping[str, Any], provided: Sequence[object]) -> "Navigation":
    import numpy as np

    from btcore.cli.trees import folder
    from robot_nodes.navigation.map import MapError, OccupancyMap, load_map
    from robot_nodes.navigation.parameters import ParameterFault, load_parameters
    from robot_nodes.navigation.stack import Navigation

    file, figures = settings.get("map_file"), settings.get("nav_params")
    try:
        map = (
            load_map(file)
            if file is not None
            else next((one for one in provided if isinstance(one, OccupancyMap)), None)
        )
        parameters = load_parameters(figures) if figures is not None else None
    except (MapError, ParameterFault) as fault:
        raise NavigationMistake(str(fault)) from fault
    if map is None:
        raise NavigationMistake("there is no map to navigate on: --map FILE.yaml names one")
    for warning in parameters.warnings if parameters is not None else ():
        click.echo(f"warning: {warning}", err=True)
    random = np.random.default_rng([settings.get("seed", 0), 4])
    return Navigation(robot, map, random, folder(), parameters)
