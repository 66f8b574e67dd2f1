"""The node libraries that a command works with: built-ins, installed ones, and ``--plugin``."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from pathlib import Path

import click

from btcore.cli import terminal
from btcore.cli.entry_points import UnavailableEntryPoint, distribution_of
from btcore.diagnostic_codes import UNKNOWN_NODE
from btcore.errors import Diagnostic, RegistrationError, TreeError
from btcore.registry.registry import ENTRY_POINTS, Registry

plugin_option = click.option(
    "--plugin",
    "plugins",
    multiple=True,
    metavar="MODULE|FILE.py",
    help="A node library, by module name or file path; may be given several times.",
)


@dataclass(slots=True)
class NodeLibraries:
    """The nodes at hand, and the installed libraries that lack something to be imported."""

    nodes: Registry
    absent: list[UnavailableEntryPoint] = field(default_factory=list)

    def missing_library_notes(self, diagnostics: Iterable[Diagnostic]) -> list[str]:
        """Where nodes that *diagnostics* call unknown may be, if not here."""
        if not any(one.code == UNKNOWN_NODE for one in diagnostics):
            return []
        return [f"the node library '{one.name}' isn't there: {one.remedy}" for one in self.absent]

    @contextmanager
    def annotate_errors(self) -> Iterator[None]:
        """Add :meth:`missing_library_notes` to a TreeError that passes."""
        try:
            yield
        except TreeError as error:
            for note in self.missing_library_notes(error.diagnostics):
                error.add_note(note)
            raise


def load_libraries(plugins: Sequence[str]) -> NodeLibraries:
    """Everything installed, and *plugins*.

    An installed library that can't be imported does not stop a tree that does without it: one that
    lacks a module is remembered, one that raises is told of in a warning. Raises RegistrationError
    for one of *plugins*, and UsageError for one that is given twice.
    """
    found = NodeLibraries(Registry.standard())
    for point in sorted(entry_points(group=ENTRY_POINTS), key=lambda one: one.name):
        try:
            found.nodes.add_installed(point.value, point.name)
        except RegistrationError as error:
            cause = error.__cause__
            if not isinstance(cause, ModuleNotFoundError):
                terminal.print_warning(str(error))
            found.absent.append(UnavailableEntryPoint(point.name, distribution_of(point), cause or error))
    seen: set[str | Path] = set()
    for plugin in plugins:
        place = Path(plugin).resolve() if plugin.endswith(".py") else plugin
        if place in seen:
            raise click.UsageError(f"--plugin {plugin} is given twice; once is enough.")
        seen.add(place)
        found.nodes.add_plugin(plugin)
    for installed, own in found.nodes.overridden_nodes:
        terminal.print_warning(
            f"<{own.id}> of {own.distribution} takes the place of {installed.distribution}'s"
        )
    return found
