"""Two robots in one domain: with a namespace for each, their sessions share nothing."""

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("btcpp_ros2_interfaces")
pytest.importorskip("tf2_msgs")

from geometry_msgs.msg import TransformStamped
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

import btcore
from btcore import Status
from btcore_ros2.leaves import register
from btcore_ros2.nav2.pose_listener import PoseListener
from btcore_ros2.robot.topic_report import sees_others, takes
from btcore_ros2.session import RosSession
from btcore_ros2.tree_server import TreeServer
from tests.ros2.conftest import LIMIT_S

TREES = """
<root BTCPP_format="4"><BehaviorTree ID="Say"><Sequence>
  <Script code="@runs := 1"/>
  <RosTopicPublish topic_name="said" type="std_msgs/msg/String" message='json:{"data": "hello"}'
                   wait_for_subscriber_timeout="60000"/>
</Sequence></BehaviorTree></root>
"""
CALL = """
<root BTCPP_format="4"><BehaviorTree ID="Main">
  <RosActionCall action_name="/robot1/bt_execution" type="btcpp_ros2_interfaces/action/ExecuteTree"
                 goal='json:{"target_tree": "Say"}' wait_for_server_timeout="60000" server_timeout="60000"/>
</BehaviorTree></root>
"""
OF_ROS = {"/rosout", "/parameter_events"}
"""The topics of each ROS node."""


class NamespacedRobot:
    """A tree server and a listener of transforms in a namespace; both ROS nodes have the same name."""

    def __init__(self, namespace: str, trees: Path, nodes: btcore.Registry) -> None:
        self.session = RosSession("robot", arguments=["-r", f"__ns:={namespace}"])
        self.listener = PoseListener(self.session)
        self.server = TreeServer(self.session, [trees], nodes=nodes)

    def names(self) -> set[str]:
        """Return the names of the topics, services and actions."""
        node = self.session.node
        topics = {entity.topic_name for part in (node.publishers, node.subscriptions) for entity in part}
        return {*topics, *(service.service_name for service in node.services)} - OF_ROS

    @contextmanager
    def running(self) -> Iterator[None]:
        """Run the server in a thread."""
        thread = threading.Thread(target=self.server.run)
        thread.start()
        try:
            yield
        finally:
            self.server.stop()
            thread.join(LIMIT_S)
            self.server.close()
            self.session.close()


def test_robots_in_two_namespaces_share_nothing(session: RosSession, tmp_path: Path) -> None:
    trees = tmp_path / "say.xml"
    trees.write_text(TREES)
    nodes = btcore.Registry.standard()
    register(nodes)
    robots = [NamespacedRobot(namespace, trees, nodes) for namespace in ("/robot1", "/robot2")]
    first, second = robots
    assert {"/robot1/tf", "/robot1/tf_static", "/robot1/get_loaded_trees"} <= first.names()
    assert all(name.startswith("/robot1/") for name in first.names())
    assert all(name.startswith("/robot2/") for name in second.names())

    received: list[tuple[str, str]] = []

    def listen(topic: str) -> None:
        create = session.node.create_subscription
        create(String, topic, lambda message: received.append((topic, message.data)), 10)

    listen("/robot1/said")
    listen("/robot2/said")
    tf: Any = session.node.create_publisher(TFMessage, "/robot1/tf", 10)
    transform = TransformStamped(child_frame_id="base_link")
    transform.header.frame_id = "map"
    transform.transform.translation.x = 1.0
    transform.transform.rotation.w = 1.0
    with ExitStack() as stack:
        for robot in robots:
            stack.enter_context(robot.running())
        tree = btcore.loads(CALL, nodes=nodes, resources=[session], clock=session.clock)
        assert tree.tick_while_running(period=0.01) is Status.SUCCESS

        def moved() -> bool:
            tf.publish(TFMessage(transforms=[transform]))
            return first.listener.pose() is not None

        assert session.wait_for(moved, LIMIT_S)
        assert session.wait_for(lambda: received, LIMIT_S)
    assert received == [("/robot1/said", "hello")]
    assert first.server.blackboard["runs"] == 1
    assert "runs" not in second.server.blackboard
    assert second.listener.pose() is None


def test_rule_of_the_user_keeps_common_transforms() -> None:
    with RosSession("robot", arguments=["-r", "__ns:=/robot1", "-r", "/tf:=/tf"]) as session:
        node = session.node
        assert (node.resolve_topic_name("/tf"), node.resolve_topic_name("/tf_static")) == (
            "/tf",
            "/robot1/tf_static",
        )


def test_ros_node_of_the_same_name_in_another_namespace_is_another_node() -> None:
    with (
        RosSession("robot", arguments=["-r", "__ns:=/robot1"]) as first,
        RosSession("robot", arguments=["-r", "__ns:=/robot2"]) as second,
    ):
        second.node.create_subscription(String, "/common", lambda message: None, 10)
        assert first.wait_for(lambda: takes(first.node, "/common", String), LIMIT_S)
        assert first.wait_for(lambda: sees_others(first.node), LIMIT_S)
