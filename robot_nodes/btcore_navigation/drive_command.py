"""`btcore drive`: drive the robot with keys, and make a map on the way."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from btcore.escaping import escape_controls
from btcore.program_runner import FiniteRange, RunCommand, print_json, require_resources, run_program
from btcore_robot.control.keyboard import (
    HELP,
    KeyboardTeleop,
    KeyInputError,
    KeySource,
    Terminal,
    parse_key_script,
)
from btcore_robot.robot import InitialPose, Phase, Robot

if TYPE_CHECKING:
    from btcore_navigation.mapping.mapper import Mapper


@click.command("drive", cls=RunCommand, short_help="Drive the robot with keys, and make a map.")
@click.option(
    "--keys",
    metavar="KEY:S,…",
    help="Hold these keys for these times (s) instead of reading the terminal: w:5,a:2,q:3.5",
)
@click.option(
    "--map-to",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE.yaml",
    help="Make a map, and save it at the end.",
)
@click.option("--duration", type=FiniteRange(0, min_open=True), metavar="S", help="Stop after this time.")
@click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, metavar="N", help="Random seed."
)
@click.option("--fast", is_flag=True, help="Run as fast as possible, not in real time; only with --keys.")
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object as the last line of stdout.")
@click.pass_context
def drive(ctx: click.Context, /, **settings: Any) -> int:
    """Drive the robot: w or ↑ forward, s or ↓ back, a or ← left, d or → right, space stop, x end."""
    path: Path | None = settings["map_to"]
    if path is not None and not path.resolve().parent.is_dir():
        raise click.UsageError(f"--map-to {path}: there is no folder {path.resolve().parent}")
    try:
        keys: KeySource = Terminal() if settings["keys"] is None else parse_key_script(settings["keys"])
    except KeyInputError as error:
        raise click.UsageError(f"--keys: {error}" if settings["keys"] is not None else str(error)) from error
    gathered = require_resources(ctx, settings, (Robot,), _map_resources() if path is not None else ())
    robot = next(resource for resource in gathered.resources if isinstance(resource, Robot))
    mapper = _mapper(robot, gathered.resources) if path is not None else None
    teleop = KeyboardTeleop(robot, keys)
    results: dict[str, object] = {}

    def end() -> None:
        if mapper is not None and path is not None:
            results["map"] = _save(mapper, path)

    with ExitStack() as attached:
        if isinstance(keys, Terminal):
            attached.enter_context(keys)
            click.echo(HELP, err=True)
        shown = [] if mapper is None else [mapper]
        done = run_program("Drive", gathered, settings, end, extra_resources=shown, keep_running=teleop.step)
    output = {"time_s": round(done.seconds, 3), **results, **done.report}
    if settings["as_json"]:
        print_json(output)
    return done.code


def _map_resources() -> Sequence[type]:
    """Return the types of the resources that put a map into the frame of a simulated world."""
    from btcore_robot.occupancy_map import OccupancyMap

    return InitialPose, OccupancyMap


def _mapper(robot: Robot, resources: Sequence[object]) -> "Mapper":
    """Return a mapper on the robot's schedule, with the transforms that it needs.

    If the initial pose is among *resources*, the map is in its frame, with the keep-out areas of the world.
    """
    from btcore_navigation.mapping.mapper import Mapper
    from btcore_robot.occupancy_map import OccupancyMap
    from btcore_robot.transforms import FrameBroadcaster, TransformTree

    start = next((resource.pose for resource in resources if isinstance(resource, InitialPose)), None)
    world = next((resource for resource in resources if isinstance(resource, OccupancyMap)), None)
    keepout = world.keepout if world is not None and start is not None else ()
    tree = TransformTree()
    frames = FrameBroadcaster(robot, tree)
    # Once before the start, so that the first scan finds its frame.
    frames.step(robot.clock.now())
    mapper = Mapper(robot, tree, start=start, keepout=keepout)
    robot.schedule.add_task(frames.RATE, Phase.TRANSFORMS, frames.step)
    robot.schedule.add_task(robot.laser.rate, Phase.LOCALISER, mapper.step)
    return mapper


def _save(mapper: "Mapper", path: Path) -> dict[str, object]:
    """Write the map, print its size, and return its numbers for the JSON output."""
    from btcore_robot.occupancy_map import MapError, save_map

    map = mapper.map()
    try:
        save_map(map, path)
    except MapError as error:
        raise click.UsageError(str(error)) from error
    click.echo(
        f"{path}: {map.width} x {map.height} cells of {map.resolution:g} m, "
        f"made of {len(mapper.scans)} scans and {mapper.loops_closed} loops"
    )
    numbers = {"scans": len(mapper.scans), "width": map.width, "height": map.height}
    quality = mapper.quality()
    if quality is None:
        return {**numbers, "loops": 0}
    if quality.warning():
        click.echo(f"warning: {escape_controls(str(path))}: {quality.warning()}", err=True)
    return {**numbers, **asdict(quality)}
