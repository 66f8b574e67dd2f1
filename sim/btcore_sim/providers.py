"""The simulator in a run: a robot in a simulated world, the world's waypoints, and its map."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, NamedTuple

from btcore import Report, Resources, RunSettings, Settings, SettingsError, option, provider
from btcore.clock import Clock
from btcore.options import SweepOption
from btcore_sim.completion import complete_world

if TYPE_CHECKING:
    import btcore_robot.occupancy_map
    import btcore_robot.robot
    import btcore_sim.simulated_robot
    import btcore_sim.simulation

UNKNOWN_START: Final = "unknown"
"""The value of `--start` for a random start pose of which the navigation is not informed."""

_RANGE: Final = re.compile(r"([a-z]+):(\d{1,9})-(\d{1,9})")
_MAX_WORLDS: Final = 10_000


def parse_worlds(text: str) -> list[str]:
    """Return the worlds in the value of `--worlds`, with all worlds of a range.

    Args:
        text: The names, separated by commas; a range of seeds is written as `office:1-30`.

    Raises:
        SettingsError: A range is invalid, or a world is listed twice.

    Examples:
        >>> from btcore_sim.providers import parse_worlds
        >>> parse_worlds("house,office:1-3")
        ['house', 'office:1', 'office:2', 'office:3']
    """
    worlds: list[str] = []
    for part in text.split(","):
        match = _RANGE.fullmatch(part.strip())
        if match is None:
            worlds.append(part.strip())
            continue
        first, last = int(match[2]), int(match[3])
        if not 0 <= last - first < _MAX_WORLDS:
            raise SettingsError(
                f"--worlds {text}: {part.strip()} has to ascend, with at most {_MAX_WORLDS} worlds."
            )
        worlds += [f"{match[1]}:{number}" for number in range(first, last + 1)]
    if len(set(worlds)) < len(worlds):
        raise SettingsError(f"--worlds {text}: a world is listed more than once.")
    return worlds


_WORLDS: Final = SweepOption(
    "worlds",
    parse_worlds,
    "NAME:A-B,…",
    "Run in several worlds: names, files, and ranges of random worlds like office:1-30,home:1-30.",
)


class SimulatorSettings(Settings):
    """The settings of the simulator."""

    world: Annotated[
        str,
        option(
            "The robot's world: a name, a JSON file, a map (YAML), or office:N or home:N for a random world.",
            metavar="NAME",
            sweep_option=_WORLDS,
            complete=complete_world,
        ),
    ] = "arena"
    waypoints: (
        Annotated[Path, option("Waypoints to use instead of the world's own.", metavar="FILE.yaml")] | None
    ) = None
    gui: Annotated[bool, option("Open the physics engine's window.", one_run_only=True)] = False
    robot: (
        Annotated[Path, option("Description of a robot to use instead of the Tiago.", metavar="FILE.json")]
        | None
    ) = None
    camera: Annotated[
        str,
        option(
            "Size and rate of the camera's pictures, which are rendered only when a leaf requests them.",
            metavar="off|WxH@HZ",
        ),
    ] = "320x240@10"
    start: (
        Annotated[
            str,
            option(
                "Start pose (m, degrees), or a random free place; unknown: the navigation has to find the "
                "place itself.  [default: the world's own rule]",
                metavar="random|unknown|X,Y,YAW",
            ),
        ]
        | None
    ) = None
    noise: Annotated[
        float,
        option(
            "Factor of the errors and latencies of the sensors: 0 removes them, 2 doubles them.",
            metavar="FACTOR",
            ge=0,
        ),
    ] = 1.0
    battery: Annotated[
        float, option("Level of the robot's battery at the start.", metavar="PERCENT", ge=0, le=100)
    ] = 100.0
    fault: Annotated[
        tuple[str, ...],
        option(
            "Let laser, odometry, camera or wheel fail from START to END (s); repeatable.",
            metavar="PART:START-END",
        ),
    ] = ()
    people: Annotated[
        int,
        option("Number of people who walk in the world; they stop in front of the robot.", metavar="N", ge=0),
    ] = 0
    obstacles: Annotated[
        int, option("Number of boxes at random places that are not on the map.", metavar="N", ge=0)
    ] = 0
    event: Annotated[
        tuple[str, ...],
        option(
            "At 30 s, box:30 drops a box ahead, or box:30@2,0.3 at 2 m ahead and 0.3 m to the left; "
            "kidnap:30 moves the robot elsewhere, carry:30 carries it; door:NAME:open@30 opens a door, or "
            "close. box:30-60 waits until 60 s for a suitable moment. Repeatable.",
            metavar="KIND:TIME",
        ),
    ] = ()


class SpareBoxes(NamedTuple):
    """The number of boxes for events that a program triggers itself; the program provides the object."""

    number: int


@provider(provides=("btcore_robot.robot.Robot", Clock), default=True)
def simulator(
    settings: SimulatorSettings,
    run_settings: RunSettings,
    report: Report,
    resources: Resources,
    spare_boxes: SpareBoxes | None,
) -> "Iterator[tuple[btcore_sim.simulated_robot.SimulatedRobot, btcore_sim.simulation.Simulation]]":
    """Provide a robot in a simulated world, and report its run.

    At the end, also after an error, stop the robot and close the world. Print a warning for each event that
    has not happened.

    Args:
        report: Gets the results; see `Simulation.report`.
        resources: If a `NavigationReporter` is among them, its pose errors and failed goals are reported.
        spare_boxes: The boxes for events that the program triggers by `Simulation.events`.

    Raises:
        SimError: An option has an invalid value, or an event was not possible at its time.
    """
    simulated = _simulate(settings, run_settings, resources, 0 if spare_boxes is None else spare_boxes.number)
    try:
        yield simulated.robot, simulated
        for event in simulated.events.pending if simulated.events is not None else ():
            report.warn(f"event '{event}' did not happen: the run ended before")
    finally:
        simulated.robot.stop()
        for heading, results in simulated.report().items():
            report[heading] = results
        simulated.robot.world.close()


@provider
def world_places(simulated: "btcore_sim.simulation.Simulation") -> "btcore_robot.robot.WorldPlaces":
    """Return the waypoints of the simulated world, and the robot's start pose if it is known."""
    from btcore_robot.robot import WorldPlaces

    return WorldPlaces(simulated.description.waypoint_poses(), simulated.known_start)


