"""The commands `btcore map`, which writes a world's map for Nav2, and `btcore world`, which makes a world."""

import json
from pathlib import Path
from typing import Any

import click

from btcore_sim.completion import complete_world
from btcore_sim.random_world_kinds import KINDS, MAX_ROOMS, ROOMS


@click.command("map")
@click.argument("world", shell_complete=complete_world)
@click.option(
    "-o",
    "--output",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path(),
    metavar="DIR",
    help="The output directory.  [default: the current directory]",
)
@click.option(
    "--resolution",
    type=click.FloatRange(min=0.005, max=1.0),
    default=0.05,
    show_default=True,
    metavar="METRES",
    help="The side length of a cell.",
)
def map_command(world: str, output: Path, resolution: float) -> None:
    """Write the map of WORLD as YAML and PGM files for map_server.

    WORLD is a name, a JSON file, or office:N or home:N for a random world.

    The map shows the static objects that a laser at the height of Tiago's laser detects. The laser detects
    only the legs of a table, so the outlines of tables are written to a keep-out file beside the map. The
    waypoints of the world are written to another file beside the map.
    """
    from btcore_robot.occupancy_map import save_map
    from btcore_robot.waypoint_file import save_waypoints, waypoints_path
    from btcore_sim.map_rasteriser import rasterise
    from btcore_sim.worlds import load_world_description

    try:
        description = load_world_description(world)
        map = rasterise(description, resolution)
        output.mkdir(parents=True, exist_ok=True)
        path = output / f"{description.name}.yaml"
        save_map(map, path)
        if description.waypoints:
            save_waypoints(description.waypoint_poses(), waypoints_path(path))
    except OSError as error:
        raise click.UsageError(f"{error.filename}: cannot write the map: {error.strerror}") from error
    x, y = map.origin
    click.echo(
        f"{path} and {path.with_suffix('.pgm').name}: {map.width} x {map.height} cells of {resolution:g} m, "
        f"origin ({x:g}, {y:g}) m"
    )
    if map.keepout:
        areas = "area" if len(map.keepout) == 1 else "areas"
        click.echo(f"{path.with_name(f'{path.stem}.keepout.yaml')}: {len(map.keepout)} keep-out {areas}")
    if description.waypoints:
        places = "waypoint" if len(description.waypoints) == 1 else "waypoints"
        click.echo(f"{waypoints_path(path)}: {len(description.waypoints)} {places}")


@click.command("world")
@click.argument("kind", type=click.Choice(KINDS))
@click.option(
    "--rooms",
    type=click.IntRange(2, MAX_ROOMS),
    default=ROOMS,
    show_default=True,
    metavar="N",
    help="The number of rooms; the corridor of an office is not counted.",
)
@click.option(
    "--seed",
    type=click.IntRange(0, 999_999_999),
    default=0,
    show_default=True,
    metavar="N",
    help="The seed: the same options make the same world.",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE.json",
    help="The file to write.  [default: office_SEED.json or home_SEED.json]",
)
def world_command(kind: str, rooms: int, seed: int, output: Path | None) -> None:
    """Make a random office or home with furniture, waypoints and a charger, as a file for --world.

    A robot of the size of Tiago can drive to all waypoints. With the default number of rooms, the world is
    the one that --world office:SEED or --world home:SEED names.
    """
    from btcore_sim.random_worlds import random_world_json

    path = output if output is not None else Path(f"{kind}_{seed}.json")
    try:
        world = random_world_json(kind, seed, rooms)
        path.write_text(_world_text(world), encoding="utf-8", newline="\n")
    except OSError as error:
        raise click.UsageError(f"{error.filename}: cannot write the world: {error.strerror}") from error
    click.echo(f"{path}: {world['description']}, {len(world['objects'])} objects")
    click.echo(f"waypoints: {', '.join(world['waypoints'])}")


def _world_text(world: dict[str, Any]) -> str:
    """Return the JSON text of a world, with an object in each line."""
    lines = [f"  {json.dumps(key)}: {json.dumps(value)}," for key, value in world.items() if key != "objects"]
    objects = ",\n".join(f"    {json.dumps(item)}" for item in world["objects"])
    return "\n".join(["{", *lines, '  "objects": [', objects, "  ]", "}", ""])
