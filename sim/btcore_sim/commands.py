"""``btcore map``: the map of a world, in the files that map servers read."""

from pathlib import Path

import click


@click.command("map")
@click.argument("world")
@click.option(
    "-o",
    "--output",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path(),
    metavar="DIR",
    help="Where the files go.  [default: here]",
)
@click.option(
    "--resolution",
    type=click.FloatRange(min=0.005, max=1.0),
    default=0.05,
    show_default=True,
    metavar="METRES",
    help="The side of a cell.",
)
def map_command(world: str, output: Path, resolution: float) -> None:
    """Write the map of WORLD, a name or a JSON file, as map_server's YAML and PGM.

    On it is what a laser at the height of Tiago's sees and never moves. Tables, which it sees only the legs
    of, are rectangles in a file of keep-outs beside it.
    """
    try:
        from btcore_robot.navigation.occupancy_map import MapError, save_map
        from btcore_sim.errors import SimError
        from btcore_sim.map_rasteriser import rasterise
        from btcore_sim.scene import load_scene
    except ModuleNotFoundError as missing:
        raise click.UsageError(
            f"maps need the module '{missing.name}'; you can have it: pip install 'btcore[sim]'"
        ) from missing
    try:
        scene = load_scene(world)
        map = rasterise(scene, resolution)
        output.mkdir(parents=True, exist_ok=True)
        path = output / f"{scene.name}.yaml"
        save_map(map, path)
    except (SimError, MapError) as mistake:
        raise click.UsageError(str(mistake)) from mistake
    except OSError as fault:
        raise click.UsageError(
            f"{fault.filename}: the map can't be written there: {fault.strerror}"
        ) from fault
    x, y = map.origin
    click.echo(
        f"{path} and {path.with_suffix('.pgm').name}: {map.width} x {map.height} cells of {resolution:g} m, "
        f"from ({x:g}, {y:g}) m on"
    )
    if map.keepout:
        click.echo(f"{path.with_name(f'{path.stem}.keepout.yaml')}: {len(map.keepout)} places to keep out of")
