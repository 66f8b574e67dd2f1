"""The simulator's part of `btcore run`: options, the robot that leaves use, and the report."""

import math
import re
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from btcore_robot.robot import BaseInfo, InitialPose, Robot, Waypoints
from btcore_sim.completion import complete_world
from btcore_sim.errors import SimError

if TYPE_CHECKING:
    from btcore_sim.events import EventRunner
    from btcore_sim.run_metrics import RunMetrics
    from btcore_sim.simulated_robot import SimulatedRobot
    from btcore_sim.world_description import WorldDescription


def _create_option(name: str, metavar: str, help: str, **settings: Any) -> click.Option:
    """Return the option `--NAME`, whose help shows the default if *settings* have one."""
    has_default = "default" in settings
    return click.Option([f"--{name}"], metavar=metavar, help=help, show_default=has_default, **settings)


_WORLD = "arena"
"""The default of `--world`."""

UNKNOWN_START = "unknown"
"""The value of `--start` for a random start pose of which the navigation is not informed."""


_RANGE = re.compile(r"([a-z]+):(\d{1,9})-(\d{1,9})")
_MOST_WORLDS = 10_000


def parse_worlds(text: str | None) -> list[str] | None:
    """Return the worlds in the value of `--worlds`, with all worlds of a range.

    Args:
        text: The names, separated by commas; a range of seeds is written as `office:1-30`.

    Raises:
        click.UsageError: A range is invalid, or a world is listed twice.

    Examples:
        >>> from btcore_sim.run_extension import parse_worlds
        >>> parse_worlds("house,office:1-3")
        ['house', 'office:1', 'office:2', 'office:3']
    """
    if text is None:
        return None
    worlds: list[str] = []
    for part in text.split(","):
        match = _RANGE.fullmatch(part.strip())
        if match is None:
            worlds.append(part.strip())
            continue
        first, last = int(match[2]), int(match[3])
        if not 0 <= last - first < _MOST_WORLDS:
            raise click.UsageError(
                f"--worlds {text}: {part.strip()} has to ascend, with at most {_MOST_WORLDS} worlds."
            )
        worlds += [f"{match[1]}:{number}" for number in range(first, last + 1)]
    if len(set(worlds)) < len(worlds):
        raise click.UsageError(f"--worlds {text}: a world is listed more than once.")
    return worlds


_COUNT = {"type": click.IntRange(min=0), "default": 0}


