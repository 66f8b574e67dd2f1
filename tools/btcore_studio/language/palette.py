"""List what can be added to the trees of a document: the registered nodes, its models, and its trees."""

from btcore.blackboard.ports import Port
from btcore.registry.manifest import Manifest
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
    """Return what can be added to the trees of a document, sorted by ID: nodes, then trees.

    Args:
        project: The project.
        source: The document.
    """
    reading = read_trees(project, source)
    dialect = reading.definitions.dialect
    nodes = [
        _node_item(manifest)
        for id, manifest in reading.nodes.manifests_of(dialect.format).items()
        if id not in dialect.subtree_tags
    ]
    return Palette([*nodes, *_tree_items(reading)])


def _node_item(manifest: Manifest) -> PaletteItem:
    kind = node_kind(manifest.type)
    return PaletteItem(
        manifest.id,
        kind,
        BUILT_IN if manifest.library == "btcore" else manifest.library,
        manifest.description,
        symbol_path(manifest.id, kind, manifest.spec.symbol),
        [_port(port) for port in manifest.ports.values()],
    )


def _port(port: Port) -> PalettePort:
    return PalettePort(
        port.name, DIRECTIONS[port.direction], type_name(port.type), port.default or "", port.description
    )


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
