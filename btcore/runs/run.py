"""Runs: a tree with the providers of what its leaves need, from their opening to their end."""

import contextlib
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from os import PathLike
from types import FrameType, TracebackType
from typing import Any, Protocol, Self, TypeVar, Unpack

from btcore.clock import NS_PER_S, Clock, SimClock, SystemClock
from btcore.engine.leaf import StatefulAction
from btcore.entry_points import names_by_remedy
from btcore.errors import BtcoreError, NodeExecutionError, TreeError
from btcore.loading.hot_reload import rebuild_tree
from btcore.loading.instantiate import instantiate, is_clock, make_leaf_tree
from btcore.loading.load import LoadOptions, check_names, plan_source
from btcore.registry.manifest import Resources
from btcore.runs.available_providers import AvailableProviders
from btcore.runs.choice import Choice, ChosenSettings, choose, unused_settings
from btcore.runs.exit_codes import ExitCode, code_of_signal
from btcore.runs.opening import OpenedProvider
from btcore.runs.providers import Need, OutputError, Provider, ProviderError, Report, full_name, is_settings
from btcore.runs.settings import RunSettings, Settings, check_settings
from btcore.runs.tick_loop import EndReason, TickLoop, Until
from btcore.signals import ending_signals, signal_handlers
from btcore.status import Status
from btcore.tree.tree import Tree
from btcore.xml.plan.plan import Plans

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
        providers: Providers of the program, besides those of installed packages; or all that may be used.
        settings: Settings of providers, and `RunSettings`.
        prepare: Called on entry when the tree was created, before the providers that follow the tree are
            opened.
        options: As in `btcore.load`, except `resources`. The default of `clock` is that of a provider, or of
            *provided*; without one, the system's clock, or a simulated clock with `RunSettings.fast`.

    Attributes:
        tree: The tree that is ticked; `replace_tree` changes it.
        settings: The settings by their classes.
        run_settings: The `RunSettings`.
        providers: The available providers.
        resources: The objects for leaves; the object of a used provider comes before others of its type.
        choice: The used providers.
        report: The results that providers have added; complete after the end.
        status: The status after the last tick.
        error: The exception that a leaf raised, or None.
        end_reason: Why the last loop ended.
        elapsed_s: The duration of the ticking by the run's clock (s).
        wall_s: The duration of the ticking in real time (s).
        is_output_incomplete: Whether an output is incomplete, such as a recording; known after the end.

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
        <Status.SUCCESS: 2>
        >>> run.elapsed_s
        0.5
    """

    def __init__(
        self,
        source: str | PathLike[str] | Plans | TreelessProgram,
        *,
        provided: Sequence[object] = (),
        providers: Sequence[Provider] | AvailableProviders = (),
        settings: Sequence[Settings] | ChosenSettings = (),
        prepare: Callable[["Run"], None] | None = None,
        **options: Unpack[LoadOptions],
    ) -> None:
        check_names(options)
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
        self._used_settings: set[type[Settings]] = {RunSettings}
        # Those of a command are checked already.
        self.settings = (
            settings
            if isinstance(settings, ChosenSettings)
            else ChosenSettings(map(check_settings, settings))
        )
        self.run_settings = self.settings.find(RunSettings) or RunSettings()
        self.providers = (
            providers if isinstance(providers, AvailableProviders) else AvailableProviders(providers)
        )
        self._prepare = prepare
        self._stack = ExitStack()
        self._opened: dict[Provider, OpenedProvider] = {}
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
            self.choice = choose(self._wanted, self.providers, self.settings, self._provided, self._optional)
            self._check_required()
            self.resources += self._provided
            self._open_all(follow_tree=False)
            for kind in [*self._wanted, *self._optional]:
                found = self._object_for(full_name(kind))
                if found is not None:
                    self.resources.choose(kind, found)
            self.tree = self._create_tree()
            if self._prepare is not None:
                self._prepare(self)
            self._open_all(follow_tree=True)
            unused = unused_settings(self.choice, self.providers, self.settings, self._used_settings)
            for kind, reason in unused.items():
                self.warn_unused(kind, reason)
            self._stack = stack.pop_all()
        self.report.is_interrupted = False
        return self

    def warn_unused(self, kind: type[Settings], reason: str) -> None:
        """Warn that settings were given, but have no effect.

        Args:
            kind: The class of the settings.
            reason: Why no provider uses them.
        """
        warnings.warn(f"{kind.__name__} have no effect: {reason}", stacklevel=3)

    def _check_required(self) -> None:
        for kind in self._required:
            problem = self.choice.problems.get(full_name(kind))
            if problem is not None:
                raise ProviderError("; ".join([problem, *self._unavailable_notes()]))

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
        source, options = self._source, self._options
        if isinstance(source, TreelessProgram):
            return source.make_tree(self.clock)
        try:
            return instantiate(
                source, self.resources, options.get("blackboard"), self.clock, options.get("tick_limit")
            )
        except TreeError as error:
            missing = [kind for kind in self._wanted if full_name(kind) in self.choice.problems]
            for name in map(full_name, missing):
                if self.providers.of_type(name):
                    error.add_note(self.choice.problems[name])
            for note in self._unavailable_notes():
                error.add_note(note)
            if any(getattr(kind, "__module__", "builtins") != "builtins" for kind in missing):
                error.add_note(
                    "a run does not create objects of your own classes: derive the class from "
                    "btcore.TreeState, or write a provider of the object: see 'Your own resources'"
                )
            raise

    def _open_all(self, follow_tree: bool) -> None:
        for provider in self.choice.order:
            if provider.follows_tree is follow_tree:
                opened = self._opened[provider] = OpenedProvider(provider)
                self._stack.push(opened.close)
                opened.open(self._arguments(provider))
                # A provider may return an object of another one, under another type.
                known = set(map(id, self.resources))
                self.resources += [thing for thing in opened.objects if id(thing) not in known]

    def _arguments(self, provider: Provider) -> dict[str, object]:
        return {need.parameter: self._argument(need) for need in provider.needs}

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
        chosen = self.choice.by_type.get(name)
        if not isinstance(chosen, Provider):
            return chosen
        opened = self._opened.get(chosen)
        return None if opened is None else opened.object_for(name)

    # --- ticking

    def until_done(
        self,
        until: Until = "done",
        *,
        on_tick: Callable[[Status], None] | None = None,
        watcher: "TreeWatcher | None" = None,
    ) -> Status:
        """Tick at the rate of the run until the end, halt the tree, and return the status of the last tick.

        The end is the result *until*, the duration, Ctrl-C, SIGTERM or SIGHUP, or the end of the clock's
        time; see the attribute `end_reason`.

        Args:
            until: The result of the tree that ends the run.
            on_tick: Called with the tree's status after every tick.
            watcher: Replaces the tree whenever its file is saved. The end of a tree is not that of the run.

        Raises:
            NodeExecutionError: A leaf raised an exception; it is also the attribute `error`.
        """
        was_saved = None if watcher is None else watcher.was_saved
        loop = self._loop = TickLoop(self.tree, self.run_settings, until, on_tick, was_saved)
        with self._ticking(loop):
            if watcher is None:
                self.end_reason = loop.run()
            else:
                self._tick_and_reload(loop, watcher)
        if self.error is not None:
            raise self.error
        return self.status

    def _tick_and_reload(self, loop: TickLoop, watcher: "TreeWatcher") -> None:
        has_ended = False
        while True:
            try:
                self.end_reason = loop.wait_for_save() if has_ended else loop.run()
            except NodeExecutionError as error:
                self.error = error
                watcher.on_error(error)
                self.end_reason = "done"
            if self.end_reason == "saved":
                has_ended = not self._reload(watcher) and has_ended
            elif self.end_reason == "done":
                has_ended = True
                self.status = loop.status
                watcher.on_end()
            else:
                return

    def _reload(self, watcher: "TreeWatcher") -> bool:
        """Replace the tree by that in the saved file, if it has no errors; return whether it was replaced."""
        try:
            plans = watcher.read_plans()
            tree = self._rebuild(plans)
        except BtcoreError as error:
            watcher.on_rejected(error)
            return False
        try:
            self.tree.halt()
        except NodeExecutionError as error:
            watcher.on_error(error)
        watcher.on_reload(tree, plans)
        self.replace_tree(tree)
        return True

    def _rebuild(self, plans: Plans) -> Tree:
        """Return the tree of *plans*, with the blackboard of the present tree."""
        try:
            return rebuild_tree(self.tree, plans, self.resources)
        except BtcoreError as error:
            for kind in plans.required_resources():
                if not any(_is_instance(thing, kind) for thing in self.resources):
                    error.add_note(
                        "resources are created only at the start of a run: start a new run for this tree"
                    )
                    break
            raise

    @contextlib.contextmanager
    def _ticking(self, loop: TickLoop) -> Iterator[None]:
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

    def pause(self) -> None:
        """Let `until_done` stop ticking before the next tick, until `resume`. Any thread may call it.

        Meanwhile a simulated world stands still; real time continues, and counts for the duration.
        """
        if self._loop is not None:
            self._loop.is_paused = True

    def resume(self) -> None:
        """End a pause."""
        if self._loop is not None:
            self._loop.is_paused = False

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

    def replace_tree(self, tree: Tree) -> None:
        """Continue with *tree*, which the caller may tick itself. The previous tree is halted already."""
        self.tree = tree
        self.error = None
        if self._loop is not None:
            self._loop.tree = tree
        for opened in self._opened.values():
            if opened.provider.follows_tree:
                opened.replace_tree(tree, self._arguments(opened.provider))

    # --- closing

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        self.report.is_interrupted = error is not None or self.end_reason == "interrupted"
        handled = self._stack.__exit__(kind, error, trace)
        incomplete = [str(one) for opened in self._opened.values() for one in opened.incomplete]
        self.is_output_incomplete = bool(incomplete)
        if incomplete and (error is None or handled):
            raise OutputError("; ".join(incomplete))
        return handled


class TreeWatcher(Protocol):
    """What `Run.until_done` needs to replace a tree whenever its file is saved."""

    def was_saved(self) -> bool:
        """Return whether the file was saved since the last call."""

    def read_plans(self) -> Plans:
        """Return the plans of the saved file.

        Raises:
            BtcoreError: The file has errors.
        """

    def on_end(self) -> None:
        """Report that the tree has ended, and that the run waits for the next save."""

    def on_error(self, error: NodeExecutionError) -> None:
        """Report that a leaf raised an exception, which ends the tree."""

    def on_rejected(self, error: BtcoreError) -> None:
        """Report that the saved file has errors, so that the previous tree continues."""

    def on_reload(self, tree: Tree, plans: Plans) -> None:
        """Prepare *tree*, which now replaces the previous one."""


def _is_instance(thing: object, kind: Any) -> bool:
    try:
        return isinstance(thing, kind)
    except TypeError:
        return False  # a type that isinstance does not support is reported when the tree is created
