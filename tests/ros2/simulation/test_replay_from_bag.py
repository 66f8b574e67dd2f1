"""A run on `btcore ros2 sim` that was recorded in a bag gives the same commands on the bag."""

import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("pybullet")
pytest.importorskip("rosbags")

from rclpy.serialization import serialize_message
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

import btcore
from btcore.cli.node_libraries import NodeLibraries
from btcore.cli.tree_source import find_source
from btcore.clock import NS_PER_S
from btcore.errors import EndOfTimeError
from btcore_bags.reader import BagReader
from btcore_ros2.robot.bag_robot import BagRobot
from btcore_ros2.robot.description import load_robot
from btcore_ros2.robot.ros_robot import RosRobot
from btcore_ros2.robot.topic_report import type_name
from btcore_ros2.robot.topic_robot import TopicRobot
from btcore_ros2.session import RosSession
from btcore_ros2.simulation.lockstep import LockstepClock
from tests.ros2.conftest import LIMIT_S
from tests.ros2.simulation.process import SimProcess

SECONDS = 5
"""The length of the recorded run. The robot reaches an obstacle before."""


def record_messages(session: RosSession, writer: Writer) -> None:
    """Record what the ROS node takes and publishes from now on, at the times of the session's clock."""
    node: Any = session.node
    store, connections = get_typestore(Stores.ROS2_KILTED), {}
    create_subscription, create_publisher = node.create_subscription, node.create_publisher

    def write(name: str, message: Any) -> None:
        topic = session.node.resolve_topic_name(name)
        if topic not in connections:
            kind = type_name(type(message))
            connections[topic] = writer.add_connection(topic, kind, typestore=store)
        writer.write(connections[topic], session.clock.now(), serialize_message(message))

    def subscribe(kind: type, topic: str, callback: Callable[[Any], None], qos: Any, **settings: Any) -> Any:
        def receive(message: Any) -> None:
            write(topic, message)
            callback(message)

        return create_subscription(kind, topic, receive, qos, **settings)

    def advertise(kind: type, topic: str, qos: Any) -> Any:
        publisher = create_publisher(kind, topic, qos)
        publish = publisher.publish

        def record_and_publish(message: Any) -> None:
            write(topic, message)
            publish(message)

        publisher.publish = record_and_publish
        return publisher

    node.create_subscription, node.create_publisher = subscribe, advertise


def load_tree(robot: TopicRobot) -> btcore.Tree:
    """Return the tree *bumpgo* on *robot*."""
    resources = [robot, random.Random(0)]
    return btcore.load(
        find_source("bumpgo"), nodes=NodeLibraries([]).nodes, resources=resources, clock=robot.clock
    )


def test_recorded_run_gives_the_same_commands(start: Callable[..., SimProcess], tmp_path: Path) -> None:
    simulation = start("--world", "arena", "--lockstep", "--seed", "3")
    tiago = load_robot("tiago")
    with (
        Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer,
        RosSession() as session,
    ):
        session.clock = LockstepClock(session, LIMIT_S)
        record_messages(session, writer)
        with RosRobot(session, tiago) as robot:
            tree = load_tree(robot)
            end = robot.clock.now() + SECONDS * NS_PER_S
            while robot.clock.now() < end:
                tree.tick_exactly_once()
                tree.sleep(0.1)
            tree.halt()
    simulation.interrupt()
    with BagReader(next((tmp_path / "bag").glob("*.mcap"))) as reader:
        replayed = BagRobot(reader, tiago)
        again = load_tree(replayed)
        counts = again.start_tick_counts()
        with pytest.raises(EndOfTimeError):
            again.tick_while_running(0.1)
        report = replayed.compare_commands()
    commands = report["/cmd_vel"]
    assert isinstance(commands, dict)
    assert (commands["sent"], commands["recorded"]) == (10 * SECONDS, 10 * SECONDS)
    assert (commands["agree"], commands["largest_difference"]) == (10 * SECONDS, 0.0)
    assert next(count.ticks for path, count in counts.items() if path.startswith("Back")) > 0
