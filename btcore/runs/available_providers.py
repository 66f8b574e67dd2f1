"""Finding the providers that a run can use: those of the user, of the core, and of installed packages."""

from collections.abc import Iterable, Set
from functools import cached_property
from types import ModuleType

from btcore import entry_points
from btcore.errors import ProviderError
from btcore.runs.core_providers import random_numbers, tree_logs
from btcore.runs.providers import Provider
from btcore.runs.settings import Settings


def providers_in(module: ModuleType) -> list[Provider]:
    """Return the providers that *module* defines."""
    providers = (member for member in vars(module).values() if isinstance(member, Provider))
    return [provider for provider in providers if provider.__module__ == module.__name__]


class AvailableProviders:
    """The providers that a run can use: those of the user, and those of installed packages.

    Args:
        of_user: The providers of the user's program and plugins.
        uses_installed: Whether to use those of installed packages, too.

    Attributes:
        of_user: The argument, as a list.
        core: The providers of btcore's core.
        known: The providers that were imported: the user's, then those of the core, then others.
        unavailable: The entry points that could not be imported.
    """

    def __init__(self, of_user: Iterable[Provider] = (), uses_installed: bool = True) -> None:
        self.of_user = list(of_user)
        for provider in self.of_user:
            if not isinstance(provider, Provider):
                name = getattr(provider, "__name__", repr(provider))
                raise TypeError(f"{name} is not a provider: mark the function by @btcore.provider")
        self.core = [random_numbers, tree_logs]
        self.known = [*self.of_user, *self.core]
        self.unavailable: list[entry_points.UnavailableEntryPoint] = []
        self._uses_installed = uses_installed
        self._loaded: set[str] = set()

    @cached_property
    def _points(self) -> dict[entry_points.EntryPoint, str]:
        """The entry points of installed providers, with the full names of their types."""
        points = entry_points.find(entry_points.PROVIDERS_GROUP) if self._uses_installed else []
        return {point: point.name.partition("-")[2] for point in points}

    def of_type(self, name: str) -> list[Provider]:
        """Return the providers of the type with the full *name*."""
        self._load(point for point, provided in self._points.items() if provided == name)
        return [provider for provider in self.known if name in provider.type_names]

    def with_side_effects(self, given: Set[type[Settings]]) -> list[Provider]:
        """Return the side-effect providers, such as a publisher, that take settings of *given*."""
        for provider in self.of_user:
            if not provider.types and not provider.settings_classes:
                reason = "the parameter Tree" if provider.needs_tree else "no type in its return annotation"
                raise ProviderError(
                    f"the provider {provider} has {reason}, so that leaves cannot get its object, and no "
                    "settings, so that no run would use it"
                )
        if not given <= {cls for provider in self.known for cls in provider.settings_classes}:
            self._load(point for point, provided in self._points.items() if not provided)
        side_effects = [provider for provider in self.known if not provider.types]
        return [provider for provider in side_effects if not given.isdisjoint(provider.settings_classes)]

    def all(self) -> list[Provider]:
        """Return all providers, the user's first."""
        self._load(self._points)
        return self.known

    def _load(self, points: Iterable[entry_points.EntryPoint]) -> None:
        for point in points:
            if point.value in self._loaded:
                continue
            loaded = entry_points.load_point(point)
            self._loaded.add(point.value)
            if isinstance(loaded, entry_points.UnavailableEntryPoint):
                self.unavailable.append(loaded._replace(name=loaded.name.partition("-")[0]))
            elif isinstance(loaded.value, Provider):
                self.known.append(loaded.value)
            else:
                raise ProviderError(
                    f"the entry point '{point.name}' of the distribution '{loaded.distribution}' is not a "
                    f"provider: {point.value} is a {type(loaded.value).__name__}; mark it by @btcore.provider"
                )
