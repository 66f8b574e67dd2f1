"""The trees for the exercises of the book's chapter 6: free space, distance from the goal, and boxes."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from tests.robot_nodes.conftest import RecordingRobot

pytest.importorskip("pybullet")

from btcore import Registry, Status, Tree, load, loads
from btcore.cli.main import main
from btcore_robot.components.lifecycle import Lifecycle, LifecycleState
from btcore_robot.leaves import LocateObjects, TurnToFree, register
from btcore_robot.leaves.drive import TURN_SPEED
from btcore_robot.perception.object_locator import BoundingBox3D

ROOT = Path(__file__).parents[2]
FREE_SPACE = ROOT / "trees/tutorials/free_space.xml"
RAYS = 41


def around(robot: RecordingRobot, left: float, ahead: float, right: float) -> None:
    """Return a scan of 41 rays over 4 rad: a third is *right* (m), a third *ahead* and a third *left*."""
    ranges = np.concatenate((np.full(13, right), np.full(15, ahead), np.full(13, left)))
    robot.see(*ranges, angle_min=-2.0, angle_increment=0.1)


def turning(robot: RecordingRobot, text: str = "<TurnToFree/>") -> Tree:
    nodes = Registry.standard()
    nodes.add(TurnToFree)
    return loads(
        f'<root BTCPP_format="4"><BehaviorTree ID="T">{text}</BehaviorTree></root>',
        nodes=nodes,
        resources=[robot],
        clock=robot.clock,
    )


@pytest.mark.parametrize(("left", "right", "side"), [(5.0, 1.0, 1), (1.0, 5.0, -1)])
def test_robot_turns_to_the_freer_side(robot: RecordingRobot, left: float, right: float, side: int) -> None:
    around(robot, left, 0.5, right)
    assert turning(robot).tick_once() is Status.RUNNING
    assert robot.commands == [(0.0, side * TURN_SPEED)]


def test_a_turn_keeps_its_side_and_ends_when_it_is_clear_ahead(robot: RecordingRobot) -> None:
    tree = turning(robot)
    around(robot, 5.0, 0.5, 1.0)
    tree.tick_once()
    around(robot, 1.0, 0.5, 5.0)
    tree.tick_once()
    assert robot.commands == [(0.0, TURN_SPEED)] * 2
    around(robot, 1.0, 2.0, 1.0)
    assert tree.tick_once() is Status.SUCCESS
    assert len(robot.commands) == 2


def test_obstacle_beside_clear_directions_but_in_lane_is_turned_away_from(
    robot: RecordingRobot,
) -> None:
    tree = turning(robot)
    around(robot, 5.0, 5.0, 0.5)
    assert tree.tick_once() is Status.RUNNING
    assert robot.commands == [(0.0, TURN_SPEED)]
    around(robot, 5.0, 5.0, 0.6)
    assert tree.tick_once() is Status.SUCCESS


def test_the_required_clearance_is_a_port(robot: RecordingRobot) -> None:
    around(robot, 0.6, 1.5, 0.6)
    assert turning(robot, '<TurnToFree clear="1.1"/>').tick_once() is Status.SUCCESS
    assert turning(robot, '<TurnToFree clear="1.6"/>').tick_once() is Status.RUNNING


def test_a_whole_turn_without_a_clear_direction_is_a_failure(robot: RecordingRobot) -> None:
    tree = turning(robot)
    around(robot, 0.5, 0.5, 0.5)
    ticks = 0
    while tree.tick_once() is Status.RUNNING:
        ticks += 1
        robot.clock.sleep(0.1)
    assert tree.status is Status.FAILURE
    assert ticks == pytest.approx(2 * math.pi / TURN_SPEED / 0.1, abs=2)


def test_without_a_scan_the_robot_stands(robot: RecordingRobot) -> None:
    assert turning(robot).tick_once() is Status.RUNNING
    assert robot.commands == [(0.0, 0.0)]


def test_an_enclosed_robot_searches_for_a_gap_and_then_fails(robot: RecordingRobot) -> None:
    nodes = Registry.standard()
    register(nodes)
    tree = load(FREE_SPACE, nodes=nodes, resources=[robot], clock=robot.clock)
    for _ in range(400):
        around(robot, 0.5, 0.5, 0.5)
        if tree.tick_once() is not Status.RUNNING:
            break
        robot.clock.sleep(0.1)
    assert tree.status is Status.FAILURE
    assert {v for v, _ in robot.commands} == {0.0}


class Locator(Lifecycle):
    """A locator whose boxes the test sets."""

    boxes: tuple[BoundingBox3D, ...] = ()


def test_locate_objects_writes_new_boxes_and_deactivates_on_halt(robot: RecordingRobot) -> None:
    locator = Locator()
    locator.configure()
    nodes = Registry.standard()
    nodes.add(LocateObjects)
    text = '<root BTCPP_format="4"><BehaviorTree ID="T"><LocateObjects boxes="{seen}"/></BehaviorTree></root>'
    tree = loads(text, nodes=nodes, resources=[locator], clock=robot.clock)
    assert tree.tick_once() is Status.RUNNING
    assert locator.state is LifecycleState.ACTIVE
    assert tree.blackboard["seen"] == []
    box = BoundingBox3D("map", (1.0, 2.0, 0.4), (0.3, 0.4, 0.8), 5)
    locator.boxes = (box,)
    tree.tick_once()
    assert tree.blackboard["seen"] == [box]
    tree.halt()
    assert locator.state is LifecycleState.INACTIVE


def run(*arguments: str | Path) -> dict:
    reported = ["run", *map(str, arguments), "--fast", "--json"]
    done = CliRunner().invoke(main, reported, prog_name="btcore")
    assert done.exit_code == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize("world", ["arena", "house"])
def test_the_free_space_tree_keeps_moving_without_collisions(world: str) -> None:
    robot = run("tutorials/free_space", "--world", world, "--camera", "off", "--duration", "40")["robot"]
    assert (robot["collisions"], robot["grazes"]) == (0, 0)
    assert robot["distance_m"] > 6.0


def test_the_robot_stops_a_metre_before_the_goal(tmp_path: Path) -> None:
    tree, parameters = tmp_path / "go.xml", tmp_path / "short.yaml"
    tree.write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="Go"><Move goal="-2.5;0.5"/></BehaviorTree></root>'
    )
    parameters.write_text(
        "bt_navigator:\n  ros__parameters:\n"
        "    default_nav_to_pose_bt_xml: navigate_to_pose_stopping_before_goal.xml\n"
    )
    done = run(tree, "--world", "house", "--camera", "off", "--duration", "60", "--nav-params", parameters)
    pose = done["robot"]["pose"]
    assert done["status"] == "SUCCESS"
    # The path ends a metre before the goal, and the goal checker accepts 0.25 m around its end.
    assert 0.9 < math.hypot(pose["x"] + 2.5, pose["y"] - 0.5) < 1.4


def test_objects_are_located_on_a_patrol() -> None:
    done = run("tutorials/patrolling_boxes", "--world", "house", "--duration", "3")
    ticks = {node["id"]: node["ticks"] for node in done["nodes"].values()}
    assert ticks["LocateObjects"] == ticks["TrackObjects"] == ticks["Move"] > 20
