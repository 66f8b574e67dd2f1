"""A clock that follows the topic `/clock`, for robots in a simulator."""

import threading
import time
from collections.abc import Callable
from typing import Any

from btcore.clock import NS_PER_S
from btcore_robot import time_limits
from btcore_robot.schedule import RealTimeSchedule
from btcore_ros2.errors import RosError
from btcore_ros2.robot.stamps import JUMP
from btcore_ros2.robot.topic_report import CLOCK_REMEDY
from btcore_ros2.session import RosSession

_MAX_WAIT_S = 0.001


class SimTime(RealTimeSchedule):
    """The time of the topic `/clock`, and the periodic tasks on it; ROS's `use_sim_time`.

    The time is 0 before the first message. Tasks run only while a thread waits in `wait_until`. A message
    that is older than an earlier one by at most `JUMP` is late, as over a bridge, and has no effect. While a
    paused simulation repeats its time, waiting goes on without a limit.

    Args:
        session: The ROS node.
        on_standstill: A function that is called with True when the time has not advanced for
            `time_limits.MAX_CLOCK_STANDSTILL_S`, and with False when it advances again.

    Attributes:
        offset: The time minus that of the topic (ns); 0 until `follow_jump` is called.
    """

    def __init__(self, session: RosSession, on_standstill: Callable[[bool], None]) -> None:
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from rosgraph_msgs.msg import Clock

        self._session = session
        self.offset = 0
        self._newest = self._now = 0
        self._advanced = self._heard = time.monotonic_ns()
        self._stands = False
        self._on_standstill = on_standstill
        self._jump = 0
        # Initialised before the base class, which reads the time.
        super().__init__()
        qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._subscription = session.node.create_subscription(
            Clock, "/clock", self._receive, qos, callback_group=session.callback_group
        )

    def now(self) -> int:
        """Return the newest time (ns) of the topic. It never decreases."""
        return self._now

    @property
    def has_started(self) -> bool:
        """Whether a message has arrived."""
        return self._now > 0

    def _receive(self, message: Any) -> None:
        self._newest = message.clock.sec * NS_PER_S + message.clock.nanosec
        now = self._newest + self.offset
        self._heard = time.monotonic_ns()
        if now < self._now - JUMP:
            self._jump = max(self._jump, self._now - now)
        elif now > self._now:
            self._now = now
            self._advanced = self._heard
            if self._stands:
                self._stands = False
                self._on_standstill(False)

    @property
    def has_jumped(self) -> bool:
        """Whether the time of the topic has jumped back."""
        return self._jump > 0

    def follow_jump(self) -> None:
        """After a jump of the topic, let the time go on from its present value."""
        if self._jump:
            self.offset = self._now - self._newest
            self._jump = 0

    def check(self) -> None:
        """Check that the time advances.

        Raises:
            RosError: The time jumped back, or no message has arrived for `time_limits.MAX_CLOCK_SILENCE_S`.
        """
        if self._jump:
            topic, seconds = self._subscription.topic_name, self._jump / NS_PER_S
            raise RosError(f"{topic} jumped back by {seconds:.1f} s: {self._cause(topic)}")
        now = time.monotonic_ns()
        if now - self._advanced > time_limits.MAX_CLOCK_STANDSTILL_S * NS_PER_S and not self._stands:
            self._stands = True
            self._on_standstill(True)
        silence = (now - self._heard) / NS_PER_S
        if silence > time_limits.MAX_CLOCK_SILENCE_S:
            raise RosError(
                f"{self._subscription.topic_name}: no message for {silence:.1f} s: the simulation has "
                "stopped or is paused, or the network is down"
            )

    def _cause(self, topic: str) -> str:
        """Return why the time has jumped back, and what to do."""
        from btcore_ros2.connection_checks import endpoint_name

        publishers = [endpoint_name(info) for info in self._session.node.get_publishers_info_by_topic(topic)]
        if len(publishers) > 1:
            return f"several ROS nodes publish it ({', '.join(publishers)}): {CLOCK_REMEDY}"
        name = publishers[0] if publishers else "no ROS node now"
        return f"the simulation was reset ({name} publishes it); run the tree again"

    def _sleep_until(self, until: int, wake: threading.Event) -> bool:
        before = self._now
        self._session.drain()
        self.check()
        if self._now >= until or self._now > before:
            return False
        return wake.wait(_MAX_WAIT_S)
