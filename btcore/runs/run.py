"""Runs: a tree with the providers of what its leaves need, from their opening to their end."""

import contextlib
import inspect
import random
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from os import PathLike
from types import FrameType, TracebackType
from typing import Any, Final, Self, TypeVar, Unpack

import click

from btcore.clock import NS_PER_S, Clock, SimClock, SystemClock
from btcore.engine.leaf import StatefulAction
from btcore.entry_points import names_by_remedy
from btcore.errors import BtcoreError, NodeExecutionError, TreeError
from btcore.extras import describe_missing
from btcore.loading.hot_reload import rebuild_tree
from btcore.loading.instantiate import instantiate, is_clock, make_leaf_tree
from btcore.loading.load import LoadOptions, plan_source
from btcore.runs.choice import Choice, ChosenSettings, choose
from btcore.runs.exit_codes import ExitCode, code_of_signal
from btcore.runs.providers import (
    Need,
    Provider,
    ProviderError,
    ProviderSource,
    Report,
    Resources,
    full_name,
    is_settings,
)
from btcore.runs.settings import RunSettings, Settings
from btcore.runs.tick_loop import EndReason, TickLoop, Until
from btcore.signals import ending_signals, signal_handlers
from btcore.status import Status
from btcore.tree.tree import Tree
from btcore.xml.models.stubs import StubResults
from btcore.xml.plan.plan import Plans

T = TypeVar("T")

_TOLD: Final = (BtcoreError, click.ClickException)
"""Exceptions of providers whose message is meant for the user."""


class TreelessProgram:
    """A program without a tree, such as teleoperation, which is run like a tree of a single leaf.

    Args:
        name: The ID, in CamelCase, that viewers show for the program.
        keep_running: Called at each tick; the program ends when it returns False.
    """

    def __init__(self, name: str, keep_running: Callable[[], bool] = lambda: True) -> None:
        self.name = name
        self.keep_running = keep_running

    def make_tree(self, clock: Clock) -> Tree:
        """Return the tree that viewers show."""
        program = self  # its `keep_running` may be replaced until the first tick

        class Work(StatefulAction):
            def on_start(self) -> Status:
                return self.on_running()

            def on_running(self) -> Status:
                return Status.RUNNING if program.keep_running() else Status.SUCCESS

        return make_leaf_tree(Work, self.name, clock)