class SimExtension:
    """Provides a `Robot` in a simulated world to trees that need a robot. Other trees start no simulator.

    The class has all methods of `btcore.run_extension.RunExtension`. It does not inherit from that class,
    because the simulator does not import btcore.
    """

    used_by: str | None = "leaf that needs a robot"
    is_fallback: bool = True
    options: Sequence[click.Option] = (
        _create_option(
            "world",
            "NAME",
            "The robot's world: a name, a JSON file, a map (YAML), or office:N or home:N for a random world.",
            default=_WORLD,
            shell_complete=complete_world,
        ),
        _create_option(
            "waypoints",
            "FILE.yaml",
            "Waypoints to use instead of the world's own.",
            type=click.Path(path_type=Path),
        ),
        click.Option(["--gui"], is_flag=True, help="Open the physics engine's window."),
        _create_option(
            "robot",
            "FILE.json",
            "Description of a robot to use instead of the Tiago.",
            type=click.Path(path_type=Path),
        ),
        _create_option(
            "camera",
            "off|WxH@HZ",
            "Size and rate of the camera's pictures, which are rendered only when a leaf requests them.",
            default="320x240@10",
        ),
        _create_option(
            "start",
            "random|unknown|X,Y,YAW",
            "Start pose (m, degrees), or a random free place; unknown: the navigation has to find the place "
            "itself.  [default: the world's own rule]",
        ),
        _create_option(
            "noise",
            "FACTOR",
            "Factor of the errors and latencies of the sensors: 0 removes them, 2 doubles them.",
            type=click.FloatRange(0.0),
            default=1.0,
        ),
        _create_option(
            "battery",
            "PERCENT",
            "Level of the robot's battery at the start.",
            type=click.FloatRange(0.0, 100.0),
            default=100.0,
        ),
        _create_option(
            "fault",
            "PART:START-END",
            "Let laser, odometry, camera or wheel fail from START to END (s); repeatable.",
            multiple=True,
        ),
        _create_option(
            "people",
            "N",
            "Number of people who walk in the world; they stop in front of the robot.",
            **_COUNT,
        ),
        _create_option(
            "obstacles", "N", "Number of boxes at random places that are not on the map.", **_COUNT
        ),
        _create_option(
            "event",
            "KIND:TIME",
            "At 30 s, box:30 drops a box ahead, or box:30@2,0.3 at 2 m ahead and 0.3 m to the left; "
            "kidnap:30 moves the robot elsewhere, carry:30 carries it; door:NAME:open@30 opens a door, or "
            "close. box:30-60 waits until 60 s for a suitable moment. Repeatable.",
            multiple=True,
        ),
    )

    single_run_options: Collection[str] = ("gui",)

    sweep_options: Mapping[str, click.Option] = {
        "world": _create_option(
            "worlds",
            "NAME:A-B,…",
            "Run in several worlds: names, files, and ranges of random worlds like office:1-30,home:1-30.",
            callback=lambda ctx, option, text: parse_worlds(text),
        )
    }

    def __init__(self) -> None:
        self._robot: SimulatedRobot | None = None
        self._run_metrics: RunMetrics | None = None
        self.events: EventRunner | None = None
        """The runner of events, if the world of the run has people, events or spare boxes."""
        self._report: dict[str, object] = {}

    def takes_over(self, settings: Mapping[str, Any], wanted: Sequence[type]) -> Sequence[type]:
        """Return an empty sequence: other extensions may provide a robot, too."""
        return ()

    def requires(self, wanted: Sequence[type]) -> Sequence[type]:
        """Return an empty sequence: the simulator needs no resources of other extensions."""
        return ()

    def provide(
        self, settings: Mapping[str, Any], wanted: Sequence[type], provided: Sequence[object] = ()
    ) -> Sequence[object]:
        """Return the simulated robot with its waypoints and initial pose, and the world's map, as needed.

        If another extension provides a robot, return an empty sequence, because the map of the simulated
        world does not fit another robot.

        Args:
            settings: The values of the options. A program may add `spare_boxes`, the number of boxes for
                events that it triggers by `events`.
            wanted: The types that the tree's leaves need.
            provided: The resources that other extensions provide.

        Raises:
            click.UsageError: An option has an invalid value.
            ModuleNotFoundError: A module of the simulator is not installed.
        """
        other = next((type(resource) for resource in provided if isinstance(resource, Robot)), None)
        if other is not None:
            package = other.__module__.partition(".")[0]
            self.used_by = (
                f"leaf that needs a simulated robot, because its robot is the {other.__name__} of {package}"
            )
            _check_files(settings)
            return ()
        needs_robot = any(Robot in getattr(type_, "__mro__", ()) for type_ in wanted)
        # A leaf that needs a map has imported this module already, so that an import here is not necessary.
        map_type = getattr(sys.modules.get("btcore_robot.occupancy_map"), "OccupancyMap", None)
        needs_map = map_type is not None and map_type in wanted
        if not (needs_robot or needs_map):
            _check_files(settings)
            return ()
        resources: list[object] = []
        with _convert_errors():
            world_description = _load_world(settings)
            if needs_robot:
                self._robot, self.events = _create_robot(world_description, settings)
                resources.append(self._robot)
                if Waypoints in wanted:
                    resources.append(self._robot.world.description.waypoint_poses())
                if InitialPose in wanted:
                    is_unknown = settings.get("start") == UNKNOWN_START
                    resources.append(InitialPose(None if is_unknown else self._robot.start_pose))
            if needs_map:
                resources.append(_create_map(world_description))
        return resources

    @contextmanager
    def attach(
        self, tree: object, resources: Sequence[object], settings: Mapping[str, Any]
    ) -> Iterator[None]:
        """Record the run. When the run ends, also with an error, stop the robot and close the world.

        Print a warning for each event that has not happened when the run ends.

        Args:
            tree: Ignored.
            resources: The resources of all extensions. If a `NavigationReporter` is among them, its pose
                errors and failed goals are part of the report.
            settings: Ignored.

        Raises:
            click.ClickException: An event was not possible at its time.
        """
        robot = self._robot
        if robot is None:
            yield
            return
        from btcore_sim.run_metrics import RunMetrics, navigator_among

        self._run_metrics = RunMetrics(robot, navigator_among(resources))
        try:
            yield
            for event in self.events.pending if self.events is not None else ():
                click.echo(f"warning: event '{event}' did not happen: the run ended before", err=True)
        except SimError as error:
            raise click.ClickException(str(error)) from error
        finally:
            robot.stop()
            self._report = self.report()
            robot.world.close()
            self._robot = None

    def replace_tree(self, tree: object, resources: Sequence[object], settings: Mapping[str, Any]) -> None:
        """Do nothing: the world continues.

        Args:
            tree: Ignored, like the other arguments.
            resources: Ignored.
            settings: Ignored.
        """

    def on_interrupt(self) -> None:
        """Do nothing: an interrupted run is reported like any other."""

    def report(self) -> dict[str, object]:
        """Return `{"robot": {"distance_m", "collisions", "grazes", "pose", …}}`, also during the run.

        `RunMetrics.figures` documents the other values. With people or events the report also contains
        `"events"`, a list of the events with time (s) and place (m).
        """
        if self._robot is None or self._run_metrics is None:
            return self._report
        report: dict[str, object] = {
            "robot": {**_summarize_robot(self._robot), **self._run_metrics.figures()}
        }
        if self.events is not None:
            report["events"] = self.events.event_log
        return report


