"""The nodes that a document may name, in one format, and what to say of a name that none has."""

from collections.abc import Mapping

from btcore.registry.manifest import Manifest
from btcore.suggestions import join_names, nearest_name
from btcore.xml.read.dialect import EXPLICIT_TAGS, NODE_REPLACEMENTS


class NodePalette:
    """The manifests of one format, by ID."""

    def __init__(
        self, manifests: Mapping[str, Manifest], other_format: Mapping[str, Manifest], format: int
    ) -> None:
        self.manifests = manifests
        self._other = other_format
        self._format = format

    def unknown_node_hint(
        self, name: str, trees: Mapping[str, object], declared_in: str | None = None
    ) -> str:
        """A hint for a node *name* that is not registered.

        *declared_in* is the file whose TreeNodesModel has it, if one has.
        """
        if name in trees:
            return f"'{name}' is a tree: write <SubTree ID=\"{name}\"/>"
        successor = NODE_REPLACEMENTS.get(name)
        if successor is not None and successor in self.manifests:
            return f"<{successor}> takes its place"
        if name in self._other:
            other = 3 if self._format == 4 else 4
            return f'<{name}> belongs to format {other}: load the document as one (BTCPP_format="{other}")'
        if declared_in is not None:
            model = f"--model {declared_in or 'FILE'}"
            return (
                "a <TreeNodesModel> declares it, but its code isn't here: register that (--plugin, or "
                f"nodes.add), or do without code: {model}"
            )
        if not self.manifests:
            return "the registry is empty: begin with Registry.standard(), which has the built-in nodes"
        searched = "searched: " + ", ".join(self.distributions())
        near = nearest_name(name, [*self.manifests, *EXPLICIT_TAGS])
        if near is None:
            return f"{searched}; a plugin may bring it (--plugin, or nodes.add_plugin)"
        return f"did you mean <{near}>?   {searched}"

    def distributions(self) -> list[str]:
        """Who brought the nodes, btcore first."""
        found = {manifest.distribution for manifest in self.manifests.values()}
        if "__main__" in found:
            found = (found - {"__main__"}) | {"your program"}
        return sorted(found, key=lambda name: (name != "btcore", name))


def port_hint(manifest: Manifest, name: str) -> str:
    """A hint for a port *name* that the node of *manifest* doesn't have."""
    meant = next((one for one in manifest.parameters if one.name == name and one.looks_like_port), None)
    if meant is not None:
        kind = meant.type_name
        return f"its parameter '{name}: {kind}' asks for a resource; did you mean {name}: In[{kind}]?"
    if not manifest.ports:
        return "it has no ports"
    near = nearest_name(name, manifest.ports)
    if near is not None:
        return f"did you mean '{near}'?"
    ports = join_names([f"'{one}'" for one in manifest.ports])
    return f"its ports are {ports}" if len(manifest.ports) > 1 else f"its only port is {ports}"
