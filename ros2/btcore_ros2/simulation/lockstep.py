"""Lockstep: a simulated world that waits until a client requests a time step, so that runs are repeatable.

The protocol, which a program in any language can use:

- The service `sim/step` has the type rcl_interfaces/SetParametersAtomically. The parameter `until` is the
  simulated time to which the world shall run: an integer in ns, or a double in s. The response is sent when
  the world is there; everything up to that time has been published then. A time in the past is answered at
  once, so a request may be repeated.
- Two further parameters are optional, both integers. `from` is the present time (ns) of the client: a world
  that was started again meanwhile refuses the request. The name of a topic for commands, for example
  `/cmd_vel`, stands for the number of messages that the client has published on it so far: the world takes
  them before the step.
- The service `sim/sync` has the type std_srvs/Trigger. The world publishes the newest readings again, at the
  same time, for a client that has just subscribed.
- `reason` of the first response and `message` of the second are JSON:
  `{"time": ns, "published": {"/scan_raw": 12, …}, "received": {"/cmd_vel": 3, …}}`. The numbers count the
  messages on each topic since the start. A message's `publication_sequence_number` is that number, so a
  client knows whether the newest message of each topic has arrived.
- With several clients the world runs to the earliest requested time. It does not wait for a client that
  requests nothing.
"""

import json
import logging
import threading
import time
from collections.abc import Callable, Generator, Mapping
from functools import partial
from types import coroutine
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.task import Future
from std_srvs.srv import Trigger

from btcore.clock import NS_PER_S
from btcore_robot.schedule import SimulatedSchedule
from btcore_robot.time_limits import MAX_SENSOR_WAIT_S
from btcore_ros2.errors import RosError
from btcore_ros2.session import RosSession

if TYPE_CHECKING:
    from btcore_ros2.simulation.topics import RobotTopics

_log = logging.getLogger(__name__)

MAX_STEP_NS = NS_PER_S // 10
"""The longest step (ns) that a client requests: subscriptions keep few messages."""

MAX_RESPONSE_WAIT_S = 60.0
"""The longest time (s, real time) that a client waits for a response."""

RETRY_AFTER_S = 2.0
"""The time (s, real time) after which a client repeats a request."""

MAX_ARRIVAL_WAIT_S = 10.0
"""The longest time (s, real time) to wait for a message that the other side has published.

DDS sends a reliable message that was lost again after 3 s.
"""

SYNC_AFTER_S = 0.3
"""The time (s, real time) after which a client lets the world publish the newest readings again."""

_SYNC_INTERVAL_NS = 50_000_000


