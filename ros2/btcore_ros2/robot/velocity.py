"""Velocity commands on one topic per priority, as the multiplexer twist_mux expects them."""

import math
from collections.abc import Callable
from typing import Any

from btcore_robot.command_multiplexer import SOURCE_TIMEOUT, CommandMultiplexer
from btcore_robot.robot import NS_PER_S, BaseInfo, Twist2D
from btcore_ros2.robot.description import VelocityTopics
from btcore_ros2.session import RosSession

STANDING = Twist2D(0.0, 0.0)


class VelocityCommands:
    """Publishes velocity commands, within the limits of the base, until they expire.

    A command goes to the topic with the highest priority that is not above the priority of the command. Two
    priorities may share a topic, so the priorities are enforced here as well as by the robot.

    Args:
        session: The ROS node.
        topics: The topics.
        base: The limits of the base.
        frame: The frame of stamped commands.
        stamp: Returns the present time of the robot as a message, for stamped commands.
    """

    def __init__(
        self,
        session: RosSession,
        topics: VelocityTopics,
        base: BaseInfo,
        frame: str,
        stamp: Callable[[], Any],
    ) -> None:
        from geometry_msgs.msg import Twist, TwistStamped

        self.kind: type = TwistStamped if topics.stamped else Twist
        self._stamped = topics.stamped
        self._frame = frame
        self._time = stamp
        self._base = base
        ordered = sorted(topics.priorities.items(), key=lambda entry: entry[1])
        self._publishers = [
            (priority, session.node.create_publisher(self.kind, topic, 10)) for topic, priority in ordered
        ]
        self._sources = CommandMultiplexer()
        self._command = STANDING
        self._stamp = -NS_PER_S
        self._timeout = round(base.command_timeout * NS_PER_S)
        self._moving: Any = None
        """The publisher of a command that has not expired."""
        self._used: dict[Any, int] = {}

    @property
    def topic(self) -> str:
        """The topic of the lowest priority."""
        name: str = self._publishers[0][1].topic_name
        return name

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
        publisher = self._publishers[0][1]
        for topic_priority, candidate in self._publishers:
            if topic_priority <= priority:
                publisher = candidate
        self._moving = publisher
        self._publish(publisher, self._limited(v, w), now)

    def current(self, now: int) -> Twist2D:
        """Return the last accepted command, or zero if it has expired at *now* (ns)."""
        return self._command if now - self._stamp <= self._timeout else STANDING

    def expire(self, now: int) -> None:
        """Publish zero if the last command has expired at *now* (ns): not every base stops on its own."""
        if self._moving is not None and now - self._stamp > self._timeout:
            publisher, self._moving = self._moving, None
            self._publish(publisher, STANDING, now)

    def stop(self, now: int) -> None:
        """Publish zero on all topics with recent commands, or on that of the lowest priority.

        Args:
            now: The time (ns).
        """
        recent = [publisher for publisher, used in self._used.items() if now - used <= SOURCE_TIMEOUT]
        self._sources.clear()
        self._command, self._moving = STANDING, None
        for publisher in recent or [self._publishers[0][1]]:
            self._publish(publisher, STANDING, now)

    def finish(self, now: int) -> None:
        """Stop the base if there were commands, and wait until the last message was received.

        Args:
            now: The time (ns).
        """
        if not self._used:
            return
        from rclpy.duration import Duration

        for publisher in tuple(self._used):
            self._publish(publisher, STANDING, now)
        for publisher in self._used:
            publisher.wait_for_all_acked(Duration(seconds=0.2))

    def _publish(self, publisher: Any, twist: Twist2D, now: int) -> None:
        message = self.kind()
        velocity = message.twist if self._stamped else message
        velocity.linear.x, velocity.angular.z = twist.v, twist.w
        if self._stamped:
            message.header.frame_id = self._frame
            message.header.stamp = self._time()
        self._used[publisher] = now
        publisher.publish(message)

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
