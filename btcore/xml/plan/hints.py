"""Hints for unknown nodes and ports."""

from collections.abc import Mapping
from functools import cache, cached_property

from btcore.diagnostics import NO_HINT, Hint
from btcore.entry_points import UnavailableEntryPoint, unsearched_libraries
from btcore.fixes import CallTree, DeclareNode, Rename, SetFormat, SetValue
from btcore.names import is_port_name
from btcore.registry.manifest import Manifest
from btcore.registry.registry import Registry
from btcore.suggestions import join_names, nearest_name, suggestion
from btcore.values import BOOL, EnumType, ValueType
from btcore.xml.define import Definitions
from btcore.xml.read.dialect import EXPLICIT_TAGS, NODE_REPLACEMENTS
from btcore.xml.read.document import DiagnosticCollector


class UnknownNodeHints:
    """Makes hints for the unknown nodes of a document and its includes."""

    def __init__(self, definitions: Definitions, registry: Registry, collector: DiagnosticCollector) -> None:
        self._registry = registry
        self._format = definitions.dialect.format
        self._collector = collector
        self._trees = definitions.by_id
        self._plugin_suggested = False
        # The files that declare nodes in their TreeNodesModel, by ID.
        self._declaring_files = {
            model.get("ID"): document.file
            for document in reversed(definitions.sources.documents)
            for models in document.root.iterchildren("TreeNodesModel")
            for model in models.iterchildren(*EXPLICIT_TAGS)
        }

    @cached_property
    def manifests(self) -> Mapping[str, Manifest]:
        """The registered nodes of the format, by ID."""
        return self._registry.manifests_of(self._format)

    def hint(self, name: str) -> Hint:
        """Return a hint for an unknown node; the first of the hints suggests to load a plugin."""
        if not self._collector.take_comparisons(self.manifests):
            return NO_HINT
        if name in self._trees:
            fix = CallTree(is_safe=True)
            return Hint(f"'{name}' is a tree: write <SubTree ID=\"{name}\"/>", (fix,))
        successor = NODE_REPLACEMENTS.get(name)
        if successor is not None and self._registry.get(successor, self._format) is not None:
            return Hint(f"use <{successor}>, which replaces it", (Rename(successor, is_safe=True),))
        other = 3 if self._format == 4 else 4
        if self._registry.get(name, other) is not None:
            hint = f'<{name}> belongs to format {other}: write <root BTCPP_format="{other}">'
            return Hint(hint, (SetFormat(other),))
        if name in self._declaring_files:
            model = f"--model {self._declaring_files[name] or 'FILE'}"
            return Hint(
                "a <TreeNodesModel> declares it, but its code is not registered: use --plugin or nodes.add, "
                f"or {model} to work without the code"
            )
        declare = (DeclareNode(name),) if is_port_name(name) else ()
        if not self.manifests:
            hint = "the registry is empty: start with Registry.standard(), which has the built-in nodes"
            return Hint(hint, declare)
        # A registry without installed libraries is that of a program: the commands load them all.
        is_program = not any(manifest.is_overridable for manifest in self.manifests.values())
        installed, unavailable = _installed_nodes() if is_program else (self._registry, [])
        provided = installed.get(name, self._format)
        if provided is not None:
            hint = (
                f"the installed library {provided.distribution} provides it: call nodes.add_plugins() of the "
                "registry, and pass nodes=nodes"
            )
            return Hint(hint, declare)
        searched = "searched: " + ", ".join(self._distributions())
        near = nearest_name(name, [*self.manifests, *EXPLICIT_TAGS])
        hint = searched if near is None else f"{suggestion(f'<{near}>')}   {searched}"
        if not self._plugin_suggested:
            self._plugin_suggested = True
            hint += "; load a plugin that provides it (--plugin, or nodes.add_plugin)"
            hint += "".join(f"; {note}" for note in unsearched_libraries(unavailable))
        rename = () if near is None else (Rename(near),)
        return Hint(hint, (*rename, *declare))

    def _distributions(self) -> list[str]:
        """Return the names of the Python distributions that provide the nodes, btcore first."""
        names = {manifest.distribution for manifest in self.manifests.values()}
        if "__main__" in names:
            names = (names - {"__main__"}) | {"your program"}
        return sorted(names, key=lambda name: (name != "btcore", name))


@cache
def _installed_nodes() -> tuple[Registry, list[UnavailableEntryPoint]]:
    nodes = Registry()
    return nodes, nodes.add_installed()


def literals_of(value_type: ValueType) -> list[str]:
    """Return the texts of all values of an enum or a Boolean; no texts for other types."""
    if isinstance(value_type, EnumType):
        return [value_type.to_text(member) for member in value_type.members]
    return ["true", "false"] if value_type is BOOL else []


def value_hint(value_type: ValueType) -> Hint:
    """Return the hint, without a text, for a literal that is not of the type *value_type*."""
    literals = literals_of(value_type)
    return Hint("", (SetValue(*literals),) if literals else ())


def port_hint(manifest: Manifest, name: str) -> Hint:
    """Return a hint for a port *name* that the node of *manifest* doesn't have."""
    similar = next((item for item in manifest.parameters if item.name == name and item.looks_like_port), None)
    if similar is not None:
        type_name = similar.type_name
        in_port = suggestion(f"{name}: In[{type_name}]")
        return Hint(f"its parameter '{name}: {type_name}' is a resource; {in_port}")
    if not manifest.ports:
        return Hint("it has no ports")
    near = nearest_name(name, manifest.ports)
    if near is not None:
        return Hint.similar_name(near)
    ports = join_names([f"'{port}'" for port in manifest.ports])
    return Hint(f"its ports are {ports}" if len(manifest.ports) > 1 else f"its only port is {ports}")
