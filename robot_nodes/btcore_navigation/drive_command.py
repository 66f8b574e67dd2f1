"""`btcore drive`: drive the robot with keys, and make a map on the way."""

from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from btcore import Run, RunSettings
from btcore.escaping import escape_controls
from btcore.field_options import add_options
from btcore.program_runner import GivenSettings, ProviderCommand, TreelessProgram, create_run, print_json
from btcore_robot.control.keyboard import (
    HELP,
    KeyboardTeleop,
    KeyInputError,
    KeySource,
    Terminal,
    parse_key_script,
)
from btcore_robot.robot import Phase, Robot, WorldPlaces

if TYPE_CHECKING:
    from btcore_navigation.mapping.mapper import Mapper


@click.command("drive", cls=ProviderCommand)
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
@add_options(RunSettings, "duration", "seed", "fast")
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object as the last line of stdout.")
@click.pass_context
def drive(
    ctx: click.Context, /, settings: GivenSettings, keys: str | None, map_to: Path | None, as_json: bool
) -> int:
    """Drive the robot: w or ↑ forward, s or ↓ back, a or ← left, d or → right, space stop, x end.

    With --fast, which needs --keys, the robot drives as fast as possible instead of in real time.
    """
    if map_to is not None and not map_to.resolve().parent.is_dir():
        raise click.UsageError(f"--map-to {map_to}: there is no folder {map_to.resolve().parent}")
    try:
        source: KeySource = Terminal() if keys is None else parse_key_script(keys)
    except KeyInputError as error:
        raise click.UsageError(f"--keys: {error}" if keys is not None else str(error)) from error
    program = TreelessProgram("Drive")
    results: dict[str, object] = {}
    mappers: list[Mapper] = []

    def prepare(run: Run) -> None:
        robot = run.find(Robot)
        assert robot is not None
        if map_to is not None:
            mappers.append(_mapper(run, robot))
            run.resources.extend(mappers)
        program.keep_running = KeyboardTeleop(robot, source).step

    run = create_run(ctx, program, settings, prepare).want(Robot)
    if map_to is not None:
        # What puts the map into the frame of a simulated world.
        from btcore_robot.occupancy_map import OccupancyMap

        run.want(WorldPlaces, OccupancyMap, optional=True)
    with run, ExitStack() as stack:
        if isinstance(source, Terminal):
            stack.enter_context(source)
            click.echo(HELP, err=True)
        run.tick_to_end()
        if map_to is not None:
            results["map"] = _save(mappers[0], map_to)
    if as_json:
        print_json({"time_s": round(run.elapsed_s, 3), **results, **run.report})
    return run.exit_code


def _mapper(run: Run, robot: Robot) -> "Mapper":
    """Return a mapper on the robot's schedule, with the transforms that it needs.

    If the start pose is known, the map is in its frame, with the keep-out areas of the world.
    """
    from btcore_navigation.mapping.mapper import Mapper
    from btcore_robot.occupancy_map import OccupancyMap
    from btcore_robot.transforms import FrameBroadcaster, TransformTree

    places, world = run.find(WorldPlaces), run.find(OccupancyMap)
    start = None if places is None else places.start
    keepout = world.keepout if world is not None and start is not None else ()
    tree = TransformTree()
    frames = FrameBroadcaster(robot, tree)
    # Once before the start, so that the first scan finds its frame.
    frames.step(robot.clock.now())
    mapper = Mapper(robot, tree, start=start, keepout=keepout)
    robot.schedule.add_task(frames.RATE, Phase.TRANSFORMS, frames.step)
    robot.schedule.add_task(robot.laser_info.rate, Phase.LOCALISER, mapper.step)
    return mapper


def _save(mapper: "Mapper", path: Path) -> dict[str, object]:
    """Write the map, print its size, and return its numbers for the JSON output."""
    from btcore_robot.occupancy_map import save_map

    map = mapper.map()
    save_map(map, path)
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
