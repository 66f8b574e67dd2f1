"""Topics on which a running tree can be watched: `/behavior_tree_log`, `/diagnostics` and `/rosout`."""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final, Literal

from btcore import NodeExecutionError, Status, Transition, Transitions, Tree
from btcore.clock import NS_PER_MS, NS_PER_S
from btcore.logs.log import AttachedObserver
from btcore.suggestions import did_you_mean, join_names
from btcore_ros2.errors import RosError
from btcore_ros2.session import RosSession

__all__ = ["TOPICS", "RosTelemetry", "TelemetryTopic"]

TelemetryTopic = Literal["log", "diagnostics", "rosout"]
"""What is published: transitions, the state of the tree once per second, or log records and errors."""

TOPICS: Final[tuple[TelemetryTopic, ...]] = ("log", "diagnostics", "rosout")
"""The values of `TelemetryTopic`."""

PERIOD_S: Final = 1.0
"""The period (s) of `/diagnostics`."""

MAX_WAITING: Final = 1000
"""The maximum number of ticks, and of log records, that wait to be published. Older ones are dropped."""

CLOSE_S: Final = 0.5
"""How long (s) `RosTelemetry.close` waits until subscribers have received the last messages."""

_NAME: Final = "btcore_telemetry"

_OK: Final = b"\0"
_WARN: Final = b"\1"
_ERROR: Final = b"\2"


