"""The ROS entities of leaves end with the last tree that uses them."""

import gc
from typing import Any

import pytest

pytest.importorskip("rclpy")

import btcore
from btcore import Registry, Status, Tree
from btcore_ros2 import shared_entities
from btcore_ros2.leaves import RosSubscriber, register
from btcore_ros2.session import RosSession
from tests.ros2.conftest import LIMIT_S

PUBLISH = """<RosTopicPublish topic_name="{}" type="std_msgs/msg/{}" message='json:{{}}'
                              wait_for_subscriber_timeout="0"/>"""


@pytest.fixture
def _soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let unused entities end after some milliseconds."""
    monkeypatch.setattr(shared_entities, "CHECK_NS", 10_000_000)


class Hear(RosSubscriber):
    topic_name = "heard"
    message_type = "std_msgs/msg/String"

    def on_message(self, message: Any) -> bool:
        return message is None


def run(session: RosSession, body: str, **entries: object) -> Tree:
    """Return a tree that has succeeded."""
    nodes = Registry.standard()
    register(nodes)
    nodes.add(Hear)
    text = f'<root BTCPP_format="4"><BehaviorTree ID="T">{body}</BehaviorTree></root>'
    tree = btcore.loads(text, nodes=nodes, resources=[session], clock=session.clock)
    for key, value in entries.items():
        tree.blackboard[key] = value
    assert tree.tick_once() is Status.SUCCESS
    return tree


def entities(session: RosSession) -> int:
    return sum(1 for part in (session.node.publishers, session.node.subscriptions) for _ in part)


def test_dead_leaves_leave_no_objects(session: RosSession) -> None:
    def objects() -> int:
        gc.collect()
        # Without tuples, of which the collector forgets some.
        return sum(type(found) is not tuple for found in gc.get_objects())

    kept = [run(session, "<Hear/>") for _ in range(5)]
    before = objects()
    for _ in range(100):
        run(session, "<Hear/>")
    assert objects() - before < 20
    del kept


@pytest.mark.usefixtures("_soon")
def test_publishers_of_other_names_go(session: RosSession) -> None:
    before = entities(session)
    tree = run(session, PUBLISH.format("{name}", "String"), name="/first")
    for number in range(50):
        tree.blackboard["name"] = f"/name{number}"
        assert tree.tick_once() is Status.SUCCESS
    assert session.wait_for(lambda: entities(session) == before + 1, LIMIT_S)
    group = session.node.default_callback_group.entities
    assert sum(reference() is None for reference in group) <= 10


def test_topic_of_a_dropped_tree_can_have_another_type(session: RosSession) -> None:
    run(session, PUBLISH.format("/typed", "String"))
    run(session, PUBLISH.format("/typed", "Bool"))


@pytest.mark.usefixtures("_soon")
def test_tree_that_was_released_can_run_again(session: RosSession) -> None:
    before = entities(session)
    tree = run(session, "<Sequence><Hear/>" + PUBLISH.format("/again", "String") + "</Sequence>")
    assert entities(session) == before + 2
    session.entities.release(tree)
    assert session.wait_for(lambda: entities(session) == before, LIMIT_S)
    assert tree.tick_once() is Status.SUCCESS
    assert entities(session) == before + 2
