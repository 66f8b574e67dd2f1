"""A counter of the robot's contacts with other bodies: collisions (fast) and grazes (slow)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from btcore_sim.physics_body import TOUCH
from btcore_sim.quiet_pybullet import pybullet

COLLISION_SPEED = 0.1
"""Closing speed (m/s) along the contact's normal above which a contact is a collision, not a graze."""

MIN_SEPARATION_TIME = 500_000_000
"""How long (ns) two bodies have to be apart before their next touch counts as a new event."""


@dataclass(slots=True)
class Contact:
    """A contact of the robot with *body* (PyBullet's ID) from *first* to *last* (ns).

    *speed* (m/s) is the greatest closing speed.
    """

    body: int
    first: int
    last: int
    speed: float

    @property
    def is_collision(self) -> bool:
        """Whether the contact is a collision."""
        return self.speed > COLLISION_SPEED


Velocity = tuple[Sequence[float], Sequence[float], Sequence[float]]  # linear; angular; reference point


class ContactCounter:
    """A counter of the robot's collisions and grazes. Contacts with the *floor* do not count.

    A contact's speed is measured before the physics step that resolves it, because that step removes the
    speed.
    """

    def __init__(self, client: int, robot: int, floor: int) -> None:
        self.events: list[Contact] = []
        self._client = client
        self._robot = robot
        self._floor = floor
        self._links = list(range(pybullet.getNumJoints(robot, physicsClientId=client)))
        self._open: dict[int, Contact] = {}
        self._near: list[int] = []
        self._moving: dict[tuple[int, int], Velocity] = {}

    @property
    def collisions(self) -> int:
        """The number of contacts with a closing speed above `COLLISION_SPEED`."""
        return sum(event.is_collision for event in self.events)

    @property
    def grazes(self) -> int:
        """The number of contacts that are not collisions."""
        return len(self.events) - self.collisions

    def reset(self) -> None:
        """Forget all contacts. A contact that lasts is not counted again."""
        self.events.clear()

    def before_step(self, place: Sequence[float]) -> None:
        """Record the velocities of all bodies that may touch in the coming step.

        Args:
            place: The present position (m) of the robot's base link in the world frame.
        """
        self._moving.clear()
        linear, angular = pybullet.getBaseVelocity(self._robot, physicsClientId=self._client)
        self._moving[self._robot, -1] = (linear, angular, place)
        if self._near:
            states = pybullet.getLinkStates(self._robot, self._links, 1, physicsClientId=self._client)
            for link, state in zip(self._links, states, strict=True):
                self._moving[self._robot, link] = (state[6], state[7], state[0])
            for body in self._near:
                self._record_velocity(body)

    def after_step(self, now: int) -> None:
        """Register the contacts of the step that ended at *now* (ns)."""
        self._near.clear()
        for point in pybullet.getContactPoints(bodyA=self._robot, physicsClientId=self._client):
            # PyBullet's contact points: [2] is the other body, [8] the distance, negative for an overlap.
            body: int = point[2]
            if body == self._floor:
                continue
            if body not in self._near:
                self._near.append(body)
            if point[8] <= TOUCH:
                self._record(body, self._closing_speed(point), now)

    def _record(self, body: int, speed: float, now: int) -> None:
        contact = self._open.get(body)
        if contact is None or now - contact.last >= MIN_SEPARATION_TIME:
            contact = self._open[body] = Contact(body, now, now, speed)
            self.events.append(contact)
        contact.last = now
        contact.speed = max(contact.speed, speed)

    def _closing_speed(self, point: Any) -> float:
        """Return the closing speed (m/s) of two bodies at a contact point."""
        # PyBullet's getContactPoints: positions on robot and body, and the normal, which points at the robot.
        on_robot, on_body, normal = point[5], point[6], point[7]
        robot = self._velocity(self._robot, point[3], on_robot)
        body = self._velocity(point[2], point[4], on_body)
        speed: float = sum((b - a) * n for a, b, n in zip(robot, body, normal, strict=True))
        return speed

    def _velocity(self, body: int, link: int, at: Sequence[float]) -> tuple[float, float, float]:
        moving = self._moving.get((body, link)) or self._moving.get((body, -1))
        if moving is None:
            # The body was not near before the step. Either it stands still, or it is kinematic (mass 0 and
            # a velocity), and no contact changes its velocity.
            if pybullet.getDynamicsInfo(body, -1, physicsClientId=self._client)[0] > 0.0:
                return 0.0, 0.0, 0.0
            self._record_velocity(body)
            moving = self._moving[body, -1]
        (vx, vy, vz), (wx, wy, wz), middle = moving
        # Velocity of a point of a rigid body: v + w × r.
        x, y, z = (a - m for a, m in zip(at, middle, strict=True))
        return vx + wy * z - wz * y, vy + wz * x - wx * z, vz + wx * y - wy * x

    def _record_velocity(self, body: int) -> None:
        linear, angular = pybullet.getBaseVelocity(body, physicsClientId=self._client)
        place, _ = pybullet.getBasePositionAndOrientation(body, physicsClientId=self._client)
        self._moving[body, -1] = (linear, angular, place)
