"""Running the callbacks of processes, one at a time, on the robot's schedule."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from btcore_robot.errors import RobotError
from btcore_robot.robot import Phase, RobotClock, Schedule

if TYPE_CHECKING:
    from btcore_robot.process.process import Process, Timer

ROUNDS = 1000
"""How often, at one moment, callbacks may answer each other before that counts as endless."""


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

    def add(self, process: "Process") -> None:
        """Run *process* from now on."""
        process.executor = self
        self.processes.append(process)
        for timer in process.timers:
            self.start(timer)
        self.wake()

    def remove(self, process: "Process") -> None:
        """Run *process* no more."""
        self.processes.remove(process)
        process.executor = None
        for timer in process.timers:
            self.cancel(timer)

    def start(self, timer: "Timer") -> None:
        """Have *timer* called in its period, the first time one period from now."""

        def due(now: int) -> None:
            # What was published at this very moment comes first: a controller acts on the newest reading.
            self.run()
            if timer in self._ends:
                timer.callback()
                self.run()

        self._ends[timer] = self._schedule.every(1.0 / timer.period, Phase.PROCESSES, due)

    def cancel(self, timer: "Timer") -> None:
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
