"""Loading the node libraries for a command: built-in, installed, and given by ``--plugin``."""

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
    help="Load a node library, by module name or file path. Repeatable.",
)


@dataclass(slots=True)
class NodeLibraries:
    """The available nodes, and the *absent* libraries: those that are installed but cannot be imported."""

    nodes: Registry
    absent: list[UnavailableEntryPoint] = field(default_factory=list)

    def missing_library_notes(self, diagnostics: Iterable[Diagnostic]) -> list[str]:
        """Return a note for each absent library, if *diagnostics* report an unknown node."""
        if not any(diagnostic.code == UNKNOWN_NODE for diagnostic in diagnostics):
            return []
        return [
            f"the node library '{library.name}' cannot be loaded: {library.remedy}" for library in self.absent
        ]

    @contextmanager
    def annotate_errors(self) -> Iterator[None]:
        """Return a context that adds :meth:`missing_library_notes` to a TreeError raised in it."""
        try:
            yield
        except TreeError as error:
            for note in self.missing_library_notes(error.diagnostics):
                error.add_note(note)
            raise


def load_libraries(plugins: Sequence[str]) -> NodeLibraries:
    """Load all installed node libraries and *plugins*.

    An installed library that cannot be imported is no error, since the tree may not use it. It is noted in
    `NodeLibraries.absent`; unless a missing module is the cause, a warning is printed as well.

    Raises:
        RegistrationError: One of *plugins* cannot be loaded.
        click.UsageError: One of *plugins* is given twice.
    """
    libraries = NodeLibraries(Registry.standard())
    for point in sorted(entry_points(group=ENTRY_POINTS), key=lambda point: point.name):
        try:
            libraries.nodes.add_installed(point.value, point.name)
        except RegistrationError as error:
            cause = error.__cause__
            if not isinstance(cause, ModuleNotFoundError):
                terminal.print_warning(str(error))
            libraries.absent.append(UnavailableEntryPoint(point.name, distribution_of(point), cause or error))
    seen: set[str | Path] = set()
    for plugin in plugins:
        module_or_file = Path(plugin).resolve() if plugin.endswith(".py") else plugin
        if module_or_file in seen:
            raise click.UsageError(f"--plugin {plugin} is given more than once.")
        seen.add(module_or_file)
        libraries.nodes.add_plugin(plugin)
    for installed, own in libraries.nodes.overridden_nodes:
        terminal.print_warning(
            f"<{own.id}> of {own.distribution} overrides <{own.id}> of {installed.distribution}"
        )
    return libraries
