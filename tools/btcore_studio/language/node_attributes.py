"""What the elements and attributes of a document mean: nodes, ports and scripts."""

from collections.abc import Iterator
from typing import NamedTuple

from btcore.blackboard.ports import SCRIPT_ROLES, Port, remapped_key
from btcore.names import SCRIPT_ATTRIBUTES
from btcore.registry.manifest import Manifest
from btcore.registry.registry import Registry
from btcore.script.lexer import END, Token, tokenize
from btcore.xml.read.scan import ScannedAttribute, ScannedElement, value_offsets
from btcore_studio.language.project import Project, SourceDocument
from btcore_studio.language.project_symbols import symbols_of
from btcore_studio.language.symbols import FileSymbols, is_call, node_id, read_symbols


def file_symbols(project: Project, document: SourceDocument) -> FileSymbols:
    """Return the symbols of a document, which need not be a file of the project."""
    known = symbols_of(project).files.get(document.uri)
    return known if known is not None else read_symbols(document.uri, document.scan, 4, project.registry)


def tree_of(element: ScannedElement | None) -> ScannedElement | None:
    """Return the `<BehaviorTree>` that contains *element*, or None."""
    if element is None:
        return None
    return next((around for around in element.ancestors() if around.tag == "BehaviorTree"), None)


def is_in_tree(element: ScannedElement) -> bool:
    """Return whether an element is a tree, or a node of a tree."""
    return element.tag == "BehaviorTree" or tree_of(element) is not None


class ScriptToken(NamedTuple):
    """A token of a script, from offset *start* to *end* of the document."""

    token: Token
    start: int
    end: int


class NodeElement(NamedTuple):
    """An element of a node.

    Attributes:
        element: The element.
        format: The XML format, 3 or 4.
        id: The ID of the node, or the tag of a SubTree element.
        manifest: The manifest of the node; None if the node is unknown.
    """

    element: ScannedElement
    format: int
    id: str
    manifest: Manifest | None

    @property
    def is_call(self) -> bool:
        """Whether the element calls a tree."""
        return is_call(self.element)

    def port(self, attribute: str) -> Port | None:
        """Return the port that an attribute sets; None if it is no port of a known node."""
        if self.is_call or self.manifest is None:
            return None
        return self.manifest.ports.get(attribute)

    def is_script(self, attribute: str) -> bool:
        """Return whether the attribute holds a script, and not a key of an entry with a script."""
        if self.format == 4 and attribute in SCRIPT_ATTRIBUTES:
            return True
        port = self.port(attribute)
        if port is None or port.role not in SCRIPT_ROLES:
            return False
        return remapped_key(self.element.get(attribute) or "", port.name, self.format) is None


def node_element(element: ScannedElement, format: int, registry: Registry) -> NodeElement:
    """Return the node that *element* describes. The element must be in a `<BehaviorTree>`.

    Args:
        format: The XML format, 3 or 4.
        registry: The known nodes.
    """
    id = node_id(element)
    return NodeElement(element, format, id, registry.get(id, format))


def script_tokens(text: str, attribute: ScannedAttribute) -> Iterator[ScriptToken]:
    """Yield the tokens of the script in an attribute of the document *text*."""
    offsets = value_offsets(text, attribute)
    for token in tokenize(attribute.value or ""):
        if token.type != END:
            yield ScriptToken(token, offsets[token.start], offsets[token.start + token.width])
