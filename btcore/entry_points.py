"""Loading the entry points by which packages extend btcore.

An entry point that cannot be loaded, because an extra is not installed or broken, does not raise: it is
returned together with the error, so that the rest of the command line works without it.
"""

# Named tuples instead of dataclasses save an import.
import os
import re
import sys
from collections.abc import Iterable, Iterator
from contextlib import suppress
from functools import cache
from importlib import import_module
from importlib.machinery import PathFinder
from operator import attrgetter
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
        module, _, attribute = self.value.partition("[")[0].replace(" ", "").partition(":")
        loaded = import_module(module)
        return attrgetter(attribute)(loaded) if attribute else loaded


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
    """Return the entry points of *group*. Of distributions with equal names, the first on the path counts.

    importlib.metadata would take a fifth of the time of a short run. It is used only if there may be
    distributions in zip files or eggs, or if other finders than Python's own find distributions.
    """
    path = [os.fspath(folder) for folder in sys.path]
    finders = [finder for finder in sys.meta_path if hasattr(finder, "find_distributions")]
    has_files = any(name.endswith(".egg") or os.path.isfile(name) for name in path)  # noqa: PTH113
    if finders != [PathFinder] or has_files:
        from importlib.metadata import entry_points

        points = entry_points(group=group)
        return [
            EntryPoint(point.name, point.value, point.dist.name if point.dist else "unknown")
            for point in points
        ]
    folders: dict[str, str] = {}
    for folder in path:
        with suppress(OSError):
            for child in os.listdir(folder or "."):  # noqa: PTH208
                if child.endswith((".dist-info", ".egg-info")):
                    name = re.sub("[-_.]+", "_", child.rpartition(".")[0].partition("-")[0])
                    folders.setdefault(name.lower(), f"{folder or '.'}/{child}")
    return [point for folder in folders.values() for point in _read_points(folder, group)]


def _read_points(folder: str, group: str) -> Iterator[EntryPoint]:
    """Yield the entry points of *group* of the distribution whose metadata is in *folder*."""
    heading = f"[{group}]"
    lines = _read_file(f"{folder}/entry_points.txt").splitlines()
    if heading not in lines:
        return
    header = _read_file(f"{folder}/METADATA") or _read_file(f"{folder}/PKG-INFO")
    name_match = re.search("^Name: *(.+)", header, re.MULTILINE)
    for line in lines[lines.index(heading) + 1 :]:
        if line.startswith("["):
            return
        name, equals, value = line.partition("=")
        if equals and not name.startswith("#"):
            yield EntryPoint(name.strip(), value.strip(), "unknown" if name_match is None else name_match[1])


def _read_file(path: str) -> str:
    try:
        with open(path, encoding="utf-8") as file:  # noqa: PTH123
            return file.read()
    except OSError:
        return ""


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
