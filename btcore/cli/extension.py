"""Loading and checking the extensions of a run, and collecting their resources and reports."""

import inspect
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import click

from btcore import entry_points
from btcore.extras import describe_missing
from btcore.run_extension import ExtensionError, RunExtension
from btcore.suggestions import nearest_name

_META_KEY: Final = "btcore.cli.extension.loaded"
# The methods and their parameters are read from the protocol itself, so that the check stays up to date.
_ATTRIBUTES: Final = tuple(RunExtension.__annotations__)
_METHODS: Final = {
    name: tuple(inspect.signature(member).parameters)[1:]
    for name, member in vars(RunExtension).items()
    if inspect.isfunction(member) and not name.startswith("_")
}


class LoadedExtensions(NamedTuple):
    """The *extensions* of a run, and the *unavailable* entry points: those that could not be imported."""

    extensions: list[RunExtension]
    unavailable: list[entry_points.UnavailableEntryPoint]


def load_extensions(ctx: click.Context) -> LoadedExtensions:
    """Return the extensions for the command with the context *ctx*; they are created on the first call.

    Raises:
        ExtensionError: An extension does not conform to `RunExtension`.
    """
    if _META_KEY not in ctx.meta:
        loaded_points, unavailable = entry_points.load(entry_points.RUN_EXTENSIONS_GROUP)
        ctx.meta[_META_KEY] = LoadedExtensions([_create(point) for point in loaded_points], unavailable)
    loaded: LoadedExtensions = ctx.meta[_META_KEY]
    return loaded


def _create(loaded: entry_points.LoadedEntryPoint) -> RunExtension:
    """Create an extension from its loaded entry point, and check its members."""
    try:
        extension: RunExtension = loaded.value()
    except Exception as error:
        problems = [f"creating it raised {type(error).__name__}: {error}"]
    else:
        problems = _find_problems(extension)
    if problems:
        raise ExtensionError(
            f"the extension '{loaded.name}' of the distribution '{loaded.distribution}' cannot be used: "
            f"{'; '.join(problems)}. The members are described in btcore.run_extension.RunExtension"
        )
    return extension


def _find_problems(extension: RunExtension) -> list[str]:
    """Return a message for each member of *extension* that is missing, misspelled or has the wrong type."""
    problems = []
    unset = {name for name in (*_ATTRIBUTES, *_METHODS) if _is_unset(extension, name)}
    for name in dir(extension):
        known = name in _ATTRIBUTES or name in _METHODS
        # A public attribute that resembles a member without a value is probably that member, misspelled.
        nearest = None if known or name.startswith("_") else nearest_name(name, sorted(unset))
        if nearest is not None:
            problems.append(f"unknown member '{name}' (did you mean '{nearest}'?)")
            unset.discard(nearest)
    problems += [f"missing member '{name}'" for name in sorted(unset) if not hasattr(extension, name)]
    for name, parameters in _METHODS.items():
        method = getattr(extension, name, None)
        if method is not None and not _accepts(method, parameters):
            problems.append(f"member '{name}' must be a method that takes ({', '.join(parameters)})")
    options = getattr(extension, "options", ())
    if not isinstance(options, Sequence) or not all(isinstance(option, click.Option) for option in options):
        problems.append("member 'options' must be a sequence of click.Option")
    return problems


def _is_unset(extension: RunExtension, name: str) -> bool:
    """Return whether *extension* lacks the member *name*, or inherits its default from `RunExtension`."""
    member = getattr(extension, name, None)
    # Bound methods of an instance are compared by the function of their class.
    return getattr(member, "__func__", member) in (None, getattr(RunExtension, name))


def _accepts(method: object, parameters: Sequence[str]) -> bool:
    if not callable(method):
        return False
    try:
        inspect.signature(method).bind(*parameters)
    except TypeError:
        return False
    return True


class GatheredResources(NamedTuple):
    """The *resources* for leaves, and the *extensions* in the order in which they must be attached.

    *without_resources* holds the extensions that provided no resource.
    """

    resources: list[object]
    extensions: list[RunExtension]
    without_resources: list[RunExtension]


def gather_resources(
    extensions: Sequence[RunExtension], settings: Mapping[str, Any], wanted: Sequence[type]
) -> GatheredResources:
    """Return the resources that the extensions of a run provide.

    Types that an extension takes over are wanted from this extension only.

    Extensions without requirements provide their resources first, then extensions with requirements; within
    both groups, extensions with `is_fallback` come last. Extensions that provide resources are attached
    before the other extensions, and detached after them.

    Args:
        settings: The values of the options of `btcore run`, by name.
        wanted: The types that the leaves of the tree declare as resources.

    Raises:
        click.UsageError: An extension rejects an option, or needs a module that is not installed.
    """
    taken_over = [tuple(extension.takes_over(settings, wanted)) for extension in extensions]
    all_wanted = [kind for kind in wanted if not any(kind in types for types in taken_over)]
    reserved = {id(extension): types for extension, types in zip(extensions, taken_over, strict=True)}
    known = -1
    while known < len(all_wanted):  # until no extension requires another type
        known = len(all_wanted)
        ranked = [(tuple(extension.requires(tuple(all_wanted))), extension) for extension in extensions]
        all_wanted += dict.fromkeys(one for types, _ in ranked for one in types if one not in all_wanted)
    # The sort is stable: extensions of equal rank keep the order of their entry points' names.
    ranked.sort(key=lambda entry: (bool(entry[0]), entry[1].is_fallback))
    resources: list[object] = []
    providers: list[RunExtension] = []
    without_resources: list[RunExtension] = []
    for _, extension in ranked:
        try:
            provided = extension.provide(settings, (*reserved[id(extension)], *all_wanted), tuple(resources))
        except ModuleNotFoundError as error:
            missing = describe_missing(error.name)
            raise click.UsageError(f"the resources of the run cannot be provided: {missing}") from error
        (providers if provided else without_resources).append(extension)
        resources += provided
    return GatheredResources(resources, [*providers, *without_resources], without_resources)


def merge_reports(extensions: Sequence[RunExtension]) -> dict[str, object]:
    """Return the reports of *extensions* as one dictionary; dictionaries with the same key are merged."""
    merged: dict[str, object] = {}
    for extension in extensions:
        for key, value in extension.report().items():
            before = merged.get(key)
            if isinstance(before, dict) and isinstance(value, dict):
                merged[key] = {**before, **value}
            else:
                merged[key] = value
    return merged
