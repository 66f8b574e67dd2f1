"""What other packages bring to the command line, and what to say when one of them isn't there.

A package is found by its entry points, never by its name: ``btcore.commands`` holds click
commands, ``btcore.resources`` extensions of ``run``. An extra that isn't installed, or is broken,
is remembered instead of raised: the rest of the command line works without it.
"""

from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points, metadata
from typing import Any

OWN_DISTRIBUTION = "btcore"


@dataclass(frozen=True, slots=True)
class UnavailableEntryPoint:
    """An entry point that couldn't be loaded."""

    name: str
    distribution: str
    error: BaseException

    @property
    def remedy(self) -> str:
        """Why it isn't there, and what brings it."""
        reason = f"{type(self.error).__name__}: {self.error}"
        if isinstance(self.error, ModuleNotFoundError):
            reason = f"the module '{self.error.name}' isn't installed"
            if self.distribution == OWN_DISTRIBUTION:
                extras = metadata(OWN_DISTRIBUTION).get_all("Provides-Extra") or ()
                extra = self.name if self.name in extras else "all"
                return f"{reason}; you can have it: pip install '{OWN_DISTRIBUTION}[{extra}]'"
        return f"{reason} (from the distribution '{self.distribution}')"


@dataclass(frozen=True, slots=True)
class Loaded:
    """What an entry point led to, and who brought it."""

    name: str
    distribution: str
    value: Any


def names(group: str) -> list[str]:
    """The names in an entry-point *group*, without loading any."""
    return sorted({point.name for point in entry_points(group=group)})


def load(group: str, name: str | None = None) -> tuple[list[Loaded], list[UnavailableEntryPoint]]:
    """Everything in an entry-point *group* (or only what is called *name*), and what failed to load."""
    found: list[Loaded] = []
    missing: list[UnavailableEntryPoint] = []
    for point in sorted(entry_points(group=group), key=lambda one: one.name):
        if name is not None and point.name != name:
            continue
        try:
            found.append(Loaded(point.name, distribution_of(point), point.load()))
        except Exception as error:
            missing.append(UnavailableEntryPoint(point.name, distribution_of(point), error))
    return found, missing


def distribution_of(point: EntryPoint) -> str:
    """The name of the distribution that declares *point*."""
    return point.dist.name if point.dist is not None else "an unknown distribution"
