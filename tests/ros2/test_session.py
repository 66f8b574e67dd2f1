"""The session takes messages on the thread of its caller."""

import pytest

pytest.importorskip("rclpy")

from std_msgs.msg import String

from btcore_ros2.session import RosSession


def test_message_arrives_while_the_clock_waits(session: RosSession) -> None:
    received: list[str] = []
    session.node.create_subscription(String, "words", lambda message: received.append(message.data), 10)
    with RosSession("other") as other:
        publisher = other.node.create_publisher(String, "words", 10)
        assert session.wait_for(lambda: publisher.get_subscription_count() > 0, 10)
        publisher.publish(String(data="hello"))
        assert session.wait_for(lambda: received, 10)
    assert received == ["hello"]
