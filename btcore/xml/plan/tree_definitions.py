"""The trees that documents define, by ID, and the one that is to be made."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

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
from btcore.xml.read.element import Element
from btcore.xml.read.syntax_errors import EXAMPLE


@dataclass(frozen=True, slots=True, eq=False)
class TreeDefinition:
    """One ``<BehaviorTree>``."""

    id: str
    document: Document
    element: Element


def select_dialect(
    documents: list[Document], format: int | None, diagnostics: DiagnosticCollector
) -> Dialect:
    """The dialect that the last (the including) document asks for, unless *format* says another."""
    if format is not None:
        return DIALECTS[format]
    document = documents[-1]
    written = document.root.get("BTCPP_format")
    known = parse_format(written)
    if known is None:
        message = f"BTCPP_format '{written}' is not known"
        hint = 'write BTCPP_format="4", or "3" for a tree of Groot 1'
        diagnostics.add(
            document.diagnostic(UNKNOWN_FORMAT, message, document.root, "BTCPP_format", hint=hint)
        )
    return DIALECTS[known or 4]


class TreeDefinitions:
    """The definitions of *documents*, one an ID, and all of them in order."""

    def __init__(self, documents: list[Document], dialect: Dialect, diagnostics: DiagnosticCollector) -> None:
        self.documents = documents
        self.dialect = dialect
        self.all: list[TreeDefinition] = []
        self.by_id: dict[str, TreeDefinition] = {}
        # Of a document that could not be read in whole nobody can say which trees are missing.
        self.complete = not diagnostics.errors
        unnamed = 0
        for document in documents:
            root = document.root
            if root.tag != "root":
                message = f"the outermost element is <{root.tag}>, not <root>"
                hint = EXAMPLE
                if str(root.tag).lower() == "root":
                    hint = "did you mean <root>? XML tells capital letters from small ones"
                diagnostics.add(document.diagnostic(NOT_A_ROOT, message, root, hint=hint))
                continue
            only_child = len(root.children) == 1
            for element in root.iterchildren("BehaviorTree"):
                written = element.get("ID")
                if written is None and not only_child and dialect.tree_ids_checked:
                    message = "this <BehaviorTree> has no ID"
                    hint = 'name it: <BehaviorTree ID="…">'
                    diagnostics.add(document.diagnostic(TREE_WITHOUT_ID, message, element, hint=hint))
                name = written or ""
                if not name:
                    name = f"BehaviorTree_{unnamed}"
                    unnamed += 1
                self._define(TreeDefinition(name, document, element), diagnostics)

    def _define(self, definition: TreeDefinition, diagnostics: DiagnosticCollector) -> None:
        self.all.append(definition)
        earlier = self.by_id.get(definition.id)
        if earlier is None:
            self.by_id[definition.id] = definition
            return
        place = earlier.document.span(earlier.element, "ID")
        where = f"{earlier.document.file or '<text>'}:{place.line}" if place else earlier.document.file
        if self.dialect.last_tree_wins:
            self.by_id[definition.id] = definition
            message = f"there are two trees '{definition.id}'; this one replaces that of {where}"
        else:
            message = f"there are two trees '{definition.id}'; that of {where} is used, not this one"
        hint = "rename or remove one of them"
        diagnostics.add(
            definition.document.diagnostic(DUPLICATE_TREE_ID, message, definition.element, "ID", hint=hint)
        )

    def select_main(self, asked: str | None, diagnostics: DiagnosticCollector) -> TreeDefinition | None:
        """The tree that is to be made: the one *asked* for, the document's main tree, or its only one."""
        document = self.documents[-1]
        if asked is not None:
            if asked not in self.by_id and self.complete:
                hint = self.suggestion(asked)
                message = f"no tree is called '{asked}'"
                diagnostics.add(document.diagnostic(AMBIGUOUS_MAIN_TREE, message, document.root, hint=hint))
            return self.by_id.get(asked)
        written = document.root.get("main_tree_to_execute")
        if written is not None:
            if written not in self.by_id and self.complete:
                message = f"main_tree_to_execute names the tree '{written}', which is not there"
                hint = self.suggestion(written)
                diagnostics.add(
                    document.diagnostic(
                        AMBIGUOUS_MAIN_TREE, message, document.root, "main_tree_to_execute", hint=hint
                    )
                )
            return self.by_id.get(written)
        own = [one for one in self.all if one.document is document]
        for only in (own, list(self.by_id.values())):
            if len(only) == 1:
                return self.by_id[only[0].id]
        if not self.complete:
            return None
        if not self.all:
            message = "there is no <BehaviorTree> in the document"
            hint = EXAMPLE
        else:
            message = "several trees, and none is named as the main one"
            names = join_names(sorted(self.by_id), "or")
            hint = f'write main_tree_to_execute="…" into <root>, or name one when loading: {names}'
        diagnostics.add(document.diagnostic(AMBIGUOUS_MAIN_TREE, message, document.root, hint=hint))
        return None

    def suggestion(self, name: str) -> str:
        """A hint for a tree *name* that is not there."""
        return tree_hint(name, self.by_id)


def tree_hint(name: str, known: Mapping[str, object] | Iterable[str]) -> str:
    """Which of the *known* trees the writer of *name* may have meant."""
    names = sorted(known)
    near = nearest_name(name, names)
    if near is not None:
        return f"did you mean '{near}'?"
    return f"the trees are: {join_names(names)}" if names else "no tree has an ID"
