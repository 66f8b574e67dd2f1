"""`btcore book`: the systems of *A Concise Introduction to Robot Programming with ROS2*."""

from pathlib import Path
from typing import Any

import click

from btcore.program_runner import FiniteRange
from btcore_robot.book.runner import BookRunner, report_usage_errors, world_command
from btcore_robot.process.launch import launch_processes, read_launch
from btcore_robot.process.process import ProcessOptions
from btcore_robot.process.programs import create_processes

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
@click.option("--duration", type=FiniteRange(0, min_open=True), metavar="S", help="Stop after this time.")
@click.option("--fast", is_flag=True, help="Simulated time, as fast as it goes, instead of real time.")
@click.option("--params", type=click.Path(path_type=Path), metavar="FILE.yaml", help="ROS 2 parameters.")
@click.pass_context
@report_usage_errors
def hello(ctx: click.Context, /, **settings: Any) -> int:
    """Run a program of chapter 2; by default the executor with publisher and subscriber."""
    from btcore_robot.process.parameters import load_process_parameters

    runner = BookRunner(ctx, {**settings, "as_json": False, "seed": 0}, embodied=False)
    program = settings["program"]
    options = ProcessOptions()
    if settings["params"] is not None:
        parameters = load_process_parameters(settings["params"], f"{program}_node")
        options = ProcessOptions(parameters=parameters)
    runner.add(*create_processes(program, runner.context, options))
    return runner.run("Hello")


@world_command(book, "launch", "Start the programs of a launch file.")
@click.argument("file", type=click.Path(path_type=Path))
def launch(ctx: click.Context, /, **settings: Any) -> int:
    """Start the programs of FILE, a launch file in ROS 2's YAML format; 'bridge' needs a robot."""
    from btcore_robot.book.topic_graph import draw_graph

    entries = read_launch(settings["file"])
    runner = BookRunner(ctx, settings, embodied=any(entry.program == "bridge" for entry in entries))
    runner.add(*launch_processes(entries, runner.context))
    return runner.run(
        "Launched",
        lambda: {"processes": [process.name for process in runner.executor.processes]},
        lambda: draw_graph(runner.context.topics),
    )


@world_command(book, "bumpgo-fsm", "Bump and go by a state machine (chapter 3).")
@click.option(
    "--turn",
    type=click.Choice(["left", "diagonals", "open-loop", "closed-loop"]),
    default="left",
    show_default=True,
    help="How to turn: as in the book, or as in its exercises.",
)
def bumpgo_fsm(ctx: click.Context, /, **settings: Any) -> int:
    """Drive forward, turn away from obstacles nearer than 1 m, and log every change of state."""
    from btcore_robot.book.trail import Trail
    from btcore_robot.control.bumpgo_fsm import BumpGo

    runner = BookRunner(ctx, settings)
    chosen = settings["turn"].replace("-", "_")
    program = "bumpgo" if chosen == "left" else f"bumpgo_{chosen}"
    [process] = create_processes(program, runner.context, ProcessOptions(remap=_DRIVEN))
    assert isinstance(process, BumpGo)
    runner.add(*create_processes("bridge", runner.context), process)
    trail = Trail(runner.context, lambda: process.state.value)
    colours = {"forward": (46, 130, 80), "back": (200, 70, 50), "turn": (40, 100, 190), "stop": (90, 90, 90)}
    return runner.run(
        "BumpGo",
        lambda: {"changes": process.changes, "state": process.state.value},
        lambda: trail.draw(colours, "bump and go: the way by odometry, what the laser saw").image,
    )


@world_command(book, "vff", "Avoidance by a virtual force field (chapter 5.1).")
@click.option("--all", "all_near", is_flag=True, help="Avoid all near obstacles, not only the nearest.")
def vff(ctx: click.Context, /, **settings: Any) -> int:
    """Drive forward and avoid obstacles by a virtual force field."""
    from btcore_robot.book.force_watcher import ForceWatcher
    from btcore_robot.control.vff import Avoidance

    runner = BookRunner(ctx, settings)
    program = "avoidance_vff_all" if settings["all_near"] else "avoidance_vff"
    [process] = create_processes(program, runner.context, ProcessOptions(remap=_DRIVEN))
    assert isinstance(process, Avoidance)
    watcher = ForceWatcher(runner.context)
    runner.add(*create_processes("bridge", runner.context), process, watcher)
    return runner.run("AvoidanceVff", watcher.results, watcher.draw, [watcher])


