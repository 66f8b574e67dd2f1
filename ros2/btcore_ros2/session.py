"""A ROS node for a tree: `RosSession` takes what has arrived, on the thread that ticks the tree."""

import logging
import os
import shlex
import threading
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

from btcore import SystemClock
from btcore.clock import NS_PER_S
from btcore_robot.robot import Phase, Robot, RobotClock, Schedule
from btcore_robot.schedule import RealTimeSchedule
from btcore_ros2.errors import RosError
from btcore_ros2.installation import check_installation
from btcore_ros2.shared_entities import SharedEntities

if TYPE_CHECKING:
    from rclpy.callback_groups import CallbackGroup
    from rclpy.executors import Executor
    from rclpy.node import Node

    from btcore_ros2.direct_take import DirectTake
    from btcore_ros2.executor_take import ExecutorTake

__all__ = ["RosClock", "RosSession"]

log = logging.getLogger(__name__)

FRESH_NS = 1_000_000
"""How old (ns) the last `drain` may be before `refresh` drains again."""

SHORT_WAIT_NS = 50_000_000
"""The time (ns) for which `wait_for` drains every 0.1 ms, and then every ms."""

DRAIN_RATE = 200.0
"""The rate (Hz) of `drain` while a program waits on a clock."""

MAX_DOMAIN = 232
"""The last domain of DDS. Those above 101 may share ports with other programs on Linux."""

NAMESPACED_TF = ("-r", "/tf:=tf", "-r", "/tf_static:=tf_static")
"""Arguments that give each namespace its own transforms, as those of Nav2's launch files do.

The rules of a user come first, so that `-r /tf:=/tf` keeps the common topic.
"""

CLOSE_S = 1.0
"""How long (s) `close` waits for unfinished work, such as a cancellation, and for acknowledged messages."""


class SessionClock(RobotClock, Protocol):
    """A clock that takes what arrives for a ROS node while a caller waits on it."""

    @property
    def schedule(self) -> Schedule:
        """The periodic tasks that run while a caller waits on the clock."""


class RosClock(SystemClock):
    """The monotonic clock of the machine. Waiting on it takes what arrives for the ROS node.

    Attributes:
        schedule: The periodic tasks that run while a caller waits on the clock.
    """

    def __init__(self, session: "RosSession") -> None:
        self.schedule = RealTimeSchedule()
        self._session = session
        self.schedule.add_task(DRAIN_RATE, Phase.SENSORS, lambda now: session._drain_while_waiting())

    def wait_until(self, deadline: int, wake: threading.Event) -> bool:
        """Wait until *deadline* and run the tasks that become due; see `RobotClock.wait_until`.

        Raises:
            Exception: A callback raised it in an earlier wait, and no leaf has called `refresh` since.
        """
        self._session._raise_kept_error()
        # `await tree.run()` waits itself, and calls with a past deadline; the tasks that are due must run.
        woken = self.schedule.wait_until(max(deadline, time.monotonic_ns()), wake)
        self._session._drain_while_waiting()
        return woken


