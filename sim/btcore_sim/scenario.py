"""Additions of a run to its world: people, obstacles that are not on the map, and events."""

from collections.abc import Sequence
from dataclasses import dataclass

from btcore_sim.clearance_map import ClearanceMap
from btcore_sim.events import Event, EventRunner, EventTarget, with_boxes
from btcore_sim.obstacles import with_obstacles
from btcore_sim.people import PeopleSimulation, with_people
from btcore_sim.scene import Scene
from btcore_sim.world import World, random_generator


@dataclass(frozen=True, slots=True)
class Scenario:
    """The number of *people* and *obstacles*, and the *events*."""

    people: int = 0
    obstacles: int = 0
    events: Sequence[Event] = ()

    def scene(self, scene: Scene, seed: int) -> Scene:
        """Return the scene with people, obstacles and the boxes of events.

        Args:
            scene: The world.
            seed: The seed of the random places.

        Raises:
            SimError: There is not enough room.
        """
        if self.obstacles:
            scene = with_obstacles(scene, self.obstacles, random_generator(seed, "obstacles"))
        if self.people:
            scene = with_people(scene, self.people, random_generator(seed, "people"))
        return with_boxes(scene, self.events) if self.events else scene

    def begin(self, world: World, robot: EventTarget, radius: float) -> EventRunner | None:
        """Start the people and the events.

        Args:
            world: The world, made from the result of `scene`.
            robot: The robot.
            radius: The robot's radius (m).

        Returns:
            The runner of the events, or None without people and events.
        """
        if not (self.people or self.events):
            return None
        floor = ClearanceMap.of(world.scene)
        people = PeopleSimulation(world, floor, robot.true_pose, radius)
        return EventRunner(world, robot, radius, self.events, floor, people.places)
