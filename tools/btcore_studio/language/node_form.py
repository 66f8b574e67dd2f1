"""The form of a node: its attributes with what an editor can offer for each."""

from collections.abc import Iterable, Iterator
from typing import Literal

from btcore.blackboard.ports import KEY_ROLES, SCRIPT_ROLES, Port, remapped_key
from btcore.names import SCRIPT_ATTRIBUTES
from btcore.registry.nodes_without_code import is_mock
from btcore.status import NodeType
from btcore.values.types import literals_of
from btcore.xml.plan.key_uses import NON_KEY_ATTRIBUTES
from btcore.xml.read.scan import ScannedElement
from btcore.xml.read.tags import SUBTREE_TAGS
from btcore_studio.language.descriptions import (
    CONDITION_ATTRIBUTES,
    SHARING_ATTRIBUTES,
    is_mandatory,
    type_name,
)
from btcore_studio.language.drawing import child_limits, node_kind
from btcore_studio.language.element_texts import DIRECTIONS
from btcore_studio.language.node_attributes import file_symbols, tree_of
from btcore_studio.language.project import Project, SourceDocument
from btcore_studio.language.project_symbols import symbols_of
from btcore_studio.language.studio_protocol import Field, NodeForm, NodeKind, Place, PortDirection
from btcore_studio.language.symbols import KeyForm, KeyUse, TreeSymbol, is_call, node_id
from btcore_studio.language.tree_reading import TreeReading, no_node_error, read_trees

_NAME = "The name of the node in drawings and logs; by default its ID."
_DESCRIPTION = "A comment, which Groot shows."


def form_of(project: Project, source: SourceDocument, place: Place) -> NodeForm:
    """Return the form of a node.

    Raises:
        EditError: There is no node at the place.
    """
    reading = read_trees(project, source)
    element = reading.node_at(place.position)
    tree = tree_of(element)
    if tree is None:
        raise no_node_error(place.position)
    return _Form(project, reading, element, tree).form()


