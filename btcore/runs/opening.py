"""Opening the providers of a run and closing them.

An exception whose message is not meant for the user becomes a `ProviderError` that names the provider.
"""

import contextlib
import inspect
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from traceback import walk_tb
from types import TracebackType

from btcore.clock import Clock, SimClock, SystemClock, is_clock
from btcore.entry_points import names_by_remedy
from btcore.errors import BtcoreError, ProviderError
from btcore.registry.resources import Resources, TypeRef, fits, full_name
from btcore.runs.available_providers import AvailableProviders
from btcore.runs.choice import Choice, Source, choose_providers, title_with_article
from btcore.runs.providers import Need, Provider, is_settings
from btcore.runs.report import Report
from btcore.runs.settings import GivenSettings, RunSettings, Settings
from btcore.runs.tick_loop import ReloadRequests
from btcore.suggestions import join_names
from btcore.tree.tree import Tree


class OpenedProvider:
    """A provider that was opened, and what it provides.

    Args:
        arguments: The arguments of its function.

    Attributes:
        provider: The provider.
        value: What the function returned or yielded.
        error: What the provider raised when it was closed, such as `OutputError`, or None.
    """

    def __init__(self, provider: Provider, arguments: Mapping[str, object]) -> None:
        self.provider = provider
        self.value: object = None
        self.error: BtcoreError | None = None
        self._context: contextlib.AbstractContextManager[object] | None = None
        self._open(arguments)

    def _open(self, arguments: Mapping[str, object]) -> None:
        """Call the function with *arguments*, up to its `yield`."""
        function = self.provider.function
        with _convert_errors(self.provider):
            if inspect.isgeneratorfunction(function):
                context = contextlib.contextmanager(function)(**arguments)
                self.value = context.__enter__()
                self._context = context
            else:
                self.value = function(**arguments)

    def close(
        self,
        kind: type[BaseException] | None = None,
        error: BaseException | None = None,
        trace: TracebackType | None = None,
    ) -> None:
        """Execute what follows the `yield`; *error* is the exception of the run, or None.

        An error of the provider is kept, so that the others are closed as usual. A provider may explain
        *error* by another exception, but cannot suppress it.
        """
        context, self._context = self._context, None
        if context is None:
            return
        try:
            with _convert_errors(self.provider, error):
                context.__exit__(kind, error, trace)
        except BtcoreError as own_error:
            if error is not None and error in (own_error, own_error.__cause__):
                raise  # the exception of the run, or its explanation by the provider
            self.error = self.error or own_error

    def replace_tree(self, tree: Tree, arguments: Mapping[str, object]) -> None:
        """Pass *tree* to the method `replace_tree` of the object, or open the provider again."""
        replace_tree = getattr(self.value, "replace_tree", None)
        if replace_tree is None:
            self.close()
            self._open(arguments)
        else:
            with _convert_errors(self.provider):
                replace_tree(tree)

    @property
    def objects(self) -> list[object]:
        """The provided objects."""
        value = self.value
        values = value if self.provider.provides_several and isinstance(value, tuple) else (value,)
        return [value for value in values if value is not None] if self.provider.types else []

    def object_for(self, name: str) -> object:
        """Return the object of the type with the full *name*.

        A protocol that no object of a tuple names as a base class is that of the first object.
        """
        if not self.provider.provides_several:
            return self.value
        fitting = (provided for provided in self.objects if fits(provided, name))
        return next(fitting, next(iter(self.objects), None))


