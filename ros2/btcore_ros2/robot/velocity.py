"""Velocity commands on one topic per priority, as the multiplexer twist_mux expects them."""

import math
from collections.abc import Callable
from typing import Any

from btcore.clock import NS_PER_S
from btcore_robot.command_multiplexer import SOURCE_TIMEOUT, CommandMultiplexer
from btcore_robot.robot import BaseInfo, Twist2D
from btcore_ros2.robot.description import VelocityTopics
from btcore_ros2.session import RosSession

STANDING = Twist2D(0.0, 0.0)


class VelocityCommands:
    """Publishes velocity commands, within the limits of the base, until they expire.

    A command goes to the topic with the highest priority that is not above the priority of the command. Two
    priorities may share a topic, so the priorities are enforced here as well as by the robot.

    Args:
        base: The limits of the base.
        publish: Publishes a command on a topic.
    """

    def __init__(
        self, topics: VelocityTopics, base: BaseInfo, publish: Callable[[str, Twist2D], None]
    ) -> None:
        self._base = base
        self._publish_on = publish
        self._topics = sorted(topics.topics, key=lambda topic: topics.topics[topic])
        self._priorities = topics.topics
        self._sources = CommandMultiplexer()
        self._command = STANDING
        self._stamp = -NS_PER_S
        self._timeout = round(base.command_timeout * NS_PER_S)
        self._moving: str | None = None
        """The topic of a command that has not expired."""
        self._used: dict[str, int] = {}

    @property
    def topic(self) -> str:
        """The topic of the lowest priority."""
        return self._topics[0]

    def send(self, v: float, w: float, priority: int, now: int) -> None:
        """Publish a command, unless a command of a higher priority arrived within the last 0.5 s.

        Args:
            v: The speed (m/s).
            w: The angular speed (rad/s).
            priority: The priority of the source.
            now: The time (ns).
        """
        if not self._sources.admits(priority, now):
            return
        self._command, self._stamp = Twist2D(v, w), now
        topic = self.topic
        for candidate in self._topics:
            if self._priorities[candidate] <= priority:
                topic = candidate
        self._moving = topic
        self._publish(topic, self._limited(v, w), now)

    def current(self, now: int) -> Twist2D:
        """Return the last accepted command, or zero if it has expired at *now* (ns)."""
        return self._command if now - self._stamp <= self._timeout else STANDING

    def expire(self, now: int) -> None:
        """Publish zero if the last command has expired at *now* (ns): not every base stops on its own."""
        if self._moving is not None and now - self._stamp > self._timeout:
            topic, self._moving = self._moving, None
            self._publish(topic, STANDING, now)

    def stop(self, now: int) -> None:
        """Publish zero on all topics with recent commands, or on that of the lowest priority.

        Args:
            now: The time (ns).
        """
        recent = [topic for topic, used in self._used.items() if now - used <= SOURCE_TIMEOUT]
        self._sources.clear()
        self._command, self._moving = STANDING, None
        for topic in recent or [self.topic]:
            self._publish(topic, STANDING, now)

    def finish(self, now: int) -> None:
        """Publish zero on all topics on which there were commands.

        Args:
            now: The time (ns).
        """
        for topic in tuple(self._used):
            self._publish(topic, STANDING, now)

    def _publish(self, topic: str, twist: Twist2D, now: int) -> None:
        self._used[topic] = now
        self._publish_on(topic, twist)

    def _limited(self, v: float, w: float) -> Twist2D:
        """Return a command within the limits of the base; the radius of the curve is kept."""
        base = self._base
        limit = base.v_max if v > 0.0 else -base.v_min
        scale = 1.0
        if abs(v) > limit:
            scale = limit / abs(v)
        if abs(w) * scale > base.w_max:
            scale = base.w_max / abs(w)
        return Twist2D(v * scale, w * scale)


class VelocityPublishers:
    """The publishers of velocity commands.

    Args:
        session: The ROS node.
        frame: The frame of stamped commands.
        stamp: Returns the present time of the robot as a message, for stamped commands.

    Attributes:
        kind: The class of the messages.
    """

    def __init__(
        self, session: RosSession, topics: VelocityTopics, frame: str, stamp: Callable[[], Any]
    ) -> None:
        from geometry_msgs.msg import Twist, TwistStamped

        self.message_class: type = TwistStamped if topics.type == "TwistStamped" else Twist
        self._stamped = topics.type == "TwistStamped"
        self._frame = frame
        self._time = stamp
        self._publishers = {
            topic: session.node.create_publisher(self.message_class, topic, 10) for topic in topics.topics
        }
        self._used: set[str] = set()

    def publish(self, topic: str, twist: Twist2D) -> None:
        """Publish *twist* on *topic*."""
        message: Any = self.message_class()
        velocity = message.twist if self._stamped else message
        velocity.linear.x, velocity.angular.z = twist.v, twist.w
        if self._stamped:
            message.header.frame_id = self._frame
            message.header.stamp = self._time()
        self._used.add(topic)
        self._publishers[topic].publish(message)

    def wait_for_subscribers(self) -> None:
        """Wait until the last messages were received."""
        from rclpy.duration import Duration

        for topic in self._used:
            self._publishers[topic].wait_for_all_acked(Duration(seconds=0.2))


def check_finite(v: float, w: float) -> None:
    """Raise ValueError if a command is not finite.

    Args:
        v: The speed (m/s).
        w: The angular speed (rad/s).

    Raises:
        ValueError: *v* or *w* is not finite.
    """
    if not (math.isfinite(v) and math.isfinite(w)):
        raise ValueError(f"the velocity command v={v} m/s, w={w} rad/s is not finite")