class RosTelemetry(AttachedObserver):
    """Publishes a tree on topics of ROS 2, on a thread and a ROS node of its own, until it is closed.

    A tick only appends to queues. If ROS is slower than the tree, the oldest transitions and records are
    dropped, and `/diagnostics` contains their number.

    - `log`: `/behavior_tree_log` (nav2_msgs/BehaviorTreeLog), a message for each tick with transitions, as
      from Nav2's navigator.
    - `diagnostics`: `/diagnostics` (diagnostic_msgs/DiagnosticArray) once per second: the state of the tree,
      the number and the rate of its ticks, their duration, and the last error with the path of its node. The
      level is ERROR after an error, and WARN if the tree is not ticked.
    - `rosout`: `/rosout` (rcl_interfaces/Log): records of Python's logging, which contain the paths of nodes,
      and errors of nodes.

    Args:
        tree: The tree to watch.
        topics: What is published.
        arguments: Arguments of the ROS node in the form of `--ros-args`.

    Raises:
        RosError: ROS 2 or the package of a message is not installed, or a topic is unknown.

    Examples:
        >>> from btcore_ros2.telemetry import RosTelemetry
        >>> def run(tree):
        ...     with RosTelemetry(tree, ["log", "diagnostics"]):
        ...         return tree.tick_while_running()
    """

    def __init__(
        self,
        tree: Tree,
        topics: Collection[TelemetryTopic] = TOPICS,
        *,
        arguments: Sequence[str] = (),
    ) -> None:
        check_topics(topics)
        super().__init__(tree)
        self._session = RosSession(_NAME, arguments=arguments)
        self._publishers: list[Any] = []
        self._tasks: list[Callable[[], None]] = []
        self._stop = threading.Event()
        self._wake = threading.Event()
        self._changes: deque[Transitions] | None = None
        self._counter: _Counter | None = None
        self._rosout: _RosoutHandler | None = None
        if "log" in topics:
            self._open_log()
        if "diagnostics" in topics:
            self._open_diagnostics()
        if "rosout" in topics:
            self._open_rosout()
        self._thread = threading.Thread(target=self._publish, name=_NAME, daemon=True)
        self._thread.start()
        self.attach()

    # --- on the thread that ticks the tree

    def transitions(self, changes: Transitions) -> None:
        """Hand over the transitions of a tick."""
        waiting = self._changes
        if waiting is not None:
            if len(waiting) == MAX_WAITING and self._counter is not None:
                self._counter.dropped += len(waiting[0])
            waiting.append(changes)
            self._wake.set()

    def ticked(self, tick: int, stamp: int, duration_ns: int, status: Status) -> None:
        """Count the tick."""
        if self._counter is not None:
            self._counter.add(tick, stamp, duration_ns, status)

    def raised(self, error: NodeExecutionError, stamp: int) -> None:
        """Keep the error."""
        if self._counter is not None:
            self._counter.error = str(error)
            self._counter.new_error = True
        if self._rosout is not None:
            self._rosout.append(logging.ERROR, "btcore", str(error), "", "", 0)

    def close(self) -> None:
        """Unsubscribe from the tree, and publish what is waiting. Closing again has no effect."""
        if self.closed:
            return
        super().close()
        if self._rosout is not None:
            logging.getLogger().removeHandler(self._rosout)
        self._stop.set()
        self._wake.set()
        self._thread.join(PERIOD_S + CLOSE_S * len(self._publishers))
        self._session.close()

    # --- on the thread of its own

    def _publish(self) -> None:
        while not self._stop.is_set():
            self._wake.wait(PERIOD_S / 10)
            self._wake.clear()
            self._run_tasks()
        self._run_tasks()
        self._wait_for_subscribers()

    def _run_tasks(self) -> None:
        for task in tuple(self._tasks):
            try:
                task()
            except Exception as error:
                # Treated like an observer that raises: it is unsubscribed, and the tree continues.
                self._tasks.remove(task)
                logging.getLogger("btcore").warning("publishing to ROS 2 has failed, and ends: %s", error)

    def _wait_for_subscribers(self) -> None:
        from rclpy.duration import Duration

        for publisher in self._publishers:
            publisher.wait_for_all_acked(Duration(seconds=CLOSE_S))

    def _create_publisher(self, message_type: Any, topic: str, qos: Any) -> Any:
        publisher = self._session.node.create_publisher(message_type, topic, qos)
        self._publishers.append(publisher)
        return publisher

    def _open_log(self) -> None:
        from builtin_interfaces.msg import Time
        from nav2_msgs.msg import BehaviorTreeLog, BehaviorTreeStatusChange

        publisher = self._create_publisher(BehaviorTreeLog, "behavior_tree_log", 10)
        waiting: deque[Transitions] = deque(maxlen=MAX_WAITING)
        names = {node.config.uid: node.name for node in self.tree}
        self._changes = waiting

        def event(change: Transition) -> Any:
            sec, nanosec = divmod(self.wall(change.stamp), NS_PER_S)
            return BehaviorTreeStatusChange(
                timestamp=Time(sec=sec, nanosec=nanosec),
                node_name=names.get(change.uid, ""),
                uid=change.uid & 0xFFFF,
                previous_status=change.previous.name,
                current_status=change.status.name,
            )

        def publish() -> None:
            while waiting:
                events = [event(change) for change in waiting.popleft()]
                publisher.publish(BehaviorTreeLog(timestamp=self._now(), event_log=events))

        self._tasks.append(publish)

    def _open_diagnostics(self) -> None:
        from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
        from std_msgs.msg import Header

        publisher = self._create_publisher(DiagnosticArray, "diagnostics", 10)
        counter = self._counter = _Counter(self.tree)
        due = 0.0

        def publish() -> None:
            nonlocal due
            now = time.monotonic()
            if now < due and not self._stop.is_set():
                return
            due = now + PERIOD_S
            level, message, values = counter.report()
            status = DiagnosticStatus(
                level=level,
                name=f"btcore: {self.tree.id}",
                message=message,
                values=[KeyValue(key=key, value=text) for key, text in values.items()],
            )
            publisher.publish(DiagnosticArray(header=Header(stamp=self._now()), status=[status]))

        self._tasks.append(publish)

    def _open_rosout(self) -> None:
        from builtin_interfaces.msg import Time
        from rcl_interfaces.msg import Log
        from rclpy.qos import qos_profile_rosout_default

        # A publisher instead of the logger of the ROS node, which would also print each record.
        publisher = self._create_publisher(Log, "/rosout", qos_profile_rosout_default)
        handler = self._rosout = _RosoutHandler(self._wake)

        def publish() -> None:
            while handler.records:
                stamp, level, name, text, file, function, line = handler.records.popleft()
                sec, nanosec = divmod(stamp, NS_PER_S)
                time_ = Time(sec=sec, nanosec=nanosec)
                record = Log(
                    stamp=time_, level=level, name=name, msg=text, file=file, function=function, line=line
                )
                publisher.publish(record)

        self._tasks.append(publish)
        logging.getLogger().addHandler(handler)

    def _now(self) -> Any:
        return self._session.node.get_clock().now().to_msg()