class LockstepServer:
    """Lets a simulated world advance only as far as clients request it.

    Assign `pace` to the schedule of the world.

    Args:
        session: The ROS node of the world.
        topics: The topics of the world.
        wait_limit: How long (s, real time) to wait for a request before `is_abandoned` becomes True.

    Attributes:
        is_abandoned: Whether no client requested a step for *wait_limit*.
    """

    def __init__(self, session: RosSession, topics: "RobotTopics", wait_limit: float) -> None:
        self.is_abandoned = False
        self._session = session
        self._topics = topics
        self._wait_limit = wait_limit
        self._time = 0
        self._goal = 0
        # The latest time that a client has requested. A client that is woken does not wait for the response.
        self._requested = 0
        self._requests: list[tuple[int, Future]] = []
        # A group of its own: a request that waits must not block the subscriptions for commands.
        group = ReentrantCallbackGroup()
        create = session.node.create_service
        self._steps = create(SetParametersAtomically, "sim/step", self._answer_step, callback_group=group)
        create(Trigger, "sim/sync", self._answer_sync, callback_group=group)

    def pace(self, now: int, until: int, wake: threading.Event) -> bool:
        """Wait until the world may advance; see `SimulatedSchedule`.

        Args:
            now: The present time of the world (ns). Everything up to it has been published.
            until: The time (ns) to which the world will advance.
            wake: The event that ends the wait early.
        """
        if until > self._goal:
            self._reach(max(now, self._goal))
            self._await_request(until, wake)
        return wake.is_set() or self.is_abandoned

    def close(self) -> None:
        """Answer the remaining requests: the simulation has ended."""
        self._reach(max(self._time, min(self._goal, self._next_request())))
        for _, future in self._requests:
            future.set_result(False)
        self._requests.clear()
        self._session.drain()

    def _reach(self, now: int) -> None:
        """Answer the requests up to *now* (ns)."""
        if now > self._time:
            self._time = now
            self._topics.publish_clock(now)
        for until, future in self._requests:
            if until <= now:
                future.set_result(True)
        self._requests = [request for request in self._requests if request[0] > now]

    def _next_request(self) -> int:
        return min((until for until, _ in self._requests), default=self._time)

    def _await_request(self, until: int, wake: threading.Event) -> None:
        limit = time.monotonic() + self._wait_limit
        while until > self._goal and not (wake.is_set() or self.is_abandoned):
            # In slices, so that an interrupt is noticed and the pauses between drains stay short.
            if self._session.wait_for(lambda: self._requests or wake.is_set(), 0.1, self._steps):
                self._goal = max(self._goal, self._next_request())
                # Nothing happens in the world before *until*.
                self._reach(self._goal if self._goal < until else self._time)
            self.is_abandoned = time.monotonic() > limit

    async def _answer_step(self, request: Any, response: Any) -> Any:
        result = response.result
        try:
            numbers = _numbers(request.parameters)
            until, since = numbers.pop("until"), numbers.pop("from", 0)
            if since > max(self._time, self._requested):
                raise ValueError(
                    f"the world is at {_seconds(self._time)}, before the client's {_seconds(since)}: it was "
                    "started again"
                )
            self._requested = max(self._requested, until)
        except ValueError as error:
            result.reason = str(error)
            return response
        if until > self._time:
            await self._commands_arrived(numbers)
            future: Future = Future()
            self._requests.append((until, future))
            if not await future:
                result.reason = f"the simulation ended at {_seconds(self._time)}"
                return response
        result.successful = True
        result.reason = self._state()
        return response

    async def _commands_arrived(self, numbers: Mapping[str, int]) -> None:
        """Wait until as many commands have arrived on each topic as *numbers* contains."""
        limit = time.monotonic() + MAX_ARRIVAL_WAIT_S
        received = self._topics.received()
        while late := [topic for topic, number in numbers.items() if received.get(topic, number) < number]:
            if time.monotonic() > limit:
                _log.warning("commands were lost, so the run may not be repeatable: %s", ", ".join(late))
                return
            await _next_drain()

    def _answer_sync(self, request: Any, response: Any) -> Any:
        self._topics.publish_again()
        response.success = True
        response.message = self._state()
        return response

    def _state(self) -> str:
        return json.dumps(
            {
                "time": self._time,
                "published": self._topics.published(),
                "received": self._topics.received(),
            }
        )


