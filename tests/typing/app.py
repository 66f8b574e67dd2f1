"""An app as a user writes it. Type checkers read it, but it is never run."""

from btcore import (
    Blackboard,
    In,
    Observer,
    Out,
    Put,
    Registry,
    SimClock,
    StatefulAction,
    Status,
    Transition,
    Tree,
    action,
    condition,
    loads,
)
from btcore.testing import Harness, assert_ran
from btcore_monitor.serve import serve
from btcore_robot.robot import Pose2D, Robot


@condition
def battery_ok(level: In[float], minimum: In[float] = 0.2) -> bool:
    """Whether *level* is at least *minimum*."""
    return level >= minimum


@action
def measure(robot: Robot, distance: Put[float]) -> bool:
    """Write how far the nearest obstacle ahead is (m)."""
    scan = robot.scan()
    if scan is None:
        return False
    distance(float(scan.ranges.min()))
    return True


class Approach(StatefulAction):
    """Drive for some ticks."""

    goal: In[str]
    ticks: Out[int]

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.count = 0

    def on_start(self) -> Status:
        self.count = len(self.goal)
        return Status.RUNNING

    def on_running(self) -> Status:
        self.count -= 1
        self.ticks = self.count
        return Status.RUNNING if self.count > 0 else Status.SUCCESS

    def on_halted(self) -> None:
        self.robot.stop()


class Printer(Observer):
    """Print every transition."""

    def transition(self, change: Transition) -> None:
        print(change.uid, change.status.name)


def make_tree(robot: Robot) -> Tree:
    """Return the tree for *robot*."""
    nodes = Registry.standard()
    nodes.add(battery_ok, measure, Approach)
    board = Blackboard()
    board["level"] = 0.9
    return loads("<BatteryOk level='{level}'/>", nodes=nodes, blackboard=board, resources=[robot])


def run(robot: Robot) -> Status:
    """Tick the tree of *robot*, published for the monitor, until it ends."""
    tree = make_tree(robot)
    tree.subscribe(Printer())
    with serve(tree, groot2_port=0):
        return tree.tick_while_running()


def remaining(board: Blackboard) -> float:
    """Return the ticks that are left, as a fraction of the level."""
    level: float = board.get("level", float)
    ticks: int | None = board.get("ticks", int, None)
    return level if ticks is None else ticks / level


def check(tree: Tree) -> None:
    """Drive *tree* in a harness."""
    harness = Harness(tree)
    harness.tick()
    assert_ran(harness.trace, "BatteryOk")


HOME = Pose2D(0.0, 0.0, 0.0)
CLOCK = SimClock()
