"""The XML of new nodes, calls and models, in the style of the document that gets them."""

from typing import NamedTuple

from btcore.blackboard.ports import KEY_ROLES, LOAD_TIME_ROLES, SCRIPT_ROLES, Direction, Port
from btcore.escaping import escape_text
from btcore.registry.manifest import Manifest, takes_children
from btcore.registry.nodes_without_code import is_mock
from btcore.suggestions import did_you_mean
from btcore.xml.edit.editor import DocumentEditor, Edit, EditError, apply_edits, escape_value
from btcore.xml.models.tree_nodes_model import TAG_OF
from btcore.xml.read.scan import ScannedElement
from btcore.xml.read.tags import EXPLICIT_TAGS, PORT_TAGS, SUBTREE_TAGS
from btcore.xml.read.tinyxml2_compat import decode
from btcore_studio.language.descriptions import is_mandatory
from btcore_studio.language.studio_protocol import PalettePort, PortDirection
from btcore_studio.language.tree_reading import TreeReading

DIRECTIONS: dict[Direction, PortDirection] = {
    Direction.IN: "in",
    Direction.OUT: "out",
    Direction.INOUT: "inout",
}
"""The names of the directions in the protocol."""
_PORT_TAGS = {DIRECTIONS[direction]: tag for tag, direction in PORT_TAGS.items()}
_OF_ENGINE = "btcore"


class NewElement(NamedTuple):
    """The tag and the attributes of a new node, or of a new call of a tree."""

    tag: str
    attributes: dict[str, str]

    @property
    def attribute_text(self) -> str:
        """The attributes as they are written, with a space before each."""
        return "".join(_attribute(name, text) for name, text in self.attributes.items())


def new_element(reading: TreeReading, id: str) -> NewElement:
    """Return the element of a new node, or of a new call of the tree *id*.

    The ports that the node needs have their key by name, and scripts are empty. Inputs of built-in nodes are
    not written: a warning at the field of the port requests a value.

    Raises:
        EditError: There is no node or tree *id*.
    """
    definitions = reading.definitions
    format = definitions.format
    manifest = reading.nodes.get(id, format)
    if manifest is not None and id not in SUBTREE_TAGS[definitions.format]:
        required = {
            port.name: _new_text(port)
            for port in manifest.ports.values()
            if is_mandatory(manifest, port) and not _is_reported(manifest, port)
        }
        if uses_explicit_tag(reading, manifest):
            return NewElement(TAG_OF[manifest.type], {"ID": id, **required})
        return NewElement(id, required)
    if id not in definitions.by_id:
        known = [*reading.nodes.manifests_of(format), *definitions.by_id]
        raise EditError(f"there is no node and no tree '{id}'{did_you_mean(id, known)}")
    model = definitions.subtree_models.get(id, {})
    required = {
        name: name if format == 3 else f"{{{name}}}" for name, default in model.items() if not default
    }
    return NewElement("SubTree", {"ID": id, **required})


def _is_reported(manifest: Manifest, port: Port) -> bool:
    """Return whether a missing value of the port causes a warning. Its value is usually not a key."""
    is_value = port.role not in KEY_ROLES and port.role not in LOAD_TIME_ROLES
    return port.direction is Direction.IN and is_value and not is_mock(manifest.cls)


def _new_text(port: Port) -> str:
    if port.role in SCRIPT_ROLES:
        return ""
    return port.name if port.role in KEY_ROLES else f"{{{port.name}}}"


def _attribute(name: str, text: str) -> str:
    return f' {name}="{escape_value(text)}"'


def uses_explicit_tag(reading: TreeReading, manifest: Manifest) -> bool:
    """Return whether most nodes like that of *manifest* have explicit tags such as `<Action ID="…">`."""
    format = reading.definitions.format
    explicit = compact = 0
    for tree in reading.document.root.iterchildren("BehaviorTree"):
        for element in tree.iter():
            is_explicit = element.tag in EXPLICIT_TAGS
            known = reading.nodes.get((element.get("ID") or "") if is_explicit else element.tag, format)
            # Groot writes explicit tags of leaves, and compact tags of built-in nodes.
            if known is not None and _style(known) == _style(manifest):
                explicit += is_explicit
                compact += not is_explicit
    return explicit > compact


def _style(manifest: Manifest) -> tuple[bool, bool]:
    return manifest.library == _OF_ENGINE, takes_children(manifest)


def is_port(element: ScannedElement, port: PalettePort, text: str) -> bool:
    """Return whether an element of a TreeNodesModel declares this port.

    Args:
        text: The text that contains *element*.
    """
    about = element.get("description") or ""
    if not about and element.end_tag_start >= 0:
        about = decode(text[element.start_tag_end : element.end_tag_start])
    written = (element.tag, element.get("type") or "", element.get("default") or "", " ".join(about.split()))
    return written == (_PORT_TAGS[port.direction], port.type, port.default, " ".join(port.about.split()))


def port_text(port: PalettePort) -> str:
    """Return the element of a port in a TreeNodesModel."""
    texts = {"name": port.name, "type": port.type, "default": port.default}
    attributes = "".join(_attribute(name, text) for name, text in texts.items() if text)
    tag, about = _PORT_TAGS[port.direction], escape_text(port.about)
    return f"<{tag}{attributes}>{about}</{tag}>" if about else f"<{tag}{attributes}/>"


def unindented(editor: DocumentEditor, element: ScannedElement) -> str:
    """Return the text of an element, without the indentation of its lines."""
    start, end = element.start, element.end
    closing = editor.indent_at(element.end_tag_start) if element.end_tag_start >= 0 else None
    indent = editor.indent(element) if closing is None else closing
    edits = editor.reindent(start, end, indent or "", "")
    return apply_edits(editor.text[start:end], [Edit(at - start, to - start, "") for at, to, _ in edits])