class LockstepClock(SimulatedSchedule):
    """The clock of a world in lockstep, for a program in another process.

    Waiting on the clock lets the world run, and takes all messages that it publishes. A subscription of the
    session's ROS node that has just been made receives the newest reading without a step.

    Args:
        session: The ROS node of the program.
        timeout: How long (s, real time) to wait for the world at the start.

    Raises:
        RosError: There is no world in lockstep.
    """

    def __init__(self, session: RosSession, timeout: float = 10.0) -> None:
        self._session = session
        self._arrived: dict[Any, int] = {}
        """The sequence number of the newest message of each subscription."""
        self._silent: set[Any] = set()
        self._published: Mapping[str, int] = {}
        self._commands: dict[str, int] = {}
        """The number of messages that this program has published, by topic."""
        self._command_topics: set[str] = set()
        self._synced = 0
        self._pending: Any = None
        self._steps = session.node.create_client(SetParametersAtomically, "sim/step")
        self._syncs = session.node.create_client(Trigger, "sim/sync")
        for client in (self._steps, self._syncs):
            if not session.wait_for(client.service_is_ready, timeout):
                raise RosError(
                    f"no world in lockstep: no service {client.srv_name} within {timeout:g} s; start "
                    "`btcore ros2 sim --lockstep` with the same ROS_DOMAIN_ID"
                )
        super().__init__(start=self._sync(), pace=self._step)
        self._count_commands()
        session.after_drain(self._watch)

    @property
    def schedule(self) -> "LockstepClock":
        """The periodic tasks that run while a caller waits on the clock: the clock itself."""
        return self

    def _step(self, now: int, until: int, wake: threading.Event) -> bool:
        """Let the world run from *now* to *until* (ns); return whether *wake* is set."""
        self._connect()
        while now < until and not wake.is_set():
            since, now = now, min(until, now + MAX_STEP_NS)
            # Set before the messages of the step arrive: no stamp is in the future.
            self._now = now
            numbers = {topic: self._commands.get(topic, 0) for topic in self._command_topics}
            parameters = {"until": now, "from": since, **numbers}
            request = SetParametersAtomically.Request(
                parameters=[_integer(name, value) for name, value in parameters.items()]
            )
            response = self._call(self._steps, request, wake)
            if response is None:
                return True
            if not response.result.successful:
                raise RosError(f"{self._steps.srv_name}: {response.result.reason}")
            now = self._now = max(now, self._take_state(response.result.reason))
            self._await_messages()
        self._session.refresh()
        return wake.is_set()

    def _sync(self) -> int:
        """Let the world publish its newest readings again, and return its time (ns)."""
        response = self._call(self._syncs, Trigger.Request())
        return self._take_state(response.message)

    def _call(self, client: Any, request: Any, wake: threading.Event | None = None) -> Any:
        """Return the response to *request*, or None if *wake* was set meanwhile."""
        limit = time.monotonic() + MAX_RESPONSE_WAIT_S
        while True:
            future = client.call_async(request)
            done = partial(_is_done, future, wake)
            if self._session.wait_for(done, RETRY_AFTER_S, client):
                return future.result() if future.done() else None
            client.remove_pending_request(future)
            if not client.service_is_ready():
                raise RosError(f"{client.srv_name}: the simulation has ended, or the network is down")
            if time.monotonic() > limit:
                raise RosError(
                    f"{client.srv_name}: no response for {MAX_RESPONSE_WAIT_S:g} s: the simulation hangs"
                )

    def _take_state(self, text: str) -> int:
        """Keep the numbers of messages in a response, and return the time (ns) of the world."""
        state = json.loads(text)
        self._published = state["published"]
        self._command_topics = set(state["received"])
        return int(state["time"])

    def _await_messages(self) -> None:
        """Take messages until the newest one of each subscription has arrived."""
        due = [
            (subscription, self._published.get(subscription.topic_name, 0)) for subscription in self._arrived
        ]
        due = [(subscription, number) for subscription, number in due if subscription not in self._silent]

        def late() -> list[str]:
            return [
                subscription.topic_name
                for subscription, number in due
                if self._arrived.get(subscription, number) < number
            ]

        limit = time.monotonic() + MAX_ARRIVAL_WAIT_S
        while not self._session.wait_for(lambda: not late(), SYNC_AFTER_S):
            if time.monotonic() > limit:
                _log.warning("messages were lost, so the run may not be repeatable: %s", ", ".join(late()))
                return
            # A best effort message that was lost is replaced by the same reading.
            self._sync()

    def _unconnected(self) -> list[Any]:
        """Return the subscriptions that have received nothing from the world yet."""
        return [
            subscription
            for subscription, number in self._arrived.items()
            if not number and subscription.topic_name in self._published and subscription not in self._silent
        ]

    def _connect(self) -> None:
        """Sync until each subscription has received a message, or its sensor turns out to be silent."""
        self._session.refresh()
        limit = time.monotonic() + MAX_SENSOR_WAIT_S
        while waiting := self._unconnected():
            if time.monotonic() > limit:
                # Such as a camera that has failed.
                self._silent.update(waiting)
                return
            self._sync()
            self._session.wait_for(lambda: not self._unconnected(), _SYNC_INTERVAL_NS / NS_PER_S)

    def _watch(self) -> None:
        """Follow the subscriptions of the ROS node, and request a message for those without any.

        Called after each drain.
        """
        subscriptions = set(self._session.node.subscriptions)
        if subscriptions != self._arrived.keys():
            for subscription in subscriptions:
                if subscription not in self._arrived:
                    subscription.callback = self._with_sequence_number(subscription)
            self._arrived = {
                subscription: self._arrived.get(subscription, 0) for subscription in subscriptions
            }
            self._silent &= self._arrived.keys()
        now = time.monotonic_ns()
        if now - self._synced > _SYNC_INTERVAL_NS and self._unconnected():
            # For a caller that waits for a first message in real time, while the world stands.
            self._synced = now
            if self._pending is not None:
                self._syncs.remove_pending_request(self._pending)
            self._pending = self._syncs.call_async(Trigger.Request())

    def _count_commands(self) -> None:
        """Count the messages of all publishers that the ROS node creates from now on."""
        node: Any = self._session.node
        create_publisher = node.create_publisher

        def create(*arguments: Any, **settings: Any) -> Any:
            publisher = create_publisher(*arguments, **settings)
            publish, topic = publisher.publish, publisher.topic_name

            def counted(message: Any) -> None:
                publish(message)
                self._commands[topic] = self._commands.get(topic, 0) + 1

            publisher.publish = counted
            return publisher

        node.create_publisher = create

    def _with_sequence_number(self, subscription: Any) -> Callable[[Any, Any], Any]:
        """Return the callback of *subscription*, extended: it notes the sequence number of each message."""
        callback = subscription.callback
        with_info = subscription._callback_type is subscription.CallbackType.WithMessageInfo

        def receive(message: Any, info: Any) -> Any:
            # The greatest number: the topic may have further publishers.
            number = info["publication_sequence_number"]
            self._arrived[subscription] = max(self._arrived[subscription], number)
            return callback(message, info) if with_info else callback(message)

        return receive