class _Form:
    def __init__(
        self, project: Project, reading: TreeReading, element: ScannedElement, tree: ScannedElement
    ) -> None:
        self._project = project
        self._reading = reading
        self._element = element
        self._format = reading.definitions.format
        symbols = file_symbols(project, reading.source)
        offset = tree.start + reading.source.mark_length
        self._tree = next((known for known in symbols.trees if known.element.start == offset), None)
        self._keys = sorted(_keys_of(self._tree)) if self._tree is not None else []
        self._id = node_id(element)
        self._manifest = reading.nodes.get(self._id, self._format)

    def form(self) -> NodeForm:
        """Return the form."""
        element, manifest = self._element, self._manifest
        fields = [self._field("name", "name", about=_NAME)]
        fields += self._call_fields() if is_call(element) else self._port_fields()
        if self._reading.definitions.format == 4:
            fields += [
                self._field(name, "condition", about=CONDITION_ATTRIBUTES[name], is_script=True)
                for name in SCRIPT_ATTRIBUTES
            ]
        fields.append(self._field("_description", "other", about=_DESCRIPTION))
        known = {"ID", *(field.name for field in fields)}
        others = dict.fromkeys(item.name for item in element.attributes if item.name not in known)
        fields += [self._field(name, "other") for name in others]
        called = element.get("ID") or ""
        is_known = manifest is not None and self._reading.knows(self._id)
        return NodeForm(
            self._id,
            element.get("name") or (called if is_call(element) else "") or self._id,
            self._kind(),
            manifest.description if manifest is not None and is_known else "",
            fields,
            list(self._types()),
        )

    def _kind(self) -> NodeKind:
        if is_call(self._element):
            return "subtree"
        return node_kind(self._manifest.type if self._manifest is not None else NodeType.UNDEFINED)

    def _field(
        self,
        name: str,
        group: Literal["name", "port", "condition", "subtree", "other"],
        *,
        direction: PortDirection | Literal[""] = "",
        type: str = "",
        default: str | None = None,
        is_required: bool = False,
        about: str = "",
        choices: Iterable[str] = (),
        is_script: bool = False,
    ) -> Field:
        text = self._element.get(name)
        offered = list(choices)
        return Field(name, group, text, direction, type, default, is_required, about, offered, is_script)

    # --- nodes

    def _port_fields(self) -> Iterator[Field]:
        if self._manifest is None:
            return
        is_modelled = is_mock(self._manifest.cls)
        for port in self._manifest.ports.values():
            is_script = port.role in SCRIPT_ROLES and (
                remapped_key(self._element.get(port.name) or "", port.name, self._format) is None
            )
            yield self._field(
                port.name,
                "port",
                direction=DIRECTIONS[port.direction],
                type=type_name(port.type),
                default=port.default,
                # A model does not declare whether the node works without an output: most nodes do.
                is_required=is_mandatory(self._manifest, port) and (port.reads or not is_modelled),
                about=port.description,
                choices=() if is_script else self._choices(port),
                is_script=is_script,
            )

    def _choices(self, port: Port) -> list[str]:
        keys = self._keys if port.role in KEY_ROLES else [f"{{{key}}}" for key in self._keys]
        return [*literals_of(port.type), *keys]

    def _types(self) -> Iterator[str]:
        """Yield the IDs of the nodes and trees that may have the children of this node."""
        definitions, element = self._reading.definitions, self._element
        count = len(element.node_children())
        own = self._manifest.type if self._manifest is not None else NodeType.UNDEFINED
        manifests = self._reading.nodes.manifests_of(self._format).values()
        for manifest in sorted(manifests, key=lambda manifest: (manifest.type is not own, manifest.id)):
            if manifest.id not in SUBTREE_TAGS[definitions.format]:
                _, most = child_limits(self._reading, manifest.id, manifest.id)
                if most is None or count <= most:
                    yield manifest.id
        if not count:
            own_tree = self._tree.id if self._tree is not None else None
            yield from (id for id in sorted(definitions.by_id) if id != own_tree)

    # --- calls of trees

    def _call_fields(self) -> Iterator[Field]:
        definitions, element = self._reading.definitions, self._element
        id = element.get("ID") or ""
        own_tree = self._tree.id if self._tree is not None else None
        yield self._field(
            "ID",
            "subtree",
            is_required=True,
            about="The tree that the node calls.",
            choices=[tree for tree in sorted(definitions.by_id) if tree != own_tree],
        )
        sharing = ("_autoremap",) if self._format == 4 else ("__shared_blackboard", "__autoremap")
        for name in sharing:
            yield self._field(
                name, "subtree", type="bool", about=SHARING_ATTRIBUTES[name], choices=["true", "false"]
            )
        model = definitions.subtree_models.get(id, {})
        uses = self._uses_in_called_tree(id)
        is_shared = element.get("_autoremap") == "true"
        reserved = {"ID", *NON_KEY_ATTRIBUTES, *SHARING_ATTRIBUTES, *SCRIPT_ATTRIBUTES}
        written = [item.name for item in element.attributes if item.name not in reserved]
        has_braces = self._format == 4 or element.tag != "SubTree"
        choices = [f"{{{key}}}" if has_braces else key for key in self._keys]
        for key in dict.fromkeys([*model, *written, *sorted(uses)]):
            of_key = uses.get(key, [])
            reads, writes = any(use.reads for use in of_key), any(use.writes for use in of_key)
            yield self._field(
                key,
                "subtree",
                direction="inout" if reads is writes else "in" if reads else "out",
                type=next(filter(None, map(self._type_of, of_key)), ""),
                default=model.get(key),
                is_required=key in model and not model[key] and not is_shared,
                choices=choices,
            )

    def _uses_in_called_tree(self, id: str) -> dict[str, list[KeyUse]]:
        """Return the keys of a called tree with their uses. Keys with `@` are keys of the main tree."""
        trees = symbols_of(self._project).trees_called(id, self._reading.source.uri)
        uses: dict[str, list[KeyUse]] = {}
        for tree in trees[:1]:
            for key, found in _keys_of(tree).items():
                if not key.startswith("@"):
                    uses[key] = found
        return uses

    def _type_of(self, use: KeyUse) -> str:
        if use.form in (KeyForm.SCRIPT, KeyForm.ATTRIBUTE, KeyForm.MODEL):
            return ""
        manifest = self._reading.nodes.get(node_id(use.element), self._format)
        port = manifest.ports.get(use.port) if manifest is not None else None
        return type_name(port.type) if port is not None and port.type.strong else ""


def _keys_of(tree: TreeSymbol) -> dict[str, list[KeyUse]]:
    """Return the keys that a tree names, with their uses."""
    keys: dict[str, list[KeyUse]] = {}
    connected = (port.outer for call in tree.calls for port in call.ports.values())
    for use in (*tree.uses, *connected):
        if use is not None:
            keys.setdefault(use.key, []).append(use)
    return keys
