"""List what can be added to the trees of a document: the registered nodes, its models, and its trees."""

from btcore.blackboard.ports import Port
from btcore.registry.manifest import Manifest
from btcore.registry.nodes_without_code import is_mock
from btcore.values import ANY
from btcore.xml.models.model_file import model_elements
from btcore.xml.read.element import Element
from btcore.xml.read.tags import PORT_TAGS, SUBTREE_TAGS
from btcore_drawing.symbols import symbol_path
from btcore_studio.language.descriptions import type_name
from btcore_studio.language.drawing import node_kind
from btcore_studio.language.element_texts import DIRECTIONS
from btcore_studio.language.project import Project, SourceDocument
from btcore_studio.language.studio_protocol import Palette, PaletteItem, PalettePort
from btcore_studio.language.tree_reading import TreeReading, read_trees

BUILT_IN = "BehaviorTree.CPP"
"""The group of the built-in nodes."""


def palette_of(project: Project, source: SourceDocument) -> Palette:
    """Return what can be added to the trees of a document, sorted by ID: nodes, then trees."""
    reading = read_trees(project, source)
    format = reading.definitions.format
    models = {model.get("ID"): model for model in reversed(model_elements(reading.document))}
    nodes = [
        _node_item(reading, manifest, models.get(id))
        for id, manifest in reading.nodes.manifests_of(format).items()
        if id not in SUBTREE_TAGS[format]
    ]
    return Palette([*nodes, *_tree_items(reading)])


def _node_item(reading: TreeReading, manifest: Manifest, model: Element | None) -> PaletteItem:
    kind = node_kind(manifest.type)
    is_modelled = model is not None and is_mock(manifest.cls)
    ports = [_port(port) for port in manifest.ports.values()]
    return PaletteItem(
        manifest.id,
        kind,
        BUILT_IN if manifest.library == "btcore" else manifest.library,
        manifest.description,
        symbol_path(manifest.id, kind, manifest.spec.symbol),
        _written_ports(reading, model) if model is not None and is_modelled else ports,
        is_modelled or not reading.knows(manifest.id),
    )


def _port(port: Port) -> PalettePort:
    its_type = "" if port.type is ANY else type_name(port.type)
    return PalettePort(port.name, DIRECTIONS[port.direction], its_type, port.default or "", port.description)


def _written_ports(reading: TreeReading, model: Element) -> list[PalettePort]:
    """Return the ports in a model of the document."""
    text_in = reading.document.source_map.text_in
    return [
        PalettePort(
            port.get("name") or "",
            DIRECTIONS[PORT_TAGS[port.tag]],
            port.get("type") or "",
            port.get("default") or "",
            " ".join((port.get("description") or text_in(port)).split()),
        )
        for port in model.iterchildren(*PORT_TAGS)
    ]


def _tree_items(reading: TreeReading) -> list[PaletteItem]:
    definitions = reading.definitions
    items: list[PaletteItem] = []
    for id, tree in sorted(definitions.by_id.items()):
        ports = [
            PalettePort(name, "inout", "", default or "", "")
            for name, default in definitions.subtree_models.get(id, {}).items()
        ]
        source = reading.files[tree.document]
        group = source.path.name if source.path is not None else source.uri
        about = tree.element.get("_description") or ""
        items.append(PaletteItem(id, "subtree", group, about, symbol_path("SubTree", "subtree"), ports))
    return items
