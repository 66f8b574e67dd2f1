"""The command `btcore map`, which writes a world's map in the file formats of nav2's map_server."""

from pathlib import Path

import click

from btcore_sim.completion import complete_world


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
    """Write the map of WORLD, a name or a JSON file, as YAML and PGM files for map_server.

    The map shows the static objects that a laser at the height of Tiago's laser detects. The laser detects
    only the legs of a table, so the outlines of tables are written to a keep-out file beside the map. The
    waypoints of the world are written to another file beside the map.
    """
    try:
        from btcore_robot.navigation.occupancy_map import MapError, save_map
        from btcore_robot.navigation.waypoint_file import save_waypoints, waypoints_path
        from btcore_sim.errors import SimError
        from btcore_sim.map_rasteriser import rasterise
        from btcore_sim.scene import load_scene
    except ModuleNotFoundError as missing:
        raise click.UsageError(
            f"maps need the module '{missing.name}', which is not installed: pip install 'btcore[sim]'"
        ) from missing
    try:
        scene = load_scene(world)
        map = rasterise(scene, resolution)
        output.mkdir(parents=True, exist_ok=True)
        path = output / f"{scene.name}.yaml"
        save_map(map, path)
        if scene.waypoints:
            save_waypoints(scene.waypoint_poses(), waypoints_path(path))
    except (SimError, MapError) as error:
        raise click.UsageError(str(error)) from error
    except OSError as error:
        raise click.UsageError(f"{error.filename}: cannot write the map: {error.strerror}") from error
    x, y = map.origin
    click.echo(
        f"{path} and {path.with_suffix('.pgm').name}: {map.width} x {map.height} cells of {resolution:g} m, "
        f"origin ({x:g}, {y:g}) m"
    )
    if map.keepout:
        click.echo(f"{path.with_name(f'{path.stem}.keepout.yaml')}: {len(map.keepout)} keep-out areas")
    if scene.waypoints:
        click.echo(f"{waypoints_path(path)}: {len(scene.waypoints)} waypoints")
