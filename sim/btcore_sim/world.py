"""A simulated world: physics, a schedule of tasks, and a clock.

Simulated time advances only inside `World.wait_until`, always in the same steps. With *fast* the steps follow
each other without a pause; otherwise each step waits for the wall clock. Runs with the same seed are
identical, also in different processes. Several worlds in a process are independent.
"""

import math
import os
import sys
import threading
import time
import weakref
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np

from btcore.clock import NS_PER_S
from btcore_robot.robot import Phase
from btcore_robot.schedule import SimulatedSchedule
from btcore_sim.doors import MovingDoors
from btcore_sim.errors import SimError
from btcore_sim.quiet_pybullet import pybullet
from btcore_sim.world_description import Rectangle, WorldDescription, WorldObject

__all__ = ["World"]

SOLVER_ITERATIONS = 50
"""Iterations of the constraint solver (PyBullet's default).

With 50 iterations the driven distance is exact to 0.2 % at 240 steps a second, and to 0.4 % at 120.
"""

# Collision groups: two bodies collide if the group of each is in the mask of the other.
MOVABLE, STATIC, GROUND_LINK, FLOOR, HULL, GLASS = 1, 2, 4, 8, 16, 32

OBJECTS = MOVABLE | STATIC | GLASS
"""The collision groups of all objects of a world."""

_OPEN = 5.0  # m of visible floor around the start in a world without objects
_OVERLAP = 0.001  # m: bodies that overlap by less are considered to touch only
_MAX_LATENESS_NS = NS_PER_S // 5  # ns: a real-time run catches up after a delay of at most this duration


