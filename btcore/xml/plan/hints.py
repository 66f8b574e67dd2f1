"""Hints for unknown nodes and ports."""

from collections.abc import Mapping
from functools import cache, cached_property

from btcore.diagnostics import HintAndFixes
from btcore.entry_points import UnavailableEntryPoint, unsearched_libraries
from btcore.fixes import CallTree, DeclareNode, Fix, Rename, SetFormat
from btcore.names import is_port_name
from btcore.registry.manifest import Manifest
from btcore.registry.registry import Registry
from btcore.suggestions import join_names, nearest_name, suggestion
from btcore.xml.define import Definitions
from btcore.xml.read.document import DiagnosticCollector
from btcore.xml.read.tags import EXPLICIT_TAGS, NODE_REPLACEMENTS


class UnknownNameHints:
    """Makes hints for the unknown nodes and ports of a document and its includes.

    After `MAX_COMPARISONS` comparisons of names, the hints are empty.
    """

    def __init__(self, definitions: Definitions, registry: Registry, collector: DiagnosticCollector) -> None:
        self._registry = registry
        self._collector = collector
        self._format = definitions.format
        self._trees = definitions.by_id
        # The files that declare nodes in their TreeNodesModel, by ID.
        self._declaring_files = {
            model.get("ID"): document.file
            for document in reversed(definitions.sources.documents)
            for models in document.root.iterchildren("TreeNodesModel")
            for model in models.iterchildren(*EXPLICIT_TAGS)
        }

    @cached_property
    def _manifests(self) -> Mapping[str, Manifest]:
        return self._registry.manifests_of(self._format)

    def for_node(self, name: str) -> HintAndFixes:
        """Return the hint and fixes for the most likely reason why the node *name* is unknown."""
        if not self._collector.take_comparisons(self._manifests):
            return HintAndFixes()
        return (
            self._tree_hint(name)
            or self._version_hint(name)
            or self._declaration_hint(name)
            or self._registry_hint(name)
            or self._spelling_hint(name)
        )

    def for_port(self, manifest: Manifest, name: str) -> HintAndFixes:
        """Return the hint and fixes for a port *name* that the node of *manifest* doesn't have."""
        if not self._collector.take_comparisons(manifest.ports):
            return HintAndFixes()
        similar = next(
            (item for item in manifest.parameters if item.name == name and item.looks_like_port), None
        )
        if similar is not None:
            type_name = similar.type_name
            in_port = suggestion(f"{name}: In[{type_name}]")
            return HintAndFixes(f"its parameter '{name}: {type_name}' is a resource; {in_port}")
        if not manifest.ports:
            return HintAndFixes("it has no ports")
        near = nearest_name(name, manifest.ports)
        if near is not None:
            return HintAndFixes.similar_name(near)
        ports = join_names([f"'{port}'" for port in manifest.ports])
        hint = f"its ports are {ports}" if len(manifest.ports) > 1 else f"its only port is {ports}"
        return HintAndFixes(hint)

    def _tree_hint(self, name: str) -> HintAndFixes | None:
        if name not in self._trees:
            return None
        return HintAndFixes(f"'{name}' is a tree: write <SubTree ID=\"{name}\"/>", [CallTree(is_safe=True)])

    def _version_hint(self, name: str) -> HintAndFixes | None:
        """Return the hint for a node of another version of BehaviorTree.CPP."""
        successor = NODE_REPLACEMENTS.get(name)
        if successor is not None and self._registry.get(successor, self._format) is not None:
            return HintAndFixes(f"use <{successor}>, which replaces it", [Rename(successor, is_safe=True)])
        other = 3 if self._format == 4 else 4
        if self._registry.get(name, other) is None:
            return None
        text = f'<{name}> belongs to format {other}: write <root BTCPP_format="{other}">'
        return HintAndFixes(text, [SetFormat(other)])

    def _declaration_hint(self, name: str) -> HintAndFixes | None:
        if name not in self._declaring_files:
            return None
        model = f"--model {self._declaring_files[name] or 'FILE'}"
        return HintAndFixes(
            "a <TreeNodesModel> declares it, but its code is not registered: use --plugin or nodes.add, "
            f"or {model} to work without the code"
        )

    def _registry_hint(self, name: str) -> HintAndFixes | None:
        """Return the hint for a registry that lacks the built-in nodes, or an installed library."""
        if not self._manifests:
            text = "the registry is empty: start with Registry.standard(), which has the built-in nodes"
            return HintAndFixes(text, _declaration(name))
        nodes, _ = self._libraries
        provided = nodes.get(name, self._format)
        if provided is None:
            return None
        text = (
            f"the installed library {provided.library} provides it: call "
            "nodes.add_installed_libraries() of the registry, and pass nodes=nodes"
        )
        return HintAndFixes(text, _declaration(name))

    def _spelling_hint(self, name: str) -> HintAndFixes:
        near = nearest_name(name, [*self._manifests, *EXPLICIT_TAGS])
        if near is not None:
            return HintAndFixes(suggestion(f"<{near}>"), [Rename(near), *_declaration(name)])
        names = {
            "your program" if manifest.library == "__main__" else manifest.library
            for manifest in self._manifests.values()
        }
        searched = f"searched: {', '.join(sorted(names, key=lambda name: (name != 'btcore', name)))}"
        load = "load a plugin that provides it (--plugin, or nodes.add_plugin)"
        _, unavailable = self._libraries
        hint = "; ".join([searched, load, *unsearched_libraries(unavailable)])
        return HintAndFixes(hint, _declaration(name))

    @cached_property
    def _libraries(self) -> tuple[Registry, list[UnavailableEntryPoint]]:
        """The registry with the nodes of installed libraries, and the libraries that cannot be imported.

        The commands load all libraries; a program may have loaded none.
        """
        has_libraries = any(not self._registry.is_taken(id, self._format) for id in self._manifests)
        return (self._registry, []) if has_libraries else _installed_nodes()


def _declaration(name: str) -> tuple[Fix, ...]:
    return (DeclareNode(name),) if is_port_name(name) else ()


@cache
def _installed_nodes() -> tuple[Registry, list[UnavailableEntryPoint]]:
    nodes = Registry()
    return nodes, nodes.add_installed_libraries(strict=False)
