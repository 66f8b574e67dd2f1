"""Bump-and-go in the simulator, from the XML to a drive without collisions."""

import math
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pybullet")

import btcore
from btcore import Registry, Status, Tree
from btcore.engine.node import start_tick_counts
from btcore_robot.robot import LaserScan
from btcore_sim.faults import Fault
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World
from btcore_sim.worlds import load_world_description

TREES = Path(__file__).parents[2] / "trees"
TENTH = 100_000_000


@pytest.fixture
def nodes() -> Registry:
    nodes = Registry.standard()
    nodes.add_plugin("btcore_robot.leaves")
    return nodes


@pytest.fixture
def body(request: pytest.FixtureRequest) -> Iterator[SimulatedRobot]:
    robot = SimulatedRobot(World(load_world_description(request.param), seed=4))
    yield robot
    robot.world.close()


def tick(tree: Tree, body: SimulatedRobot, seconds: float) -> None:
    for _ in range(round(seconds * 10)):
        tree.tick_once()
        body.world.wait_until(body.world.now() + TENTH, threading.Event())


@pytest.mark.parametrize("body", ["arena_boxes"], indirect=True)
def test_robot_stops_within_1_s_of_laser_failure_in_any_leaf(body: SimulatedRobot, nodes: Registry) -> None:
    tree = btcore.load(TREES / "bumpgo_wide.xml", nodes=nodes, resources=[body], clock=body.clock)
    for leaf in ("Forward", "Back", "TurnToFree"):
        node = next(node for node in tree.nodes if node.id == leaf)
        ticks = 0
        while ticks < 10:
            tick(tree, body, 0.1)
            ticks = ticks + 1 if node.status is Status.RUNNING else 0
        now = body.world.now()
        body.faults.faults = [Fault("laser", now, now + 5_000_000_000)]
        tick(tree, body, 1.0)
        assert body.odometry().twist.v == pytest.approx(0.0, abs=0.002)
        assert body.odometry().twist.w == pytest.approx(0.0, abs=0.005)
        stopped = body.true_pose()
        tick(tree, body, 4.0)
        still = body.true_pose()
        assert math.hypot(still.x - stopped.x, still.y - stopped.y) < 0.002
        assert abs(still.yaw - stopped.yaw) < 0.005
        before = body.distance
        tick(tree, body, 15.0)
        assert body.distance > before + 1.0
    assert body.contacts.events == []


@pytest.mark.parametrize("body", ["arena_boxes"], indirect=True)
def test_a_wrong_echo_does_not_let_the_robot_back_up(body: SimulatedRobot, nodes: Registry) -> None:
    """Its way back may not be free: it may just have turned."""
    tree = btcore.load(TREES / "bumpgo_wide.xml", nodes=nodes, resources=[body], clock=body.clock)
    tree.start_tick_counts()
    scan, wrong = body.scan, True

    def scan_with_dust() -> LaserScan | None:
        seen = scan()
        if seen is None or not wrong:
            return seen
        ranges = np.full_like(seen.ranges, math.inf)
        ranges[len(ranges) // 2] = 0.3
        return replace(seen, ranges=ranges)

    body.scan = scan_with_dust
    tick(tree, body, 0.1)
    wrong = False
    tick(tree, body, 0.5)
    ran = {node.id: start_tick_counts(node).ticks for node in tree.nodes}
    assert ran["Delay"] > 0
    assert ran["Back"] == 0
    assert ran["Forward"] > 0


@pytest.mark.parametrize("name", ["bumpgo", "bumpgo_wide"])
def test_the_model_in_the_file_equals_the_ports_of_the_leaves(name: str, nodes: Registry) -> None:
    """Groot shows the ports of the file's TreeNodesModel, which must be those of the leaves."""
    from lxml import etree

    models = etree.parse(str(TREES / f"{name}.xml")).getroot().find("TreeNodesModel")
    assert models is not None
    for model in models.iterchildren("*"):
        manifest = nodes.manifests[model.get("ID")]
        written = [(port.get("name"), float(port.get("default")), port.text) for port in model]
        known = [(port.name, float(port.default), port.description) for port in manifest.ports.values()]
        assert written == known
