"""Find the trees that documents define, the main tree among them, and the models of subtrees.

This is the second stage of loading.
"""

from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple

from btcore.diagnostic_codes import (
    DUPLICATE_MODELS,
    DUPLICATE_TREE_ID,
    INVALID_NAME,
    MISSING_ID,
    NOT_A_ROOT,
    TREE_TOO_LARGE,
    TREE_WITHOUT_ID,
    UNDETERMINED_MAIN_TREE,
    UNKNOWN_FORMAT,
)
from btcore.diagnostics import HintAndFixes
from btcore.fixes import NameTree, Rename, SetFormat
from btcore.names import model_port_name_error
from btcore.suggestions import join_names, nearest_name, suggestion
from btcore.xml.read.document import CollectedDiagnostics, DiagnosticCollector, Document
from btcore.xml.read.element import EXAMPLE, Element
from btcore.xml.read.read import Sources
from btcore.xml.read.tags import PORT_TAGS

MAX_MODEL_PORTS: Final = 1_000
"""Maximum number of ports in the model of a subtree."""


def parse_format(written: str | None) -> int | None:
    """Return the format (3 or 4) that the attribute `BTCPP_format` names, or None if it is unknown.

    A document without the attribute has format 3, as Groot 1 writes it.
    """
    if written is None:
        return 3
    return {"3": 3, "4": 4}.get(written.strip())


class TreeDefinition(NamedTuple):
    """A `<BehaviorTree>` element with its ID and its document."""

    id: str
    document: Document
    element: Element


class Definitions(NamedTuple):
    """The trees that documents define.

    Attributes:
        sources: The documents.
        format: The format of the main document, 3 or 4, whose rules apply to all documents.
        is_format_assumed: Whether the main document is read as format 3, because no format is stated.
        requested_tree: The ID of the main tree, if it was requested.
        all: The definitions in the order of the documents.
        by_id: The definitions without unused duplicates.
        main_tree: The main tree; None if it is missing or ambiguous.
        subtree_models: For each tree that a model declares, the names of its ports with their defaults; None
            means a required port.
        are_complete: Whether all documents could be read, in a known format; else a missing tree is no error.
        diagnostics: What was found in this stage and before.
    """

    sources: Sources
    format: int
    is_format_assumed: bool
    requested_tree: str | None
    all: tuple[TreeDefinition, ...]
    by_id: Mapping[str, TreeDefinition]
    main_tree: TreeDefinition | None
    subtree_models: Mapping[str, Mapping[str, str | None]]
    are_complete: bool
    diagnostics: CollectedDiagnostics


def define(sources: Sources, tree_id: str | None = None, format: int | None = None) -> Definitions:
    """Return the trees that documents define.

    Args:
        tree_id: The ID of the main tree; by default the main document determines it.
        format: 3 or 4, overriding the main document's `BTCPP_format`.
    """
    collector = DiagnosticCollector(sources.diagnostics)
    main_document = sources.main_document
    written = main_document.root.get("BTCPP_format")
    is_format_assumed = format is None and written is None
    if format is None:
        format = parse_format(written)
        if format is None:
            message = f"unknown BTCPP_format '{written}'"
            hint = 'write BTCPP_format="4", or "3" for a tree of Groot 1'
            collector.report(
                main_document, UNKNOWN_FORMAT, message, main_document.root, attribute="BTCPP_format",
                hint=hint, fixes=[SetFormat(4), SetFormat(3)],
            )  # fmt: skip
    format = format or 4
    are_complete = not collector.errors
    definitions: list[TreeDefinition] = []
    by_id: dict[str, TreeDefinition] = {}
    unnamed = 0
    for document in sources.documents:
        root = document.root
        if root.tag != "root":
            message = f"the outermost element is <{root.tag}>, not <root>"
            is_capitalised = root.tag.lower() == "root"
            hint = f"{suggestion('<root>')} XML is case-sensitive" if is_capitalised else EXAMPLE
            fixes = [Rename("root", is_safe=True)] if is_capitalised else []
            collector.report(document, NOT_A_ROOT, message, root, hint=hint, fixes=fixes)
            continue
        only_child = len(root.children) == 1
        for element in root.iterchildren("BehaviorTree"):
            id = element.get("ID")
            if not id and not only_child and format == 4:
                message = "missing ID of the <BehaviorTree>"
                hint = 'write <BehaviorTree ID="…">'
                collector.report(document, TREE_WITHOUT_ID, message, element, hint=hint, fixes=[NameTree()])
            if id is None:
                # The ID that BehaviorTree.CPP gives to a tree without an ID. An empty ID remains empty.
                id = f"BehaviorTree_{unnamed}"
                unnamed += 1
            definition = TreeDefinition(id, document, element)
            definitions.append(definition)
            earlier = by_id.setdefault(id, definition)
            if earlier is not definition:
                # In format 3 the first of several trees with the same ID is used.
                replaces = format == 4 or earlier.document in sources.shared_documents
                if replaces:
                    by_id[id] = definition
                _warn_duplicate(definition, earlier, replaces, collector)
    main = None
    if main_document.root.tag == "root":
        main = _find_main(main_document, tree_id, definitions, by_id, are_complete, collector)
    models = _read_subtree_models(sources.documents, format, collector)
    return Definitions(
        sources=sources,
        format=format,
        is_format_assumed=is_format_assumed,
        requested_tree=tree_id,
        all=tuple(definitions),
        by_id=by_id,
        main_tree=main,
        subtree_models=models,
        are_complete=are_complete,
        diagnostics=collector.diagnostics,
    )


