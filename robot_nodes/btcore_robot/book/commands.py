"""`btcore book`: the systems of *A Concise Introduction to Robot Programming with ROS2*."""

from pathlib import Path
from typing import Annotated

import click

from btcore import RunSettings, Settings, option
from btcore.field_options import FiniteRange, add_options
from btcore.program_runner import GivenSettings
from btcore_robot.book.runner import BookRunner, Results, run_components, world_command
from btcore_robot.components.component import ComponentOptions
from btcore_robot.components.launch import launch_components, read_launch
from btcore_robot.components.programs import create_components

FIRST_STEPS = ("logger", "publisher", "subscriber", "executor", "localization")
_DRIVEN = {
    "input_scan": "/scan_raw",
    "output_vel": "/nav_vel",
    "input_image": "/head_front_camera/rgb/image_raw",
}


@click.group()
def book() -> None:
    """Run an example from the book "A Concise Introduction to Robot Programming with ROS2"."""


@book.command("hello", short_help="The first programs: publisher, subscriber, executor …")
@click.argument("program", type=click.Choice(FIRST_STEPS), default="executor")
@add_options(RunSettings, "duration", "fast")
@click.option("--params", type=click.Path(path_type=Path), metavar="FILE.yaml", help="ROS 2 parameters.")
@click.pass_context
def hello(
    ctx: click.Context, /, program: str, duration: float | None, fast: bool, params: Path | None
) -> int:
    """Run a program of chapter 2; by default the executor with publisher and subscriber."""
    from btcore_robot.components.parameters import load_component_parameters

    options = ComponentOptions()
    if params is not None:
        options = ComponentOptions(parameters=load_component_parameters(params, f"{program}_node"))

    def create(runner: BookRunner) -> Results:
        runner.add(*create_components(program, runner.context, options))
        return Results()

    settings = GivenSettings([RunSettings(duration=duration, fast=fast)])
    return run_components(ctx, settings, "Hello", create, embodied=False)


@world_command(book, "launch", "Start the programs of a launch file.")
@click.argument("file", type=click.Path(path_type=Path))
def launch(ctx: click.Context, /, settings: GivenSettings, file: Path) -> int:
    """Start the programs of FILE, a launch file in ROS 2's YAML format; 'bridge' needs a robot."""
    from btcore_robot.book.topic_graph import draw_graph

    entries = read_launch(file)

    def create(runner: BookRunner) -> Results:
        runner.add(*launch_components(entries, runner.context))
        return Results(
            lambda: {"components": [component.name for component in runner.executor.components]},
            lambda: draw_graph(runner.context.topics),
        )

    is_embodied = any(entry.node.program == "bridge" for entry in entries)
    return run_components(ctx, settings, "Launched", create, embodied=is_embodied)


@world_command(book, "bumpgo-fsm", "Bump and go by a state machine (chapter 3).")
@click.option(
    "--turn",
    type=click.Choice(["left", "diagonals", "open-loop", "closed-loop"]),
    default="left",
    show_default=True,
    help="How to turn: as in the book, or as in its exercises.",
)
def bumpgo_fsm(ctx: click.Context, /, settings: GivenSettings, turn: str) -> int:
    """Drive forward, turn away from obstacles nearer than 1 m, and log every change of state."""
    from btcore_robot.book.trail import Trail
    from btcore_robot.control.bumpgo_fsm import BumpGo

    program = "bumpgo" if turn == "left" else f"bumpgo_{turn.replace('-', '_')}"
    colours = {"forward": (46, 130, 80), "back": (200, 70, 50), "turn": (40, 100, 190), "stop": (90, 90, 90)}

    def create(runner: BookRunner) -> Results:
        [component] = create_components(program, runner.context, ComponentOptions(remap=_DRIVEN))
        assert isinstance(component, BumpGo)
        runner.add(*create_components("bridge", runner.context), component)
        trail = Trail(runner.context, lambda: component.state.value)
        return Results(
            lambda: {"changes": component.changes, "state": component.state.value},
            lambda: trail.draw(colours, "bump and go: the way by odometry, what the laser saw").image,
        )

    return run_components(ctx, settings, "BumpGo", create)


@world_command(book, "vff", "Avoidance by a virtual force field (chapter 5.1).")
@click.option("--all", "all_near", is_flag=True, help="Avoid all near obstacles, not only the nearest.")
def vff(ctx: click.Context, /, settings: GivenSettings, all_near: bool) -> int:
    """Drive forward and avoid obstacles by a virtual force field."""
    from btcore_robot.book.force_watcher import ForceWatcher
    from btcore_robot.control.vff import Avoidance

    def create(runner: BookRunner) -> Results:
        program = "avoidance_vff_all" if all_near else "avoidance_vff"
        [component] = create_components(program, runner.context, ComponentOptions(remap=_DRIVEN))
        assert isinstance(component, Avoidance)
        watcher = ForceWatcher(runner.context)
        runner.add(*create_components("bridge", runner.context), component, watcher)
        return Results(watcher.results, watcher.draw, [watcher])

    return run_components(ctx, settings, "AvoidanceVff", create)