def _obstacle(ctx: click.Context, settings: dict[str, Any], detector: str, name: str) -> int:
    from btcore_robot.book.obstacle_watcher import ObstacleWatcher

    runner = BookRunner(ctx, settings)
    parameters = {"colour_by_distance": settings["colour_by_distance"]}
    processes = create_processes(detector, runner.context, ProcessOptions(remap=_DRIVEN))
    processes += create_processes("obstacle_monitor", runner.context, ProcessOptions(parameters=parameters))
    for program in ("displacement", "obstacle_in_frames"):
        if settings[program]:
            processes += create_processes(program, runner.context)
    watcher = ObstacleWatcher(runner.context, settings["drive"], settings["turn"])
    runner.add(*create_processes("bridge", runner.context), *processes, watcher)
    return runner.run(name, watcher.results, watcher.draw, [watcher])


_DETECTOR_OPTIONS = [
    click.option(
        "--drive", type=FiniteRange(), default=0.0, metavar="M/S", help="Drive meanwhile, as with a keyboard."
    ),
    click.option("--turn", type=FiniteRange(), default=0.0, metavar="RAD/S", help="Turn meanwhile."),
    click.option("--colour-by-distance", is_flag=True, help="Colour the arrow: green if far, red if near."),
    click.option("--displacement", is_flag=True, help="Log each second how far the robot has moved."),
    click.option("--frames", "obstacle_in_frames", is_flag=True, help="Log its position in three frames."),
]


@world_command(
    book, "obstacle-detector", "An obstacle as a frame below the laser (chapter 4).", _DETECTOR_OPTIONS
)
def obstacle_detector(ctx: click.Context, /, **settings: Any) -> int:
    """Publish the obstacle ahead as a static frame below the laser's frame, which moves with the robot."""
    return _obstacle(ctx, settings, "obstacle_detector", "ObstacleDetector")


@world_command(
    book, "obstacle-detector-improved", "An obstacle as a frame below odom (chapter 4).", _DETECTOR_OPTIONS
)
def obstacle_detector_improved(ctx: click.Context, /, **settings: Any) -> int:
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
def colour(ctx: click.Context, /, **settings: Any) -> int:
    """Detect objects of a colour in the camera images and log where they are."""
    from btcore_robot.book.colour_watcher import ColourWatcher, parse_hsv_ranges

    ranges = parse_hsv_ranges(settings["hsv"])
    runner = BookRunner(ctx, settings)
    options = ProcessOptions(remap=_DRIVEN, parameters={"hsv_ranges": ranges, "each": settings["each"]})
    watcher = ColourWatcher(runner.context, ranges, settings["each"])
    runner.add(
        *create_processes("bridge", runner.context),
        *create_processes("object_detector", runner.context, options),
        watcher,
    )
    runner.robot.move_head(settings["pan"], settings["tilt"])
    return runner.run("ColourDetection", watcher.results, watcher.draw, [watcher])


@world_command(book, "head-tracking", "The head follows a colour, by PID (chapter 5.2).")
@click.option("--turn", type=FiniteRange(), default=0.0, metavar="RAD/S", help="Turn the base meanwhile.")
@click.option("--reactive", is_flag=True, help="Use higher gains and 20 Hz, as in the book's exercise.")
def head_tracking(ctx: click.Context, /, **settings: Any) -> int:
    """Turn the head towards objects of the colour of wooden furniture."""
    from btcore_robot.book.head_watcher import HeadWatcher

    runner = BookRunner(ctx, settings)
    watcher = HeadWatcher(runner.context, settings["turn"], settings["reactive"])
    runner.add(watcher)
    return runner.run("HeadTracking", watcher.results, watcher.draw, [watcher])
