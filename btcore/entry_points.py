"""Loading the entry points by which packages extend btcore.

An entry point that cannot be loaded, because an extra is not installed or broken, does not raise: it is
returned together with the error, so that the rest of the command line works without it.
"""

# Named tuples instead of dataclasses save an import.
import os
import re
from collections.abc import Iterable
from functools import cache
from typing import Any, Final, NamedTuple

OWN_DISTRIBUTION = "btcore"

NODES_GROUP: Final = "btcore.nodes"  # node libraries
COMMANDS_GROUP: Final = "btcore.commands"  # click commands
PROVIDERS_GROUP: Final = "btcore.providers"  # providers of a run
LOGS_GROUP: Final = "btcore.logs"  # formats of log files

LIMIT_VARIABLE: Final = "BTCORE_ENTRY_POINTS"
"""The environment variable that limits the entry points.

If it is set, only those entry points of btcore are used whose names it lists, separated by spaces, and no
entry points of other distributions. `btcore mcp` sets it, so that a run for an agent has no way to a robot.
"""


class EntryPoint(NamedTuple):
    """An entry point.

    Attributes:
        name: The name.
        value: What it names: a module, or an object of a module as `module:object`.
        distribution: The distribution that declares it.
    """

    name: str
    value: str
    distribution: str

    def load(self) -> Any:
        """Import and return the module or the object."""
        from importlib.metadata import EntryPoint as InstalledEntryPoint  # slow to import

        return InstalledEntryPoint(self.name, self.value, group="").load()


class UnavailableEntryPoint(NamedTuple):
    """An entry point that could not be loaded, and the *error* that loading it raised."""

    name: str
    distribution: str
    error: BaseException

    @property
    def missing_module(self) -> ModuleNotFoundError | None:
        """The error or its cause, if a module is not installed; None for any other error."""
        causes = (self.error, self.error.__cause__)
        return next((cause for cause in causes if isinstance(cause, ModuleNotFoundError)), None)

    @property
    def remedy(self) -> str:
        """The reason for the failure; if an extra is not installed, also the command that installs it."""
        from btcore.extras import describe_missing

        missing = self.missing_module
        if missing is None:
            reason = f"{type(self.error).__name__}: {self.error}"
        elif self.distribution == OWN_DISTRIBUTION:
            return describe_missing(missing.name)
        else:
            reason = f"the module '{missing.name}' is not installed"
        return f"{reason} (from the distribution '{self.distribution}')"


def names_by_remedy(unavailable: Iterable[UnavailableEntryPoint]) -> dict[str, str]:
    """Return the names of the entry points that have a remedy in common, as an enumeration, by the remedy."""
    from btcore.suggestions import join_names

    names: dict[str, list[str]] = {}
    for point in unavailable:
        names.setdefault(point.remedy, []).append(f"'{point.name}'")
    return {remedy: join_names(texts) for remedy, texts in names.items()}


def unsearched_libraries(unavailable: Iterable[UnavailableEntryPoint]) -> list[str]:
    """Return notes for a message about an unknown node: node libraries that were not searched."""
    return [
        f"node libraries that cannot be loaded were not searched ({names}): {remedy}"
        for remedy, names in names_by_remedy(unavailable).items()
    ]


class LoadedEntryPoint(NamedTuple):
    """The object that an entry point names, and the distribution that declares the entry point."""

    name: str
    distribution: str
    value: Any


def find(group: str, own: bool = True) -> list[EntryPoint]:
    """Return the installed entry points of *group* that `LIMIT_VARIABLE` permits, sorted by name.

    Args:
        group: The group, such as `btcore.commands`.
        own: Whether to include those of btcore's own packages.
    """
    points = sorted(_find_installed(group), key=lambda point: point.name)
    if not own:
        points = [point for point in points if point.distribution != OWN_DISTRIBUTION]
    limit = os.environ.get(LIMIT_VARIABLE)
    if limit is None:
        return points
    permitted = limit.split()
    return [
        point
        for point in points
        # The name of a provider's entry point continues with a type.
        if point.name.partition("-")[0] in permitted and point.distribution == OWN_DISTRIBUTION
    ]


def _find_installed(group: str) -> list[EntryPoint]:
    from importlib.metadata import entry_points  # slow to import

    points = entry_points(group=group)
    return [
        EntryPoint(point.name, point.value, point.dist.name if point.dist else "unknown") for point in points
    ]


@cache
def own_packages(group: str) -> frozenset[str]:
    """Return the names of btcore's own packages that declare entry points of *group*."""
    own = [point for point in _find_installed(group) if point.distribution == OWN_DISTRIBUTION]
    return frozenset(re.split(r"\W", point.value)[0] for point in own)


def load(group: str, name: str | None = None) -> tuple[list[LoadedEntryPoint], list[UnavailableEntryPoint]]:
    """Load the entry points of a group, sorted by name.

    Args:
        group: The group, such as `btcore.commands`.
        name: Load only the entry points with this name; None loads all.

    Returns:
        The loaded entry points, and those that could not be loaded.
    """
    loaded: list[LoadedEntryPoint] = []
    unavailable: list[UnavailableEntryPoint] = []
    for point in find(group):
        if name is not None and point.name != name:
            continue
        result = load_point(point)
        if isinstance(result, LoadedEntryPoint):
            loaded.append(result)
        else:
            unavailable.append(result)
    return loaded, unavailable


def load_point(point: EntryPoint) -> LoadedEntryPoint | UnavailableEntryPoint:
    """Load one entry point."""
    try:
        return LoadedEntryPoint(point.name, point.distribution, point.load())
    except Exception as error:
        return UnavailableEntryPoint(point.name, point.distribution, error)
