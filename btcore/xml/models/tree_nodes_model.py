"""Read and write TreeNodesModel, the palette of Groot."""

from collections.abc import Iterable, Sequence
from typing import Final

from btcore.blackboard.ports import Direction, Port
from btcore.diagnostic_codes import INVALID_NAME, MISSING_ID, TOO_LARGE
from btcore.escaping import escape_text
from btcore.names import model_port_name_error
from btcore.registry.manifest import Manifest
from btcore.status import NodeType
from btcore.xml.read.diagnostics import DiagnosticCollector
from btcore.xml.read.dialect import Dialect
from btcore.xml.read.document import Document
from btcore.xml.read.element import Element

__all__ = ["subtree_models", "write_models"]

TAG_OF: Final = {
    NodeType.ACTION: "Action",
    NodeType.CONDITION: "Condition",
    NodeType.CONTROL: "Control",
    NodeType.DECORATOR: "Decorator",
    NodeType.SUBTREE: "SubTree",
    NodeType.UNDEFINED: "Action",  # Groot has no tag for other kinds of nodes
}
PORT_TAGS: Final = {f"{direction.value}_port": direction for direction in Direction}


_ATTRIBUTE_ESCAPES: Final = str.maketrans(
    {'"': "&quot;", "'": "&apos;", "\n": "&#10;", "\r": "&#13;", "\t": "&#9;"}
)


def quoted(text: str) -> str:
    """Return *text* as an attribute's value in quotes, escaped as BehaviorTree.CPP does."""
    return f'"{escape_text(text).translate(_ATTRIBUTE_ESCAPES)}"'


MAX_MODEL_PORTS: Final = 1_000
"""Maximum number of ports in the model of a subtree."""


def subtree_models(
    documents: Sequence[Document], dialect: Dialect, diagnostics: DiagnosticCollector
) -> dict[str, dict[str, str | None]]:
    """Return the ports that subtree models declare. Models of other nodes are ignored.

    Args:
        documents: The documents with the models.
        dialect: The rules of the XML format, which determine the valid port names.
        diagnostics: Collects errors in the models.

    Returns:
        For each tree ID the names of the ports with their defaults; None means a required port.
    """
    models_by_id: dict[str, dict[str, str | None]] = {}
    for document in documents:
        for models in document.root.iterchildren("TreeNodesModel"):
            for model in models.iterchildren("SubTree"):
                id = model.get("ID")
                if id is None:
                    message = "missing ID in the model of a subtree"
                    hint = 'write <SubTree ID="…">'
                    diagnostics.add(document.diagnostic(MISSING_ID, message, model, hint=hint))
                    continue
                ports = models_by_id.setdefault(id, {})
                for port in model.iterchildren(*PORT_TAGS):
                    if len(ports) >= MAX_MODEL_PORTS:
                        # Every call of the tree has all ports: a short document could fill the memory.
                        message = f"the model of '{id}' has more than {MAX_MODEL_PORTS:,} ports"
                        diagnostics.add(document.diagnostic(TOO_LARGE, message, model, "ID"))
                        break
                    _port(document, port, ports, dialect, diagnostics)
    return models_by_id


def _port(
    document: Document,
    port: Element,
    ports: dict[str, str | None],
    dialect: Dialect,
    diagnostics: DiagnosticCollector,
) -> None:
    name = port.get("name")
    if name is None:
        message = f"missing name of the <{port.tag}>"
        diagnostics.add(document.diagnostic(MISSING_ID, message, port, hint=f'write <{port.tag} name="…"/>'))
        return
    error = model_port_name_error(name) if dialect.tree_ids_checked else ""
    if error:
        message = f"invalid port name '{name}' in the model of a subtree: {error}"
        diagnostics.add(document.diagnostic(INVALID_NAME, message, port, "name"))
    ports[name] = port.get("default")


def write_models(manifests: Iterable[Manifest], format: int = 4) -> str:
    """Return a document with a TreeNodesModel, sorted by ID, that Groot can import.

    Args:
        manifests: The nodes.
        format: 4, or 3 for Groot 1, where ports are sorted by direction and name.

    Examples:
        >>> import btcore
        >>> from btcore.xml.models.tree_nodes_model import write_models
        >>> @btcore.action
        ... def go(place: btcore.In[str]):
        ...     pass
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(go)
        >>> print(write_models([nodes.get("Go")]), end="")
        <root BTCPP_format="4">
            <TreeNodesModel>
                <Action ID="Go">
                    <input_port name="place" type="std::string"/>
                </Action>
            </TreeNodesModel>
        </root>
    """
    root = '<root BTCPP_format="4">' if format == 4 else "<root>"
    return "\n".join([root, *model_lines(manifests, format), "</root>"]) + "\n"


def model_lines(manifests: Iterable[Manifest], format: int = 4) -> list[str]:
    """Return the lines of a TreeNodesModel, indented as a child of `<root>`.

    Args:
        manifests: The nodes.
        format: 4, or 3 for Groot 1, where ports are sorted by direction and name.
    """
    lines = ["    <TreeNodesModel>"]
    for manifest in sorted(manifests, key=lambda manifest: manifest.id):
        lines += _model(manifest, format)
    return [*lines, "    </TreeNodesModel>"]


def _model(manifest: Manifest, format: int) -> list[str]:
    tag = TAG_OF[manifest.type]
    start = f"        <{tag} ID={quoted(manifest.id)}"
    ports: list[Port] = list(manifest.ports.values())
    # Format 3 has no metadata.
    metadata = manifest.metadata if format == 4 else {}
    if not ports and not metadata:
        return [start + "/>"]
    if format == 3:
        order = list(Direction)
        ports.sort(key=lambda port: (order.index(port.direction), port.name))
    lines = [start + ">"]
    for port in ports:
        port_tag = f"{port.direction.value}_port"
        text = f"            <{port_tag} name={quoted(port.name)} type={quoted(port.type.name)}"
        if port.default:
            text += f" default={quoted(port.default)}"
        if port.description:
            text += f">{escape_text(port.description)}</{port_tag}>"
        else:
            text += "/>"
        lines.append(text)
    if metadata:
        fields = [f"                <Metadata {name}={quoted(text)}/>" for name, text in metadata.items()]
        lines += ["            <MetadataFields>", *fields, "            </MetadataFields>"]
    return [*lines, f"        </{tag}>"]