def check_topics(topics: Collection[str]) -> None:
    """Check that ROS 2 and the messages for *topics* are installed.

    Raises:
        RosError: ROS 2 or the package of a message is not installed, or a topic is unknown.
    """
    from btcore_ros2.interfaces import load_interface

    for topic in topics:
        if topic not in _MESSAGES:
            hint = did_you_mean(topic, TOPICS) or f"; topics: {join_names(TOPICS)}"
            raise RosError(f"'{topic}' cannot be published{hint}")
        try:
            load_interface(_MESSAGES[topic], "msg")
        except RosError as error:
            raise RosError(f"'{topic}' cannot be published: {error}") from error


_MESSAGES: Final = {
    "log": "nav2_msgs/msg/BehaviorTreeLog",
    "diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "rosout": "rcl_interfaces/msg/Log",
}


@dataclass
class _Counter:
    """Counts ticks, and describes the state of a tree. It is written by one thread and read by another."""

    tree: Tree
    ticks: int = 0
    status: Status = Status.IDLE
    error: str = ""
    new_error: bool = False
    dropped: int = 0

    def __post_init__(self) -> None:
        self._durations: list[int] = []
        self._stamps: list[int] = []

    def add(self, tick: int, stamp: int, duration_ns: int, status: Status) -> None:
        """Count a tick; see `Observer.ticked`."""
        self.ticks = tick
        self.status = status
        if len(self._stamps) < 100_000:
            self._stamps.append(stamp)
            self._durations.append(duration_ns)

    def report(self) -> tuple[bytes, str, dict[str, str]]:
        """Return level, message and values of the state since the last report."""
        stamps, durations = self._stamps, self._durations
        # The last stamp is the beginning of the next interval.
        self._stamps, self._durations = stamps[-1:], []
        intervals = [later - earlier for earlier, later in pairwise(stamps)]
        values = {"state": self.status.name, "ticks": str(self.ticks)}
        if intervals and sum(intervals):
            rate = len(intervals) * NS_PER_S / sum(intervals)
            late = max(intervals) - sorted(intervals)[len(intervals) // 2]
            values["rate (Hz)"] = f"{rate:.1f}"
            values["greatest lateness of a tick (ms)"] = f"{late / NS_PER_MS:.1f}"
        if durations:
            values["mean duration of a tick (ms)"] = f"{sum(durations) / len(durations) / NS_PER_MS:.3f}"
            values["longest tick (ms)"] = f"{max(durations) / NS_PER_MS:.3f}"
        if self.error:
            values["last error"] = self.error
        if self.dropped:
            values["dropped transitions"] = str(self.dropped)
        if self.new_error:
            self.new_error = False
            return _ERROR, self.error.partition("\n")[0], values
        if not durations:
            return _WARN, "not ticked", values
        return _OK, self.status.name, values


class _RosoutHandler(logging.Handler):
    """Collects log records for another thread."""

    def __init__(self, wake: threading.Event) -> None:
        super().__init__()
        self.records: deque[tuple[int, int, str, str, str, str, int]] = deque(maxlen=MAX_WAITING)
        self._wake = wake

    def emit(self, record: logging.LogRecord) -> None:
        """Keep *record*."""
        self.append(
            record.levelno,
            record.name,
            record.getMessage(),
            record.pathname,
            record.funcName or "",
            record.lineno,
        )

    def append(self, level: int, name: str, text: str, file: str, function: str, line: int) -> None:
        """Keep the parts of a record; the time is the present."""
        level = max(0, min(255, level))
        self.records.append((time.time_ns(), level, name, text, file, function, line))
        self._wake.set()
