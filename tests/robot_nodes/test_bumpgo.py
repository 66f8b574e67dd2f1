"""Bump-and-go in the simulator, from the XML to a drive without collisions."""

import math
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

import btcore
from btcore import Registry, Status, Tree
from btcore_sim.faults import parse_fault
from btcore_sim.scene import load_scene
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World

TREES = Path(__file__).parents[2] / "trees"
TENTH = 100_000_000


@pytest.fixture
def nodes() -> Registry:
    made = Registry.standard()
    made.add_plugin("btcore_robot.leaves")
    return made


@pytest.fixture
def body(request) -> Iterator[SimulatedRobot]:
    world, *faults = request.param
    made = SimulatedRobot(World(load_scene(world), seed=4), faults=[parse_fault(text) for text in faults])
    yield made
    made.world.close()


def tick(tree: Tree, body: SimulatedRobot, seconds: float) -> None:
    for _ in range(round(seconds * 10)):
        tree.tick_once()
        body.world.wait_until(body.world.now() + TENTH, threading.Event())


@pytest.mark.parametrize(
    ("name", "body"), [("bumpgo", ["arena"]), ("bumpgo_wide", ["arena_boxes"])], indirect=["body"]
)
def test_the_robot_drives_for_a_minute_without_collisions(name: str, body: SimulatedRobot, nodes: Registry):
    tree = btcore.load(TREES / f"{name}.xml", nodes=nodes, resources=[body])
    tree.count_ticks()
    tick(tree, body, 60)
    assert (body.contacts.collisions, body.contacts.grazes) == (0, 0)
    assert body.distance > 5.0
    assert all(node.count_ticks().ticks > 0 for node in tree.nodes)


@pytest.mark.parametrize("body", [["arena_boxes", "laser:20-25"]], indirect=True)
def test_the_robot_stands_while_the_laser_fails_and_then_goes_on(body: SimulatedRobot, nodes: Registry):
    tree = btcore.load(TREES / "bumpgo_wide.xml", nodes=nodes, resources=[body])
    tick(tree, body, 21)
    stopped = body.true_pose()
    tick(tree, body, 4)
    still = body.true_pose()
    assert math.hypot(still.x - stopped.x, still.y - stopped.y) < 0.002
    assert abs(still.yaw - stopped.yaw) < 0.005
    before = body.distance
    tick(tree, body, 20)
    assert body.distance > before + 2.0
    assert body.contacts.events == []


@pytest.mark.parametrize("leaf", ["Forward", "Back", "TurnToFree"])
def test_the_robot_stops_within_a_second_of_a_laser_failure_in_any_leaf(leaf: str, nodes: Registry):
    """Run once to find out when the leaf is at work, and let the laser fail at that time in a second run."""
    seeing = SimulatedRobot(World(load_scene("arena_boxes"), seed=11))
    tree = btcore.load(TREES / "bumpgo_wide.xml", nodes=nodes, resources=[seeing])
    working = next(node for node in tree.nodes if node.id == leaf)
    ticks = 0
    while ticks < 10:
        tick(tree, seeing, 0.1)
        ticks = ticks + 1 if working.status is Status.RUNNING else 0
    moment = seeing.world.now() / 1e9
    seeing.world.close()

    blind = SimulatedRobot(
        World(load_scene("arena_boxes"), seed=11), faults=[parse_fault(f"laser:{moment}-{moment + 5}")]
    )
    tree = btcore.load(TREES / "bumpgo_wide.xml", nodes=nodes, resources=[blind])
    tick(tree, blind, moment)
    assert next(node for node in tree.nodes if node.id == leaf).status is Status.RUNNING
    tick(tree, blind, 1.0)
    assert blind.odometry().twist.v == pytest.approx(0.0, abs=0.002)
    assert blind.odometry().twist.w == pytest.approx(0.0, abs=0.005)
    place = blind.true_pose()
    tick(tree, blind, 4.0)
    assert math.hypot(blind.true_pose().x - place.x, blind.true_pose().y - place.y) < 0.002
    before = blind.distance
    tick(tree, blind, 15.0)
    assert blind.distance > before + 1.0
    assert blind.contacts.events == []
    blind.world.close()


@pytest.mark.parametrize("name", ["bumpgo", "bumpgo_wide"])
def test_the_model_in_the_file_equals_the_ports_of_the_leaves(name: str, nodes: Registry):
    """Groot shows the ports of the file's TreeNodesModel, which must be those of the leaves."""
    from lxml import etree

    models = etree.parse(str(TREES / f"{name}.xml")).getroot().find("TreeNodesModel")
    assert models is not None
    for model in models.iterchildren("*"):
        manifest = nodes.manifests[model.get("ID")]
        written = [(port.get("name"), float(port.get("default")), port.text) for port in model]
        known = [(port.name, float(port.default), port.description) for port in manifest.ports.values()]
        assert written == known
