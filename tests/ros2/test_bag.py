"""rclpy reads the messages in btcore's bags."""

from pathlib import Path

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("nav2_msgs")
pytest.importorskip("rosbags")

from nav2_msgs.msg import BehaviorTreeLog
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.rosbag2 import Reader
from std_msgs.msg import String

import btcore
from btcore.logs import open_log, read_log


def test_rclpy_reads_the_messages_of_a_bag(tmp_path: Path) -> None:
    b = btcore.Builder()
    tree = b.build(b.Sequence(b.AlwaysSuccess(name="a"), b.AlwaysSuccess(name="door"), name="both"))
    with open_log(tree, tmp_path / "run.mcap"):
        tree.tick_while_running()
    recording = read_log(tmp_path / "run.mcap")
    found = []
    with Reader(tmp_path / "run.mcap") as reader:
        for connection, stamp, data in reader.messages():
            kind = BehaviorTreeLog if connection.topic == "/behavior_tree_log" else String
            message = deserialize_message(data, kind)
            assert len(serialize_message(message)) == len(data)  # bytes between fields are arbitrary
            if kind is String:
                assert message.data == recording.xml
                continue
            assert stamp == message.timestamp.sec * 1_000_000_000 + message.timestamp.nanosec
            found += [
                (change.node_name, change.uid, change.previous_status, change.current_status)
                for change in message.event_log
            ]
    names = {1: "both", 2: "a", 3: "door"}
    assert found == [
        (names[change.uid], change.uid, change.previous.name, change.status.name)
        for change in recording.transitions
    ]
    assert len(found) == 7
