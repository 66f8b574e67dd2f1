"""The topics of the navigation and of its simulated robot have Nav2's types, QoS and contents."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("nav2_msgs")
pytest.importorskip("tf2_msgs")
pytest.importorskip("map_msgs")
pytest.importorskip("pybullet")

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PolygonStamped
from map_msgs.msg import OccupancyGridUpdate
from nav2_msgs.msg import Costmap, CostmapUpdate
from nav_msgs.msg import OccupancyGrid

from btcore.bundled_trees import folder
from btcore_navigation.parameters import GlobalCostmapParameters
from btcore_navigation.stack import Navigation
from btcore_robot.occupancy_map import OccupancyMap
from btcore_robot.robot import Pose2D
from btcore_ros2.errors import RosError
from btcore_ros2.interfaces import interface_name
from btcore_ros2.nav2 import navigation_topics
from btcore_ros2.nav2.navigation_topics import LATCHED, CostmapTopics, NavigationTopics
from btcore_ros2.nav2.served_navigation import ServedNavigation
from btcore_ros2.session import RosSession
from btcore_ros2.simulation.topics import RobotTopics
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World
from btcore_sim.worlds import load_world_description
from tests.ros2.conftest import LIMIT_S
from tests.ros2.nav2.rviz_displays import DISPLAYS

GLOBAL_NAMES = {"/clock", "/parameter_events", "/rosout"}
"""The names that all ROS nodes share, whatever their namespace."""

NAV2_OCCUPANCY = {0: 0, 1: 1, 128: 50, 252: 98, 253: 99, 254: 100, 255: -1}
"""Costs, and the occupancies that Costmap2DPublisher of Nav2 translates them to."""


@pytest.fixture
def navigation() -> Iterator[Navigation]:
    cells = np.zeros((80, 80), dtype=np.int8)
    cells[:, [10, 70]] = 100
    world = World(load_world_description("arena"))
    map = OccupancyMap(cells, 0.05, (-2.0, -2.0))
    yield Navigation(SimulatedRobot(world), map, np.random.default_rng(1), folder())
    world.close()


class CostmapClient:
    """The topics of a costmap, and what subscribers of a session have received from them."""

    def __init__(self, session: RosSession, navigation: Navigation, **parameters: Any) -> None:
        self.session, self.costmap = session, navigation.global_costmap
        settings = GlobalCostmapParameters(robot_radius=0.3, **parameters)
        self.topics = CostmapTopics(session.node, navigation, "global_costmap", settings, lambda: Time(sec=5))
        self.received: dict[str, list[Any]] = {}
        self.subscribe(OccupancyGrid, "costmap")
        self.subscribe(OccupancyGridUpdate, "costmap_updates")
        self.subscribe(Costmap, "costmap_raw")
        self.subscribe(CostmapUpdate, "costmap_raw_updates")
        self.subscribe(PolygonStamped, "published_footprint")
        sent = [each for each in session.node.publishers if "costmap/" in each.topic_name]
        assert session.wait_for(lambda: all(each.get_subscription_count() for each in sent), LIMIT_S)

    def subscribe(self, kind: type, name: str) -> None:
        self.received[name] = []
        self.session.node.create_subscription(
            kind, f"global_costmap/{name}", self.received[name].append, LATCHED
        )

    def publish(self, *names: str) -> list[Any]:
        """Publish the costmap, and return the only new message on each topic of *names*."""
        for messages in self.received.values():
            messages.clear()
        self.topics.publish(0)
        assert self.session.wait_for(lambda: all(self.received[name] for name in names), LIMIT_S)
        assert {name for name, messages in self.received.items() if messages} == set(names)
        return [message for name in names for message in self.received[name]]


def test_types_and_qos_are_those_of_nav2(session: RosSession, navigation: Navigation) -> None:
    NavigationTopics(session, navigation)
    publishers = {publisher.topic_name: publisher for publisher in session.node.publishers}
    found = {name: (interface_name(each.msg_type), each.qos_profile) for name, each in publishers.items()}
    for display in DISPLAYS:
        kind, qos = found[f"/{display.topic}"]
        expected = display.publisher.profile()
        assert kind.replace("/msg/", "/") == display.type
        assert (qos.reliability, qos.durability, qos.depth) == (
            expected.reliability,
            expected.durability,
            expected.depth,
        ), display.topic


def test_robots_in_two_namespaces_share_nothing(navigation: Navigation) -> None:
    with RosSession("robot", arguments=["-r", "__ns:=/robot1"]) as session:
        NavigationTopics(session, navigation)
        ServedNavigation(session, navigation)
        robot = navigation.robot
        assert isinstance(robot, SimulatedRobot)
        RobotTopics(session, robot)
        node = session.node
        of_node = (
            node.get_publisher_names_and_types_by_node,
            node.get_subscriber_names_and_types_by_node,
            node.get_service_names_and_types_by_node,
        )
        names = {name for get in of_node for name, _ in get("robot", "/robot1")}
    assert {name for name in names if not name.startswith("/robot1/")} == GLOBAL_NAMES
    assert {"/robot1/map", "/robot1/scan", "/robot1/spin/_action/send_goal", "/robot1/is_path_valid"} <= names


def test_whole_costmap_is_followed_by_what_changes(session: RosSession, navigation: Navigation) -> None:
    client = CostmapClient(session, navigation)
    costs = client.costmap.costs
    for column, cost in enumerate(NAV2_OCCUPANCY):
        costs[40, 30 + column] = cost
    grid, raw = client.publish("costmap", "costmap_raw")
    row = slice(40 * 80 + 30, 40 * 80 + 37)
    assert list(raw.data[row]) == list(NAV2_OCCUPANCY)
    assert list(grid.data[row]) == list(NAV2_OCCUPANCY.values())
    assert (grid.info.width, grid.info.height, grid.info.resolution) == (80, 80, pytest.approx(0.05))
    assert (grid.info.origin.position.x, grid.info.origin.position.y) == (-2.0, -2.0)
    assert (raw.metadata.size_x, raw.metadata.size_y, raw.metadata.layer) == (80, 80, "master")
    assert raw.metadata.origin == grid.info.origin
    client.publish()  # nothing has changed

    costs[10, 20], costs[15, 30] = 254, 253
    update, raw_update = client.publish("costmap_updates", "costmap_raw_updates")
    assert (update.x, update.y, update.width, update.height) == (20, 10, 11, 6)
    assert (raw_update.x, raw_update.y, raw_update.size_x, raw_update.size_y) == (20, 10, 11, 6)
    assert (np.reshape(raw_update.data, (6, 11)) == costs[10:16, 20:31]).all()
    assert (update.data[0], update.data[-1]) == (100, 99)
    for message in (grid, raw, update, raw_update):
        assert (message.header.frame_id, message.header.stamp.sec) == ("map", 5)

    # A costmap with another origin is published completely.
    client.costmap.origin = (-1.95, -2.0)
    client.publish("costmap", "costmap_raw")


def test_a_new_subscriber_receives_the_whole_costmap(session: RosSession, navigation: Navigation) -> None:
    client = CostmapClient(session, navigation)
    client.publish("costmap", "costmap_raw")
    client.costmap.costs[10, 20] = 254
    with RosSession("other") as other:
        grids: list[OccupancyGrid] = []
        other.node.create_subscription(OccupancyGrid, "global_costmap/costmap", grids.append, LATCHED)
        assert other.wait_for(lambda: grids, LIMIT_S)  # the costmap before the change
        client.publish("costmap", "costmap_raw")
        assert other.wait_for(lambda: grids[-1].data[10 * 80 + 20] == 100, LIMIT_S)


def test_always_send_full_costmap(session: RosSession, navigation: Navigation) -> None:
    client = CostmapClient(session, navigation, always_send_full_costmap=True)
    for _ in range(2):
        client.publish("costmap", "costmap_raw")


def test_without_map_msgs_the_whole_costmap_is_published(
    session: RosSession, navigation: Navigation, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(name: str, kind: str) -> None:
        raise RosError(f"the package of {name} is not installed")

    monkeypatch.setattr(navigation_topics, "load_interface", missing)
    client = CostmapClient(session, navigation)
    for _ in range(2):
        client.publish("costmap", "costmap_raw")


def test_footprint(session: RosSession, navigation: Navigation) -> None:
    client = CostmapClient(session, navigation)

    def outline(pose: Pose2D | None) -> list[tuple[float, float]]:
        client.topics.publish_footprint(lambda: pose, 0)
        assert session.wait_for(lambda: client.received["published_footprint"], LIMIT_S)
        message = client.received["published_footprint"].pop()
        assert (message.header.frame_id, message.header.stamp.sec) == ("map", 5)
        return [(point.x, point.y) for point in message.polygon.points]

    client.topics.publish_footprint(lambda: None, 0)
    circle = outline(Pose2D(1.0, 2.0, 0.5))
    assert len(circle) == 16
    assert np.hypot(*(np.array(circle) - (1.0, 2.0)).T) == pytest.approx(0.3)
    # Nav2's outline of a footprint is turned with the robot.
    client = CostmapClient(session, navigation, footprint="[[0.4, 0.1], [-0.2, 0.1], [-0.2, -0.1]]")
    turned = outline(Pose2D(1.0, 2.0, np.pi / 2))
    assert np.array(turned) == pytest.approx(np.array([[0.9, 2.4], [0.9, 1.8], [1.1, 1.8]]))
