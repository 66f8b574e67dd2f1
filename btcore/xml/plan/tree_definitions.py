"""The trees that documents define, by ID, and the selection of the main tree."""

from collections.abc import Collection, Iterable
from typing import NamedTuple

from btcore.diagnostic_codes import (
    AMBIGUOUS_MAIN_TREE,
    DUPLICATE_TREE_ID,
    NOT_A_ROOT,
    TREE_WITHOUT_ID,
    UNKNOWN_FORMAT,
)
from btcore.suggestions import join_names, nearest_name
from btcore.xml.read.diagnostics import DiagnosticCollector
from btcore.xml.read.dialect import DIALECTS, Dialect, parse_format
from btcore.xml.read.document import Document
from btcore.xml.read.element import EXAMPLE, Element


class TreeDefinition(NamedTuple):
    """A `<BehaviorTree>` element with its ID and its document."""

    id: str
    document: Document
    element: Element


def select_dialect(
    documents: list[Document], format: int | None, diagnostics: DiagnosticCollector
) -> Dialect:
    """Return the rules of the XML format of the last document, which includes the other documents.

    Args:
        documents: All documents, included documents first.
        format: 3 or 4, overriding the document's `BTCPP_format`.
        diagnostics: Collects an error if the format is unknown.
    """
    if format is not None:
        return DIALECTS[format]
    document = documents[-1]
    written = document.root.get("BTCPP_format")
    known = parse_format(written)
    if known is None:
        message = f"unknown BTCPP_format '{written}'"
        hint = 'write BTCPP_format="4", or "3" for a tree of Groot 1'
        diagnostics.add(
            document.diagnostic(UNKNOWN_FORMAT, message, document.root, "BTCPP_format", hint=hint)
        )
    return DIALECTS[known or 4]


class TreeDefinitions:
    """The tree definitions of documents: *all* in order, and *by_id* without unused duplicates.

    A tree in *libraries*, which are some of the documents, is replaced by a later tree with the same ID.
    """

    def __init__(
        self,
        documents: list[Document],
        dialect: Dialect,
        diagnostics: DiagnosticCollector,
        libraries: Collection[Document] = (),
    ) -> None:
        self.documents = documents
        self._libraries = libraries
        self.dialect = dialect
        self.all: list[TreeDefinition] = []
        self.by_id: dict[str, TreeDefinition] = {}
        # If a document could not be read or included, it may define the missing trees: don't report them.
        self.complete = not diagnostics.errors
        unnamed = 0
        for document in documents:
            root = document.root
            if root.tag != "root":
                message = f"the outermost element is <{root.tag}>, not <root>"
                hint = EXAMPLE
                if str(root.tag).lower() == "root":
                    hint = "did you mean <root>? XML is case-sensitive"
                diagnostics.add(document.diagnostic(NOT_A_ROOT, message, root, hint=hint))
                continue
            only_child = len(root.children) == 1
            for element in root.iterchildren("BehaviorTree"):
                written = element.get("ID")
                if not written and not only_child and dialect.tree_ids_checked:
                    message = "missing ID of the <BehaviorTree>"
                    hint = 'write <BehaviorTree ID="…">'
                    diagnostics.add(document.diagnostic(TREE_WITHOUT_ID, message, element, hint=hint))
                name = written
                if name is None:
                    # The name that BehaviorTree.CPP gives to a tree without an ID. An empty ID remains empty.
                    name = f"BehaviorTree_{unnamed}"
                    unnamed += 1
                self._define(TreeDefinition(name, document, element), diagnostics)

    def _define(self, definition: TreeDefinition, diagnostics: DiagnosticCollector) -> None:
        self.all.append(definition)
        earlier = self.by_id.get(definition.id)
        if earlier is None:
            self.by_id[definition.id] = definition
            return
        place = earlier.document.source_map.span(earlier.element, "ID")
        where = f"{earlier.document.file or '<text>'}:{place.line}" if place else earlier.document.file
        if self.dialect.last_tree_wins or earlier.document in self._libraries:
            self.by_id[definition.id] = definition
            message = f"duplicate tree '{definition.id}': it replaces the tree at {where}"
        else:
            message = f"duplicate tree '{definition.id}': it is ignored, the tree at {where} is used"
        hint = "rename or remove one of the two trees"
        diagnostics.add(
            definition.document.diagnostic(DUPLICATE_TREE_ID, message, definition.element, "ID", hint=hint)
        )

    def select_main(self, requested: str | None, diagnostics: DiagnosticCollector) -> TreeDefinition | None:
        """Return the tree to build: *requested*, or the document's main tree or only tree; None on error.

        Args:
            requested: ID of a tree, or None.
            diagnostics: Collects an error if the tree is missing or ambiguous.
        """
        document = self.documents[-1]
        if requested is not None:
            if requested not in self.by_id and self.complete:
                hint = tree_hint(requested, self.by_id)
                if not hint.startswith("did you mean"):
                    hint = f"--tree, or tree=… in Python, takes the ID of a <BehaviorTree>; {hint}"
                message = f"unknown main tree '{requested}'"
                diagnostics.add(document.diagnostic(AMBIGUOUS_MAIN_TREE, message, document.root, hint=hint))
            return self.by_id.get(requested)
        written = document.root.get("main_tree_to_execute")
        if written is not None:
            if written not in self.by_id and self.complete:
                message = f"unknown main tree '{written}' in main_tree_to_execute"
                hint = tree_hint(written, self.by_id)
                diagnostics.add(
                    document.diagnostic(
                        AMBIGUOUS_MAIN_TREE, message, document.root, "main_tree_to_execute", hint=hint
                    )
                )
            return self.by_id.get(written)
        # Trees of the document itself take precedence over included trees.
        own = [definition for definition in self.all if definition.document is document]
        for candidates in (own, list(self.by_id.values())):
            if len(candidates) == 1:
                return self.by_id[candidates[0].id]
        if not self.complete:
            return None
        if not self.all:
            message = "missing <BehaviorTree>: the document has no tree"
            hint = EXAMPLE
        else:
            message = "ambiguous main tree: the document has several trees"
            names = join_names(sorted(self.by_id), "or")
            hint = f'write main_tree_to_execute="…" in <root>, or select a tree when loading: {names}'
        diagnostics.add(document.diagnostic(AMBIGUOUS_MAIN_TREE, message, document.root, hint=hint))
        return None


def tree_hint(name: str, known: Iterable[str]) -> str:
    """Return a hint for an unknown tree.

    Args:
        name: The unknown ID.
        known: The IDs of the known trees.
    """
    names = sorted(known)
    near = nearest_name(name, names)
    if near is not None:
        return f"did you mean '{near}'?"
    return f"the trees are: {join_names(names)}" if names else "no tree has an ID"
