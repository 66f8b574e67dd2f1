"""A ROS node for a tree: `RosSession` takes what has arrived, on the thread that ticks the tree."""

import os
import threading
import time
import warnings
from collections.abc import Callable, Sequence
from typing import Any

from btcore import SystemClock
from btcore_robot.robot import NS_PER_S, Phase
from btcore_robot.schedule import RealTime
from btcore_ros2.errors import RosError

FRESH_NS = 1_000_000
"""How old (ns) the last `drain` may be before `refresh` drains again."""

SHORT_WAIT_NS = 50_000_000
"""The time (ns) for which `wait_for` drains every 0.1 ms, and then every ms."""

DRAIN_RATE = 200.0
"""The rate (Hz) of `drain` while the tree waits for its next tick."""


MAX_DOMAIN = 232
"""The last domain of DDS. Those above 101 may share ports with other programs on Linux."""

CLOSE_S = 1.0
"""How long (s) `close` waits for unfinished work, such as a cancellation that was not acknowledged."""


class RosClock(SystemClock):
    """The monotonic clock of the machine. Waiting on it takes what arrives for the ROS node.

    Attributes:
        schedule: The periodic tasks that run while a caller waits on the clock.
    """

    def __init__(self, drain: Callable[[], None]) -> None:
        self.schedule = RealTime()
        self._drain = drain
        self.schedule.every(DRAIN_RATE, Phase.SENSORS, lambda now: drain())

    def wait_until(self, deadline: int, wake: threading.Event) -> bool:
        """Wait until *deadline* and run the tasks that become due; see `RobotClock.wait_until`."""
        woken = self.schedule.wait_until(deadline, wake)
        self._drain()
        return woken


class RosSession:
    """A ROS node in a context of its own, and the clock on which a tree waits while messages are taken.

    There is no executor thread: `drain` takes what has arrived and calls the callbacks, on the thread of its
    caller. Waiting on `clock` drains too, so that a tree that is run by `btcore run`, `tick_while_running` or
    `run` needs no call. Leaves call `refresh`, which covers programs that call `tick_once` on their own.

    Args:
        name: The name of the ROS node.
        arguments: Arguments in the form of `--ros-args`, for example `["-r", "scan:=/scan_raw"]`.
        domain: The domain (0 to 101); None = that of the environment.
        use_executor: Whether `drain` uses rclpy's executor, which is slower: 0.3 ms instead of 0.05 ms for
            ten subscriptions without a message. The default uses parts of rclpy that are not documented; if
            the installed version lacks them, the executor is used, with a warning.

    Attributes:
        context: The context of the ROS node.
        node: The ROS node.
        clock: The clock for the tree.
        shared: ROS entities that several leaves use, by type and name.
        unfinished: The work that `close` waits for, at most `CLOSE_S`. Each object removes itself.

    Raises:
        RosError: ROS 2 is not installed, the arguments are invalid, or there is no such domain.
    """

    def __init__(
        self,
        name: str = "btcore",
        *,
        arguments: Sequence[str] = (),
        domain: int | None = None,
        use_executor: bool = False,
    ) -> None:
        try:
            from rclpy.context import Context
            from rclpy.executors import SingleThreadedExecutor
            from rclpy.impl.implementation_singleton import rclpy_implementation
            from rclpy.node import Node
        except ModuleNotFoundError as missing:
            raise RosError(
                f"ROS 2 is not installed (no module '{missing.name}'): "
                "pip install 'btcore[ros2]', or source the setup file of your ROS 2"
            ) from missing
        _check_domain(str(domain) if domain is not None else os.environ.get("ROS_DOMAIN_ID") or "0")
        self.context = Context()
        # Without signal handlers, which are installed by rclpy.init() only: a last stop command can be sent
        # after Ctrl-C.
        ros_arguments = ["--ros-args", *arguments] if arguments else []
        try:
            self.context.init(args=ros_arguments, domain_id=domain)
            self.node: Node = Node(name, context=self.context)
        except rclpy_implementation.RCLError as error:
            reason, _, _ = str(error).partition(", at /")  # then places in the source of rcl
            raise RosError(f"ROS 2 cannot start: {reason}") from error
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._take = _take_function(self.node, self._executor, use_executor)
        self._draining = False
        self.clock = RosClock(self.drain)
        self.shared: dict[tuple[Any, ...], Any] = {}
        self.unfinished: set[object] = set()
        self._after_drain: list[Callable[[], None]] = []
        self._drained = 0

    def drain(self) -> None:
        """Take what has arrived, and call the callbacks; then call those of `after_drain`.

        A call within a callback has no effect. An exception in a callback is raised here; what has not been
        taken then is taken by the next call.
        """
        if self._draining:
            return
        self._draining = True
        try:
            self._take()
            for callback in tuple(self._after_drain):
                callback()
        finally:
            self._draining = False
        self._drained = time.monotonic_ns()

    def refresh(self) -> None:
        """Drain unless that happened within the last millisecond. Leaves call it at each tick."""
        if time.monotonic_ns() - self._drained > FRESH_NS:
            self.drain()

    def after_drain(self, callback: Callable[[], None]) -> Callable[[], None]:
        """Call *callback* after each drain, for work that goes on in the background.

        Returns:
            A function that ends the calls.
        """
        self._after_drain.append(callback)
        return lambda: self._after_drain.remove(callback)

    def wait_for(self, condition: Callable[[], Any], seconds: float) -> bool:
        """Drain until *condition* returns a true value, at most for *seconds* (s, real time).

        Args:
            condition: A function that returns whether to end the wait.
            seconds: The limit (s, real time).

        Returns:
            Whether the condition was met.
        """
        start = time.monotonic_ns()
        end = start + round(seconds * NS_PER_S)
        self.drain()
        while not condition():
            now = time.monotonic_ns()
            if now > end:
                return False
            # Most waits are short: those for a response of another process.
            time.sleep(0.0001 if now - start < SHORT_WAIT_NS else 0.001)
            self.drain()
        return True

    def close(self) -> None:
        """Destroy the ROS node and its context. Further calls have no effect."""
        if self.context.ok():
            self.wait_for(lambda: not self.unfinished, CLOSE_S)
            self._executor.shutdown()
            self.node.destroy_node()
            self.context.try_shutdown()

    def __enter__(self) -> "RosSession":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _check_domain(domain: str) -> None:
    """Raise a RosError for a domain that does not exist: Fast DDS would end the process."""
    if not (domain.isdecimal() and int(domain) <= MAX_DOMAIN):
        raise RosError(f"ROS_DOMAIN_ID: there is no domain {domain}, only 0 to {MAX_DOMAIN}")


def _take_function(node: Any, executor: Any, use_executor: bool) -> Callable[[], None]:
    """Return the function that takes what has arrived for *node*, which was added to *executor*."""
    from btcore_ros2.direct_take import DirectTake, missing_parts
    from btcore_ros2.executor_take import ExecutorTake

    if use_executor:
        return ExecutorTake(executor).take
    if missing := missing_parts():
        warnings.warn(
            f"this version of rclpy lacks {', '.join(missing)}: taking messages uses rclpy's executor, "
            "which is slower (RosSession(use_executor=True) hides this warning)",
            stacklevel=3,
        )
        return ExecutorTake(executor).take
    return DirectTake(node, executor).take