class DetectorSettings(Settings):
    """The settings of the obstacle detectors."""

    drive: Annotated[float, option("Drive meanwhile, as with a keyboard.", metavar="M/S")] = 0.0
    turn: Annotated[float, option("Turn meanwhile.", metavar="RAD/S")] = 0.0
    colour_by_distance: Annotated[bool, option("Colour the arrow: green if far, red if near.")] = False
    displacement: Annotated[bool, option("Log each second how far the robot has moved.")] = False
    frames: Annotated[bool, option("Log its position in three frames.")] = False


def _obstacle(ctx: click.Context, settings: GivenSettings, program: str, name: str) -> int:
    from btcore_robot.book.obstacle_watcher import ObstacleWatcher

    detector = settings.of(DetectorSettings)

    def create(runner: BookRunner) -> Results:
        parameters = {"colour_by_distance": detector.colour_by_distance}
        components = create_components(program, runner.context, ComponentOptions(remap=_DRIVEN))
        components += create_components(
            "obstacle_monitor", runner.context, ComponentOptions(parameters=parameters)
        )
        if detector.displacement:
            components += create_components("displacement", runner.context)
        if detector.frames:
            components += create_components("obstacle_in_frames", runner.context)
        watcher = ObstacleWatcher(runner.context, detector.drive, detector.turn)
        runner.add(*create_components("bridge", runner.context), *components, watcher)
        return Results(watcher.results, watcher.draw, [watcher])

    return run_components(ctx, settings, name, create)


@world_command(book, "obstacle-detector", "An obstacle as a frame below the laser (chapter 4).")
@add_options(DetectorSettings)
def obstacle_detector(ctx: click.Context, /, settings: GivenSettings) -> int:
    """Publish the obstacle ahead as a static frame below the laser's frame, which moves with the robot."""
    return _obstacle(ctx, settings, "obstacle_detector", "ObstacleDetector")


@world_command(book, "obstacle-detector-improved", "An obstacle as a frame below odom (chapter 4).")
@add_options(DetectorSettings)
def obstacle_detector_improved(ctx: click.Context, /, settings: GivenSettings) -> int:
    """Publish the obstacle ahead as a frame below odom, which stays in place when the robot drives."""
    return _obstacle(ctx, settings, "obstacle_detector_improved", "ObstacleDetectorImproved")


@world_command(book, "colour", "Objects by their colour (chapter 5.2).")
@click.option(
    "--hsv",
    default="15,20,50,200,20,200",
    show_default=True,
    metavar="h,H,s,S,v,V",
    help="From and to of hue (0-180), saturation and value (0-255); the default is wooden furniture.",
)
@click.option("--each", is_flag=True, help="Detect every object separately.")
@click.option("--pan", type=FiniteRange(), default=0.0, metavar="RAD", help="Pan of the head, + is left.")
@click.option("--tilt", type=FiniteRange(), default=0.0, metavar="RAD", help="Tilt of the head, + is up.")
def colour(
    ctx: click.Context, /, settings: GivenSettings, hsv: str, each: bool, pan: float, tilt: float
) -> int:
    """Detect objects of a colour in the camera images and log where they are."""
    from btcore_robot.book.colour_watcher import ColourWatcher, parse_hsv_ranges

    ranges = parse_hsv_ranges(hsv)

    def create(runner: BookRunner) -> Results:
        options = ComponentOptions(remap=_DRIVEN, parameters={"hsv_ranges": ranges, "each": each})
        watcher = ColourWatcher(runner.context, ranges, each)
        runner.add(
            *create_components("bridge", runner.context),
            *create_components("object_detector", runner.context, options),
            watcher,
        )
        runner.robot.move_head(pan, tilt)
        return Results(watcher.results, watcher.draw, [watcher])

    return run_components(ctx, settings, "ColourDetection", create)


@world_command(book, "head-tracking", "The head follows a colour, by PID (chapter 5.2).")
@click.option("--turn", type=FiniteRange(), default=0.0, metavar="RAD/S", help="Turn the base meanwhile.")
@click.option("--reactive", is_flag=True, help="Use higher gains and 20 Hz, as in the book's exercise.")
def head_tracking(ctx: click.Context, /, settings: GivenSettings, turn: float, reactive: bool) -> int:
    """Turn the head towards objects of the colour of wooden furniture."""
    from btcore_robot.book.head_watcher import HeadWatcher

    def create(runner: BookRunner) -> Results:
        watcher = HeadWatcher(runner.context, turn, reactive)
        runner.add(watcher)
        return Results(watcher.results, watcher.draw, [watcher])

    return run_components(ctx, settings, "HeadTracking", create)