class World:
    """A world in its own physics engine. It is also a clock, with `now` and `wait_until`.

    Args:
        description: The description of the world.
        seed: The seed of all random generators.
        fast: False to run in real time.
        gui: Whether to open the physics engine's window.

    Attributes:
        schedule: The schedule of all tasks.
        client: The number of the connection to the physics engine.
        floor: The physics engine's number of the floor.

    Raises:
        SimError: The window cannot be opened.

    Examples:
        >>> import threading
        >>> from btcore_sim.simulated_robot import SimulatedRobot
        >>> from btcore_sim.world import World
        >>> from btcore_sim.worlds import load_world_description
        >>> world = World(load_world_description("arena"))
        >>> robot = SimulatedRobot(world, camera=None)
        >>> _ = world.wait_until(100_000_000, threading.Event())
        >>> world.now()
        100000000
        >>> world.close()
    """

    def __init__(
        self, description: WorldDescription, *, seed: int = 0, fast: bool = True, gui: bool = False
    ) -> None:
        self.description = description
        self.schedule = SimulatedSchedule(pace=None if fast else Pacer().wait)
        self._seed = seed
        self._before_callbacks: list[Callable[[int], None]] = []
        self._after_callbacks: list[Callable[[int], None]] = []
        self.client = _connect(gui)
        self._disconnect = weakref.finalize(self, pybullet.disconnect, self.client)
        engine = {"physicsClientId": self.client}
        pybullet.setGravity(0.0, 0.0, -9.81, **engine)
        self.rate = description.physics_rate
        """The number of physics steps per second."""
        pybullet.setTimeStep(1.0 / self.rate, **engine)
        # Without deterministicOverlappingPairs the order of contacts, and so the result, may differ.
        pybullet.setPhysicsEngineParameter(
            numSolverIterations=SOLVER_ITERATIONS, deterministicOverlappingPairs=1, **engine
        )
        self.floor = self._create_floor()
        self.bodies = {self._create_body(item): item for item in description.objects}
        """The objects of the world, by PyBullet's IDs of their bodies."""
        self._create_walls()
        self.movable = tuple(body for body, item in self.bodies.items() if not item.is_static)
        """PyBullet's IDs of the bodies that can move: by a push, or by `move_kinematic_body`."""
        self._doors = MovingDoors(self.client, description.doors, self.bodies, self.rate)
        self._has_robot = False
        self.schedule.add_task(self.rate, Phase.PHYSICS, self._step)

    def now(self) -> int:
        """Return the simulated time since the start (ns)."""
        return self.schedule.now()

    def wait_until(self, deadline: int, wake: threading.Event) -> bool:
        """Run the world until a deadline, or until an event is set.

        All tasks that are due at the deadline have run when the method returns.

        Args:
            deadline: The simulated time to run to (ns).
            wake: The event that ends the wait early.

        Returns:
            Whether *wake* is set.
        """
        return self.schedule.wait_until(deadline, wake)

    def random(self, purpose: str) -> np.random.Generator:
        """Return a random generator that depends only on the seed and *purpose*.

        Each purpose has its own generator. Drawing more numbers for a purpose does not change the numbers for
        other purposes.
        """
        return random_generator(self._seed, purpose)

    def add_step_callbacks(self, before: Callable[[int], None], after: Callable[[int], None]) -> None:
        """Register two callbacks that are called around every physics step with the simulated time (ns).

        Args:
            before: The callback that is called before the step.
            after: The callback that is called after the step.
        """
        self._before_callbacks.append(before)
        self._after_callbacks.append(after)

    def add_robot(self) -> None:
        """Record that a robot is in the world.

        Raises:
            SimError: The world has a robot already. The sensors and the contacts of two robots would not
                notice the other robot.
        """
        if self._has_robot:
            raise SimError(
                f"world '{self.description.name}' has a robot already, and robots would not notice each "
                "other: make another World for each robot"
            )
        self._has_robot = True

    def settle(self, seconds: float) -> None:
        """Run *seconds* (s) of physics without advancing the clock, so that bodies come to rest."""
        for _ in range(round(seconds * self.rate)):
            pybullet.stepSimulation(physicsClientId=self.client)

    def kinematic_bodies(self, prefix: str) -> list[int]:
        """Return PyBullet's IDs of the kinematic objects whose names begin with *prefix*, in their order."""
        return [
            body
            for body, item in self.bodies.items()
            if item.is_kinematic and item.name.startswith(prefix) and item.name not in self.description.doors
        ]

    def move_kinematic_body(
        self, body: int, x: float, y: float, yaw: float, *, z: float = 0.0, v: float = 0.0
    ) -> None:
        """Place a kinematic body, and set its velocity.

        Args:
            body: PyBullet's ID of the body.
            x: The x coordinate (m) of the middle of the body's underside.
            y: The y coordinate (m) of the middle of the body's underside.
            yaw: The heading (rad).
            z: The height (m) of the body's underside.
            v: The speed in the direction of the heading (m/s).
        """
        engine = {"physicsClientId": self.client}
        middle = [x, y, z + self.bodies[body].size[2] / 2]
        turned = [0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)]
        pybullet.resetBasePositionAndOrientation(body, middle, turned, **engine)
        # The engine moves a body without mass by its velocity, and no contact stops the body.
        speed = [v * math.cos(yaw), v * math.sin(yaw), 0.0]
        pybullet.resetBaseVelocity(body, speed, [0.0, 0.0, 0.0], **engine)

    def set_door(self, name: str, open: bool) -> None:
        """Open or close a door, in `doors.OPENING_TIME` seconds from its other end position.

        The door waits while the robot, a person or a movable object is in its way.

        Args:
            name: The name of the door, one of `WorldDescription.doors`.
            open: True to open the door, False to close it.

        Raises:
            SimError: The world has no door of this name.
        """
        self.description.door(name)
        self._doors.set(name, open)

    def door_opening(self, name: str) -> float:
        """Return how far a door is open at present, from 0 (closed) to 1 (open).

        Raises:
            SimError: The world has no door of this name.
        """
        self.description.door(name)
        return self._doors.opening(name)

    def door_leaves(self) -> list[WorldObject]:
        """Return all leaves of doors at their present poses, and moving leaves at their next poses too."""
        return self._doors.leaves()

    def door_leaves_of(self, name: str, open: bool) -> list[WorldObject]:
        """Return the leaf of a door at its present pose, and the poses that it would have while it moves.

        Args:
            name: The name of the door, one of `WorldDescription.doors`.
            open: Whether the door would open.

        Raises:
            SimError: The world has no door of this name.
        """
        self.description.door(name)
        return self._doors.leaves_of(name, open)

    def door_distance(self, x: float, y: float) -> float:
        """Return the distance (m) from a point to the nearest leaf of a door at present; inf without doors.

        Args:
            x: The x coordinate of the point in the world frame (m).
            y: The y coordinate of the point in the world frame (m).
        """
        return self._doors.distance(x, y)

    def overlapping(self, body: int) -> str | None:
        """Return what overlaps a kinematic body at its present pose: an object's name, "the robot" or None.

        Args:
            body: PyBullet's ID of the body.
        """
        engine = {"physicsClientId": self.client}
        low, high = pybullet.getAABB(body, **engine)
        near = {number for number, _ in pybullet.getOverlappingObjects(low, high, **engine) or ()}
        for other_body in sorted(near - {body, self.floor}):
            points = pybullet.getClosestPoints(body, other_body, 0.0, **engine)
            # Element 8 is the distance, negative for an overlap.
            if any(point[8] < -_OVERLAP for point in points):
                return f"'{self.bodies[other_body].name}'" if other_body in self.bodies else "the robot"
        return None

    def close(self) -> None:
        """Disconnect from the engine. The world cannot be used afterwards; a second call does nothing."""
        self._disconnect()

    def _step(self, now: int) -> None:
        for call in self._before_callbacks:
            call(now)
        self._doors.step()
        pybullet.stepSimulation(physicsClientId=self.client)
        for call in self._after_callbacks:
            call(now)

    def _create_floor(self) -> int:
        engine = {"physicsClientId": self.client}
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, **engine)
        # A plane has no visible surface, so a flat box is added for the renderers.
        x0, y0, x1, y1 = world_extent(self.description)
        tile = pybullet.createVisualShape(
            pybullet.GEOM_BOX,
            halfExtents=[(x1 - x0) / 2, (y1 - y0) / 2, 0.005],
            visualFramePosition=[(x0 + x1) / 2, (y0 + y1) / 2, -0.005],
            rgbaColor=[part / 255 for part in self.description.floor],
            **engine,
        )
        floor: int = pybullet.createMultiBody(0.0, plane, tile, **engine)
        pybullet.changeDynamics(floor, -1, lateralFriction=1.0, rollingFriction=0.0, **engine)
        pybullet.setCollisionFilterGroupMask(floor, -1, FLOOR, MOVABLE | GROUND_LINK, **engine)
        return floor

    def _create_walls(self) -> None:
        engine = {"physicsClientId": self.client}
        for vertices, indices in (
            self.description.walls.meshes() if self.description.walls is not None else ()
        ):
            shape = pybullet.createCollisionShape(
                pybullet.GEOM_MESH,
                vertices=vertices,
                indices=indices,
                flags=pybullet.GEOM_FORCE_CONCAVE_TRIMESH,
                **engine,
            )
            body = pybullet.createMultiBody(0.0, shape, **engine)
            pybullet.setCollisionFilterGroupMask(body, -1, STATIC, MOVABLE | HULL, **engine)

    def _create_body(self, item: WorldObject) -> int:
        engine = {"physicsClientId": self.client}
        color = [part / 255 for part in item.color]
        hull: dict[str, Any]
        if item.kind == "box":
            shape_type, hull = pybullet.GEOM_BOX, {"halfExtents": [side / 2 for side in item.size]}
            drawn = hull
        elif item.kind == "cylinder":
            shape_type, hull = pybullet.GEOM_CYLINDER, {"radius": item.size[0] / 2, "height": item.size[2]}
            # PyBullet calls a cylinder's height "length" in a visual shape.
            drawn = {"radius": hull["radius"], "length": hull["height"]}
        else:
            corners, indices = prism_mesh(item)
            shape_type, drawn = pybullet.GEOM_MESH, {"vertices": corners, "indices": indices}
            # One body and one shape for a concave outline; the engine fills the convex hull of other meshes.
            hull = {**drawn, "flags": pybullet.GEOM_FORCE_CONCAVE_TRIMESH}
        shape = pybullet.createCollisionShape(shape_type, **hull, **engine)
        visual = pybullet.createVisualShape(shape_type, **drawn, rgbaColor=color, **engine)
        x, y, z = item.position
        turned = [0.0, 0.0, math.sin(item.yaw / 2), math.cos(item.yaw / 2)]
        middle = [x, y, z + item.size[2] / 2]
        # The engine then stores a still body as a rigid body instead of a multi-body, which each step would
        # update: with the 62 still bodies of the house, a step takes a fifth less time.
        still = int(item.is_static)
        body: int = pybullet.createMultiBody(
            item.mass, shape, visual, middle, turned, useMaximalCoordinates=still, **engine
        )
        if item.mass > 0.0:
            group, mask = MOVABLE, OBJECTS | FLOOR | HULL
        else:
            group, mask = GLASS if item.is_glass else STATIC, MOVABLE | HULL
        pybullet.setCollisionFilterGroupMask(body, -1, group, mask, **engine)
        return body


