"""Runs: trees with the providers of what their leaves need, from their opening to their end."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import chain
from os import PathLike
from types import TracebackType
from typing import Self, TypeVar

from btcore.blackboard.blackboard import Blackboard
from btcore.clock import NS_PER_S, Clock
from btcore.engine.leaf import StatefulAction
from btcore.errors import NodeExecutionError, TreeError
from btcore.exit_codes import ExitCode
from btcore.loading.instantiate import instantiate, resources_as_sequence
from btcore.loading.load import loads, registry_or_standard
from btcore.registry.registry import Registry
from btcore.registry.resources import Resources, TypeRef
from btcore.runs.available_providers import AvailableProviders
from btcore.runs.opening import RunProviders
from btcore.runs.providers import Provider
from btcore.runs.report import Report, RunPrinter
from btcore.runs.run_end import EndReason, RunEnd, join_errors
from btcore.runs.settings import GivenSettings, RunSettings, Settings
from btcore.runs.tick_loop import OnTick, Reloader, ReloadRequests, TickLoop, Until
from btcore.signals import EndingSignals
from btcore.status import Status
from btcore.tree.tree import Tree
from btcore.xml.plan.plan import Plans, plan_document
from btcore.xml.read.read import parse_file

T = TypeVar("T")


class TreelessProgram:
    """A program without a tree, such as teleoperation, which is run like a tree of a single leaf.

    Args:
        name: The ID, in CamelCase, that viewers show for the program.
        keep_running: Called at each tick; the program ends when it returns False.
    """

    def __init__(self, name: str, keep_running: Callable[[], bool] = lambda: True) -> None:
        self.name = name
        self.keep_running = keep_running

    def create_tree(self, clock: Clock) -> Tree:
        """Return the tree that viewers show."""
        program = self  # its `keep_running` may be replaced until the first tick

        class Work(StatefulAction):
            def on_start(self) -> Status:
                return self.on_running()

            def on_running(self) -> Status:
                return Status.RUNNING if program.keep_running() else Status.SUCCESS

        nodes = Registry.standard()
        nodes.add(Work, ID=self.name)
        xml = f'<BehaviorTree ID="{self.name}Alone"><{self.name}/></BehaviorTree>'
        tree = loads(f'<root BTCPP_format="4">{xml}</root>', nodes=nodes, clock=clock)
        tree.documents = ()  # recorders ignore a tree without documents
        return tree


Runnable = str | PathLike[str] | Plans | TreelessProgram
"""What a run ticks: the tree in an XML file or of plans, or a program without a tree."""


def _plan(source: object, nodes: Registry | None, tree: str | None) -> Plans | TreelessProgram:
    """Plan the tree of a file, and check plans for errors. A program is returned unchanged."""
    if isinstance(source, (str, PathLike)):
        source = plan_document(parse_file(source), registry_or_standard(nodes), tree)
    if isinstance(source, Plans):
        source.diagnostics.raise_errors()
    elif not isinstance(source, TreelessProgram):
        raise TypeError(
            f"there is no run of a {type(source).__name__}: write the XML to a file, and pass its path"
        )
    return source


class Run:
    """A tree that is ticked, or several, with the providers of what their leaves need.

    On entry, a run chooses the providers, opens them, creates the trees, and opens those that need the tree.
    On exit it halts the trees and closes the providers, in the reverse order.

    Several trees share the providers and the clock, and are ticked in their order. A tree that has ended is
    not ticked again. The run ends when all trees have ended, with FAILURE if one of them failed. A provider
    with a parameter of the type `Tree`, such as a publisher or a log, gets the first tree.

    From its entry to its exit, a run handles Ctrl-C, SIGTERM and SIGHUP (the terminal was closed):

    - The first signal ends `tick_to_end` or `run_until_signal` as usual. While providers are closed, it
      ends their waits.
    - A second signal, or a signal at another time, raises KeyboardInterrupt. If the signal is not Ctrl-C, the
      exception leaves the run as SystemExit.

    Args:
        source: The path of an XML file, the plans of a tree, or a `TreelessProgram`; or a list of them.
        providers: Providers besides those of installed packages; or all providers that may be used.
        settings: Settings of providers, and `RunSettings`.
        prepare: Called on entry when the trees were created, before the providers that need the tree open.
        nodes: The nodes and trees that the tree of a file may use, as in `btcore.load`.
        tree: The ID of the tree of a file, as in `btcore.load`.
        resources: Objects for leaves and providers, which are preferred to providers of the same types.
        blackboard: The blackboard of the main trees, which share it.
        clock: The clock; default the clock of a provider, or the first of *resources* that is a clock;
            without one, the system's clock, or a simulated clock with `RunSettings.fast`.
        tick_limit: As in `btcore.load`.
        printer: Prints the messages of the run. By default, warnings go to stderr, and the errors of closed
            providers are raised.

    Attributes:
        settings: The settings by their classes.
        run_settings: The `RunSettings`.
        providers: The providers: which are used (`choice`), and what they raised when they were closed
            (`errors`).
        report: The results that providers have added; complete after the end.
        elapsed_s: The duration of the ticking by the run's clock (s).
        wall_s: The duration of the ticking in real time (s).

    Raises:
        TreeError: The tree has an error, or lacks a resource.
        ProviderError: The providers cannot be used together, or one raised an exception; also at the end.
        OutputError: At the end: an output is incomplete.

    Examples:
        >>> from pathlib import Path
        >>> from btcore import Run, RunSettings
        >>> xml = '<root BTCPP_format="4"><BehaviorTree ID="Main"><Sleep msec="500"/></BehaviorTree></root>'
        >>> _ = Path("nap.xml").write_text(xml)
        >>> with Run("nap.xml", settings=[RunSettings(fast=True)]) as run:
        ...     run.tick_to_end()
        <Status.SUCCESS: 2>
        >>> run.elapsed_s
        0.5
    """

    def __init__(
        self,
        source: Runnable | Sequence[Runnable],
        *,
        providers: Sequence[Provider] | AvailableProviders = (),
        settings: Iterable[Settings] = (),
        prepare: Callable[["Run"], None] | None = None,
        nodes: Registry | None = None,
        tree: str | None = None,
        resources: Sequence[object] = (),
        blackboard: Blackboard | None = None,
        clock: Clock | None = None,
        tick_limit: float | None = None,
        printer: RunPrinter | None = None,
    ) -> None:
        sources: Sequence[object] = [source]
        if isinstance(source, Sequence) and not isinstance(source, (str, Plans)):  # plans are a tuple
            sources = source
        if not sources:
            raise ValueError("there is no run of an empty list: pass a tree or a TreelessProgram")
        self._sources = [_plan(each, nodes, tree) for each in sources]
        self._blackboard = blackboard
        self._tick_limit = tick_limit
        plans = [planned for planned in self._sources if isinstance(planned, Plans)]
        leaf_types = list(dict.fromkeys(chain(*(tree.required_resources() for tree in plans))))
        self._prepare = prepare
        self.settings = GivenSettings(settings)
        self.run_settings = self.settings.of(RunSettings)
        self._end = RunEnd()
        self._printer = printer or RunPrinter()
        self.report = Report(self._end, self._printer)
        self.elapsed_s = 0.0
        self.wall_s = 0.0
        available = providers if isinstance(providers, AvailableProviders) else AvailableProviders(providers)
        self.providers = RunProviders(
            available, self.settings, leaf_types, resources_as_sequence(resources), clock, self.report
        )
        self._loop = TickLoop(self.run_settings)
        self._signals = EndingSignals()
        self._stack = ExitStack()
        self._has_exited = False

    # --- opening

    def want(self, *types: TypeRef, optional: bool = False) -> Self:
        """Let the run provide *types*, too; see `find`.

        Args:
            types: The types.
            optional: Whether the run continues if nothing provides one of them.

        Raises:
            RuntimeError: The run was entered, so that its providers are chosen.
        """
        if self.trees:
            raise RuntimeError("the run was entered already: call want() before 'with'")
        self.providers.want(types, optional)
        return self

    def find(self, type: Callable[..., T]) -> T | None:  # type[T] would exclude protocols
        """Return the object of a type among the resources, or None."""
        return self.providers.find(type)  # type: ignore[arg-type, return-value]

    def __enter__(self) -> Self:
        try:
            self._enter()
        except Exception as error:
            for closing_error in self.providers.errors:
                error.add_note(str(closing_error))
            raise
        return self

    def _enter(self) -> None:
        with ExitStack() as stack:
            stack.enter_context(self._signals)
            providers = self.providers
            providers.choose()
            providers.open_before_tree(stack)
            self._loop.trees = [self._create_tree(source) for source in self._sources]
            if self._prepare is not None:
                self._prepare(self)
            providers.open_after_tree(self.tree, stack)
            stack.callback(self._halt)
            for settings_class, reason in providers.find_unused_settings().items():
                self._printer.print_unused(settings_class, reason)
            self._stack = stack.pop_all()

    @property
    def trees(self) -> list[Tree]:
        """The trees that are ticked; none before the entry."""
        return self._loop.trees

    @property
    def tree(self) -> Tree:
        """The tree that is ticked, or the first of them; `replace_tree` changes it.

        Raises:
            RuntimeError: The run was not entered.
        """
        if not self.trees:
            raise RuntimeError("a run has no tree before its entry: write 'with Run(…) as run:'")
        return self.trees[0]

    @property
    def resources(self) -> Resources:
        """The objects for leaves; the object of a used provider comes before others of its type."""
        return self.providers.resources

    @property
    def reload_requests(self) -> ReloadRequests | None:
        """The requests of clients for other trees, if a provided object takes them."""
        return self.providers.reload_requests

    @property
    def clock(self) -> Clock:
        """The clock of the run."""
        return self.providers.clock

    def _create_tree(self, source: Plans | TreelessProgram) -> Tree:
        if isinstance(source, TreelessProgram):
            return source.create_tree(self.clock)
        try:
            return instantiate(source, self.resources, self._blackboard, self.clock, self._tick_limit)
        except TreeError as error:
            for note in self.providers.explain_missing():
                error.add_note(note)
            raise

    # --- ticking

    def tick_to_end(
        self,
        until: Until = "done",
        *,
        on_tick: OnTick | None = None,
        reloader: Reloader | None = None,
    ) -> Status:
        """Tick at the rate of the run until the end, halt the trees, and return the status of the last tick.

        The end is the result *until* of each tree, the duration, a signal, or the end of the clock's time;
        see the attribute `end_reason`.

        Args:
            until: The result that ends a tree; the run ends when all trees have ended.
            on_tick: Called with the `status` after every tick.
            reloader: Its method `reload` is called between ticks, and may call `replace_tree`. If it is
                endless, the run waits until it does after the end of all trees, also by an exception of a
                leaf. The exception is raised at the end, unless another tree has replaced that tree.

        Raises:
            NodeExecutionError: A leaf raised an exception; it is also the attribute `error`.
        """
        self._check_open()
        loop = self._loop
        loop.start()
        began = time.perf_counter()
        try:
            with self._stop_at_signal(loop.stop), self._keep_leaf_error():
                self._end.loop_end = loop.run(until, on_tick, reloader)
            self._halt()
        finally:
            self.elapsed_s = loop.elapsed_ns / NS_PER_S
            self.wall_s = time.perf_counter() - began
        return self.status

    def step(self) -> Status:
        """Tick the tree once, without waiting, and return its status.

        Of several trees, those that are RUNNING are ticked, or all if none is. Time passes only by other
        means: a `SimClock` by `run.clock.advance(0.1)`.

        Raises:
            NodeExecutionError: A leaf raised an exception.
        """
        self._check_open()
        with self._keep_leaf_error():
            self._loop.step()
        return self.status

    def run_until_signal(self, tick_trees: Callable[[], None], stop: Callable[[], None]) -> None:
        """Call *tick_trees*, which ticks trees itself, until it returns or a signal ends it.

        Args:
            tick_trees: Called once. It passes each of its trees to `replace_tree` before it ticks it, and
                returns soon after a call of *stop*.
            stop: Called by the handler of the first signal.
        """
        self._check_open()
        with self._stop_at_signal(stop):
            tick_trees()

    def pause(self) -> None:
        """Let `tick_to_end` stop ticking before the next tick, until `resume`. Any thread may call it.

        Meanwhile a simulated world stands still; real time continues, and counts for the duration. A pause
        also holds for calls of `tick_to_end` that begin later.
        """
        self._loop.is_paused = True

    def resume(self) -> None:
        """End a pause."""
        self._loop.is_paused = False

    def replace_tree(self, tree: Tree) -> None:
        """Continue with *tree* in place of the first, which is halted already. The caller may tick it."""
        self._end.error = None
        self._loop.replace_tree(tree)
        self.providers.replace_tree(tree)

    @contextmanager
    def _keep_leaf_error(self) -> Iterator[None]:
        try:
            yield
        except NodeExecutionError as error:
            self._end.error = error
            raise

    @contextmanager
    def _stop_at_signal(self, stop: Callable[[], object]) -> Iterator[None]:
        self._end.loop_end = None
        self._end.signal = self._signals.number = 0
        self._signals.stop = stop
        try:
            yield
        finally:
            self._signals.stop = None
            self._end.signal = self._signals.number

    def _check_open(self) -> None:
        _ = self.tree  # raises before the entry
        if self._has_exited:
            raise RuntimeError("the run has ended, and its providers are closed: tick in the 'with' block")

    def _halt(self) -> None:
        """Halt the trees. What their leaves raise is added to `error`, or raised if there is none."""
        errors: list[NodeExecutionError] = []
        for tree in self.trees:
            # An interrupted first tick leaves the status of the tree IDLE.
            statuses = [tree.status, *(node.status for node in tree.nodes)]
            if any(status is not Status.IDLE for status in statuses):
                try:
                    tree.halt()
                except NodeExecutionError as error:
                    errors.append(error)
        if errors and self.error is not None:
            self.error.later_errors += errors
        elif errors:
            with self._keep_leaf_error():
                errors[0].later_errors += errors[1:]
                raise errors[0]

    # --- the end

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._has_exited = True
        earlier_signal = self._signals.number
        self._end.note_exit(error, earlier_signal)
        try:
            self._stack.__exit__(kind, error, trace)
        except (KeyboardInterrupt, SystemExit):  # as `EndingSignals` raises them
            if earlier_signal or not self._signals.number:
                raise
            # The first signal has ended the waits of the providers.
            self._end.signal = self._signals.number
        finally:
            errors = self.providers.errors
            were_printed = self._printer.print_errors(errors)
        if error is None and errors and not were_printed:
            raise join_errors(errors)

    @property
    def status(self) -> Status:
        """The status after the last tick; IDLE if a leaf raised an exception.

        For several trees, RUNNING or FAILURE if one of them has it, otherwise the status of the first.
        """
        return self._loop.status if self.error is None else Status.IDLE

    @property
    def error(self) -> NodeExecutionError | None:
        """The exception that a leaf raised, or None. `replace_tree` clears it."""
        return self._end.error

    @property
    def end_reason(self) -> EndReason | None:
        """Why the run ended; None before its end."""
        return self._end.reason

    @property
    def exit_code(self) -> ExitCode:
        """The exit code of a process for this run."""
        return self._end.exit_code(self.status, self.providers.errors)

    @property
    def missed_ticks(self) -> int:
        """The number of ticks that did not take place because an earlier tick was in progress."""
        return self._loop.schedule.missed_ticks
