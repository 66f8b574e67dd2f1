"""A process (ROS's "node"): publishers, subscriptions, timers and parameters; and its executor."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from btcore_robot.errors import RobotError
from btcore_robot.process.parameters import Parameters, Value
from btcore_robot.process.topics import Publisher, Subscription, Topics, full_name
from btcore_robot.robot import NS_PER_S, Phase, Robot, RobotClock, Schedule
from btcore_robot.transforms import TransformTree

Message = TypeVar("Message")

ROUNDS = 1000
"""How often, at one moment, callbacks may answer each other before that counts as endless."""

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


class MessageLoopError(RobotError):
    """Callbacks publish to each other without end, so that time would stand still."""


class Executor:
    """Runs the timers of its processes when they are due, and gives messages to their listeners.

    It is a single-threaded one: a callback runs to its end before the next begins. Messages are given out at
    the moment they are published, in rounds: processes in the order in which they were added, their
    subscriptions in the order in which they were made, one message each. A process that belongs to no
    executor hears nothing, and its timers rest.
    """

    def __init__(self, schedule: Schedule, clock: RobotClock) -> None:
        self.processes: list[Process] = []
        self._schedule = schedule
        self._clock = clock
        self._ends: dict[Timer, Callable[[], None]] = {}
        self._asleep: Callable[[], None] | None = None
        self._running = False

    def add(self, process: Process) -> None:
        """Run *process* from now on."""
        process.executor = self
        self.processes.append(process)
        for timer in process.timers:
            self.start(timer)
        self.wake()

    def remove(self, process: Process) -> None:
        """Run *process* no more."""
        self.processes.remove(process)
        process.executor = None
        for timer in process.timers:
            self.cancel(timer)

    def start(self, timer: Timer) -> None:
        """Have *timer* called in its period, the first time one period from now."""

        def due(now: int) -> None:
            # What was published at this very moment comes first: a controller acts on the newest reading.
            self.run()
            if timer in self._ends:
                timer.callback()
                self.run()

        self._ends[timer] = self._schedule.every(1.0 / timer.period, Phase.PROCESSES, due)

    def cancel(self, timer: Timer) -> None:
        """Call *timer* no more."""
        end = self._ends.pop(timer, None)
        if end is not None:
            end()

    def wake(self) -> None:
        """There is a message: give it out as soon as the world comes to processes, at this moment."""
        if self._asleep is None and not self._running:
            # A task of which only the first call is wanted.
            self._asleep = self._schedule.every(
                1.0, Phase.PROCESSES, lambda now: self.run(), first=self._clock.now()
            )

    def run(self) -> None:
        """Give out all messages that wait. Raises MessageLoopError when that never ends."""
        if self._running:
            return
        if self._asleep is not None:
            self._asleep()
            self._asleep = None
        self._running = True
        try:
            for _ in range(ROUNDS):
                took = [one.take() for process in self.processes for one in process.subscriptions]
                if not any(took):
                    return
            names = ", ".join(process.name for process in self.processes)
            raise MessageLoopError(f"the callbacks of {names} publish to each other without end")
        finally:
            self._running = False