def _warn_duplicate(
    definition: TreeDefinition, earlier: TreeDefinition, replaces: bool, collector: DiagnosticCollector
) -> None:
    id, document, element = definition
    place = earlier.document.source_map.span(earlier.element, "ID")
    where = f"{earlier.document.file or '<text>'}:{place.line}"
    effect = f"it replaces the tree at {where}" if replaces else f"it is ignored, the tree at {where} is used"
    message, hint = f"duplicate tree '{id}': {effect}", "rename or remove one of the two trees"
    collector.report(document, DUPLICATE_TREE_ID, message, element, attribute="ID", hint=hint)


def _find_main(
    document: Document,
    requested: str | None,
    definitions: list[TreeDefinition],
    by_id: Mapping[str, TreeDefinition],
    are_complete: bool,
    collector: DiagnosticCollector,
) -> TreeDefinition | None:
    """Return the main tree: *requested*, or the document's main tree or only tree; None on error."""
    root = document.root
    if requested is not None:
        if requested not in by_id and are_complete:
            message = f"unknown main tree '{requested}'"
            hint, fixes = tree_hint(requested, by_id)
            if not fixes:
                hint = f"--tree, or tree=… in Python, takes the ID of a <BehaviorTree>; {hint}"
            # Without the fix, which would change the marked root.
            collector.report(document, UNDETERMINED_MAIN_TREE, message, root, hint=hint)
        return by_id.get(requested)
    attribute = "main_tree_to_execute"
    written = root.get(attribute)
    if written is not None:
        if written not in by_id and are_complete:
            message = f"unknown main tree '{written}' in {attribute}"
            hint, fixes = tree_hint(written, by_id)
            collector.report(
                document, UNDETERMINED_MAIN_TREE, message, root, attribute=attribute, hint=hint, fixes=fixes
            )
        return by_id.get(written)
    # Trees of the document itself take precedence over included trees.
    own = [definition for definition in definitions if definition.document is document]
    for candidates in (own, list(by_id.values())):
        if len(candidates) == 1:
            return by_id[candidates[0].id]
    if not are_complete:
        return None
    if not definitions:
        message, hint = "missing <BehaviorTree>: the document has no tree", EXAMPLE
    else:
        message = "ambiguous main tree: the document has several trees"
        names = join_names(sorted(by_id), "or")
        hint = f'write {attribute}="…" in <root>, or select a tree when loading: {names}'
    collector.report(document, UNDETERMINED_MAIN_TREE, message, root, hint=hint)
    return None


def tree_hint(name: str, known: Iterable[str]) -> HintAndFixes:
    """Return the hint and fixes for an unknown tree *name*, given the IDs of the known trees."""
    names = sorted(known)
    near = nearest_name(name, names)
    if near is not None:
        return HintAndFixes.similar_name(near)
    return HintAndFixes(f"the trees are: {join_names(names)}" if names else "no tree has an ID")


def _read_subtree_models(
    documents: Iterable[Document], format: int, collector: DiagnosticCollector
) -> dict[str, dict[str, str | None]]:
    """Return the ports that subtree models declare. Models of other nodes are ignored."""
    models_by_id: dict[str, dict[str, str | None]] = {}
    for document in documents:
        sections = list(document.root.iterchildren("TreeNodesModel"))
        if format == 4 and len(sections) > 1:
            message = "second <TreeNodesModel> in the document"
            hint = "move its models into the first <TreeNodesModel>"
            collector.report(document, DUPLICATE_MODELS, message, sections[1], hint=hint)
        for section in sections:
            for model in section.iterchildren("SubTree"):
                id = model.get("ID")
                if id is None:
                    message = "missing ID in the model of a subtree"
                    hint = 'write <SubTree ID="…">'
                    collector.report(document, MISSING_ID, message, model, hint=hint)
                    continue
                ports = models_by_id.setdefault(id, {})
                for port in model.iterchildren(*PORT_TAGS):
                    if len(ports) >= MAX_MODEL_PORTS:
                        # Every call of the tree has all ports: a short document could fill the memory.
                        message = f"the model of '{id}' has more than {MAX_MODEL_PORTS:,} ports"
                        collector.report(document, TREE_TOO_LARGE, message, model, attribute="ID")
                        break
                    _add_model_port(document, port, ports, format, collector)
    return models_by_id


def _add_model_port(
    document: Document,
    port: Element,
    ports: dict[str, str | None],
    format: int,
    collector: DiagnosticCollector,
) -> None:
    name = port.get("name")
    if name is None:
        message = f"missing name of the <{port.tag}>"
        collector.report(document, MISSING_ID, message, port, hint=f'write <{port.tag} name="…"/>')
        return
    error = model_port_name_error(name) if format == 4 else ""
    if error:
        message = f"invalid port name '{name}' in the model of a subtree: {error}"
        collector.report(document, INVALID_NAME, message, port, attribute="name")
    ports[name] = port.get("default")
