"""Draw the pictures of the guides to worlds with the renderer of the simulated camera.

``python docs/site/world_pictures.py docs/images/world_kinds.png`` draws an example of each kind of object
beside the robot; ``… docs/images/world_lobby.png lobby`` draws a whole world, and
``… docs/images/random_worlds.png office:1 office:2 home:1 home:2`` draws four worlds from above.
"""

import json
import math
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from btcore_robot.robot import CameraInfo
from btcore_sim.renderer import Renderer
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.visible_faces import VisibleFaces
from btcore_sim.world import World, world_extent
from btcore_sim.world_description import WorldDescription
from btcore_sim.worlds import load_world_description

FINER = 3  # each pixel is the mean of 3 x 3 pixels, for smooth edges
TILE = (300, 225)
EXAMPLES: tuple[dict[str, Any], ...] = (
    {
        "name": "crate",
        "kind": "box",
        "position": [0, 0],
        "size": [0.8, 0.5, 0.5],
        "yaw": 0.3,
        "color": "#b5793c",
    },
    {
        "name": "drum",
        "kind": "cylinder",
        "position": [0, 0],
        "radius": 0.3,
        "height": 0.9,
        "color": "#2f7f86",
    },
    {"name": "desk", "kind": "table", "position": [0, 0], "size": [1.4, 0.7, 0.74], "color": "#8a6a45"},
    {
        "name": "corner",
        "kind": "wall",
        "points": [[-1, -0.6], [0.8, -0.6], [0.8, 0.8]],
        "height": 1.2,
        "color": "#d9d4c7",
    },
    {
        "name": "counter",
        "kind": "polygon",
        "points": [[-1, -0.6], [0.8, -0.6], [0.8, 0.8], [0.3, 0.8], [0.3, -0.1], [-1, -0.1]],
        "height": 0.9,
        "color": "#7d5a86",
    },
    {
        "name": "office_door",
        "kind": "hinged_door",
        "position": [0, 0],
        "height": 1.6,
        "open": False,
        "color": "#8a6a45",
    },
    {"name": "entrance", "kind": "sliding_door", "position": [0, 0], "height": 1.6, "material": "glass"},
)
CRATE = {"name": "crate", "kind": "box", "position": [0, 0.5], "size": [0.5, 0.5, 0.5], "color": "#b5793c"}
PANE = {"name": "pane", "kind": "box", "position": [0, -0.3], "size": [1.6, 0.03, 1.2], "material": "glass"}
JAMBS = (
    {"name": "west", "kind": "wall", "points": [[-1.6, 0], [-0.45, 0]], "height": 1.6, "color": "#d9d4c7"},
    {"name": "east", "kind": "wall", "points": [[0.45, 0], [1.6, 0]], "height": 1.6, "color": "#d9d4c7"},
)
GROUND = {
    "name": "ground",
    "kind": "box",
    "position": [0, 0.1, -0.01],
    "size": [3.6, 3.0, 0.01],
    "color": "#a8adb2",
}
HALF_OPEN = 0.4
PLAN = (640, 520)
"""The size (pixels) of a world that is drawn from above."""
WAYPOINT = (30, 30, 200)


