"""Additions of a run to its world."""

import threading
from hashlib import sha256

from btcore_sim.events import parse_event
from btcore_sim.scenario import Scenario
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World
from btcore_sim.worlds import load_world_description

SECOND = 1_000_000_000


def trace(seed: int, seconds: int = 12) -> str:
    """Return a digest of every scan and true pose of a run with people, obstacles and events."""
    scenario = Scenario(3, 2, [parse_event("box:2-12"), parse_event("carry:8")])
    world = World(scenario.add_to(load_world_description("aws_house"), seed, 0.27), seed=seed)
    body = SimulatedRobot(world)
    events = scenario.begin(world, body, body.base_info.radius)
    seen = sha256()
    for tick in range(1, seconds * 10 + 1):
        body.drive(0.1, 0.1)
        world.wait_until(tick * SECOND // 10, threading.Event())
        seen.update(body.scan().ranges.tobytes())
        seen.update(repr((body.true_pose(), body.contacts.events)).encode())
    seen.update(repr(events.event_log).encode())
    world.close()
    return seen.hexdigest()


def test_the_same_seed_gives_the_same_bytes() -> None:
    assert trace(5) == trace(5)
    assert trace(5, 2) != trace(6, 2)


def test_an_empty_scenario_does_not_change_the_world() -> None:
    house = load_world_description("house")
    assert Scenario().add_to(house, 1, 0.27) is house
