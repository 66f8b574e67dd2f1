"""The motion of doors. A door stops in front of the robot, people and movable objects, and waits."""

import math
from collections.abc import Mapping

from btcore_sim.quiet_pybullet import pybullet
from btcore_sim.world_description import Door, WorldObject

OPENING_TIME = 3.0
"""Time (s) in which a door opens or closes."""

MARGIN = 0.1
"""Distance (m) from an obstacle at which a door stops that moves towards the obstacle."""

_STRIDE = 0.1  # greatest difference of opening between two poses of a moving leaf
_TOWARDS = 0.01  # m/s: a part of the door that moves more slowly towards an obstacle does not stop the door


class MovingDoors:
    """The doors of a world. `step` moves them; it is called before every physics step.

    Args:
        client: The number of the connection to the physics engine.
        doors: The doors by name.
        bodies: The objects of the world, by PyBullet's IDs of their bodies; the leaves of the doors are among
            them.
        rate: The number of physics steps per second.
    """

    def __init__(
        self, client: int, doors: Mapping[str, Door], bodies: Mapping[int, WorldObject], rate: int
    ) -> None:
        self._client = client
        self._step = 1.0 / (OPENING_TIME * rate)
        leaves = {item.name: body for body, item in bodies.items() if item.name in doors}
        self._doors = {name: _State(door, leaves[name], bodies[leaves[name]]) for name, door in doors.items()}
        self._leaves = frozenset(leaves.values())
        self._kinematic = frozenset(body for body, item in bodies.items() if item.is_kinematic)
        self._moving: dict[str, _State] = {}

    def set(self, name: str, open: bool) -> None:
        """Let a door move to its open or its closed position.

        Args:
            name: The name of the door.
            open: Whether the door opens.
        """
        state = self._doors[name]
        state.target = float(open)
        self._moving[name] = state

    def opening(self, name: str) -> float:
        """Return how far the door *name* is open, from 0 (closed) to 1 (open)."""
        return self._doors[name].opening

    def leaves(self) -> list[WorldObject]:
        """Return all leaves of doors at their present poses, and moving leaves at their next poses too."""
        return [leaf for state in self._doors.values() for leaf in state.leaves(state.target)]

    def leaves_of(self, name: str, open: bool) -> list[WorldObject]:
        """Return the leaf of a door at its present pose, and the poses that it would have while it moves.

        Args:
            name: The name of the door.
            open: Whether the door would open.
        """
        return self._doors[name].leaves(float(open))

    def distance(self, x: float, y: float) -> float:
        """Return the distance (m) from a point to the nearest leaf at its present pose; inf without doors.

        Args:
            x: The x coordinate of the point in the world frame (m).
            y: The y coordinate of the point in the world frame (m).
        """
        return min((state.leaf().distance(x, y) for state in self._doors.values()), default=math.inf)

    def step(self) -> None:
        """Set poses and velocities of the moving doors for the coming physics step."""
        for name, state in list(self._moving.items()):
            left = state.target - state.opening
            if abs(left) < self._step / 2:
                state.opening = state.target
                del self._moving[name]
                self._place(state, 0.0)
                continue
            direction = math.copysign(1.0, left)
            if self._blocked(state, direction):
                self._place(state, 0.0)
                continue
            self._place(state, direction)
            state.opening = min(max(state.opening + direction * self._step, 0.0), 1.0)

    def _place(self, state: "_State", direction: float) -> None:
        """Place a leaf at its opening; the physics step moves it in *direction* (+1 opens, -1 closes)."""
        leaf = state.door.leaf_pose(state.opening)
        middle = [leaf.x, leaf.y, state.item.size[2] / 2]
        turned = [0.0, 0.0, math.sin(leaf.yaw / 2), math.cos(leaf.yaw / 2)]
        engine = {"physicsClientId": self._client}
        pybullet.resetBasePositionAndOrientation(state.body, middle, turned, **engine)
        speed = direction / OPENING_TIME
        vx, vy = state.velocity(leaf.x, leaf.y, speed)
        pybullet.resetBaseVelocity(state.body, [vx, vy, 0.0], [0.0, 0.0, speed * state.door.swing], **engine)

    def _blocked(self, state: "_State", direction: float) -> bool:
        """Return whether an obstacle is near a part of the leaf that moves towards the obstacle."""
        engine = {"physicsClientId": self._client}
        low, high = pybullet.getAABB(state.body, -1, **engine)
        low, high = [edge - MARGIN for edge in low], [edge + MARGIN for edge in high]
        near = {body for body, _ in pybullet.getOverlappingObjects(low, high, **engine) or ()}
        for body in near - self._leaves:
            # The base of a robot and movable objects have a mass, people are kinematic; walls are neither.
            if pybullet.getDynamicsInfo(body, -1, **engine)[0] == 0.0 and body not in self._kinematic:
                continue
            # Elements of a point: [5] is its place on the leaf, [7] the direction from the body to the leaf.
            for point in pybullet.getClosestPoints(state.body, body, MARGIN, **engine):
                vx, vy = state.velocity(point[5][0], point[5][1], direction / OPENING_TIME)
                if -(vx * point[7][0] + vy * point[7][1]) > _TOWARDS:
                    return True
        return False


class _State:
    """A door with its leaf: how far it is open, and how far it is to be open, each from 0 to 1."""

    def __init__(self, door: Door, body: int, item: WorldObject) -> None:
        self.door = door
        self.body = body
        self.item = item
        self.opening = self.target = float(door.open)

    def leaf(self) -> WorldObject:
        """Return the leaf at its present pose."""
        return self.door.placed(self.item, self.opening)

    def leaves(self, target: float) -> list[WorldObject]:
        """Return the leaf at its present pose, and at further poses until it is open by *target* (0 to 1)."""
        steps = math.ceil(abs(target - self.opening) / _STRIDE)
        further = (self.opening + (target - self.opening) * step / steps for step in range(1, steps + 1))
        return [self.leaf(), *(self.door.placed(self.item, opening) for opening in further)]

    def velocity(self, x: float, y: float, speed: float) -> tuple[float, float]:
        """Return the velocity (m/s) of a point (x, y; m) of the leaf whose opening grows by *speed* (1/s)."""
        if self.door.swing:
            turn = speed * self.door.swing
            hinge_x, hinge_y = self.door.hinge
            return -turn * (y - hinge_y), turn * (x - hinge_x)
        along = speed * self.door.width
        return along * math.cos(self.door.yaw), along * math.sin(self.door.yaw)