class Pacer:
    """Synchronises simulated time with the wall clock.

    The simulation catches up after a delay of at most 0.2 s. A longer delay remains, so simulated time then
    stays behind the wall clock.
    """

    def __init__(self) -> None:
        self._offset: int | None = None
        self._warned = False

    def wait(self, now: int, until: int, wake: threading.Event) -> bool:
        """Wait until the wall clock reaches a simulated time, or an event is set.

        Args:
            now: The present simulated time (ns).
            until: The simulated time to wait for (ns).
            wake: The event that ends the wait early.

        Returns:
            Whether *wake* is set.
        """
        wall = time.monotonic_ns()
        if self._offset is None:
            self._offset = wall - now
        late = wall - self._offset - until
        if late < 0:
            return wake.wait(-late / NS_PER_S)
        if late > _MAX_LATENESS_NS:
            self._offset += late
            if not self._warned:
                self._warned = True
                print("the simulation is slower than real time", file=sys.stderr)
        return wake.is_set()


def random_generator(seed: int, purpose: str) -> np.random.Generator:
    """Return a random generator that depends only on *seed* and *purpose*.

    Args:
        seed: The seed of the run.
        purpose: A name for the use of the numbers, for example `laser`. Each purpose has its own numbers.
    """
    # CRC-32, because hash() of a string differs between processes.
    return np.random.default_rng([seed, zlib.crc32(purpose.encode())])