class RunProviders:
    """The providers of a run, which are chosen and then opened, and the objects of the run.

    Args:
        leaf_types: The types that the leaves need.
        clock: The clock that the program has given, or None.

    Attributes:
        choice: The used providers.
        report: The report of the run.
        tree: The first tree, or the tree that has replaced it; None before its creation.
        resources: The objects for leaves; the object of a used provider comes before others of its type.
    """

    def __init__(
        self,
        available: AvailableProviders,
        settings: GivenSettings,
        leaf_types: Sequence[TypeRef],
        program_resources: Sequence[object],
        clock: Clock | None,
        report: Report,
    ) -> None:
        self._available = available
        self._settings = settings
        self._program_resources = program_resources
        self._program_clock = clock
        self._leaf_types = leaf_types
        self._opened: dict[Provider, OpenedProvider] = {}
        self._wanted_types: list[TypeRef] = []
        self._optional_types: list[TypeRef] = []
        self.choice = Choice()
        self.report = report
        self.tree: Tree | None = None
        self.resources = Resources()
        self.resources.missing_note = "the run does not provide it"

    def want(self, types: Sequence[TypeRef], is_optional: bool) -> None:
        """Provide *types* for the program, which can do without them if *is_optional*."""
        (self._optional_types if is_optional else self._wanted_types).extend(types)

    def choose(self) -> None:
        """Choose the providers."""
        self.choice = choose_providers(
            [*self._leaf_types, *self._wanted_types],
            self._available,
            self._settings.classes,
            self._program_resources,
            self._optional_types,
        )
        for name in map(full_name, self._wanted_types):
            if problem := self.choice.sources[name].problem:
                raise ProviderError("; ".join([problem, *self._explain_unavailable()]))

    def open_before_tree(self, stack: contextlib.ExitStack) -> None:
        """Open the providers that do not need the tree, and fill the resources; *stack* closes them."""
        used = [cls for provider in self.choice.order for cls in provider.settings_classes]
        for settings in map(self._settings.find, dict.fromkeys(used)):
            if settings is not None:
                settings.check_environment()
        self.resources += self._program_resources
        for provider in self.choice.order:
            if not provider.needs_tree:
                # A provider may return an object of another one, under another type.
                known = set(map(id, self.resources))
                objects = self._open(provider, stack)
                self.resources += [provided for provided in objects if id(provided) not in known]
        for type in (*self._leaf_types, *self._wanted_types, *self._optional_types):
            assigned = self._find_assigned(full_name(type))
            if assigned is not None:
                self.resources.assign(type, assigned)

    def open_after_tree(self, tree: Tree, stack: contextlib.ExitStack) -> None:
        """Open the providers that need *tree*, whose leaves do not get their objects."""
        self.tree = tree
        for provider in self.choice.order:
            if provider.needs_tree:
                self._open(provider, stack)

    def _open(self, provider: Provider, stack: contextlib.ExitStack) -> list[object]:
        opened = self._opened[provider] = OpenedProvider(provider, self._collect_arguments(provider))
        stack.push(opened.close)
        return opened.objects

    def find(self, type: TypeRef) -> object:
        """Return the object of a type: the assigned object, else the first among the resources; or None."""
        assigned = self._find_assigned(full_name(type))
        if assigned is not None:
            return assigned
        return next((resource for resource in self.resources if fits(resource, type)), None)

    def _find_assigned(self, type_name: str) -> object:
        """Return the object that the choice assigns to the type with a full name, or None."""
        source = self.choice.sources.get(type_name, Source())
        if source.provider in self._opened:
            return self._opened[source.provider].object_for(type_name)
        return source.own

    @cached_property
    def clock(self) -> Clock:
        """The clock of the run."""
        if self._program_clock is not None:
            return self._program_clock
        provider = self.choice.clock
        if provider is None:
            own = next(filter(is_clock, self._program_resources), None)
            return own or (SimClock() if self._settings.of(RunSettings).fast else SystemClock())
        if provider not in self._opened:
            raise ProviderError(f"the clock of the run is needed to open its own provider, {provider}")
        for provided in self._opened[provider].objects:
            for clock in (provided, getattr(provided, "clock", None)):
                if is_clock(clock):
                    return clock
        raise ProviderError(f"the provider {provider} declares a Clock, but provides no object with a clock")

    def replace_tree(self, tree: Tree) -> None:
        """Pass *tree* to the providers that need the tree."""
        self.tree = tree
        for provider, opened in self._opened.items():
            if provider.needs_tree:
                opened.replace_tree(tree, self._collect_arguments(provider))

    @property
    def reload_requests(self) -> ReloadRequests | None:
        """The requests of clients for other trees: the attribute of this name of a provided object."""
        found = (getattr(opened.value, "reload_requests", None) for opened in self._opened.values())
        return next((requests for requests in found if requests is not None), None)

    @property
    def errors(self) -> list[BtcoreError]:
        """What the providers raised when they were closed."""
        return [opened.error for opened in self._opened.values() if opened.error is not None]

    def find_unused_settings(self) -> dict[type[Settings], str]:
        """Return the classes of the given settings that no used provider takes, with the reasons."""
        choice = self.choice
        used = {RunSettings, *(cls for provider in choice.order for cls in provider.settings_classes)}
        reasons = {}
        for settings_class in [cls for cls in self._settings.classes if cls not in used]:
            takers = [taker for taker in self._available.all() if settings_class in taker.settings_classes]
            takers = [taker for taker in takers if settings_class not in taker.optional_settings] or takers
            rejections = [choice.rejected[taker] for taker in takers if taker in choice.rejected]
            types = dict.fromkeys(title_with_article(taker.types[0]) for taker in takers if taker.types)
            if rejections:
                reasons[settings_class] = rejections[0]
            elif types:
                reasons[settings_class] = f"no leaf needs {join_names(list(types), 'or')}"
            elif takers:
                reasons[settings_class] = "it is not used"
        return reasons

    def explain_missing(self) -> Iterator[str]:
        """Yield why objects are missing that the leaves need."""
        unknown = []
        for type in self._leaf_types:
            name = full_name(type)
            source = self.choice.sources[name]
            if self._available.of_type(name) and source.problem:
                yield source.problem
            elif source.problem:
                unknown.append(type)
            elif self._find_assigned(name) is None:
                yield f"the provider {source.provider} has provided None"
        yield from self._explain_unavailable()
        if any(getattr(type, "__module__", "builtins") != "builtins" for type in unknown):
            yield (
                "a run does not create objects of your own classes: derive the class from "
                "btcore.TreeResource, or write a provider of the object: see 'Your own resources'; a program "
                "may pass the object in Run(resources=[…])"
            )

    def _explain_unavailable(self) -> list[str]:
        remedies = names_by_remedy(self._available.unavailable).items()
        return [
            f"providers that may do so cannot be loaded ({names}): {remedy}" for remedy, names in remedies
        ]

    def _collect_arguments(self, provider: Provider) -> dict[str, object]:
        return {need.parameter: self._find_argument(provider, need) for need in provider.needs}

    def _find_argument(self, provider: Provider, need: Need) -> object:
        if need.type is Clock:
            return self.clock
        if need.type is Tree:
            return self.tree
        if need.type is Report:
            return self.report
        if need.type is Resources:
            return self.resources
        if is_settings(need.type):
            return self._settings.find(need.type)
        assigned = self._find_assigned(need.type_name)
        if assigned is None and not need.is_optional:
            other = self.choice.sources[need.type_name].provider
            raise ProviderError(f"{provider} needs its '{need.parameter}', but {other} has provided None")
        return assigned


@contextlib.contextmanager
def _convert_errors(provider: Provider, error_of_run: BaseException | None = None) -> Iterator[None]:
    """Return a context in which an exception of a provider becomes a `ProviderError`.

    A BtcoreError, and *error_of_run*, are passed on unchanged.
    """
    try:
        yield
    except BtcoreError:
        raise
    except ModuleNotFoundError as error:
        from btcore.extras import describe_missing

        missing = describe_missing(error.name)
        raise ProviderError(f"the resources of the run cannot be provided: {missing}") from error
    except Exception as error:
        if error is error_of_run:
            raise
        frames = [(frame.f_code.co_filename, line) for frame, line in walk_tb(error.__traceback__)]
        own = [place for place in frames if place[0] == provider.function.__code__.co_filename]
        if not own and frames[-1][0] == contextlib.__file__:
            raise ProviderError(f"the provider {provider} does not yield exactly once: {error}") from error
        file, line = (own or frames)[-1]
        raise ProviderError(
            f"the provider {provider} raised {type(error).__name__} at {file}:{line}: {error}"
        ) from error
