"""A component (like a ROS 2 node) with publishers, subscriptions, timers and parameters, and the executor."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from btcore.clock import NS_PER_S
from btcore_robot.components.parameters import Parameters, ParameterValue
from btcore_robot.components.topics import Publisher, Subscription, Topics, full_name
from btcore_robot.errors import RobotError
from btcore_robot.robot import Phase, Robot, RobotClock, Schedule
from btcore_robot.transforms import TransformTree

Message = TypeVar("Message")

MAX_DELIVERY_ROUNDS = 1000
"""The maximum number of delivery rounds before callbacks are assumed to publish to each other endlessly."""

QUEUE_DEPTH = 10
"""The default of the maximum number of messages in a subscription's queue."""


@dataclass(frozen=True, slots=True)
class LogMessage:
    """A line of the log: *level* (INFO, WARN or ERROR), *stamp* (ns), component *name* and *text*."""

    level: str
    stamp: int
    name: str
    text: str

    def __str__(self) -> str:
        return f"[{self.level}] [{self.stamp / NS_PER_S:.3f}] [{self.name}]: {self.text}"


class ComponentContext:
    """The resources that components share.

    Args:
        clock: The clock of the components.
        schedule: The schedule that calls the timers of the components.
        log_sink: A function that receives every log message.
        robot: The robot, if the components have one.

    Attributes:
        transforms: The transform tree that the components share.
        topics: The topics by name.
    """

    def __init__(
        self,
        clock: RobotClock,
        schedule: Schedule,
        log_sink: Callable[[LogMessage], None],
        *,
        robot: Robot | None = None,
    ) -> None:
        self.clock = clock
        self.schedule = schedule
        self.log_sink = log_sink
        self.robot = robot
        self.transforms = TransformTree()
        self.topics = Topics()


@dataclass(frozen=True, slots=True)
class ComponentOptions:
    """Options of a component at its start.

    *name* replaces its default name. *remap* maps old names of topics to new names. *parameters* maps the
    names of parameters to their values.
    """

    name: str | None = None
    remap: Mapping[str, str] = field(default_factory=dict)
    parameters: Mapping[str, ParameterValue] = field(default_factory=dict)


class Timer:
    """A timer that calls *callback* every *period* seconds while its component runs.

    Args:
        component: The component of the timer.
    """

    def __init__(self, component: "Component", period: float, callback: Callable[[], None]) -> None:
        self.period = period
        self.callback = callback
        self._component = component

    def cancel(self) -> None:
        """Stop the timer."""
        self._component.timers.remove(self)
        if self._component.executor is not None:
            self._component.executor.cancel_timer(self)


class Component:
    """A program of the robot, like a ROS 2 node. A subclass creates timers and subscriptions in `__init__`.

    A component runs after `Executor.add` has added it to an executor. *name* is its default name, which
    *options* may override.

    Attributes:
        name: The name that *options* contains, or else the default name.
        context: The resources that the component shares with other components.
        parameters: The parameters of the component.
        subscriptions: The subscriptions, in order of creation.
        timers: The timers, in order of creation.
        executor: The executor, once `Executor.add` was called.
    """

    def __init__(self, name: str, context: ComponentContext, options: ComponentOptions | None = None) -> None:
        options = options if options is not None else ComponentOptions()
        self.name = options.name or name
        self.context = context
        self.parameters = Parameters(self.name, options.parameters)
        self.subscriptions: list[Subscription[Any]] = []
        self.timers: list[Timer] = []
        self.executor: Executor | None = None
        self._names = {full_name(old): full_name(new) for old, new in options.remap.items()}

    def now(self) -> int:
        """Return the time (ns)."""
        return self.context.clock.now()

    def create_publisher(
        self, topic: str, type_: type[Message], *, latched: bool = False
    ) -> Publisher[Message]:
        """Return a publisher of messages of *type_* on *topic*.

        Args:
            topic: The topic's name before remapping.
            type_: The class of the messages.
            latched: Whether the last message is kept for subscriptions that are created later.

        Raises:
            TopicError: The topic has messages of another type.
        """
        resolved = self.context.topics.topic(self.resolve(topic), type_, self.name)
        resolved.publishers.append(self.name)
        return Publisher(resolved, latched)

    def create_subscription(
        self, topic: str, type_: type[Message], callback: Callable[[Message], None], depth: int = QUEUE_DEPTH
    ) -> Subscription[Message]:
        """Subscribe *callback* to the messages of *topic*.

        Args:
            topic: The topic's name before remapping.
            type_: The class of the messages.
            callback: The function to call with each message.
            depth: The maximum number of messages in the queue; when it is full the oldest message is dropped.

        Returns:
            The subscription.

        Raises:
            TopicError: The topic has messages of another type.
        """
        resolved = self.context.topics.topic(self.resolve(topic), type_, self.name)
        created = Subscription(resolved, callback, depth, self._wake, self.name)
        resolved.subscriptions.append(created)
        self.subscriptions.append(created)
        if resolved.latched is not None:
            created.put(resolved.latched)
        return created

    def create_timer(self, period: float, callback: Callable[[], None]) -> Timer:
        """Call a function periodically while an executor runs the component, first after one period.

        Args:
            period: The time (s) between two calls, greater than 0.
            callback: The function to call.

        Returns:
            The timer; its method `cancel` ends the calls.
        """
        created = Timer(self, period, callback)
        self.timers.append(created)
        if self.executor is not None:
            self.executor.start_timer(created)
        return created

    def resolve(self, topic: str) -> str:
        """Return the name of *topic* after remapping."""
        return self._names.get(full_name(topic), full_name(topic))

    def info(self, text: str) -> None:
        """Log *text* with the level INFO."""
        self._log("INFO", text)

    def warn(self, text: str) -> None:
        """Log *text* as a warning, with the level WARN."""
        self._log("WARN", text)

    def error(self, text: str) -> None:
        """Log *text* as an error, with the level ERROR."""
        self._log("ERROR", text)

    def destroy(self) -> None:
        """Remove the component from its executor and from all topics."""
        if self.executor is not None:
            self.executor.remove(self)
        for subscription in self.subscriptions:
            subscription.destroy()

    def unused_warnings(self) -> Iterator[str]:
        """Yield a warning for every parameter that was given but never declared."""
        yield from self.parameters.unused_warnings()

    def _wake(self) -> None:
        if self.executor is not None:
            self.executor.wake()

    def _log(self, level: str, text: str) -> None:
        self.context.log_sink(LogMessage(level, self.now(), self.name, text))


