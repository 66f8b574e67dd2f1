"""What a run adds to a world: people, obstacles that its map doesn't have, and events."""

from collections.abc import Sequence
from dataclasses import dataclass

from sim.events import Carried, Event, Events, with_boxes
from sim.floor import Floor
from sim.obstacles import with_obstacles
from sim.scene import Scene
from sim.walkers import Walkers, with_people
from sim.world import World, generator


@dataclass(frozen=True, slots=True)
class Life:
    """How many *people* and *obstacles*, and which *events*."""

    people: int = 0
    obstacles: int = 0
    events: Sequence[Event] = ()

    def scene(self, scene: Scene, seed: int) -> Scene:
        """The scene with all of it, placed by *seed*; raises `SimError` when there is no room."""
        if self.obstacles:
            scene = with_obstacles(scene, self.obstacles, generator(seed, "obstacles"))
        if self.people:
            scene = with_people(scene, self.people, generator(seed, "people"))
        return with_boxes(scene, self.events) if self.events else scene

    def begin(self, world: World, robot: Carried, radius: float) -> Events | None:
        """Let people walk and events come in *world*, made from `scene`, around *robot* of *radius* (m)."""
        if not (self.people or self.events):
            return None
        floor = Floor.of(world.scene)
        walkers = Walkers(world, floor, robot.true_pose, radius)
        return Events(world, robot, radius, self.events, floor, walkers.places)
