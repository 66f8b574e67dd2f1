"""Write an XML schema (XSD 1.0) of all registered nodes, for completion and validation in editors.

`btcore schema` prints it.
"""

import re
from collections.abc import Mapping, Sequence
from enum import Enum
from typing import Final

import click
from lxml import etree

from btcore.blackboard.ports import Port
from btcore.cli import terminal
from btcore.cli.node_libraries import AllNodesOptions, NodeLibraries
from btcore.field_options import pass_options
from btcore.names import POSTCONDITION_ATTRIBUTES, PRECONDITION_ATTRIBUTES
from btcore.registry.manifest import Manifest
from btcore.registry.registry import Registry
from btcore.status import NodeType, Status
from btcore.values import BOOL, DOUBLE, INT, INT64, NODE_STATUS, UINT, UINT64, EnumType, ValueType
from btcore.xml.read.tags import (
    CONTROLS_WITH_CHILDREN_IN_3,
    EXPLICIT_TAGS,
    MODEL_TAGS,
    PORT_TAGS,
    SUBTREE_TAGS,
)

__all__ = ["write_schema"]

_XS: Final = "http://www.w3.org/2001/XMLSchema"
_TAG: Final = re.compile(r"[A-Za-z_][\w.-]*\Z", re.ASCII)
# A key in braces, or "=" for the key with the name of the port.
_POINTER: Final = r"\s*\{.+\}\s*|="
_TYPES: Final[Mapping[str, str]] = {
    BOOL.name: "boolean",
    INT.name: "integer",
    INT64.name: "integer",
    UINT.name: "cardinal",
    UINT64.name: "cardinal",
    DOUBLE.name: "decimal",
    NODE_STATUS.name: "status",
}


class _SchemaElement:
    """An element of a schema."""

    def __init__(self, element: etree._Element) -> None:
        self.element = element

    def add(self, tag: str, /, **attributes: str) -> "_SchemaElement":
        """Append a new child element and return it.

        Args:
            tag: Name of the element, without the namespace.
            **attributes: Its attributes.
        """
        return _SchemaElement(etree.SubElement(self.element, f"{{{_XS}}}{tag}", attributes))


def _add_documentation(part: _SchemaElement, text: str) -> None:
    """Add *text* as the documentation of *part*, which must not have children yet."""
    if text:
        part.add("annotation").add("documentation").element.text = text


def _add_enumeration(schema: _SchemaElement, name: str, values: Sequence[str]) -> None:
    """Add an enumeration type *name* with *values*."""
    restriction = schema.add("simpleType", name=name).add("restriction", base="xs:string")
    for value in values:
        restriction.add("enumeration", value=value)


def _add_union(schema: _SchemaElement, name: str) -> None:
    """Add the type `<name>OrBlackboard`, which accepts values of the type *name* and `{key}`."""
    schema.add("simpleType", name=f"{name}OrBlackboard").add("union", memberTypes=f"blackboard {name}")


def _add_attribute(
    part: _SchemaElement, name: str, type: str, required: bool = False, about: str = ""
) -> None:
    """Add an attribute to *part*."""
    more = {"use": "required"} if required else {}
    _add_documentation(part.add("attribute", name=name, type=type, **more), about)


def write_schema(registry: Registry, format: int = 4) -> str:
    """Return the schema for trees with the nodes of a registry.

    Like writeTreeXSD of BehaviorTree.CPP, the schema describes the compact form: each node has a type
    `<ID>Type` with its ports as attributes, and ports without a default are required. Explicit tags
    such as `<Action ID="…">` accept any attributes. IDs that are not valid tags are left out.

    Args:
        registry: The registered nodes.
        format: The format of the trees, 3 or 4.

    Examples:
        >>> import btcore
        >>> from btcore_studio.schema import write_schema
        >>> schema = write_schema(btcore.Registry.standard())
        >>> "Sequence" in schema
        True
    """
    manifests = registry.manifests_of(format)
    root = etree.Element(f"{{{_XS}}}schema", elementFormDefault="qualified", nsmap={"xs": _XS})
    schema = _SchemaElement(root)
    _simple_types(schema)
    _groups(schema, format)
    nodes = schema.add("group", name="nodeGroup").add("choice")
    subtrees = SUBTREE_TAGS[format]
    for id, manifest in manifests.items():
        if _TAG.match(id) and id not in EXPLICIT_TAGS and id not in subtrees:
            nodes.add("element", name=id, type=f"{id}Type")
            _node(schema, manifest, format)
    for tag in sorted(EXPLICIT_TAGS):
        nodes.add("element", name=tag, type=f"explicit{tag}Type")
        _explicit(schema, tag)
    for tag in sorted(subtrees):
        nodes.add("element", name=tag, type=f"{tag}Type")
        _subtree(schema, tag, manifests.get(tag))
    _add_document_types(schema, format)
    text: bytes = etree.tostring(root, pretty_print=True, xml_declaration=True, encoding="UTF-8")
    return text.decode()