@provider
def world_map(simulated: "btcore_sim.simulation.Simulation") -> "btcore_robot.occupancy_map.OccupancyMap":
    """Return the map of the simulated world, without the objects that the run adds."""
    from btcore_sim.map_rasteriser import rasterise

    return rasterise(simulated.description)


def _simulate(
    settings: SimulatorSettings, run_settings: RunSettings, resources: Resources, spare_boxes: int
) -> "btcore_sim.simulation.Simulation":
    from btcore_sim.camera import parse_camera
    from btcore_sim.events import check_events, parse_event
    from btcore_sim.faults import parse_fault
    from btcore_sim.robot_description import TIAGO, load_robot_description
    from btcore_sim.scenario import Scenario, with_start
    from btcore_sim.simulated_robot import SimulatedRobot
    from btcore_sim.simulation import Simulation
    from btcore_sim.world import World, random_generator
    from btcore_sim.worlds import load_world_description

    robot = load_robot_description(settings.robot or TIAGO).with_noise(settings.noise)
    radius = robot.base.radius
    description = load_world_description(
        settings.world, seed=run_settings.seed, radius=radius, waypoints=settings.waypoints
    )
    if settings.start is not None:
        random = random_generator(run_settings.seed, "start")
        description = with_start(description, settings.start, random, radius)
    robot.base.check_rate(run_settings.rate)
    camera = parse_camera(settings.camera)
    faults = [parse_fault(text) for text in settings.fault]
    planned = [parse_event(text) for text in settings.event]
    scenario = Scenario(settings.people, settings.obstacles, planned, spare_boxes)
    check_events(planned, description, run_settings.duration)
    world = World(
        scenario.add_to(description, run_settings.seed, radius),
        seed=run_settings.seed,
        fast=run_settings.fast,
        gui=settings.gui,
    )
    body = SimulatedRobot(world, robot, camera=camera, faults=faults, battery=settings.battery)
    events = scenario.begin(world, body, radius)
    known_start = None if settings.start == UNKNOWN_START else body.start_pose
    return Simulation(body, description, events, resources, known_start)