class Run:
    """A tree that is ticked, with the providers of what its leaves need.

    On entry, a run chooses the providers, opens them, creates the tree, and opens those that follow the tree.
    On exit it halts the tree and closes the providers, in the reverse order.

    Args:
        source: The path of an XML file, the plans of a tree, or a program.
        provided: Objects for leaves and providers; they are preferred to providers of the same types.
        providers: Providers of the program, besides those of installed packages.
        settings: Settings of providers, and `RunSettings`.
        stubs: The results of stubs.
        prepare: Called on entry when the tree was created, before the providers that follow the tree are
            opened.
        source_of_providers: The providers, if they were searched before; then *providers* is ignored.
        options: As in `btcore.load`, except `resources`. The default of `clock` is that of a provider, or of
            *provided*; without one, the system's clock, or a simulated clock with `RunSettings.fast`.

    Attributes:
        tree: The tree that is ticked; `replace_tree` changes it.
        settings: The settings by their classes.
        run_settings: The `RunSettings`.
        providers: The available providers.
        resources: The objects for leaves.
        choice: The used providers.
        report: The results that providers have added; complete after the end.
        status: The status after the last tick.
        error: The exception that a leaf raised, or None.
        end_reason: Why the last loop ended.
        elapsed_s: The duration of the ticking by the run's clock (s).
        wall_s: The duration of the ticking in real time (s).
        is_output_incomplete: Whether an output is incomplete, such as a recording.

    Raises:
        TreeError: The tree has an error, or lacks a resource.
        ProviderError: The providers cannot be used together, or one raised an exception.
        OutputError: At the end: an output is incomplete.

    Examples:
        >>> from pathlib import Path
        >>> from btcore import Run, RunSettings
        >>> xml = '<root BTCPP_format="4"><BehaviorTree ID="Main"><Sleep msec="500"/></BehaviorTree></root>'
        >>> _ = Path("nap.xml").write_text(xml)
        >>> with Run("nap.xml", settings=[RunSettings(fast=True)]) as run:
        ...     run.until_done()
        >>> run.status, run.elapsed_s
        (<Status.SUCCESS: 2>, 0.5)
    """

    def __init__(
        self,
        source: str | PathLike[str] | Plans | TreelessProgram,
        *,
        provided: Sequence[object] = (),
        providers: Sequence[Provider] = (),
        settings: Sequence[Settings] = (),
        stubs: StubResults | None = None,
        prepare: Callable[["Run"], None] | None = None,
        source_of_providers: ProviderSource | None = None,
        **options: Unpack[LoadOptions],
    ) -> None:
        if options.get("resources"):
            raise TypeError("a run has no argument 'resources': write provided=[…]")
        if isinstance(source, (str, PathLike)):
            source = plan_source(source, options)
        self._source = source
        self._options = options
        self._provided = list(provided)
        self._wanted: list[Any] = source.required_resources() if isinstance(source, Plans) else []
        self._required: list[Any] = []
        self._optional: list[Any] = []
        self.settings = ChosenSettings(settings)
        self.run_settings = self.settings.find(RunSettings) or RunSettings()
        self.providers = source_of_providers or ProviderSource(providers)
        self._own: list[object] = [random.Random(self.run_settings.seed), stubs or StubResults({})]
        self._prepare = prepare
        self._stack = ExitStack()
        self._opened: dict[Provider, _Opened] = {}
        self._clock: Clock | None = None
        self._loop: TickLoop | None = None
        self._signal = 0
        self.tree: Tree
        self.choice: Choice
        self.resources = Resources()
        self.report = Report()
        self.status = Status.IDLE
        self.error: NodeExecutionError | None = None
        self.end_reason: EndReason = "done"
        self.elapsed_s = 0.0
        self.wall_s = 0.0
        self.is_output_incomplete = False

    # --- opening

    def want(self, *types: Any, optional: bool = False) -> Self:
        """Let the run provide *types*, too; see `find`. Call it before the entry.

        Args:
            types: The types.
            optional: Whether the run continues if nothing provides one of them.
        """
        if optional:
            self._optional += types
        else:
            self._wanted += types
            self._required += types
        return self

    def find(self, kind: Callable[..., T]) -> T | None:  # type[T] would exclude protocols
        """Return the object of a type among the resources, or None."""
        found = self._object_for(full_name(kind))
        if found is None:
            found = next((thing for thing in self.resources if _is_instance(thing, kind)), None)
        return found  # type: ignore[return-value]

    def __enter__(self) -> Self:
        # Also an error while the providers are opened ends the run.
        self.report.is_interrupted = True
        with ExitStack() as stack:
            self._stack = stack
            wanted = [kind for kind in self._wanted if not any(_is_instance(own, kind) for own in self._own)]
            self.choice = choose(wanted, self.providers, self.settings, self._provided, self._optional)
            self._check_required()
            self.resources += self._provided
            self._open_all(follow_tree=False)
            self.resources += self._own
            self.tree = self._create_tree()
            if self._prepare is not None:
                self._prepare(self)
            self._open_all(follow_tree=True)
            self._stack = stack.pop_all()
        self.report.is_interrupted = False
        return self

    def _check_required(self) -> None:
        for kind in self._required:
            problem = self.choice.problems.get(full_name(kind))
            if problem is not None:
                raise ProviderError("; ".join([problem, *self._unavailable_notes()]))

    def missing_types(self) -> list[Any]:
        """Return the types that leaves need and that nothing provides."""
        return [kind for kind in self._wanted if not any(_is_instance(one, kind) for one in self.resources)]

    def _unavailable_notes(self) -> list[str]:
        remedies = names_by_remedy(self.providers.unavailable).items()
        return [
            f"providers that may do so cannot be loaded ({names}): {remedy}" for remedy, names in remedies
        ]

    @property
    def clock(self) -> Clock:
        """The clock of the run."""
        if self._clock is None:
            self._clock = self._options.get("clock") or self._find_clock()
        return self._clock

    def _find_clock(self) -> Clock:
        provider = self.choice.clock
        if provider is not None and provider in self._opened:
            for thing in self._opened[provider].objects:
                for clock in (thing, getattr(thing, "clock", None)):
                    if is_clock(clock):
                        return clock
            raise ProviderError(
                f"the provider {provider} declares a Clock, but provides no object with a clock"
            )
        given = next((thing for thing in self._provided if is_clock(thing)), None)
        return given or (SimClock() if self.run_settings.fast else SystemClock())

    def _create_tree(self) -> Tree:
        source = self._source
        if isinstance(source, TreelessProgram):
            return source.make_tree(self.clock)
        try:
            tree = instantiate(
                source,
                self.resources_for_leaves(),
                self._options.get("blackboard"),
                self.clock,
                self._options.get("tick_limit"),
            )
        except TreeError as error:
            for name in map(full_name, source.required_resources()):
                if name in self.choice.problems and self.providers.of_type(name):
                    error.add_note(self.choice.problems[name])
            for note in self._unavailable_notes():
                error.add_note(note)
            raise
        return tree

    def resources_for_leaves(self) -> list[object]:
        """Return the resources; objects that fit several wanted types come after those that fit one.

        A leaf gets the first object of its type: one that locates objects can also track them.
        """
        fits = {id(one): sum(_is_instance(one, kind) for kind in self._wanted) for one in self.resources}
        return sorted(self.resources, key=lambda one: fits[id(one)])

    def _open_all(self, follow_tree: bool) -> None:
        for provider in self.choice.order:
            if provider.follows_tree is follow_tree:
                opened = self._opened[provider] = _Opened(provider, ExitStack())
                self._stack.enter_context(opened.stack)
                opened.value = self._call(opened)
                self.resources += opened.objects

    def _call(self, opened: "_Opened") -> object:
        provider = opened.provider
        arguments = {need.parameter: self._argument(need) for need in provider.needs}
        with _named(provider):
            if not inspect.isgeneratorfunction(provider.function):
                return provider.function(**arguments)
            context = contextlib.contextmanager(provider.function)(**arguments)
            value: object = context.__enter__()
        opened.stack.push(_NamedExit(provider, context).close)
        return value

    def _argument(self, need: Need) -> object:
        if need.type is Clock:
            return self.clock
        if need.type is Tree:
            return self.tree
        if need.type is Report:
            return self.report
        if need.type is Resources:
            return self.resources
        if is_settings(need.type):
            return self.settings.find(need.type)
        return self._object_for(full_name(need.type))

    def _object_for(self, name: str) -> object:
        source = self.choice.sources.get(name)
        if not isinstance(source, Provider):
            return source
        opened = self._opened.get(source)
        return None if opened is None else opened.object_for(name)

    # --- ticking

    def until_done(
        self,
        until: Until = "done",
        *,
        on_tick: Callable[[Status], None] | None = None,
    ) -> None:
        """Tick at the rate of the run until the end, and halt the tree.

        The end is the result *until*, the duration, Ctrl-C, SIGTERM or SIGHUP, or the end of the clock's
        time. The attributes `end_reason` and `status` describe it. An exception of a leaf is kept in `error`.

        Args:
            until: The result of the tree that ends the run.
            on_tick: Called with the tree's status after every tick.

        Raises:
            NodeExecutionError: A program raised an exception.
        """
        loop = self.loop(until, on_tick)
        with self.ticking(loop):
            self.end_reason = loop.run()
        if self.error is not None and isinstance(self._source, TreelessProgram):
            raise self.error

    def loop(
        self,
        until: Until = "done",
        on_tick: Callable[[Status], None] | None = None,
        was_saved: Callable[[], bool] | None = None,
    ) -> TickLoop:
        """Return the loop of the run, for a caller that continues it after a save.

        Args:
            until: As in `until_done`.
            on_tick: As in `until_done`.
            was_saved: Called between two ticks; ends the loop when it returns True.
        """
        settings = self.run_settings
        self._loop = TickLoop(
            self.tree,
            settings.rate,
            settings.duration,
            until,
            on_tick or (lambda status: None),
            was_saved,
            settings.fast,
        )
        return self._loop

    @contextlib.contextmanager
    def ticking(self, loop: TickLoop) -> Iterator[None]:
        """Return a context in which *loop* is run: signals end it, and the tree is halted at its end."""
        began = time.perf_counter()
        try:
            with loop.handle_signals():
                yield
            self.tree.halt()
        except NodeExecutionError as error:
            self.error = error
        except BaseException:
            self.tree.halt()
            raise
        finally:
            self.status = loop.status if self.error is None else Status.IDLE
            self.elapsed_s = loop.elapsed_ns / NS_PER_S
            self.wall_s = time.perf_counter() - began

    def serve(self, serve: Callable[[], None], stop: Callable[[], None]) -> None:
        """Call *serve*, for a program that ticks trees itself, until it returns or a signal ends it.

        The program passes each of its trees to `replace_tree`.

        Args:
            serve: Called once. It returns soon after a call of *stop*.
            stop: Called by the handler of SIGINT, SIGTERM or SIGHUP; a second signal raises an exception.
        """

        def end(number: int, frame: FrameType | None) -> None:
            if self._signal:
                raise KeyboardInterrupt
            self._signal = number
            stop()

        with signal_handlers(ending_signals(), end):
            serve()
        if self._signal:
            self.end_reason = "interrupted"

    @property
    def exit_code(self) -> ExitCode:
        """The exit code of a process for this run."""
        if self.error is not None:
            return ExitCode.LEAF_ERROR
        if self.is_output_incomplete:
            return ExitCode.INCOMPLETE_OUTPUT
        if self.end_reason == "interrupted":
            return code_of_signal(self.received_signal)
        failed = self.end_reason == "done" and self.status is Status.FAILURE
        return ExitCode.FAILURE if failed else ExitCode.SUCCESS

    def step(self) -> Status:
        """Tick the tree once, without waiting, and return its status."""
        self.status = self.tree.tick_once()
        return self.status

    @property
    def received_signal(self) -> int:
        """The number of the signal that ended the run, or 0."""
        return self._signal if self._loop is None else self._loop.received_signal

    @property
    def skipped_ticks(self) -> int:
        """The number of ticks that were skipped because an earlier tick was still in progress."""
        return 0 if self._loop is None else self._loop.skipped_ticks

    def rebuild(self, plans: Plans) -> Tree:
        """Return a new tree with the blackboard of the present one, for `replace_tree`.

        Raises:
            TreeError: The tree cannot be created.
        """
        wanted = plans.required_resources()
        try:
            return rebuild_tree(self.tree, plans, self.resources_for_leaves())
        except BtcoreError as error:
            with contextlib.suppress(TypeError):  # isinstance does not support a type: the error says so
                if not all(any(isinstance(one, kind) for one in self.resources) for kind in wanted):
                    error.add_note(
                        "resources are created only at the start of a run: start a new run for this tree"
                    )
            raise

    def replace_tree(self, tree: Tree) -> None:
        """Continue with *tree*, which the caller may tick itself. The previous tree is halted already."""
        self.tree = tree
        self.error = None
        if self._loop is not None:
            self._loop.tree = tree
        for opened in self._opened.values():
            follow = getattr(opened.value, "replace_tree", None)
            if follow is not None and opened.provider.follows_tree:
                with _named(opened.provider):
                    follow(tree)
            elif opened.provider.follows_tree:
                opened.stack.close()
                opened.value = self._call(opened)

    # --- closing

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        self.report.is_interrupted = error is not None or self.end_reason == "interrupted"
        return self._stack.__exit__(kind, error, trace)


