"""Back, Turn and Forward: the book's tests (chapter 6.2) and further cases."""

import pytest

import btcore
from btcore import Registry, Status, Tree
from tests.robot_nodes.conftest import RecordingRobot

TENTH = 100_000_000


def tree_of(leaf: str, robot: RecordingRobot) -> Tree:
    nodes = Registry.standard()
    nodes.add_plugin("btcore_robot.leaves")
    text = f'<root main_tree_to_execute="T"><BehaviorTree ID="T"><Action ID="{leaf}"/></BehaviorTree></root>'
    return btcore.loads(text, nodes=nodes, resources=[robot])


def tick(tree: Tree, robot: RecordingRobot, times: int) -> Status:
    """Tick at 10 Hz until the result is not RUNNING, at most *limit* times."""
    status = Status.IDLE
    for _ in range(times):
        status = tree.tick_once()
        if status is not Status.RUNNING:
            break
        robot.clock.time += TENTH
    return status


@pytest.mark.parametrize(
    ("leaf", "times", "status", "direction"),
    [
        ("Turn", 100, Status.SUCCESS, (0, 1)),
        ("Back", 100, Status.SUCCESS, (-1, 0)),
        ("Forward", 30, Status.RUNNING, (1, 0)),
    ],
)
def test_a_leaf_sends_some_thirty_commands_in_its_direction(
    robot: RecordingRobot, leaf: str, times: int, status: Status, direction: tuple[int, int]
) -> None:
    assert tick(tree_of(leaf, robot), robot, times) is status
    assert len(robot.commands) == pytest.approx(30, abs=1)
    for speed, sign in zip(robot.commands[0], direction, strict=True):
        assert speed * sign > 0.1 if sign else speed == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize(
    ("leaf", "command"), [("Forward", (0.3, 0.0)), ("Back", (-0.3, 0.0)), ("Turn", (0.0, 0.5))]
)
def test_every_tick_commands_the_books_figure(
    robot: RecordingRobot, leaf: str, command: tuple[float, float]
) -> None:
    tick(tree_of(leaf, robot), robot, 10)
    assert robot.commands == [command] * 10


@pytest.mark.parametrize("leaf", ["Back", "Turn"])
def test_a_manoeuvre_takes_three_seconds_from_its_first_tick(robot: RecordingRobot, leaf: str) -> None:
    robot.clock.time = 7 * 10**9
    tree = tree_of(leaf, robot)
    assert tree.tick_once() is Status.RUNNING
    robot.clock.time = 10 * 10**9 - 1
    assert tree.tick_once() is Status.RUNNING
    robot.clock.time = 10 * 10**9
    assert tree.tick_once() is Status.SUCCESS


def test_a_manoeuvre_takes_its_whole_time_again_after_a_halt(robot: RecordingRobot) -> None:
    tree = tree_of("Turn", robot)
    tick(tree, robot, 20)
    tree.halt()
    assert tick(tree, robot, 25) is Status.RUNNING
    assert tick(tree, robot, 10) is Status.SUCCESS
