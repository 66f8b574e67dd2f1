"""The worlds by their names: bundled worlds, world files, maps, and random worlds."""

import itertools
import re
from pathlib import Path

from btcore.suggestions import did_you_mean
from btcore_robot.occupancy_map import MapError
from btcore_robot.waypoint_file import load_waypoints
from btcore_sim.errors import SimError
from btcore_sim.map_world import load_map_world, with_waypoints
from btcore_sim.random_world_kinds import KINDS
from btcore_sim.random_worlds import random_world
from btcore_sim.world_description import WorldDescription, read_world_description, world_names

__all__ = ["load_world_description"]

_RANDOM = re.compile(rf"({'|'.join(KINDS)}):(\d{{1,9}})")
_SUFFIXES = (".json", ".yaml", ".yml")
"""The suffixes of world files and of maps."""


def load_world_description(
    name: str, *, seed: int = 0, radius: float = 0.3, waypoints: Path | None = None
) -> WorldDescription:
    """Load the description of a world of any kind.

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
        >>> from btcore_sim.worlds import load_world_description
        >>> "recharge" in load_world_description("office:3").waypoints
        True
    """
    try:
        places = load_waypoints(waypoints) if waypoints is not None else None
    except MapError as error:
        raise SimError(str(error)) from error
    if _is_path(name) and not Path(name).exists():
        raise SimError(f"{name}: no such file{did_you_mean(Path(name).name, _files_beside(Path(name)))}")
    if Path(name).suffix in _SUFFIXES[1:]:
        return load_map_world(Path(name), seed, radius, places)
    match = _RANDOM.fullmatch(name)
    if match is None and not _is_path(name) and name not in world_names():
        raise SimError(_unknown_world(name))
    description = random_world(match[1], int(match[2])) if match else read_world_description(name)
    return description if places is None else with_waypoints(description, places)


def _is_path(name: str) -> bool:
    return Path(name).suffix in _SUFFIXES or Path(name).name != name


def _files_beside(path: Path) -> list[str]:
    """Return the names of the world files and maps in the folder of *path*, at most 500."""
    files = (file.name for file in path.parent.glob("*.*") if file.suffix in _SUFFIXES)
    return list(itertools.islice(files, 500))


def _unknown_world(name: str) -> str:
    """Return the message for a name that is neither a world nor a path."""
    seed = name.partition(":")[2]
    random_worlds = [f"{kind}:{seed if seed.isdecimal() else 1}" for kind in KINDS]
    hint = did_you_mean(name, [*world_names(), *random_worlds, *_files_beside(Path(name))])
    known = ", ".join([*world_names(), *(f"{kind}:N" for kind in KINDS)])
    return (
        f"there is no world '{name}': worlds are {known} (random; N is a number); "
        f"or use the path of a world file (JSON) or of a map (YAML){hint}"
    )
