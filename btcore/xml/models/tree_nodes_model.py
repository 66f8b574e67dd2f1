"""Write TreeNodesModel, the palette of Groot."""

from collections.abc import Iterable
from typing import Final

from btcore.blackboard.ports import Direction, Port
from btcore.escaping import escape_text
from btcore.registry.manifest import Manifest
from btcore.status import NodeType
from btcore.xml.read.tags import MODEL_TAGS

__all__ = ["write_models"]

# Groot has no tag for other kinds of nodes.
TAG_OF: Final = {node_type: tag for tag, node_type in MODEL_TAGS.items()} | {NodeType.UNDEFINED: "Action"}

_ATTRIBUTE_ESCAPES: Final = str.maketrans(
    {'"': "&quot;", "'": "&apos;", "\n": "&#10;", "\r": "&#13;", "\t": "&#9;"}
)


def quoted(text: str) -> str:
    """Return *text* as an attribute's value in quotes, escaped as BehaviorTree.CPP does."""
    return f'"{escape_text(text).translate(_ATTRIBUTE_ESCAPES)}"'


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
