"""Nav2's nodes on real servers and costmaps, for a robot on the floor of a walled hall."""

import threading

import numpy as np
import pytest

import btcore
from btcore import Registry, Status, Tree
from btcore.clock import NS_PER_S
from btcore.registry.outcome_grammar import LETTERS
from btcore_navigation import nodes as nav2_nodes
from btcore_navigation.costmap import GlobalCostmap
from btcore_navigation.planner import Planner, PlannerServer
from btcore_navigation.servers import Servers
from btcore_navigation.smoother import SmootherServer
from btcore_robot.occupancy_map import OccupancyMap
from btcore_robot.robot import Phase, Pose2D
from btcore_robot.transforms import TransformTree
from tests.conformance.recorded_cases import CallLog, RecordedAct
from tests.robot_nodes.navigation.conftest import NavigationRig, rig_on_floor

HALF = 5.0  # m from the middle of the hall to its walls
CELL = 0.05  # m


def hall() -> OccupancyMap:
    """Return a map of 10 m by 10 m with walls around, and an unknown corner beyond x = y = 4 m."""
    count = round(2 * HALF / CELL)
    cells = np.zeros((count, count), dtype=np.int8)
    cells[[0, -1], :] = cells[:, [0, -1]] = 100
    cells[-20:, -20:] = -1
    return OccupancyMap(cells, CELL, (-HALF, -HALF))


class TransformLocaliser:
    """A source of the robot's pose by odometry, on a map whose origin is the start of odometry."""

    def __init__(self, transforms: TransformTree) -> None:
        self.transforms = transforms
        self.is_confident = True
        self.is_searching = False
        self.searches = 0

    def pose(self) -> Pose2D | None:
        return self.transforms.lookup("map", "base_footprint").to_pose() if self.is_confident else None

    def step(self, now: int) -> None:
        """Do nothing: the pose is always known."""

    def reinitialise_global_localisation(self) -> None:
        self.searches += 1


class NodeRig:
    """A robot, its servers, and trees of Nav2's nodes and of leaves with planned results."""

    def __init__(self, navigation: NavigationRig) -> None:
        self.navigation = navigation
        self.robot = navigation.robot
        self.calls = CallLog()
        self.localiser = TransformLocaliser(navigation.transforms)
        self.costmap = GlobalCostmap(hall())
        self.compute_path = PlannerServer(Planner(self.costmap), self.localiser.pose)
        self.smooth_path = SmootherServer(self.compute_path.planner)
        self.servers = Servers(
            robot=navigation.robot,
            transforms=navigation.transforms,
            localiser=self.localiser,
            global_costmap=self.costmap,
            local_costmap=navigation.costmap,
            compute_path=self.compute_path,
            follow_path=navigation.follow_path,
            spin=navigation.spin,
            back_up=navigation.back_up,
            drive_on_heading=navigation.drive_on_heading,
            wait=navigation.wait,
            assisted_teleop=navigation.assisted_teleop,
            smooth_path=self.smooth_path,
        )
        self.robot.schedule.add_task(20.0, Phase.PLANNER, self.compute_path.step)
        self.robot.schedule.add_task(20.0, Phase.PLANNER, self.smooth_path.step)

    def tree(self, content: str, **entries: object) -> Tree:
        """Return a tree with the XML *content*, on a blackboard with *entries*."""
        nodes = Registry.standard()
        nav2_nodes.register(nodes)
        nodes.add(RecordedAct, ID="Act")
        text = f'<root BTCPP_format="4"><BehaviorTree ID="T">{content}</BehaviorTree></root>'
        tree = btcore.loads(text, nodes=nodes, resources=[self.servers, self.calls], clock=self.robot.clock)
        for key, value in entries.items():
            tree.blackboard[key] = value
        return tree

    def wait(self, seconds: float) -> None:
        """Advance the time without a tick."""
        self.robot.clock.wait_until(self.robot.clock.now() + round(seconds * NS_PER_S), threading.Event())

    def run(self, tree: Tree, seconds: float, hz: float = 100.0) -> Status:
        """Tick until the result is not RUNNING, or until the time is over."""
        status = tree.tick_exactly_once()
        end = self.robot.clock.now() + round(seconds * NS_PER_S)
        while status is Status.RUNNING and self.robot.clock.now() < end:
            self.wait(1.0 / hz)
            status = tree.tick_exactly_once()
        return status

    def letters(self, tree: Tree, count: int, every: float = 0.0) -> str:
        """Return *count* results as the letters of outcomes, below a parent that does not reset children."""
        letter_of = {status: letter for letter, status in LETTERS.items()}
        letters = ""
        for _ in range(count):
            letters += letter_of[tree.root.execute_tick()]
            if every:
                self.wait(every)
        return letters

    def move(self, x: float, y: float = 0.0, yaw: float = 0.0) -> None:
        """Move the robot together with its odometry, and take new readings."""
        self.robot.pose = Pose2D(x, y, yaw)
        self.wait(0.1)


@pytest.fixture
def rig() -> NodeRig:
    return NodeRig(rig_on_floor())


def act(name: str, outcomes: str) -> str:
    """Return the element of a mock action."""
    return f'<Act name="{name}" outcomes="{outcomes}"/>'


def restarting_leaf(name: str, outcomes: str) -> str:
    """Return a mock action that starts again when it is ticked after its end, as below a decorator."""
    return f"<Inverter><Inverter>{act(name, outcomes)}</Inverter></Inverter>"
