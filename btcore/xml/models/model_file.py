"""Register mock nodes: node classes without code, with the IDs and ports that a TreeNodesModel describes.

With mock nodes, trees whose leaves are written in C++ can be checked, drawn, converted, and run with
planned results.
"""

import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

from btcore.blackboard.ports import Direction, Port, remapped_key
from btcore.diagnostic_codes import INVALID_NAME, MISSING_ID, UNREADABLE_FILE
from btcore.diagnostics import Diagnostic
from btcore.errors import RegistrationError, TreeError
from btcore.names import SCRIPT_ATTRIBUTES, is_port_name, port_name_error
from btcore.registry.nodes_without_code import create_mock_class
from btcore.registry.registration_checks import default_value_error
from btcore.registry.registry import Registry
from btcore.status import NodeType
from btcore.values import ANY, ValueType
from btcore.xml.define import parse_format
from btcore.xml.read.document import DiagnosticCollector, Document
from btcore.xml.read.element import Element
from btcore.xml.read.read import parse_file, read
from btcore.xml.read.tags import EXPLICIT_TAGS, PORT_TAGS

# Other names for types of BehaviorTree.CPP, as users and other compilers write them.
_ALIASES: Final = {
    "string": "std::string",
    "str": "std::string",
    "std::string_view": "std::string",
    "unsigned": "unsigned int",
    "uint": "unsigned int",
    "uint32_t": "unsigned int",
    "int32_t": "int",
    "int64_t": "long",
    "uint64_t": "unsigned long",
    "uint8_t": "unsigned char",
    "uint16_t": "unsigned short",
    "int8_t": "signed char",
    "int16_t": "short",
    "NodeStatus": "BT::NodeStatus",
    "Any": "BT::Any",
}


def add_models(nodes: Registry, path: str | os.PathLike[str], confined: bool = False) -> list[str]:
    """Register a mock node for every model in a file, and for every explicit tag in its trees.

    Registered nodes are not replaced, except for nodes of an installed library.

    Args:
        path: A palette exported by Groot, a project of Groot 2 (`.btproj`), or a file of trees with
            their models.
        confined: Whether includes from outside of the file's folder are errors.

    Returns:
        The IDs of the new mock nodes.
    """
    sources = read(parse_file(path, confined=confined))
    sources.diagnostics.raise_errors()
    documents = sources.documents
    added = [id for document in documents for id in add_document_models(nodes, document, override=True)]
    added += add_explicit_nodes(nodes, documents)
    if not added and not any(model_elements(document) for document in documents):
        message = "the file contains no model of a node"
        hint = "export a <TreeNodesModel> with Groot or `btcore nodes --xml`"
        raise TreeError([Diagnostic(UNREADABLE_FILE, message, os.fspath(path), hint=hint)])
    return added


def add_explicit_nodes(nodes: Registry, documents: Iterable[Document]) -> list[str]:
    """Register a mock node for each unknown node that an explicit tag names, as `<Action ID="Move"/>`.

    The tag determines the node type. The attributes of all elements with this ID become its ports.

    Returns:
        The IDs of the new mock nodes.
    """
    unknown: dict[str, tuple[Document, str, dict[str, Port]]] = {}
    for document in documents:
        format = parse_format(document.root.get("BTCPP_format")) or 4
        for tree in document.root.iterchildren("BehaviorTree"):
            for element in tree.iter(*EXPLICIT_TAGS):
                id = element.get("ID") or ""
                if id and nodes.get(id, 3) is None and nodes.get(id, 4) is None:
                    ports = unknown.setdefault(id, (document, element.tag, {}))[2]
                    collect_ports(element, ports, format)
    for id, (document, tag, seen) in unknown.items():
        add_mock(nodes, id, EXPLICIT_TAGS[tag], list(seen.values()), "", document)
    return list(unknown)