@contextmanager
def _convert_errors() -> Iterator[None]:
    """Raise a usage error if an option has an invalid value."""
    try:
        yield
    except SimError as error:
        raise click.UsageError(str(error)) from error


def _check_files(settings: Mapping[str, Any]) -> None:
    """Check the files of a world, waypoints and a robot that this run does not use."""
    given = settings.get("world", _WORLD) != _WORLD or settings.get("waypoints") or settings.get("robot")
    if given:
        with _convert_errors():
            _load_world({**settings, "start": None})


def _load_world(settings: Mapping[str, Any]) -> "WorldDescription":
    from btcore_sim.robot_description import TIAGO, load_robot_description
    from btcore_sim.scenario import with_start
    from btcore_sim.world import random_generator
    from btcore_sim.worlds import load_world_description

    seed = settings.get("seed", 0)
    radius = load_robot_description(settings.get("robot") or TIAGO).base.radius
    description = load_world_description(
        settings.get("world", _WORLD),
        seed=seed,
        radius=radius,
        waypoints=settings.get("waypoints"),
    )
    start = settings.get("start")
    if start is None:
        return description
    return with_start(description, start, random_generator(seed, "start"), radius)


def _create_map(world_description: "WorldDescription") -> object:
    from btcore_sim.map_rasteriser import rasterise

    return rasterise(world_description)


def _create_robot(
    world_description: "WorldDescription", settings: Mapping[str, Any]
) -> "tuple[SimulatedRobot, EventRunner | None]":
    # Imported here, because a tree without a robot must not load the physics engine.
    from btcore_sim.camera import parse_camera
    from btcore_sim.events import check_events, parse_event
    from btcore_sim.faults import parse_fault
    from btcore_sim.robot_description import TIAGO, load_robot_description
    from btcore_sim.scenario import Scenario
    from btcore_sim.simulated_robot import SimulatedRobot
    from btcore_sim.world import World

    noise = settings.get("noise", 1.0)
    if not math.isfinite(noise):
        raise SimError(f"--noise {noise}: the factor has to be a finite number of at least 0")
    robot_description = load_robot_description(settings.get("robot") or TIAGO).with_noise(noise)
    _check_rate(settings.get("rate"), robot_description.base)
    camera = parse_camera(settings.get("camera", "off"))
    faults = [parse_fault(text) for text in settings.get("fault", ())]
    events = [parse_event(text) for text in settings.get("event", ())]
    scenario = Scenario(
        settings.get("people", 0), settings.get("obstacles", 0), events, settings.get("spare_boxes", 0)
    )
    seed = settings.get("seed", 0)
    check_events(events, world_description, settings.get("duration"))
    world_description = scenario.add_to(world_description, seed, robot_description.base.radius)
    world = World(
        world_description, seed=seed, fast=settings.get("fast", False), gui=settings.get("gui", False)
    )
    level = settings.get("battery", 100.0)
    if math.isnan(level):
        raise SimError("--battery nan: the level has to be a number from 0 to 100")
    simulated = SimulatedRobot(world, robot_description, camera=camera, faults=faults, battery=level)
    return simulated, scenario.begin(world, simulated, robot_description.base.radius)


def _check_rate(rate: float | None, base: BaseInfo) -> None:
    least = 1.0 / base.command_timeout
    if rate is not None and rate < least:
        raise SimError(
            f"--rate {rate:g} is too slow for a tree that drives: the base stops "
            f"{base.command_timeout:g} s after a velocity command, so the tree "
            f"has to be ticked at least {least:g} times a second"
        )


def _summarize_robot(robot: "SimulatedRobot") -> dict[str, object]:
    pose = robot.true_pose()
    return {
        "distance_m": round(robot.distance, 4),
        "collisions": robot.contacts.collisions,
        "grazes": robot.contacts.grazes,
        "pose": {"x": round(pose.x, 4), "y": round(pose.y, 4), "yaw": round(pose.yaw, 4)},
    }