def _simple_types(schema: _SchemaElement) -> None:
    """Add the types of attributes: each accepts literals and blackboard entries in braces."""
    schema.add("simpleType", name="blackboard").add("restriction", base="xs:string").add(
        "pattern", value=_POINTER
    )
    literals = {
        "boolean": ["0", "1", "true", "TRUE", "True", "false", "FALSE", "False"],
        "status": [status.name for status in Status],
    }
    for name, values in literals.items():
        _add_enumeration(schema, name, values)
        _add_union(schema, name)
    numbers = {"integer": "xs:integer", "cardinal": "xs:nonNegativeInteger", "decimal": "xs:double"}
    for name, known in numbers.items():
        schema.add("simpleType", name=name).add("restriction", base=known)
        _add_union(schema, name)


def _groups(schema: _SchemaElement, format: int) -> None:
    group = schema.add("attributeGroup", name="anyNodeAttributes")
    _add_attribute(group, "name", "xs:string", about="name of the node in logs and paths")
    _add_attribute(group, "_description", "xs:string", about="a comment")
    if format == 3:
        return
    for name in ("_uid", "_fullpath"):
        _add_attribute(group, name, "xs:string", about="written by monitors, without effect")
    for title, names, about in (
        ("preconditions", PRECONDITION_ATTRIBUTES, "a condition that is checked before the node is ticked"),
        (
            "postconditions",
            POSTCONDITION_ATTRIBUTES,
            "a script that runs after the node has completed or was halted",
        ),
    ):
        scripts = schema.add("attributeGroup", name=title)
        for name in names:
            _add_attribute(scripts, name, "xs:string", about=about)
        group.add("attributeGroup", ref=title)


def _node(schema: _SchemaElement, manifest: Manifest, format: int) -> None:
    """Add the type of a node: its children and its ports."""
    element_type = schema.add("complexType", name=f"{manifest.id}Type")
    _add_documentation(element_type, manifest.description)
    _children(element_type, *_number_of_children(manifest, format))
    for port in manifest.ports.values():
        required = port.default is None and not port.optional
        # An output port must point to an entry; format 3 also accepts its name without braces.
        type = _type_of(schema, port.type) if port.reads or format == 3 else "blackboard"
        _add_attribute(element_type, port.name, type, required, _about(port))
    element_type.add("attributeGroup", ref="anyNodeAttributes")


def _number_of_children(manifest: Manifest, format: int) -> tuple[int, int | None]:
    least, most = manifest.spec.child_count
    if manifest.type is NodeType.DECORATOR:
        return 1, 1
    if manifest.type is not NodeType.CONTROL:
        return 0, 0
    # Format 3 requires children of some control nodes only.
    may_be_empty = least == 1 and format == 3 and manifest.id not in CONTROLS_WITH_CHILDREN_IN_3
    return (0 if may_be_empty else least), most


def _children(element_type: _SchemaElement, least: int, most: int | None) -> None:
    if most != 0:
        bounds = {"minOccurs": str(least), "maxOccurs": "unbounded" if most is None else str(most)}
        element_type.add("sequence").add("group", ref="nodeGroup", **bounds)


def _type_of(schema: _SchemaElement, value_type: ValueType) -> str:
    """Return the name of the attribute type for *value_type*; add the type if it is a new enum."""
    if isinstance(value_type, EnumType) and issubclass(value_type.python_type, Enum):
        name = re.sub(r"\W", "_", value_type.name)
        if schema.element.find(f"{{{_XS}}}simpleType[@name='{name}']") is None:
            schema.add("simpleType", name=name).add("union", memberTypes=f"{name}Name xs:integer")
            _add_enumeration(schema, f"{name}Name", list(value_type.python_type.__members__))
            _add_union(schema, name)
        return f"{name}OrBlackboard"
    known = _TYPES.get(value_type.name)
    return "xs:string" if known is None else f"{known}OrBlackboard"