def world_extent(description: WorldDescription) -> Rectangle:
    """Return the bounding rectangle of a world (m). An empty world extends 5 m beyond its start area."""
    x0, y0, x1, y1 = description.area
    if description.walls is not None:
        return description.walls.known
    if not description.objects:
        return x0 - _OPEN, y0 - _OPEN, x1 + _OPEN, y1 + _OPEN
    outlines = [item.outline() for item in description.objects if not item.is_parked]
    lows, highs = [(x0, y0), *(box[:2] for box in outlines)], [(x1, y1), *(box[2:] for box in outlines)]
    return *map(min, zip(*lows, strict=True)), *map(max, zip(*highs, strict=True))


def prism_mesh(item: WorldObject) -> tuple[list[tuple[float, float, float]], list[int]]:
    """Return the surface of a prism around the middle of its extent.

    Returns:
        The corners (x, y, z in m), and three indices of corners for each triangle, counter-clockwise seen
        from outside.
    """
    half = item.size[2] / 2
    corners: list[tuple[float, float, float]] = []
    indices: list[int] = []
    for part in item.parts:
        first, count = len(corners), len(part)
        corners += [(x, y, -half) for x, y in part] + [(x, y, half) for x, y in part]
        for k in range(1, count - 1):
            indices += [first, first + k + 1, first + k]
            indices += [first + count, first + count + k, first + count + k + 1]
    for (x0, y0), (x1, y1) in item.sides():
        first = len(corners)
        corners += [(x0, y0, -half), (x1, y1, -half), (x1, y1, half), (x0, y0, half)]
        indices += [first, first + 1, first + 2, first, first + 2, first + 3]
    return corners, indices


def _connect(gui: bool) -> int:
    if gui and sys.platform == "linux" and not os.environ.get("DISPLAY"):
        # Without a display, PyBullet would end the process.
        raise SimError("the physics engine's window needs a display, but DISPLAY is not set")
    try:
        client: int = pybullet.connect(pybullet.GUI if gui else pybullet.DIRECT)
    except pybullet.error as error:
        raise SimError(f"cannot open the physics engine's window: {error}") from None
    if client < 0:
        raise SimError(
            "cannot open the physics engine's window: there is no display, or a window is already open"
        )
    return client