def _is_done(future: Future, wake: threading.Event | None) -> bool:
    """Whether *future* is done, or *wake* is set."""
    return bool(future.done()) or (wake is not None and wake.is_set())


@coroutine
def _next_drain() -> Generator[None, None, None]:
    """Suspend a coroutine until the next drain."""
    yield


def _numbers(parameters: Any) -> dict[str, int]:
    """Return the parameters of a request: times in ns, and numbers of messages by topic."""
    numbers: dict[str, int] = {}
    for parameter in parameters:
        name, parameter_type, value = parameter.name, parameter.value.type, parameter.value
        if name not in ("until", "from") and not name.startswith("/"):
            raise ValueError(f"unknown parameter '{name}': use until, from, or the name of a topic")
        if parameter_type == ParameterType.PARAMETER_INTEGER:
            numbers[name] = value.integer_value
        elif parameter_type == ParameterType.PARAMETER_DOUBLE and name == "until":
            numbers[name] = round(value.double_value * NS_PER_S)
        else:
            raise ValueError(f"'{name}' has to be an integer; only 'until' may be a double, in s")
    if "until" not in numbers:
        raise ValueError("the parameter 'until' is missing: the time to run to, in ns")
    return numbers


def _integer(name: str, value: int) -> Parameter:
    return Parameter(
        name=name, value=ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=value)
    )


def _seconds(time: int) -> str:
    return f"{time / NS_PER_S:.3f} s"
