"""Driving a tree tick by tick on a simulated clock, and reading what happened.

harness = Harness.load("patrol.xml", nodes=nodes, resources=[robot])
harness.tick()
assert harness.result("Move") is Status.RUNNING
harness.wait(2.5)
harness.run()
"""

import threading
from collections.abc import Callable
from os import PathLike
from typing import Any, Final

from btcore.blackboard.blackboard import Blackboard
from btcore.clock import NS_PER_S, SimClock, SystemClock, TickSchedule
from btcore.loading.load import load, loads
from btcore.status import IDLE, RUNNING, Status
from btcore.testing.trace import Trace, TraceStep, format_trace
from btcore.tree.tree import Tree

MAX_TICKS_PER_INSTANT: Final = 10_000
"""How many ticks :meth:`Harness.run` makes at one moment before it gives up."""


class Harness:
    """A tree in the hands of a test. *tree* must be on a simulated clock, or ValueError is raised."""

    def __init__(self, tree: Tree) -> None:
        if isinstance(tree.clock, SystemClock):
            raise ValueError(
                f"the tree '{tree.id}' is on the system's clock, which a test can't step; "
                "load it with clock=SimClock()"
            )
        self.tree = tree
        self.trace = Trace(tree)

    @classmethod
    def load(cls, path: str | PathLike[str], **options: Any) -> "Harness":
        """A harness for the tree in the file *path*; *options* as for :func:`btcore.load`."""
        return cls(load(path, **{"clock": SimClock(), **options}))

    @classmethod
    def loads(cls, text: str, **options: Any) -> "Harness":
        """A harness for the tree in the XML *text*; *options* as for :func:`btcore.loads`."""
        return cls(loads(text, **{"clock": SimClock(), **options}))

    # --- driving

    def tick(self, times: int = 1) -> Status:
        """Tick the root exactly once, or *times* times, without any time passing; the last result."""
        status = IDLE
        for _ in range(times):
            status = self.tree.tick_exactly_once()
        return status

    def wait(self, seconds: float) -> None:
        """Let *seconds* (s) of the tree's clock pass, without a tick."""
        clock = self.tree.clock
        clock.wait_until(clock.now() + round(seconds * NS_PER_S), threading.Event())

    def run(self, period: float = 0.01, limit: float = 60.0) -> Status:
        """Tick until the root isn't RUNNING, as ``tick_while_running(period)`` does; its result.

        Raises AssertionError when it still runs after *limit* seconds of its clock.
        """
        status = self._go(lambda status: status is not RUNNING, period, limit)
        assert status is not None, f"the tree still runs after {limit:g} s\n{self}"
        return status

    def run_until(self, done: Callable[[], object], period: float = 0.01, limit: float = 60.0) -> None:
        """Tick until *done*() is true, also over the tree's completion, which starts it anew.

        Raises AssertionError when *limit* seconds of the tree's clock go by before.
        """
        reached = self._go(lambda _: bool(done()), period, limit)
        assert reached is not None, f"what was waited for did not come within {limit:g} s\n{self}"

    def run_for(self, seconds: float, period: float = 0.01) -> Status:
        """Tick for *seconds* (s) of the tree's clock, also over the tree's completion; the last result."""
        self._go(lambda _: False, period, seconds)
        return self.tree.status

    def halt(self) -> None:
        """Halt the tree."""
        self.tree.halt()
        self.trace.catch_up()

    def _go(self, done: Callable[[Status], bool], period: float, limit: float) -> Status | None:
        clock, context = self.tree.clock, self.tree.context
        end = clock.now() + round(limit * NS_PER_S)
        metronome = TickSchedule(period, clock.now())
        moment, left = clock.now(), MAX_TICKS_PER_INSTANT
        while left:
            status = self.tree.tick_exactly_once()
            if done(status):
                return status
            left -= 1
            if status is RUNNING and context.take_wake_up():
                continue
            if clock.now() >= end:
                return None
            context.wait_until(min(metronome.next(clock.now()), end))
            if clock.now() > moment:
                moment, left = clock.now(), MAX_TICKS_PER_INSTANT
        return None

    # --- reading

    @property
    def blackboard(self) -> Blackboard:
        """The blackboard of the main tree."""
        return self.tree.blackboard

    @property
    def last(self) -> TraceStep:
        """The last step. Raises IndexError before the first tick."""
        return self.trace[-1]

    def status(self, node: str) -> Status:
        """The stored status of the *node* with that path or name; IDLE again once it was reset."""
        return self.tree.node(node).status

    def result(self, node: str) -> Status | None:
        """What *node* gave in the last tick of the root; None if it wasn't ticked."""
        results = self.last.results.get(self.trace.path(node), ())
        return results[-1] if results else None

    def __str__(self) -> str:
        return format_trace(self.trace)
