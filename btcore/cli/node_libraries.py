"""The nodes of a command: built-in, installed, loaded by `--plugin`, and declared by `--model`."""

import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Annotated, Final, Literal

import click

from btcore import entry_points
from btcore.cli import terminal
from btcore.diagnostic_codes import UNKNOWN_NODE
from btcore.diagnostics import Diagnostic
from btcore.entry_points import NODES_GROUP, UnavailableEntryPoint, unsearched_libraries
from btcore.options import Options, option
from btcore.registry.registry import Plugin, Registry, import_plugin, library_of
from btcore.xml.read.document import Document
from btcore.xml.read.read import Sources, read
from btcore.xml.read.tags import EXPLICIT_TAGS


class LibraryOptions(Options):
    """The options of commands that load node libraries."""

    plugins: Annotated[
        tuple[str, ...],
        option(
            "Load a node library, by module name or file path. Repeatable.",
            metavar="MODULE|FILE.py",
            name="plugin",
        ),
    ] = ()
    models: Annotated[
        tuple[Path, ...],
        option(
            "Load node declarations from a TreeNodesModel file, such as Groot exports: these nodes need no "
            "code. Repeatable.",
            metavar="FILE",
            name="model",
        ),
    ] = ()


class AllNodesOptions(LibraryOptions):
    """The options of commands about all nodes of an XML format."""

    format: Annotated[Literal[3, 4], option("The XML format of the nodes.")] = 4


class NodeLibraries:
    """The built-in nodes, all installed libraries, *plugins* and *models*.

    An installed library that cannot be imported is not an error, since the tree may not use it. Unless a
    missing module is the cause, a warning is printed.

    Args:
        plugins: Modules and Python files with nodes, which override installed libraries.
        models: TreeNodesModel files.
        confined: Whether a model that includes a file from outside of its folder is invalid.
        btcore_on_demand: Whether to load the libraries of btcore's own packages only when a document needs
            them. They are loaded at once nevertheless if a plugin has imported one of these packages, because
            the plugin may use their types, and with *models*, which declare only what is unknown.
        imported: Plugins that are imported already, by their names in *plugins*.

    Attributes:
        nodes: The registry of the available nodes.
        unavailable: The libraries that are installed but cannot be imported.
    """

    def __init__(
        self,
        plugins: Sequence[str],
        models: Sequence[Path] = (),
        confined: bool = False,
        btcore_on_demand: bool = False,
        imported: Mapping[str, Plugin] | None = None,
    ) -> None:
        loaded: dict[str | Path, Plugin] = {}
        for plugin in plugins:
            module_or_file = Path(plugin).resolve() if plugin.endswith(".py") else plugin
            if module_or_file in loaded:
                raise click.UsageError(f"--plugin {plugin} is given more than once.")
            loaded[module_or_file] = (imported or {}).get(plugin) or import_plugin(plugin)
        self._plugins = list(loaded.values())
        self._warnings: set[str] = set()
        # Providers import these packages, too, but not their nodes.
        has_imported = bool(loaded) and not entry_points.own_packages(NODES_GROUP).isdisjoint(sys.modules)
        self._load(with_btcore=not btcore_on_demand or bool(models) or has_imported)
        self._has_models = bool(models)
        for model in models:
            from btcore.xml.models.model_file import add_models  # most commands have no models

            add_models(self.nodes, model, confined)

    def _load(self, with_btcore: bool) -> None:
        self._has_btcore_libraries = with_btcore
        # Plugins add types, which the copies of a registry share.
        load = load_installed if self._plugins else installed_once
        nodes, self.unavailable = load(with_btcore)
        self.nodes = nodes.copy()
        for unavailable in self.unavailable:
            if unavailable.missing_module is None:
                self._warn(str(unavailable.error))
        for plugin in self._plugins:
            if plugin.has_nodes or not _has_providers(plugin):
                self.nodes.add_plugin(plugin)
        for installed, added in self.nodes.overridden_nodes:
            self._warn(f"<{added.id}> of {added.library} overrides <{added.id}> of {installed.library}")
        for installed_type, added_type in self.nodes.types.overridden:
            self._warn(
                f"the type {added_type.name} of {library_of(added_type.python_type)} overrides the type "
                f"{added_type.name} of {library_of(installed_type.python_type)}"
            )

    def _warn(self, message: str) -> None:
        """Print a warning, unless it was printed when the libraries were loaded before."""
        if message not in self._warnings:
            self._warnings.add(message)
            terminal.print_warning(message)

    def _ensure_loaded_for(self, documents: Iterable[Document]) -> bool:
        """Load the libraries of btcore's own packages if a node is unknown without them.

        This replaces `nodes`: nodes and rules for a single tree are added to a copy.

        Returns:
            Whether libraries were loaded, which may have registered trees.
        """
        if self._has_btcore_libraries or all(
            self.nodes.get(id, 4) is not None or self.nodes.get(id, 3) is not None
            for id in _find_node_ids(documents)
        ):
            return False
        self._load(with_btcore=True)
        return True

    def read(self, document: Document) -> tuple[Sources, Registry]:
        """Read the includes of *document*, and ensure that the libraries of its nodes are loaded.

        Returns:
            The documents, and the nodes for their trees. With models the nodes include those that explicit
            tags, such as `<Action ID="Move"/>`, declare. Without models unknown nodes remain errors.
        """
        sources = read(document, self.nodes.documents)
        if self._ensure_loaded_for(sources.documents):
            sources = read(document, self.nodes.documents)
        if not self._has_models:
            return sources, self.nodes
        from btcore.xml.models.model_file import add_explicit_nodes

        # A copy, since the same explicit tag may have other ports in another document.
        nodes = self.nodes.copy()
        add_explicit_nodes(nodes, sources.documents)
        return sources, nodes

    def nodes_for(self, document: Document) -> Registry:
        """Return the nodes for the trees of *document*, as `read` does."""
        return self.read(document)[1]

    def missing_library_notes(self, diagnostics: Iterable[Diagnostic]) -> list[str]:
        """Return notes about unavailable libraries, if *diagnostics* report an unknown node without them."""
        hints = [diagnostic.hint or "" for diagnostic in diagnostics if diagnostic.code == UNKNOWN_NODE]
        return [
            note
            for note in unsearched_libraries(self.unavailable if hints else ())
            if not any(note in hint for hint in hints)
        ]


def load_installed(own: bool) -> tuple[Registry, Sequence[UnavailableEntryPoint]]:
    """Return the built-in and the installed nodes, and the libraries that cannot be loaded."""
    nodes = Registry.standard()
    return nodes, nodes.add_installed_libraries(own=own, strict=False)


installed_once: Final = cache(load_installed)
"""The same as `load_installed`, for the many runs of a sweep in a process."""


def _has_providers(plugin: Plugin) -> bool:
    from btcore.runs.available_providers import providers_in  # not for commands without plugins

    return bool(providers_in(plugin.module))


def _find_node_ids(documents: Iterable[Document]) -> Iterator[str]:
    for document in documents:
        for top in document.root.iterchildren("BehaviorTree"):
            for element in islice(top.iter(), 1, None):
                yield (element.get("ID") or "") if element.tag in EXPLICIT_TAGS else element.tag


def complete_node_id(ctx: click.Context, parameter: click.Parameter, incomplete: str) -> list[str]:
    """Return the IDs of the built-in and installed nodes."""
    ids = NodeLibraries(()).nodes.manifests_of(4)
    return [node_id for node_id in ids if node_id.startswith(incomplete)]
