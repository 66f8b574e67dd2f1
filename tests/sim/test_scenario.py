"""Additions of a run to its world, from the options of `btcore run` to the report."""

import threading
from hashlib import sha256
from typing import Any

import click
import pytest

from btcore_robot.occupancy_map import OccupancyMap
from btcore_robot.robot import Robot
from btcore_sim.events import parse_event
from btcore_sim.map_rasteriser import rasterise
from btcore_sim.run_extension import SimExtension
from btcore_sim.scenario import Scenario
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World
from btcore_sim.worlds import load_world_description

SECOND = 1_000_000_000
SETTINGS: dict[str, Any] = {"world": "house", "seed": 3, "fast": True, "camera": "off"}


def trace(seed: int, seconds: int = 12) -> str:
    """Return a digest of every scan and true pose of a run with people, obstacles and events."""
    scenario = Scenario(3, 2, [parse_event("box:2-12"), parse_event("carry:8")])
    world = World(scenario.add_to(load_world_description("aws_house"), seed, 0.27), seed=seed)
    body = SimulatedRobot(world)
    events = scenario.begin(world, body, body.base.radius)
    seen = sha256()
    for tick in range(1, seconds * 10 + 1):
        body.drive(0.1, 0.1)
        world.wait_until(tick * SECOND // 10, threading.Event())
        seen.update(body.scan().ranges.tobytes())
        seen.update(repr((body.true_pose(), body.contacts.events)).encode())
    seen.update(repr(events.event_log).encode())
    world.close()
    return seen.hexdigest()


def test_the_same_seed_gives_the_same_bytes():
    assert trace(5) == trace(5)
    assert trace(5, 2) != trace(6, 2)


def test_an_empty_scenario_does_not_change_the_world():
    house = load_world_description("house")
    assert Scenario().add_to(house, 1, 0.27) is house


def test_options_reach_the_world_and_events_the_report():
    extension = SimExtension()
    settings = {**SETTINGS, "people": 2, "obstacles": 1, "event": ("box:90-95", "kidnap:1")}
    resources = extension.provide(settings, [Robot])
    body = next(one for one in resources if isinstance(one, SimulatedRobot))
    names = [body.world.bodies[number].name for number in body.world.movable]
    assert names == ["obstacle_0", "person_0", "person_1", "dropped_box_0"]
    with extension.attach(object(), resources, settings):
        for tick in range(1, 21):
            body.drive(0.1, 0.0)
            body.clock.wait_until(tick * SECOND // 10, threading.Event())
    report: Any = extension.report()
    assert [(one["event"], one["t"]) for one in report["events"]] == [("kidnap", 1.0)]


def test_the_map_is_provided_on_request():
    (map,) = SimExtension().provide(SETTINGS, [OccupancyMap])
    assert isinstance(map, OccupancyMap)
    drawn = rasterise(load_world_description("house"))
    assert ((map.cells == drawn.cells).all(), map.keepout) == (True, drawn.keepout)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"event": ("bx:1",)}, "did you mean 'box'"),
        ({"world": "arena", "people": 100}, "no room for 100 people"),
        ({"world": "arena", "obstacles": 100}, "no room for 100 obstacles"),
    ],
)
def test_an_impossible_scenario_is_a_usage_error(changes: dict[str, Any], said: str):
    with pytest.raises(click.UsageError, match=said):
        SimExtension().provide({**SETTINGS, **changes}, [Robot])
