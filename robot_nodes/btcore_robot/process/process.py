"""A process (ROS's "node"): publishers, subscriptions, timers and parameters under one name."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar

from btcore_robot.process.parameters import Parameters, Value
from btcore_robot.process.topics import Publisher, Subscription, Topics, full_name
from btcore_robot.robot import NS_PER_S, Robot, RobotClock, Schedule
from btcore_robot.transforms import TransformTree

if TYPE_CHECKING:
    from btcore_robot.process.executor import Executor

Message = TypeVar("Message")

QUEUE = 10
"""How many messages wait in a queue unless said otherwise: the book's number."""


@dataclass(frozen=True, slots=True)
class LogMessage:
    """What a process said: *level* (INFO, WARN or ERROR), *stamp* (ns), its *name*, the *text*."""

    level: str
    stamp: int
    name: str
    text: str

    def __str__(self) -> str:
        return f"[{self.level}] [{self.stamp / NS_PER_S:.3f}] [{self.name}]: {self.text}"


class ProcessContext:
    """What processes share: topics, transforms, a clock, a schedule, a log, and a robot where there is one.

    *say* takes every line that a process logs.
    """

    def __init__(
        self,
        clock: RobotClock,
        schedule: Schedule,
        say: Callable[[LogMessage], None],
        *,
        robot: Robot | None = None,
        transforms: TransformTree | None = None,
    ) -> None:
        self.clock = clock
        self.schedule = schedule
        self.say = say
        self.robot = robot
        self.transforms = transforms if transforms is not None else TransformTree()
        self.topics = Topics()


@dataclass(frozen=True, slots=True)
class ProcessOptions:
    """How a process is started: another *name* than its own, topics by other names, parameters' values."""

    name: str | None = None
    remap: Mapping[str, str] = field(default_factory=dict)
    parameters: Mapping[str, Value] = field(default_factory=dict)


class Timer:
    """Calls *callback* every *period* seconds while its process runs."""

    def __init__(self, process: "Process", period: float, callback: Callable[[], None]) -> None:
        self.period = period
        self.callback = callback
        self._process = process

    def cancel(self) -> None:
        """Call it no more."""
        self._process.timers.remove(self)
        if self._process.executor is not None:
            self._process.executor.cancel(self)


class Process:
    """A program of the robot. A subclass sets itself up in ``__init__`` and acts in callbacks.

    An executor runs it: see `Executor.add`. *name* is its own; *options* may give it another.
    """

    def __init__(self, name: str, context: ProcessContext, options: ProcessOptions | None = None) -> None:
        options = options if options is not None else ProcessOptions()
        self.name = options.name or name
        self.context = context
        self.parameters = Parameters(self.name, options.parameters)
        self.subscriptions: list[Subscription[Any]] = []
        self.timers: list[Timer] = []
        self.executor: Executor | None = None
        self._names = {full_name(old): full_name(new) for old, new in options.remap.items()}

    def now(self) -> int:
        """The time (ns)."""
        return self.context.clock.now()

    def publisher(self, topic: str, type_: type[Message], *, latched: bool = False) -> Publisher[Message]:
        """A publisher of messages of *type_* on *topic*; a latched one keeps its last for whoever comes."""
        named = self.context.topics.topic(self.resolve(topic), type_, self.name)
        named.publishers.append(self.name)
        return Publisher(named, latched)

    def subscribe(
        self, topic: str, type_: type[Message], callback: Callable[[Message], None], depth: int = QUEUE
    ) -> Subscription[Message]:
        """Have *callback* called with each message on *topic*; *depth* of them wait at most."""
        named = self.context.topics.topic(self.resolve(topic), type_, self.name)
        made = Subscription(named, callback, depth, self._wake, self.name)
        named.listeners.append(made)
        self.subscriptions.append(made)
        if named.latched is not None:
            made.put(named.latched)
        return made

    def timer(self, period: float, callback: Callable[[], None]) -> Timer:
        """Have *callback* called every *period* seconds."""
        made = Timer(self, period, callback)
        self.timers.append(made)
        if self.executor is not None:
            self.executor.start(made)
        return made

    def resolve(self, topic: str) -> str:
        """The name that *topic* has after the remappings."""
        return self._names.get(full_name(topic), full_name(topic))

    def info(self, text: str) -> None:
        """Log *text*."""
        self._say("INFO", text)

    def warn(self, text: str) -> None:
        """Log *text* as a warning."""
        self._say("WARN", text)

    def error(self, text: str) -> None:
        """Log *text* as an error."""
        self._say("ERROR", text)

    def end(self) -> None:
        """Leave the executor and all topics."""
        if self.executor is not None:
            self.executor.remove(self)
        for subscription in self.subscriptions:
            subscription.end()

    def unused(self) -> Iterator[str]:
        """A sentence for every parameter that was given and that the process never declared."""
        yield from self.parameters.unused()

    def _wake(self) -> None:
        if self.executor is not None:
            self.executor.wake()

    def _say(self, level: str, text: str) -> None:
        self.context.say(LogMessage(level, self.now(), self.name, text))
