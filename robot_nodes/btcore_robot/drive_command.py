"""``btcore drive``: the robot by keys, and a map of what it sees on the way."""

import json
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from btcore.program_runner import FiniteRange, RunCommand, require_resources, run_program
from btcore_robot.control.keyboard import HELP, KeyDrive, KeyInputError, Keys, Terminal, script
from btcore_robot.robot import Phase, Robot

if TYPE_CHECKING:
    from btcore_robot.navigation.mapping.mapper import Mapper


@click.command("drive", cls=RunCommand, short_help="Drive the robot by keys, and map what it sees.")
@click.option(
    "--keys",
    metavar="KEY:S,…",
    help="Hold these keys so long (s) each, instead of reading the terminal: w:5,a:2,q:3.5",
)
@click.option(
    "--map-to",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE.yaml",
    help="Make a map on the way, and save it at the end.",
)
@click.option("--duration", type=FiniteRange(0, min_open=True), metavar="S", help="End after so long.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="For chance.")
@click.option("--fast", is_flag=True, help="As fast as it goes, instead of real time; for --keys.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object as the last line of stdout.")
@click.pass_context
def drive(ctx: click.Context, /, **settings: Any) -> int:
    """Drive the robot: w or ↑ forward, s or ↓ back, a or ← left, d or → right, space stop, x end."""
    path: Path | None = settings["map_to"]
    if path is not None and not path.resolve().parent.is_dir():
        raise click.UsageError(f"--map-to {path}: there is no folder {path.resolve().parent}")
    try:
        keys: Keys = Terminal() if settings["keys"] is None else script(settings["keys"])
    except KeyInputError as fault:
        raise click.UsageError(f"--keys: {fault}" if settings["keys"] is not None else str(fault)) from fault
    gathered = require_resources(ctx, settings, (Robot,))
    robot = next(one for one in gathered.resources if isinstance(one, Robot))
    mapper = _mapper(robot) if path is not None else None
    driving = KeyDrive(robot, keys)
    made: dict[str, object] = {}

    def end() -> None:
        if mapper is not None and path is not None:
            made["map"] = _save(mapper, path)

    with ExitStack() as attached:
        if isinstance(keys, Terminal):
            attached.enter_context(keys)
            click.echo(HELP, err=True)
        shown = [] if mapper is None else [mapper]
        done = run_program("Drive", gathered, settings, end, shown=shown, goes_on=driving.step)
    told = {"time_s": round(done.seconds, 3), **made, **done.report}
    if settings["as_json"]:
        click.echo(json.dumps(told, ensure_ascii=False))
    return done.code


def _mapper(robot: Robot) -> "Mapper":
    """A mapper on the robot's schedule, with the transforms that it needs."""
    try:
        from btcore_robot.navigation.mapping.mapper import Mapper
    except ModuleNotFoundError as missing:
        raise click.UsageError(
            f"maps need the module '{missing.name}'; you can have it: pip install 'btcore[robot]'"
        ) from missing
    from btcore_robot.transforms import FrameBroadcaster, TransformTree

    tree = TransformTree()
    frames = FrameBroadcaster(robot, tree)
    frames.step(robot.clock.now())
    mapper = Mapper(robot, tree)
    robot.schedule.every(frames.RATE, Phase.TRANSFORMS, frames.step)
    robot.schedule.every(robot.laser.rate, Phase.LOCALISER, mapper.step)
    return mapper


def _save(mapper: "Mapper", path: Path) -> dict[str, object]:
    """Write the map, and say what is on it."""
    from btcore_robot.navigation.occupancy_map import MapError, save_map

    map = mapper.map()
    try:
        save_map(map, path)
    except MapError as fault:
        raise click.UsageError(str(fault)) from fault
    click.echo(
        f"{path}: {map.width} x {map.height} cells of {map.resolution:g} m, "
        f"made of {len(mapper.scans)} scans and {mapper.loops_closed} loops"
    )
    made = {"scans": len(mapper.scans), "loops": mapper.loops_closed}
    return {**made, "width": map.width, "height": map.height}
