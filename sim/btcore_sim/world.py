"""A simulated world: physics, the schedule, and the clock that whoever waits on it drives forward.

Time is simulated: it moves only inside `World.wait_until`, step by step, and always over the same steps.
Unpaced (*fast*) these follow each other at once; in real time each waits for the wall clock. The same seed
gives the same run, in one process or in several; two worlds in one process do not meet.
"""

import math
import os
import sys
import threading
import time
import weakref
import zlib
from collections.abc import Callable

import numpy as np

from btcore_robot.robot import NS_PER_S, Phase
from btcore_robot.schedule import SimulatedTime
from btcore_sim.errors import SimError
from btcore_sim.quiet_pybullet import pybullet
from btcore_sim.scene import PHYSICS_RATE, Rectangle, Scene, SceneObject

__all__ = ["PHYSICS_RATE", "Pacer", "World", "random_generator", "scene_extent"]

SOLVER_ITERATIONS = 50
"""With these a base drives true to 0.2 % at 240 steps a second, and to 0.4 % at 120."""

# Collision groups: a pair collides when each one's group is in the other's mask.
MOVABLE, STATIC, GROUND_LINK, FLOOR, HULL = 1, 2, 4, 8, 16

_OPEN = 5.0  # m of floor that is drawn around the start in a scene without things
_PATIENCE = NS_PER_S // 5  # how late (ns) a run in real time may be before it slows down


class World:
    """A scene in a physics engine of its own. As a clock: `now`, `wait_until`."""

    def __init__(self, scene: Scene, *, seed: int = 0, fast: bool = True, gui: bool = False) -> None:
        self.scene = scene
        self.schedule = SimulatedTime(pace=None if fast else Pacer().wait)
        self._seed = seed
        self._before: list[Callable[[int], None]] = []
        self._after: list[Callable[[int], None]] = []
        self.client = _connect(gui)
        self._disconnect = weakref.finalize(self, pybullet.disconnect, self.client)
        engine = {"physicsClientId": self.client}
        pybullet.setGravity(0.0, 0.0, -9.81, **engine)
        self.rate = scene.physics_rate
        """Steps of the physics a second."""
        pybullet.setTimeStep(1.0 / self.rate, **engine)
        pybullet.setPhysicsEngineParameter(
            numSolverIterations=SOLVER_ITERATIONS, deterministicOverlappingPairs=1, **engine
        )
        self.floor = self._make_floor()
        self.bodies = {self._make(thing): thing for thing in scene.things}
        """Every thing of the scene by its body's number in the engine."""
        self.movable = tuple(body for body, thing in self.bodies.items() if not thing.still)
        """The bodies that can move: by a push, or by `move_kinematic_body`."""
        self.schedule.every(self.rate, Phase.PHYSICS, self._step)

    def now(self) -> int:
        """The simulated time (ns) since the start."""
        return self.schedule.now()

    def wait_until(self, deadline: int, wake: threading.Event) -> bool:
        """Run the world to *deadline* (ns), or until *wake* is set; whether it was set.

        Everything that is due at *deadline* has happened when this returns.
        """
        return self.schedule.wait_until(deadline, wake)

    def random(self, purpose: str) -> np.random.Generator:
        """A random generator that depends on seed and *purpose* alone, so that no use disturbs another."""
        return random_generator(self._seed, purpose)

    def around_steps(self, before: Callable[[int], None], after: Callable[[int], None]) -> None:
        """Call *before* and *after* with the time (ns) of every step of the physics."""
        self._before.append(before)
        self._after.append(after)

    def settle(self, seconds: float) -> None:
        """Let the physics come to rest for *seconds* (s) in which no time passes."""
        for _ in range(round(seconds * self.rate)):
            pybullet.stepSimulation(physicsClientId=self.client)

    def kinematic_bodies(self, prefix: str) -> list[int]:
        """The kinematic bodies whose objects' names begin with *prefix*, in the scene's order."""
        return [
            body
            for body, thing in self.bodies.items()
            if thing.is_kinematic and thing.name.startswith(prefix)
        ]

    def move_kinematic_body(
        self, body: int, x: float, y: float, yaw: float, *, z: float = 0.0, v: float = 0.0
    ) -> None:
        """Put a kinematic body at x, y, z (m) with heading *yaw* (rad); it goes on that way at *v* (m/s)."""
        engine = {"physicsClientId": self.client}
        middle = [x, y, z + self.bodies[body].size[2] / 2]
        turned = [0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)]
        pybullet.resetBasePositionAndOrientation(body, middle, turned, **engine)
        # The engine moves a body without mass by its velocity, and asks nothing in its way.
        speed = [v * math.cos(yaw), v * math.sin(yaw), 0.0]
        pybullet.resetBaseVelocity(body, speed, [0.0, 0.0, 0.0], **engine)

    def close(self) -> None:
        """Free the engine. The world can't be used afterwards; a second call does nothing."""
        self._disconnect()

    def _step(self, now: int) -> None:
        for call in self._before:
            call(now)
        pybullet.stepSimulation(physicsClientId=self.client)
        for call in self._after:
            call(now)

    def _make_floor(self) -> int:
        engine = {"physicsClientId": self.client}
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, **engine)
        # The renderers need a face to draw: a plane has none.
        x0, y0, x1, y1 = scene_extent(self.scene)
        tile = pybullet.createVisualShape(
            pybullet.GEOM_BOX,
            halfExtents=[(x1 - x0) / 2, (y1 - y0) / 2, 0.005],
            visualFramePosition=[(x0 + x1) / 2, (y0 + y1) / 2, -0.005],
            rgbaColor=[part / 255 for part in self.scene.floor],
            **engine,
        )
        floor: int = pybullet.createMultiBody(0.0, plane, tile, **engine)
        pybullet.changeDynamics(floor, -1, lateralFriction=1.0, rollingFriction=0.0, **engine)
        pybullet.setCollisionFilterGroupMask(floor, -1, FLOOR, MOVABLE | GROUND_LINK, **engine)
        return floor

    def _make(self, thing: SceneObject) -> int:
        engine = {"physicsClientId": self.client}
        color = [part / 255 for part in thing.color]
        if thing.kind == "box":
            half = [side / 2 for side in thing.size]
            shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half, **engine)
            visual = pybullet.createVisualShape(
                pybullet.GEOM_BOX, halfExtents=half, rgbaColor=color, **engine
            )
        else:
            radius, height = thing.size[0] / 2, thing.size[2]
            shape = pybullet.createCollisionShape(
                pybullet.GEOM_CYLINDER, radius=radius, height=height, **engine
            )
            visual = pybullet.createVisualShape(
                pybullet.GEOM_CYLINDER, radius=radius, length=height, rgbaColor=color, **engine
            )
        x, y, z = thing.position
        turned = [0.0, 0.0, math.sin(thing.yaw / 2), math.cos(thing.yaw / 2)]
        middle = [x, y, z + thing.size[2] / 2]
        body: int = pybullet.createMultiBody(thing.mass, shape, visual, middle, turned, **engine)
        if thing.mass > 0.0:
            pybullet.setCollisionFilterGroupMask(body, -1, MOVABLE, MOVABLE | STATIC | FLOOR | HULL, **engine)
        else:
            pybullet.setCollisionFilterGroupMask(body, -1, STATIC, MOVABLE | HULL, **engine)
        return body