class RosSession:
    """A ROS node for a tree, and the clock on which the tree waits while messages are taken.

    There is no executor thread: `drain` takes what has arrived and calls the callbacks, on the thread of its
    caller. Waiting on `clock` drains too, so that a tree that is run by `btcore run`, `tick_while_running` or
    `run` needs no call. Leaves call `refresh`, which covers programs that call `tick_once` on their own.

    With *node*, the session uses the ROS node of a program, for example in the callback of a timer. The
    executor of that ROS node ignores the entities of the leaves, which are in a callback group of their own,
    and serves all others; rclpy's experimental EventsExecutor has no callback groups and cannot be used.
    `close` destroys the entities of the leaves only.

    Args:
        name: The name of the ROS node.
        arguments: Arguments in the form of `--ros-args`, for example `["-r", "scan:=/scan_raw"]`. With a
            namespace, `["-r", "__ns:=/robot1"]`, the topics `/tf` and `/tf_static` are in it, too.
        domain: The domain (0 to 232; above 101 its ports may be those of other programs); None = the domain
            of the variable ROS_DOMAIN_ID, or 0.
        use_executor: Whether `drain` uses rclpy's executor, which is slower: 0.3 ms instead of 0.05 ms for
            ten subscriptions without a message. The default uses parts of rclpy that are not documented; if
            the installed version lacks them, the executor is used, with a warning.
        node: An existing ROS node, with the name, the arguments and the domain that it has; None = a new ROS
            node in a context of its own.

    Attributes:
        context: The context of the ROS node.
        node: The ROS node.
        callback_group: The callback group of the subscriptions, clients and services that `drain` takes for.
            With a new ROS node, it is the default group.
        clock: The clock for the tree; may be replaced by a `LockstepClock`.
        entities: The ROS entities of the leaves.
        unfinished: The work that `close` waits for, at most `CLOSE_S`. Each object removes itself.

    Raises:
        RosError: ROS 2 is not installed or mixed with another ROS 2, the arguments are invalid, there is no
            such domain, or arguments or a domain are given together with *node*.
    """

    def __init__(
        self,
        name: str = "btcore",
        *,
        arguments: Sequence[str] = (),
        domain: int | None = None,
        use_executor: bool = False,
        node: "Node | None" = None,
    ) -> None:
        check_installation()
        try:
            from rclpy.executors import SingleThreadedExecutor

            from btcore_ros2.connection_checks import ConnectionChecks
            from btcore_ros2.executor_take import GroupExecutor, HiddenGroup
        except ImportError as error:
            raise RosError(f"ROS 2 cannot be imported: {error}; run: btcore ros2 doctor") from error
        self._owns_node = node is None
        self._draining_thread: int | None = None
        self.callback_group: CallbackGroup
        self._executor: Executor
        if node is None:
            self.node = _create_node(name, arguments, domain)
            self.callback_group = self.node.default_callback_group
            self._executor = SingleThreadedExecutor(context=self.node.context)
            self._executor.add_node(self.node)
        elif arguments or domain is not None:
            raise RosError("a RosSession takes arguments and a domain only without a ROS node")
        else:
            self.node = node
            self.callback_group = hidden = HiddenGroup(lambda: self._draining_thread == threading.get_ident())
            self._executor = GroupExecutor(node, hidden)
        self.context = self.node.context
        self._taker = _taker(
            self.node, self._executor, None if self._owns_node else self.callback_group, use_executor
        )
        self.clock: SessionClock = RosClock(self)
        self.entities = SharedEntities(self.node)
        self.unfinished: set[object] = set()
        self._after_drain: list[Callable[[], None]] = []
        self._drained = 0
        self._error: Exception | None = None  # of a drain during a wait
        self._process = os.getpid()
        self._is_closed = False
        self._reports: dict[str, str] = {}
        self._checks = ConnectionChecks(self.node, self.report)

    @property
    def reports(self) -> Mapping[str, str]:
        """The messages of the current problems by subject, for example "topic /scan"; see `report`."""
        return self._reports

    def drain(self) -> None:
        """Take what has arrived, and call the callbacks; then call those of `after_drain`.

        A call within a callback has no effect. An exception in a callback is raised here; what has not been
        taken then is taken by the next call. An exception that was raised while a tree waited for its next
        tick is raised by the next call.

        Raises:
            RosError: The session was closed, its context was shut down, or this is a forked process.
        """
        if self._draining_thread is not None:
            return
        self._raise_kept_error()
        if self._is_closed or not self.context.ok() or self._process != os.getpid():
            raise RosError(self._unusable())
        self._draining_thread = threading.get_ident()
        try:
            self._taker.take()
            for callback in tuple(self._after_drain):
                callback()
            self._checks.check()
            self.entities.check()
        except Exception as error:
            if self.context.ok():
                raise
            raise RosError(self._unusable()) from error
        finally:
            self._draining_thread = None
        self._drained = time.monotonic_ns()

    def drain_during(self, robot: Robot) -> None:
        """Drain while *robot* waits on its clock, if that is not the session's clock."""
        if robot.clock is not self.clock:
            robot.schedule.add_task(DRAIN_RATE, Phase.SENSORS, lambda now: self.drain())

    def refresh(self) -> None:
        """Drain unless that happened within the last millisecond. Leaves call it at each tick."""
        if self._error is not None or time.monotonic_ns() - self._drained > FRESH_NS:
            self.drain()

    def report(self, subject: str, message: str) -> None:
        """Log *message* as a warning, unless it is the current message of *subject*.

        Args:
            subject: The subject, for example "topic /scan".
            message: The problem and what to do about it; "" if the problem has ended.
        """
        if message == self._reports.get(subject, ""):
            return
        if message:
            self._reports[subject] = message
            log.warning("%s", message)
        else:
            del self._reports[subject]

    def after_drain(self, callback: Callable[[], None]) -> Callable[[], None]:
        """Call *callback* after each drain, for work that goes on in the background.

        Returns:
            A function that ends the calls.
        """
        self._after_drain.append(callback)
        return lambda: self._after_drain.remove(callback)

    def wait_for(self, condition: Callable[[], Any], seconds: float, entity: Any = None) -> bool:
        """Drain until *condition* returns a true value, at most for *seconds* (s, real time).

        Args:
            condition: A function that returns whether to end the wait.
            seconds: The limit (s, real time).
            entity: A client or a service whose next item will probably meet the condition. Until it arrives,
                drains are rare, which saves processor time.

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
            pause = 0.0001 if now - start < SHORT_WAIT_NS else 0.001
            if entity is None:
                time.sleep(pause)
            else:
                self._taker.rest(entity, pause)
            self.drain()
        return True

    def close(self) -> None:
        """Destroy the ROS node and its context. Further calls have no effect.

        Of a ROS node that was given to the session, only the entities of the leaves are destroyed.

        Waits, for at most `CLOSE_S`, for unfinished work and for the arrival of the last messages. Exceptions
        in callbacks are logged.
        """
        # Shutting down the context of the parent process would crash.
        if self._is_closed or self._process != os.getpid():
            return
        if self.context.ok():
            self._end()
        self._is_closed = True

    def _end(self) -> None:
        """Wait for unfinished work and the last messages, and destroy what the session has created."""
        end = time.monotonic_ns() + round(CLOSE_S * NS_PER_S)
        while self.unfinished and self.context.ok() and (left := end - time.monotonic_ns()) > 0:
            try:
                self.wait_for(lambda: not self.unfinished, left / NS_PER_S)
            except Exception as error:
                log.error("a callback raised while the ROS session was closed: %r", error)
        self._wait_for_subscribers(end)
        self._executor.shutdown()
        if self._owns_node:
            self.node.destroy_node()
            self.context.try_shutdown()
        else:
            self.entities.close(self.callback_group)

    def _wait_for_subscribers(self, end: int) -> None:
        """Wait until the messages of all reliable publishers are acknowledged, or until *end* (ns)."""
        from rclpy.duration import Duration

        for publisher in tuple(self.node.publishers):
            left = max(0, end - time.monotonic_ns())
            publisher.wait_for_all_acked(Duration(nanoseconds=left))

    def _raise_kept_error(self) -> None:
        if self._error is not None:
            error, self._error = self._error, None
            raise error

    def _drain_while_waiting(self) -> None:
        """Drain. An exception is kept for the next call of `drain`, mostly by a leaf, which is then named."""
        if self._error is not None:
            return
        try:
            self.drain()
        except Exception as error:
            self._error = error

    def _unusable(self) -> str:
        """Return why the session cannot be used."""
        if self._process != os.getpid():
            return (
                "this process was forked from the process that created the ROS session, and the session does "
                "not work in it: start the process by spawning it (multiprocessing.get_context('spawn')), or "
                "create the session after the fork"
            )
        if self._is_closed:
            return "the ROS session was closed"
        return (
            "the ROS context was shut down, so that no message can be sent or received; the signal handlers "
            "of rclpy.init() shut down all contexts, unless you pass "
            "signal_handler_options=SignalHandlerOptions.NO"
        )

    def __enter__(self) -> "RosSession":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def node_arguments(text: str | None) -> list[str]:
    """Return the arguments of a ROS node that the option `--ros-args` contains.

    Args:
        text: The value of the option, quoted as in a shell; None = no arguments.

    Raises:
        RosError: A quotation mark is missing.
    """
    try:
        return shlex.split(text or "")
    except ValueError as error:
        raise RosError(f"--ros-args: {error} in {text}") from error


def _check_domain(domain: str, origin: str) -> None:
    """Raise a RosError for a domain that does not exist: Fast DDS would end the process."""
    if not (domain.isdecimal() and int(domain) <= MAX_DOMAIN):
        raise RosError(f"{origin}: there is no domain {domain}, only 0 to {MAX_DOMAIN}")


def _create_node(name: str, arguments: Sequence[str], domain: int | None) -> "Node":
    """Create a ROS node in a context of its own; see `RosSession`."""
    from rclpy.context import Context
    from rclpy.impl.implementation_singleton import rclpy_implementation
    from rclpy.node import Node

    if domain is not None:
        _check_domain(str(domain), "domain")
    else:
        _check_domain(os.environ.get("ROS_DOMAIN_ID") or "0", "ROS_DOMAIN_ID")
    context = Context()
    # Without signal handlers, which are installed by rclpy.init() only: a last stop command can be sent
    # after Ctrl-C.
    try:
        context.init(args=["--ros-args", *arguments, *NAMESPACED_TF], domain_id=domain)
        return Node(name, context=context)
    except rclpy_implementation.UnknownROSArgsError as error:
        raise RosError(
            f"unknown arguments of the ROS node: {error}; the form is: -p NAME:=VALUE -r OLD:=NEW"
        ) from error
    except rclpy_implementation.RCLError as error:
        reason, _, _ = str(error).partition(", at /")  # then places in the source of rcl
        raise RosError(f"ROS 2 cannot start: {reason}") from error


def _taker(
    node: "Node", executor: "Executor", group: "CallbackGroup | None", use_executor: bool
) -> "DirectTake | ExecutorTake":
    """Return the object that takes what has arrived for *node*, or for *group* of its entities.

    With ten subscriptions without a message, a call of `DirectTake` costs 0.05 ms, of `ExecutorTake` 0.3 ms.
    """
    from btcore_ros2.direct_take import DirectTake, missing_parts
    from btcore_ros2.executor_take import ExecutorTake

    if use_executor:
        return ExecutorTake(executor)
    if missing := missing_parts():
        warnings.warn(
            f"this version of rclpy lacks {', '.join(missing)}: taking messages uses rclpy's executor, "
            "which is slower (RosSession(use_executor=True) hides this warning)",
            stacklevel=3,
        )
        return ExecutorTake(executor)
    return DirectTake(node, executor, group)