class _Opened:
    """A provider that was opened, what it provides, and how it is closed."""

    def __init__(self, provider: Provider, stack: ExitStack) -> None:
        self.provider = provider
        self.stack = stack
        self.value: object = None

    @property
    def objects(self) -> list[object]:
        """The provided objects."""
        values = (
            self.value if self.provider.provides_several and isinstance(self.value, tuple) else [self.value]
        )
        return [one for one in values if one is not None] if self.provider.types else []

    def object_for(self, name: str) -> object:
        """Return the object of the type with the full *name*."""
        if not self.provider.provides_several:
            return self.value
        named = (one for one in self.objects if any(full_name(base) == name for base in type(one).__mro__))
        return next(named, self.objects[0])


class _NamedExit:
    """The end of a provider, whose own exceptions name it."""

    def __init__(self, provider: Provider, context: contextlib.AbstractContextManager[object]) -> None:
        self._provider = provider
        self._context = context

    def close(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        """Close the provider; *error* is the exception of the run, or None."""
        with _named(self._provider, but=error):
            return self._context.__exit__(kind, error, trace)


@contextlib.contextmanager
def _named(provider: Provider, but: BaseException | None = None) -> Iterator[None]:
    """Return a context in which an exception of a provider becomes an error that names it.

    Args:
        one: The provider.
        but: The exception of the run, which is passed on.
    """
    try:
        yield
    except _TOLD:
        raise
    except ModuleNotFoundError as error:
        missing = describe_missing(error.name)
        raise click.UsageError(f"the resources of the run cannot be provided: {missing}") from error
    except Exception as error:
        if error is but:
            raise
        last = error.__traceback__
        while last is not None and last.tb_next is not None:
            last = last.tb_next
        place = "" if last is None else f" at {last.tb_frame.f_code.co_filename}:{last.tb_lineno}"
        raise ProviderError(
            f"the provider {provider} raised {type(error).__name__}{place}: {error}"
        ) from error


def _is_instance(thing: object, kind: Any) -> bool:
    try:
        return isinstance(thing, kind)
    except TypeError:
        return False  # a type that isinstance does not support is reported when the tree is created
