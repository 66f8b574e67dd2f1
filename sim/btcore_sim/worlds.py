"""The worlds by their names: bundled worlds, world files, maps, and random worlds."""

import re
from pathlib import Path

from btcore_robot.navigation.occupancy_map import MapError
from btcore_robot.navigation.waypoint_file import load_waypoints
from btcore_sim.errors import SimError
from btcore_sim.map_world import load_map_world, with_waypoints
from btcore_sim.random_world_kinds import KINDS
from btcore_sim.random_worlds import random_world
from btcore_sim.scene import Scene, load_scene

__all__ = ["load_world"]

_RANDOM = re.compile(rf"({'|'.join(KINDS)}):(\d{{1,9}})")


def load_world(name: str, *, seed: int = 0, radius: float = 0.3, waypoints: Path | None = None) -> Scene:
    """Load a world of any kind.

    Args:
        name: The name of a bundled world, the path of a world file (JSON) or of a map (YAML), or `office:3`
            or `home:3` for a random world with the seed 3.
        seed: The seed of the run, for the random places on a map.
        radius: The radius (m) of the robot, for the random places on a map.
        waypoints: A YAML file with waypoints to use instead of the world's own.

    Returns:
        The world's description.

    Raises:
        SimError: The world is unknown, or a file is missing or invalid.

    Examples:
        >>> from btcore_sim.worlds import load_world
        >>> "recharge" in load_world("office:3").waypoints
        True
    """
    try:
        places = load_waypoints(waypoints) if waypoints is not None else None
    except MapError as error:
        raise SimError(str(error)) from error
    if Path(name).suffix in (".yaml", ".yml"):
        return load_map_world(Path(name), seed, radius, places)
    match = _RANDOM.fullmatch(name)
    scene = random_world(match[1], int(match[2])) if match else load_scene(name)
    return scene if places is None else with_waypoints(scene, places)