class Pacer:
    """Holds simulated time to the wall clock; where that fails, time goes slower and skips nothing."""

    def __init__(self) -> None:
        self._offset: int | None = None
        self._warned = False

    def wait(self, now: int, moment: int, wake: threading.Event) -> bool:
        """Return at the simulated *moment* (ns), it being *now*, or when *wake* is set; whether it was."""
        wall = time.monotonic_ns()
        if self._offset is None:
            self._offset = wall - now
        late = wall - self._offset - moment
        if late < 0:
            return wake.wait(-late / NS_PER_S)
        if late > _PATIENCE:
            self._offset += late
            if not self._warned:
                self._warned = True
                print("the simulation can't keep up with real time, and goes slower", file=sys.stderr)
        return wake.is_set()


def random_generator(seed: int, purpose: str) -> np.random.Generator:
    """The random generator that a world of *seed* has for *purpose*."""
    return np.random.default_rng([seed, zlib.crc32(purpose.encode())])


def scene_extent(scene: Scene) -> Rectangle:
    """The rectangle (x and y from, x and y to, m) that holds the scene; in an empty one, some floor."""
    x0, y0, x1, y1 = scene.area
    if not scene.things:
        return x0 - _OPEN, y0 - _OPEN, x1 + _OPEN, y1 + _OPEN
    outlines = [thing.outline() for thing in scene.things if not thing.parked]
    lows, highs = [(x0, y0), *(one[:2] for one in outlines)], [(x1, y1), *(one[2:] for one in outlines)]
    return *map(min, zip(*lows, strict=True)), *map(max, zip(*highs, strict=True))


def _connect(gui: bool) -> int:
    if gui and sys.platform == "linux" and not os.environ.get("DISPLAY"):
        # The engine itself would end the process.
        raise SimError("the physics engine's window needs a display, and there is none: DISPLAY isn't set")
    try:
        client: int = pybullet.connect(pybullet.GUI if gui else pybullet.DIRECT)
    except pybullet.error as fault:
        raise SimError(f"the physics engine's window can't be opened: {fault}") from None
    if client < 0:
        raise SimError(
            "the physics engine's window can't be opened: there is no display, or one is open already"
        )
    return client
