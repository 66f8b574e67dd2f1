"""The pieces of a schema: elements of XSD, and the frame around the nodes that every document has."""

from collections.abc import Sequence
from typing import Final

from lxml import etree

_XS: Final = "http://www.w3.org/2001/XMLSchema"
_MODELS: Final = ("Action", "Condition", "Control", "Decorator", "SubTree")
_PORTS: Final = ("input_port", "output_port", "inout_port")


class SchemaElement:
    """An element of a schema."""

    def __init__(self, tag: str, parent: "SchemaElement | None" = None, **attributes: str) -> None:
        name = f"{{{_XS}}}{tag}"
        self.element: etree._Element = (
            etree.Element(name, attributes, nsmap={"xs": _XS})
            if parent is None
            else etree.SubElement(parent.element, name, attributes)
        )

    def add(self, tag: str, /, **attributes: str) -> "SchemaElement":
        """A new element inside of this one, after all others."""
        return SchemaElement(tag, self, **attributes)

    def has(self, tag: str, name: str) -> bool:
        """Whether there is a *tag* called *name* in it."""
        return any(one.get("name") == name for one in self.element.iterchildren(f"{{{_XS}}}{tag}"))


def add_documentation(part: SchemaElement, text: str) -> None:
    """Let editors show *text* about *part*, which has nothing inside yet."""
    if text:
        part.add("annotation").add("documentation").element.text = text


def add_enumeration(schema: SchemaElement, name: str, values: Sequence[str]) -> None:
    """A type *name* of these *values* alone."""
    restriction = schema.add("simpleType", name=name).add("restriction", base="xs:string")
    for value in values:
        restriction.add("enumeration", value=value)


def add_union(schema: SchemaElement, name: str) -> None:
    """The type that takes a *name* or a blackboard entry."""
    schema.add("simpleType", name=f"{name}OrBlackboard").add("union", memberTypes=f"blackboard {name}")


def add_attribute(part: SchemaElement, name: str, type: str, required: bool = False, about: str = "") -> None:
    """An attribute of *part*."""
    more = {"use": "required"} if required else {}
    add_documentation(part.add("attribute", name=name, type=type, **more), about)


def add_document_types(schema: SchemaElement, format: int) -> None:
    """Everything around the nodes: root, includes, trees and models."""
    root = schema.add("element", name="root").add("complexType")
    inside = root.add("choice", minOccurs="0", maxOccurs="unbounded")
    include = inside.add("element", name="include").add("complexType")
    add_attribute(include, "path", "xs:string", required=True)
    add_attribute(include, "ros_pkg", "xs:string")
    inside.add("element", name="BehaviorTree", type="BehaviorTreeType")
    inside.add("element", name="TreeNodesModel", type="TreeNodesModelType")
    number = root.add("attribute", name="BTCPP_format", fixed=str(format))
    if format == 4:
        number.element.set("use", "required")
    add_attribute(root, "main_tree_to_execute", "xs:string", about="the ID of the tree to run")
    add_attribute(root, "project_name", "xs:string", about="of a Groot 2 project")
    tree = schema.add("complexType", name="BehaviorTreeType")
    tree.add("group", ref="nodeGroup")
    add_attribute(tree, "ID", "xs:string")
    add_attribute(tree, "_description", "xs:string")
    add_attribute(tree, "_fullpath", "xs:string")
    _models(schema)


def _models(schema: SchemaElement) -> None:
    """TreeNodesModel: the palette of an editor."""
    models = schema.add("complexType", name="TreeNodesModelType")
    choice = models.add("choice", minOccurs="0", maxOccurs="unbounded")
    for tag in _MODELS:
        choice.add("element", name=tag, type="modelType")
    model = schema.add("complexType", name="modelType")
    inside = model.add("choice", minOccurs="0", maxOccurs="unbounded")
    for tag in _PORTS:
        inside.add("element", name=tag, type="portType")
    inside.add("element", name="description", type="xs:string")
    fields = inside.add("element", name="MetadataFields").add("complexType").add("sequence")
    field = fields.add("element", name="Metadata", minOccurs="0", maxOccurs="unbounded").add("complexType")
    field.add("anyAttribute", processContents="skip")
    add_attribute(model, "ID", "xs:string", required=True)
    model.add("anyAttribute", processContents="skip")
    port = schema.add("complexType", name="portType").add("simpleContent").add("extension", base="xs:string")
    add_attribute(port, "name", "xs:string", required=True)
    for name in ("type", "default", "description"):
        add_attribute(port, name, "xs:string")
