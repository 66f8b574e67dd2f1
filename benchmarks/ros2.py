"""How long it takes to take what has arrived for a ROS node, compared with rclpy's executor.

    python benchmarks/ros2.py [--pairs 15] [--quick] [--json]

Two ROS nodes have the same ten subscriptions: laser scans of 666 rays, and nine topics with small messages. A
third ROS node publishes. `RosSession.drain` takes for the first ROS node, and `spin_once` of an executor for
the second. `spin_once` calls one callback, so it is called until all callbacks were called. Without messages,
both functions are called once. The time of the callbacks, which count the messages, is included. Times are
processor times of the taking thread; the threads of the middleware are excluded. The targets are limits of
the time for a tick: the ratio is relative to the limit.

The session also runs a round of the executor every half second, for events such as an incompatible QoS. That
adds the time of the executor without messages to a few calls; the values are those of the other calls.
"""

import array
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Float64

from btcore.clock import NS_PER_MS
from btcore_ros2.session import RosSession
from btcore_ros2.testing import isolate_ros
from measure.paired_timing import Measured, Work, measure, measure_rounds
from measure.report import Report, at_most, create_parser

SMALL_TOPICS = 9
RAYS = 666
DISCOVERY = 30.0  # s
ARRIVAL = 0.02  # s, for messages between two ROS nodes of a process
ROUNDS_PER_PAIR = 10  # with messages: the time of a round is short, and varies
IDLE = 0.1  # ms, that the session may take without messages
TEN_MESSAGES = 1.0  # ms
WITHIN = at_most(pure=1, compiled=1)


class Subscriber:
    """A ROS node with ten subscriptions that count messages.

    Args:
        session: The session of the ROS node.
        take: The function that takes messages.
    """

    def __init__(self, session: RosSession, take: Callable[[], object]) -> None:
        self.take = take
        self.count = 0
        session.node.create_subscription(LaserScan, "scan", self._receive, 10)
        for index in range(SMALL_TOPICS):
            session.node.create_subscription(Float64, f"small_{index}", self._receive, 10)

    def take_all(self) -> None:
        """Take until the messages of a round were counted."""
        while self.count <= SMALL_TOPICS:
            self.take()

    def _receive(self, message: Any) -> None:
        self.count += 1


def thread_time(work: Work) -> int:
    """Return the processor time (ns) of a call of *work* in this thread."""
    start = time.thread_time_ns()
    work()
    return time.thread_time_ns() - start


def rounds(
    publisher: RosSession, direct: Subscriber, executor: Subscriber, count: int
) -> Iterator[Mapping[str, Work]]:
    """Yield *count* rounds, in each of which ten messages have arrived for both subscribers."""
    scan = LaserScan(ranges=array.array("f", [1.5]) * RAYS)
    scans = publisher.node.create_publisher(LaserScan, "scan", 10)
    small = [publisher.node.create_publisher(Float64, f"small_{index}", 10) for index in range(SMALL_TOPICS)]
    found = publisher.wait_for(
        lambda: all(made.get_subscription_count() == 2 for made in (scans, *small)), DISCOVERY
    )
    assert found, "the ROS nodes must discover each other"
    for _ in range(count):
        direct.count = executor.count = 0
        for made in small:
            made.publish(Float64(data=1.0))
        scans.publish(scan)
        time.sleep(ARRIVAL)
        yield {"direct": direct.take_all, "executor": executor.take_all}


def add_rows(report: Report, label: str, measured: Measured, limit: float) -> None:
    """Add the rows for *measured* to *report*; the session may take *limit* (ms)."""
    session, executor = (
        measured.time("direct").times(1 / NS_PER_MS),
        measured.time("executor").times(1 / NS_PER_MS),
    )
    figures = {"executor": f"{executor.median:.3f} ms", "session": f"{session.median:.3f} ms"}
    report.add(f"{label}: session / executor", measured.ratio("direct", "executor"), None, figures)
    report.add(f"{label}: session / {limit:g} ms", session.times(1 / limit), WITHIN)


def main() -> None:
    """Run the benchmark."""
    options = create_parser(__doc__ or "", pairs=15).parse_args()
    isolate_ros()
    report = Report("ros2", "The time to take what has arrived for ten subscriptions", options.pairs)
    with RosSession("direct") as first, RosSession("executor") as second, RosSession("publisher") as third:
        spinning = SingleThreadedExecutor(context=second.context)
        spinning.add_node(second.node)
        spin_once = partial(spinning.spin_once, timeout_sec=0.0)
        direct, executor = Subscriber(first, first.drain), Subscriber(second, spin_once)
        slices = 2 if options.quick else 12
        idle = measure({"direct": first.drain, "executor": spin_once}, options.pairs, slices)
        add_rows(report, "no message", idle, IDLE)
        count = options.pairs * (1 if options.quick else ROUNDS_PER_PAIR)
        busy = measure_rounds(rounds(third, direct, executor, count + 1), thread_time)
        add_rows(report, "10 messages", busy, TEN_MESSAGES)
        spinning.shutdown()
    report.output(options.json)


if __name__ == "__main__":
    main()