class MessageLoopError(RobotError):
    """Callbacks publish to each other without end, so that the time would never advance."""


class Executor:
    """An executor that runs the timers of its components when they are due, and delivers their messages.

    It is single-threaded: a callback ends before the next callback begins. Messages are delivered at the time
    of their publication, in rounds. In each round every subscription receives at most one message. A round
    visits the components in the order in which they were added, and their subscriptions in the order of
    creation. A component without an executor receives no messages, and its timers are inactive.

    Args:
        schedule: The schedule that calls the executor.
        clock: The clock of the timers.

    Attributes:
        components: The components in the order in which they were added.
    """

    def __init__(self, schedule: Schedule, clock: RobotClock) -> None:
        self.components: list[Component] = []
        self._schedule = schedule
        self._clock = clock
        self._cancel_functions: dict[Timer, Callable[[], None]] = {}
        self._cancel_wake_up: Callable[[], None] | None = None
        self._running = False

    def add(self, component: Component) -> None:
        """Run the timers of *component* and deliver its messages from now on."""
        component.executor = self
        self.components.append(component)
        for timer in component.timers:
            self.start_timer(timer)
        self.wake()

    def remove(self, component: Component) -> None:
        """Stop the timers of *component* and the delivery of its messages."""
        self.components.remove(component)
        component.executor = None
        for timer in component.timers:
            self.cancel_timer(timer)

    def start_timer(self, timer: Timer) -> None:
        """Call *timer* periodically, the first time after one period."""

        def due(now: int) -> None:
            # Deliver pending messages first, so that a controller acts on the newest data.
            self.spin_some()
            if timer in self._cancel_functions:
                timer.callback()
                self.spin_some()

        self._cancel_functions[timer] = self._schedule.add_task(1.0 / timer.period, Phase.COMPONENTS, due)

    def cancel_timer(self, timer: Timer) -> None:
        """Stop calling *timer*."""
        end = self._cancel_functions.pop(timer, None)
        if end is not None:
            end()

    def wake(self) -> None:
        """Schedule the delivery of pending messages at the current time, in the phase `Phase.COMPONENTS`."""
        if self._cancel_wake_up is None and not self._running:
            # `spin_some` cancels this periodic task, so that it runs only once.
            self._cancel_wake_up = self._schedule.add_task(
                1.0, Phase.COMPONENTS, lambda now: self.spin_some(), first=self._clock.now()
            )

    def spin_some(self) -> None:
        """Deliver all pending messages, including those that the callbacks publish.

        Raises:
            MessageLoopError: There are still messages after `MAX_DELIVERY_ROUNDS` rounds.
        """
        if self._running:
            return
        if self._cancel_wake_up is not None:
            self._cancel_wake_up()
            self._cancel_wake_up = None
        self._running = True
        try:
            for _ in range(MAX_DELIVERY_ROUNDS):
                delivered = [
                    subscription.take()
                    for component in self.components
                    for subscription in component.subscriptions
                ]
                if not any(delivered):
                    return
            names = ", ".join(component.name for component in self.components)
            raise MessageLoopError(f"the callbacks of {names} publish to each other without end")
        finally:
            self._running = False