def draw(description: WorldDescription, size: tuple[int, int], span: float, up: float) -> NDArray[np.uint8]:
    """Return a picture (BGR) of a world with its robot, seen from the south.

    Args:
        description: The world. Its doors are drawn at `HALF_OPEN`.
        size: Width and height (pixels).
        span: The width (m) that the picture shows at the middle of the world.
        up: The angle (rad) of the view above the horizon.
    """
    leaves = {
        name: door.placed(_object(description, name), HALF_OPEN) for name, door in description.doors.items()
    }
    objects = tuple(leaves.get(item.name, item) for item in description.objects)
    world = World(replace(description, objects=objects, doors={}))
    body = SimulatedRobot(world, camera=None)
    visible = VisibleFaces(world, body.physics_body)
    width, height = (FINER * side for side in size)
    x0, y0, x1, y1 = world_extent(description) if description.waypoints else (-1.0, -1.0, 1.0, 1.0)
    away = 2.2 * span
    ahead = np.array((0.0, math.cos(up), -math.sin(up)))
    eye = np.array(((x0 + x1) / 2, (y0 + y1) / 2, 0.5)) - away * ahead
    right = np.array((1.0, 0.0, 0.0))
    focal = width * away / span
    lens = CameraInfo(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2, 0.1, 99.0, 1.0, "eye")
    axes = np.stack((right, np.cross(ahead, right), ahead), axis=1)
    rgb, _ = Renderer(lens).draw(visible.now(), visible.colors, eye, axes)
    world.close()
    picture: NDArray[np.uint8] = cv2.resize(rgb[:, :, ::-1], size, interpolation=cv2.INTER_AREA)
    return picture


def plan(description: WorldDescription) -> NDArray[np.uint8]:
    """Return a picture (BGR) of a world with its robot from above, with the names of its waypoints."""
    x0, y0, x1, y1 = world_extent(description)
    width, height = PLAN
    # The walls are nearer to the eye than the floor, and so appear larger.
    span = 1.15 * max(x1 - x0, (y1 - y0) * width / height)
    picture = draw(description, PLAN, span, math.radians(90))
    for name, (x, y) in description.waypoints.items():
        column = round(width / 2 + (x - (x0 + x1) / 2) * width / span)
        row = round(height / 2 - (y - (y0 + y1) / 2) * width / span)
        cv2.circle(picture, (column, row), 4, WAYPOINT, cv2.FILLED, cv2.LINE_AA)
        place = (column + 8, row - 6)
        cv2.putText(picture, name, place, cv2.FONT_HERSHEY_DUPLEX, 0.45, WAYPOINT, 1, cv2.LINE_AA)
    return picture


def plans(names: Sequence[str]) -> NDArray[np.uint8]:
    """Return a picture (BGR) of an even number of worlds from above, two in each row."""
    drawn = [plan(load_world_description(name)) for name in names]
    return np.vstack([np.hstack(drawn[row : row + 2]) for row in range(0, len(drawn), 2)])


def _object(description: WorldDescription, name: str) -> Any:
    return next(item for item in description.objects if item.name == name)


def kinds() -> NDArray[np.uint8]:
    """Return a picture (BGR) with a tile for each kind of object, and one for glass."""
    tiles: dict[str, list[dict[str, Any]]] = {str(example["kind"]): [example] for example in EXAMPLES}
    for kind in ("hinged_door", "sliding_door"):
        tiles[kind] += JAMBS
    tiles['"material": "glass"'] = [CRATE, PANE]
    drawn = []
    for name, objects in tiles.items():
        world = {"start": {"pose": [-1.15, 1.0, -0.8]}, "objects": [GROUND, *objects]}
        with tempfile.NamedTemporaryFile("w", suffix=".json", encoding="utf-8") as file:
            json.dump(world, file)
            file.flush()
            tile = draw(load_world_description(file.name), TILE, 4.2, math.radians(32))
        cv2.putText(tile, name, (8, 20), cv2.FONT_HERSHEY_DUPLEX, 0.55, (60, 50, 40), 1, cv2.LINE_AA)
        drawn.append(cv2.copyMakeBorder(tile, 2, 2, 2, 2, cv2.BORDER_CONSTANT, value=(255, 255, 255)))
    return np.vstack([np.hstack(drawn[:4]), np.hstack(drawn[4:])])


def main(target: str, *worlds: str) -> None:
    """Draw a picture into the file *target*: the kinds of objects, a world, or several worlds from above."""
    if not worlds:
        picture = kinds()
    elif len(worlds) == 1:
        picture = draw(load_world_description(worlds[0]), (900, 680), 11.8, math.radians(66))
    else:
        picture = plans(worlds)
    cv2.imwrite(target, picture, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    print(f"{target}: {Path(target).stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main(*sys.argv[1:])