def collect_ports(element: Element, ports: dict[str, Port], format: int) -> None:
    """Add the attributes of *element* to *ports* as inputs, or as inouts if they hold a `{key}`."""
    for name, text in element.attributes.items():
        is_port = is_port_name(name) if format == 4 else not port_name_error(name, 3)
        if is_port and name not in SCRIPT_ATTRIBUTES:
            known = ports.get(name)
            is_key = remapped_key(text, name, 3) is not None
            if known is None or (is_key and known.direction is Direction.IN):
                ports[name] = Port(name, Direction.INOUT if is_key else Direction.IN)


def model_elements(document: Document) -> list[Element]:
    """Return the models of nodes in a document."""
    root = document.root
    tables = [root] if root.tag == "TreeNodesModel" else list(root.iterchildren("TreeNodesModel"))
    return [model for table in tables for model in table.iterchildren(*EXPLICIT_TAGS)]


def add_document_models(nodes: Registry, document: Document, override: bool = False) -> list[str]:
    """Register a mock node for every model of *document* whose node is unknown.

    Args:
        override: Whether the models override nodes of installed libraries.

    Returns:
        The IDs of the new mock nodes.

    Raises:
        TreeError: A model is invalid; the others are registered.
    """
    added: list[str] = []
    collector = DiagnosticCollector()
    for model in model_elements(document):
        id = model.get("ID")
        if id is None:
            message = f"missing ID in the model <{model.tag}>"
            collector.report(document, MISSING_ID, message, model, hint=f'write <{model.tag} ID="…">')
            continue
        is_known = nodes.is_taken if override else nodes.get
        if is_known(id, 3) or is_known(id, 4):
            continue
        ports = [_port(nodes, document, item) for item in model.iterchildren(*PORT_TAGS) if item.get("name")]
        described = next(model.iterchildren("description"), None)
        about = " ".join(document.source_map.text_in(described).split()) if described is not None else ""
        try:
            add_mock(nodes, id, EXPLICIT_TAGS[model.tag], ports, about, document, _metadata(model))
            added.append(id)
        except RegistrationError as error:
            collector.report(document, INVALID_NAME, str(error), model, attribute="ID")
    collector.diagnostics.raise_errors()
    return added


def _metadata(model: Element) -> dict[str, str]:
    metadata: dict[str, str] = {}
    for fields in model.iterchildren("MetadataFields"):
        for field in fields.iterchildren("Metadata"):
            metadata |= field.attributes
    return metadata


def _port(nodes: Registry, document: Document, element: Element) -> Port:
    port = Port(
        element.get("name") or "",
        PORT_TAGS[element.tag],
        _type(nodes, element.get("type") or ""),
        element.get("default") or None,
        " ".join((element.get("description") or document.source_map.text_in(element)).split()),
    )
    if default_value_error(port):
        # Only the C++ code can convert texts of this port: accept any text.
        port.type = ValueType(port.type.name, object, converts=False)
    return port


def _type(nodes: Registry, name: str) -> ValueType:
    """Return the type with the C++ name *name*; an unknown name becomes a new type without conversion."""
    name = re.sub(r"\bconst\b|&", "", name).strip()
    if not name:
        return ANY
    known = nodes.types.named(_ALIASES.get(name, name))
    if known is None:
        return ValueType(name, object, converts=False)
    if nodes.types.is_of_library(known):
        # The C++ class of this name may have another text form: accept any text.
        return ValueType(name, known.python_type, converts=False)
    return known


def add_mock(
    nodes: Registry,
    id: str,
    node_type: NodeType,
    ports: list[Port],
    description: str,
    document: Document,
    metadata: Mapping[str, str] | None = None,
) -> None:
    """Register a mock node. Ports whose name is not valid in format 4 exist in format 3 only."""
    origin = Path(document.file).stem.replace(".", "_") if document.file else "model"
    allowed = [port for port in ports if not port_name_error(port.name) or port_name_error(port.name, 3)]
    by_format = {None: ports} if len(allowed) == len(ports) else {3: ports, 4: allowed}
    for format, its_ports in by_format.items():
        cls = create_mock_class(id, node_type, its_ports, description, origin, metadata)
        nodes.add(cls, ID=id, format=format)