def _about(port: Port) -> str:
    about = [f"{port.direction.value}, {port.type.name}"]
    if port.default is not None:
        about.append(f"default {port.default!r}")
    return ", ".join(about) + (f": {port.description}" if port.description else "")


def _explicit(schema: _SchemaElement, tag: str) -> None:
    """Add the type of an explicit tag such as `<Action ID="…">`, which accepts any attributes."""
    element_type = schema.add("complexType", name=f"explicit{tag}Type")
    _add_documentation(element_type, f"A node of the type {tag}, named by its ID.")
    if tag in ("Control", "Decorator"):
        _children(element_type, 1, 1 if tag == "Decorator" else None)
    _add_attribute(element_type, "ID", "xs:string", required=True)
    element_type.add("anyAttribute", processContents="skip")


def _subtree(schema: _SchemaElement, tag: str, manifest: Manifest | None) -> None:
    element_type = schema.add("complexType", name=f"{tag}Type")
    _add_documentation(element_type, manifest.description if manifest is not None else "")
    _add_attribute(element_type, "ID", "xs:string", required=True, about="ID of the called tree")
    _add_attribute(element_type, "name", "xs:string")
    element_type.add("anyAttribute", processContents="skip")


def _add_document_types(schema: _SchemaElement, format: int) -> None:
    """Add the types of elements around the nodes: root, includes, trees and models."""
    root = schema.add("element", name="root").add("complexType")
    inside = root.add("choice", minOccurs="0", maxOccurs="unbounded")
    include = inside.add("element", name="include").add("complexType")
    _add_attribute(include, "path", "xs:string", required=True)
    _add_attribute(include, "ros_pkg", "xs:string")
    inside.add("element", name="BehaviorTree", type="BehaviorTreeType")
    inside.add("element", name="TreeNodesModel", type="TreeNodesModelType")
    number = root.add("attribute", name="BTCPP_format", fixed=str(format))
    if format == 4:
        number.element.set("use", "required")
    _add_attribute(root, "main_tree_to_execute", "xs:string", about="ID of the tree to run")
    _add_attribute(root, "project_name", "xs:string", about="name of a Groot 2 project")
    tree = schema.add("complexType", name="BehaviorTreeType")
    tree.add("group", ref="nodeGroup")
    _add_attribute(tree, "ID", "xs:string")
    _add_attribute(tree, "_description", "xs:string")
    _add_attribute(tree, "_fullpath", "xs:string")
    _models(schema)


def _models(schema: _SchemaElement) -> None:
    """Add the type of TreeNodesModel, the palette of an editor."""
    models = schema.add("complexType", name="TreeNodesModelType")
    choice = models.add("choice", minOccurs="0", maxOccurs="unbounded")
    for tag in MODEL_TAGS:
        choice.add("element", name=tag, type="modelType")
    model = schema.add("complexType", name="modelType")
    inside = model.add("choice", minOccurs="0", maxOccurs="unbounded")
    for tag in PORT_TAGS:
        inside.add("element", name=tag, type="portType")
    inside.add("element", name="description", type="xs:string")
    fields = inside.add("element", name="MetadataFields").add("complexType").add("sequence")
    field = fields.add("element", name="Metadata", minOccurs="0", maxOccurs="unbounded").add("complexType")
    field.add("anyAttribute", processContents="skip")
    _add_attribute(model, "ID", "xs:string", required=True)
    model.add("anyAttribute", processContents="skip")
    port = schema.add("complexType", name="portType").add("simpleContent").add("extension", base="xs:string")
    _add_attribute(port, "name", "xs:string", required=True)
    for name in ("type", "default", "description"):
        _add_attribute(port, name, "xs:string")


@click.command()
@pass_options(AllNodesOptions, "options")
def schema(options: AllNodesOptions) -> None:
    """Print an XML schema (XSD) of trees and all available nodes.

    The schema covers nodes that are built-in, installed, or loaded by --plugin or --model. XML editors use it
    to complete tags and attributes, and to show their documentation.
    """
    terminal.print_xml(write_schema(NodeLibraries(options.plugins, options.models).nodes, options.format))
