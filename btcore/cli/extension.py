"""The extensions of a run: loading and checking them, and the order in which they are called."""

import inspect
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import click

from btcore.cli import entry_points
from btcore.run_extension import ExtensionError, RunExtension
from btcore.suggestions import nearest_name

GROUP: Final = "btcore.resources"
_META: Final = "btcore.cli.extension.loaded"
_ATTRIBUTES: Final = tuple(RunExtension.__annotations__)
_METHODS: Final = {
    name: tuple(inspect.signature(member).parameters)[1:]
    for name, member in vars(RunExtension).items()
    if inspect.isfunction(member) and not name.startswith("_")
}


class LoadedExtensions(NamedTuple):
    """The *extensions* of a run, and the entry points that are *missing*, as they can't be imported."""

    extensions: list[RunExtension]
    missing: list[entry_points.UnavailableEntryPoint]


def load_extensions(ctx: click.Context) -> LoadedExtensions:
    """Return the extensions of the run of *ctx*; they are created on the first call.

    Raises:
        ExtensionError: An extension does not keep to `RunExtension`.
    """
    if _META not in ctx.meta:
        found, missing = entry_points.load(GROUP)
        ctx.meta[_META] = LoadedExtensions([_create(one) for one in found], missing)
    loaded: LoadedExtensions = ctx.meta[_META]
    return loaded


def _create(loaded: entry_points.Loaded) -> RunExtension:
    """Create the extension that *loaded* names, and check it."""
    try:
        extension: RunExtension = loaded.value()
    except Exception as error:
        faults = [f"creating it raised {type(error).__name__}: {error}"]
    else:
        faults = _find_faults(extension)
    if faults:
        raise ExtensionError(
            f"the extension '{loaded.name}' of the distribution '{loaded.distribution}' can't be used: "
            f"{'; '.join(faults)}. The hooks are described in btcore.run_extension.RunExtension"
        )
    return extension


def _find_faults(extension: RunExtension) -> list[str]:
    """Return a sentence for each hook of *extension* that is missing, misspelled or of another form."""
    faults = []
    unset = {name for name in (*_ATTRIBUTES, *_METHODS) if _is_unset(extension, name)}
    for name in dir(extension):
        known = name in _ATTRIBUTES or name in _METHODS
        meant = None if known or name.startswith("_") else nearest_name(name, sorted(unset))
        if meant is not None:
            faults.append(f"unknown hook '{name}' (did you mean '{meant}'?)")
            unset.discard(meant)
    faults += [f"missing hook '{name}'" for name in sorted(unset) if not hasattr(extension, name)]
    for name, parameters in _METHODS.items():
        hook = getattr(extension, name, None)
        if hook is not None and not _accepts(hook, parameters):
            faults.append(f"hook '{name}' has to be a method that takes ({', '.join(parameters)})")
    options = getattr(extension, "options", ())
    if not isinstance(options, Sequence) or not all(isinstance(one, click.Option) for one in options):
        faults.append("hook 'options' has to be a sequence of click.Option")
    return faults


def _is_unset(extension: RunExtension, name: str) -> bool:
    """Whether *extension* lacks the hook, or has the default that it inherits."""
    hook = getattr(extension, name, None)
    return getattr(hook, "__func__", hook) in (None, getattr(RunExtension, name))


def _accepts(hook: object, parameters: Sequence[str]) -> bool:
    if not callable(hook):
        return False
    try:
        inspect.signature(hook).bind(*parameters)
    except TypeError:
        return False
    return True


class GatheredResources(NamedTuple):
    """The *resources* for leaves, and the extensions in the order in which they are to be attached.

    *idle* are the extensions that provided nothing.
    """

    resources: list[object]
    extensions: list[RunExtension]
    idle: list[RunExtension]


def gather_resources(
    extensions: Sequence[RunExtension], settings: Mapping[str, Any], wanted: Sequence[type]
) -> GatheredResources:
    """Return what *extensions* provide for leaves that declare the types *wanted*.

    Extensions that require nothing provide first; among equals, fallbacks provide last. Those that provide
    something are attached first, and so take part in the run from its start to its end.
    """
    all_wanted = list(wanted)
    ranked: list[tuple[bool, RunExtension]] = []
    for extension in reversed(extensions):
        required = extension.requires(tuple(all_wanted))
        all_wanted += required
        ranked.insert(0, (bool(required), extension))
    ranked.sort(key=lambda entry: (entry[0], entry[1].is_fallback))
    resources: list[object] = []
    providers: list[RunExtension] = []
    idle: list[RunExtension] = []
    for _, extension in ranked:
        provided = extension.provide(settings, tuple(all_wanted), tuple(resources))
        (providers if provided else idle).append(extension)
        resources += provided
    return GatheredResources(resources, [*providers, *idle], idle)


def merge_reports(extensions: Sequence[RunExtension]) -> dict[str, object]:
    """Return the reports of *extensions* as a single object; objects of the same name are merged."""
    merged: dict[str, object] = {}
    for extension in extensions:
        for key, value in extension.report().items():
            before = merged.get(key)
            if isinstance(before, dict) and isinstance(value, dict):
                merged[key] = {**before, **value}
            else:
                merged[key] = value
    return merged
