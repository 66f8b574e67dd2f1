"""Opening the providers of a run and closing them.

An exception whose message is not meant for the user becomes a `ProviderError` that names the provider.
"""

import contextlib
import inspect
from collections.abc import Callable, Iterator, Mapping
from traceback import walk_tb
from types import TracebackType

from btcore.errors import BtcoreError, ProviderError
from btcore.runs.choice import Choice, GivenSettings
from btcore.runs.providers import ATTRIBUTES_OF_RUN, Need, Provider, fits, full_name, is_settings
from btcore.tree.tree import Tree


class OpenedProvider:
    """A provider in a run, and what it provides.

    Attributes:
        provider: The provider.
        value: What the function returned or yielded.
        error: What the provider raised when it was closed, such as `OutputError`, or None.
    """

    def __init__(self, provider: Provider) -> None:
        self.provider = provider
        self.value: object = None
        self.error: BtcoreError | None = None
        self._context: contextlib.AbstractContextManager[object] | None = None

    def open(self, arguments: Mapping[str, object]) -> None:
        """Call the function with *arguments*, up to its `yield`.

        Raises:
            ProviderError: The function raised an exception whose message is not meant for the user.
        """
        function = self.provider.function
        with _named(self.provider):
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
            with _named(self.provider, error):
                context.__exit__(kind, error, trace)
        except BtcoreError as own_error:
            if error is not None and error in (own_error, own_error.__cause__):
                raise  # the exception of the run, or its explanation by the provider
            self.error = self.error or own_error

    def follow(self, tree: Tree) -> bool:
        """Pass *tree* to what was provided; return False if it has no method `replace_tree`."""
        replace_tree = getattr(self.value, "replace_tree", None)
        if replace_tree is None:
            return False
        with _named(self.provider):
            replace_tree(tree)
        return True

    @property
    def objects(self) -> list[object]:
        """The provided objects."""
        value = self.value
        values = value if self.provider.provides_several and isinstance(value, tuple) else (value,)
        return [one for one in values if one is not None] if self.provider.types else []

    def object_for(self, name: str) -> object:
        """Return the object of the type with the full *name*."""
        if not self.provider.provides_several:
            return self.value
        named = (one for one in self.objects if fits(one, name))
        return next(named, next(iter(self.objects), None))


class OpenedProviders:
    """The open providers of a run.

    Args:
        choice: The used providers.
        settings: The settings of the run.
        attribute: Returns an attribute of the run by its name; a provider may need the clock, for example.
    """

    def __init__(self, choice: Choice, settings: GivenSettings, attribute: Callable[[str], object]) -> None:
        self._choice = choice
        self._settings = settings
        self._attribute = attribute
        self._opened: dict[Provider, OpenedProvider] = {}

    def open(self, provider: Provider, stack: contextlib.ExitStack) -> list[object]:
        """Open *provider*, which *stack* closes, and return the provided objects.

        Raises:
            ProviderError: The provider raised an exception, or another has provided None.
        """
        opened = self._opened[provider] = OpenedProvider(provider)
        stack.push(opened.close)
        opened.open(self._arguments(provider))
        return opened.objects

    def find(self, name: str) -> object:
        """Return the object for the type with the full *name*, of a provider or the program, or None."""
        chosen = self._choice.by_type.get(name)
        if not isinstance(chosen, Provider):
            return chosen
        opened = self._opened.get(chosen)
        return None if opened is None else opened.object_for(name)

    def objects_of(self, provider: Provider) -> list[object] | None:
        """Return what *provider* has provided; None if it is not open."""
        return self._opened[provider].objects if provider in self._opened else None

    def replace_tree(self, tree: Tree) -> None:
        """Let the providers that follow the tree follow *tree*; those that cannot are opened again."""
        again: dict[Provider, OpenedProvider] = {}
        for provider, opened in self._opened.items():  # each after those that it needs
            if provider.needs_tree:
                is_new = not opened.follow(tree)
            else:
                is_new = any(other in again for other in self._choice.providers_for(provider))
            if is_new:
                again[provider] = opened
        for opened in reversed(again.values()):
            opened.close()
        for provider, opened in again.items():
            opened.open(self._arguments(provider))

    @property
    def errors(self) -> list[BtcoreError]:
        """What the providers raised when they were closed."""
        return [opened.error for opened in self._opened.values() if opened.error is not None]

    def _arguments(self, provider: Provider) -> dict[str, object]:
        return {need.parameter: self._argument(provider, need) for need in provider.needs}

    def _argument(self, provider: Provider, need: Need) -> object:
        if need.type in ATTRIBUTES_OF_RUN:
            return self._attribute(ATTRIBUTES_OF_RUN[need.type])
        if is_settings(need.type):
            return self._settings.find(need.type)
        name = full_name(need.type)
        found = self.find(name)
        if found is None and not need.is_optional:
            giver = self._choice.by_type[name]
            raise ProviderError(f"{provider} needs its '{need.parameter}', but {giver} has provided None")
        return found


@contextlib.contextmanager
def _named(provider: Provider, error_of_run: BaseException | None = None) -> Iterator[None]:
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
