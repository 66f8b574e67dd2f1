"""What a camera can see of a world: every shape as coloured faces, where it is now."""

from collections.abc import Sequence

import numpy as np

from sim import faces
from sim.engine import pybullet
from sim.faces import Floats
from sim.model import Model
from sim.scene import Thing
from sim.world import World, extent

_KINDS = {pybullet.GEOM_BOX: "box", pybullet.GEOM_CYLINDER: "cylinder", pybullet.GEOM_SPHERE: "sphere"}
_THICK = 0.01  # m of floor


class Visible:
    """The faces of the floor, of all things and of the robot itself. Meshes of a URDF are left out."""

    def __init__(self, world: World, model: Model) -> None:
        self._world = world
        self._model = model
        still = [_standing(thing) for body, thing in world.bodies.items() if body not in world.movable]
        still.append(_floor(world))
        self._still = np.concatenate([one for one, _ in still])
        self._moved = [(body, *_shaped(world.bodies[body])) for body in world.movable]
        self._robot = _robot(world, model)
        painted = [*still, *(one[1:] for one in self._moved), *(one[1:] for one in self._robot)]
        self.colors = np.concatenate([np.tile(color, (len(shape), 1)) for shape, color in painted])
        """The colour (RGB, 0–255) of every face, shape ``(n, 3)``."""

    def now(self) -> Floats:
        """All faces in the frame of the world, shape ``(n, 4, 3)``; the robot's own are the last ones."""
        found = [self._still]
        for body, shape, _ in self._moved:
            place, turned = pybullet.getBasePositionAndOrientation(body, physicsClientId=self._world.client)
            found.append(faces.moved(shape, faces.matrix(turned), place))
        places: dict[int, tuple[Floats, Sequence[float]]] = {}
        for link, shape, _ in self._robot:
            if link not in places:
                place, turned = self._model.link_place(link)
                places[link] = faces.matrix(turned), place
            found.append(faces.moved(shape, *places[link]))
        return np.concatenate(found)


def _shaped(thing: Thing) -> tuple[Floats, Floats]:
    return faces.shape(thing.kind, thing.size), np.array(thing.color[:3], dtype=np.float64)


def _standing(thing: Thing) -> tuple[Floats, Floats]:
    shape, color = _shaped(thing)
    x, y, z = thing.position
    turned = faces.matrix((0.0, 0.0, np.sin(thing.yaw / 2), np.cos(thing.yaw / 2)))
    return faces.moved(shape, turned, (x, y, z + thing.size[2] / 2)), color


def _floor(world: World) -> tuple[Floats, Floats]:
    x0, y0, x1, y1 = extent(world.scene)
    shape = faces.box((x1 - x0, y1 - y0, _THICK))
    middle = ((x0 + x1) / 2, (y0 + y1) / 2, -_THICK / 2)
    return faces.moved(shape, np.eye(3), middle), np.array(world.scene.floor[:3], dtype=np.float64)


def _robot(world: World, model: Model) -> list[tuple[int, Floats, Floats]]:
    """The URDF's shapes: the link, the faces in its frame, and the colour."""
    found: list[tuple[int, Floats, Floats]] = []
    for one in pybullet.getVisualShapeData(model.number, physicsClientId=world.client):
        _, link, geometry, size, _, place, turned, color, *_ = one
        if geometry not in _KINDS:
            continue
        # The engine has a cylinder's length before its radius.
        sizes = (2 * size[1], 2 * size[1], size[0]) if geometry == pybullet.GEOM_CYLINDER else size
        shape = faces.moved(faces.shape(_KINDS[geometry], sizes), faces.matrix(turned), place)
        found.append((link, shape, 255.0 * np.array(color[:3], dtype=np.float64)))
    return found
