"""A harness that ticks a tree on a simulated clock and records its events, for tests.

A test ticks its tree step by step:

    harness = Harness.load("patrol.xml", nodes=nodes, resources=[robot])
    harness.tick()
    assert harness.result("Move") is RUNNING
    harness.wait(2.5)
    harness.run()
"""

import threading
from collections.abc import Callable, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any, Final

from btcore.blackboard.blackboard import Blackboard
from btcore.clock import NS_PER_S, SimClock, SystemClock, TickSchedule
from btcore.loading.load import load, loads, registry_or_standard
from btcore.status import IDLE, RUNNING, Status
from btcore.testing.trace import Trace, TraceStep, format_trace
from btcore.tree.tree import Tree
from btcore.xml.plan.plan import plan_document
from btcore.xml.read.read import parse_file, parse_text

if TYPE_CHECKING:
    from btcore.runs.providers import Provider
    from btcore.runs.run import Run
    from btcore.runs.settings import Settings

MAX_TICKS_PER_INSTANT: Final = 10_000
"""The number of ticks without progress of the clock after which a harness stops ticking."""


class Harness:
    """A tree that a test ticks, and the trace of its events.

    The methods that tick raise NodeExecutionError if a node raises an exception.

    Args:
        tree: The tree, on a simulated clock.
        run: The run of the tree, whose providers `close` closes.

    Attributes:
        tree: The tree.
        trace: The steps since the creation of the harness.

    Raises:
        ValueError: The tree uses the system's clock.

    Examples:
        >>> import btcore
        >>> from btcore.testing import Harness
        >>> b = btcore.Builder()
        >>> xml = b.xml(b.Sequence(b.Sleep(msec=500, name="wait"), b.AlwaysSuccess(name="done")))
        >>> harness = Harness.loads(xml)
        >>> harness.tick(), harness.result("wait"), harness.run(), harness.result("done")
        (<Status.RUNNING: 1>, <Status.RUNNING: 1>, <Status.SUCCESS: 2>, <Status.SUCCESS: 2>)
    """

    def __init__(self, tree: Tree, run: "Run | None" = None) -> None:
        if isinstance(tree.clock, SystemClock):
            raise ValueError(
                f"the tree '{tree.id}' uses the system's clock, which a test cannot advance; "
                "load it with clock=SimClock()"
            )
        self.tree = tree
        self.trace = Trace(tree)
        self._run = run

    @classmethod
    def load(
        cls,
        path: str | PathLike[str],
        *,
        providers: "Sequence[Provider]" = (),
        settings: "Sequence[Settings]" = (),
        **options: Any,
    ) -> "Harness":
        """Return a harness for the tree in an XML file.

        Args:
            path: The XML file.
            providers: Providers of resources; those of installed packages are not used. They are open until
                `close`, which the fixture `btcore_harness` calls at the end of the test.
            settings: The settings of the providers.
            options: Keyword arguments of `btcore.load`, for example `nodes` and `resources`. The
                default of `clock` is a new `SimClock`.

        Raises:
            TreeError: The file has errors.
            TypeError: An argument is unknown, `nodes` is not a Registry, or `resources` is not a list.
            ValueError: The tree would use the system's clock.
        """
        return cls._make(path, False, providers, settings, options)

    @classmethod
    def loads(
        cls,
        text: str,
        *,
        providers: "Sequence[Provider]" = (),
        settings: "Sequence[Settings]" = (),
        **options: Any,
    ) -> "Harness":
        """Return a harness for the tree in an XML text.

        Args:
            text: The XML. Paths of includes are relative to the working directory.
            providers: As in `load`.
            settings: As in `load`.
            options: Keyword arguments of `btcore.loads`, for example `nodes` and `resources`. The
                default of `clock` is a new `SimClock`.

        Raises:
            TreeError: The document has errors.
            TypeError: An argument is unknown, `nodes` is not a Registry, or `resources` is not a list.
            ValueError: The tree would use the system's clock.
        """
        return cls._make(text, True, providers, settings, options)

    @classmethod
    def _make(
        cls,
        source: str | PathLike[str],
        is_text: bool,
        providers: "Sequence[Provider]",
        settings: "Sequence[Settings]",
        options: Any,
    ) -> "Harness":
        if not providers:
            # A clock among the options takes precedence.
            options = {"clock": SimClock(), **options}
            return cls(loads(str(source), **options) if is_text else load(source, **options))
        from btcore.runs.available_providers import AvailableProviders
        from btcore.runs.run import Run
        from btcore.runs.settings import RunSettings

        confined = options.pop("confined", False)
        document = (
            parse_text(str(source), confined=confined) if is_text else parse_file(source, confined=confined)
        )
        nodes = registry_or_standard(options.pop("nodes", None))
        about_tree = {name: options.pop(name) for name in ("tree", "format", "packages") if name in options}
        run = Run(
            plan_document(document, nodes, **about_tree),
            settings=[RunSettings(fast=True), *settings],
            providers=AvailableProviders(providers, uses_installed=False),
            **options,
        )
        return cls(run.__enter__().tree, run)

    def close(self) -> None:
        """Halt the tree and close the providers, if there are any."""
        if self._run is not None:
            self.tree.halt()
            self._run.__exit__(None, None, None)
            self._run = None

    def tick(self, times: int = 1) -> Status:
        """Tick the root *times* times without advancing the clock, and return the last result."""
        status = IDLE
        for _ in range(times):
            status = self.tree.tick_exactly_once()
        return status

    def wait(self, seconds: float) -> None:
        """Advance the clock by *seconds* (s) without a tick."""
        clock = self.tree.clock
        clock.wait_until(clock.now() + round(seconds * NS_PER_S), threading.Event())

    def run(self, period: float = 0.01, limit: float = 60.0) -> Status:
        """Tick until the root is not RUNNING, as `tick_while_running(period)` does, and return its result.

        Args:
            period: The time between two ticks (s). `btcore run` ticks every 0.1 s.
            limit: The maximum duration (s of the tree's clock).

        Raises:
            AssertionError: The root is still RUNNING after *limit*, or after `MAX_TICKS_PER_INSTANT` ticks
                without progress of the clock.
        """
        status = self._tick_until(lambda status: status is not RUNNING, period, limit)
        assert status is not None, f"the tree is still RUNNING after {limit:g} s\n{self}"
        return status

    def run_until(self, done: Callable[[], object], period: float = 0.01, limit: float = 60.0) -> None:
        """Tick until *done* returns a true value. A tree that completes is ticked again.

        Args:
            done: The condition, called after each tick.
            period: The time between two ticks (s).
            limit: The maximum duration (s of the tree's clock).

        Raises:
            AssertionError: The condition is not met within *limit*, or within `MAX_TICKS_PER_INSTANT` ticks
                without progress of the clock.
        """
        reached = self._tick_until(lambda _: bool(done()), period, limit)
        assert reached is not None, f"the condition is not met within {limit:g} s\n{self}"

    def run_for(self, seconds: float, period: float = 0.01) -> Status:
        """Tick for a duration, and return the result of the last tick of the root.

        A tree that completes is ticked again. The method returns early after `MAX_TICKS_PER_INSTANT` ticks
        without progress of the clock.

        Args:
            seconds: The duration (s of the tree's clock).
            period: The time between two ticks (s).
        """
        self._tick_until(lambda _: False, period, seconds)
        return self.tree.status

    def halt(self) -> None:
        """Halt the tree."""
        self.tree.halt()
        self.trace.catch_up()

    def _tick_until(self, done: Callable[[Status], bool], period: float, limit: float) -> Status | None:
        clock, context = self.tree.clock, self.tree.context
        end = clock.now() + round(limit * NS_PER_S)
        schedule = TickSchedule(period, clock.now())
        moment, left = clock.now(), MAX_TICKS_PER_INSTANT
        while left:
            status = self.tree.tick_exactly_once()
            if done(status):
                return status
            left -= 1
            # A node has requested an additional tick, before which no time passes.
            if status is RUNNING and context.consume_wake_up():
                continue
            if clock.now() >= end:
                return None
            context.wait_until(min(schedule.next(clock.now()), end))
            if clock.now() > moment:
                moment, left = clock.now(), MAX_TICKS_PER_INSTANT
        return None

    @property
    def blackboard(self) -> Blackboard:
        """The blackboard of the main tree."""
        return self.tree.blackboard

    @property
    def last(self) -> TraceStep:
        """The last step of the trace. Raises IndexError before the first tick."""
        return self.trace[-1]

    def status(self, node: str) -> Status:
        """Return the stored status of *node* (a path or name), which a reset changes to IDLE."""
        return self.tree.node(node)._status

    def result(self, node: str) -> Status | None:
        """Return the result of *node* in the last tick of the root; None if it was not ticked."""
        results = self.last.results.get(self.trace.path(node), ())
        return results[-1] if results else None

    def __str__(self) -> str:
        return format_trace(self.trace)
