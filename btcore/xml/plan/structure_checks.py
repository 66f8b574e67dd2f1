"""Check the structure of trees (known tags, numbers of children, valid names), and list their nodes."""

from btcore.diagnostic_codes import (
    CAPITALISED_ROOT,
    DUPLICATE_MODELS,
    INVALID_NAME,
    MISSING_ID,
    SEVERAL_ASYNC_SEQUENCES,
    TOO_DEEP,
    TOO_LARGE,
    TREE_NAMED_AS_NODE,
    UNKNOWN_NODE,
    UNREACHABLE_CHILD,
    WRONG_CHILD_COUNT,
    DiagnosticCode,
)
from btcore.engine.node_config import MAX_NODES
from btcore.names import forbidden_in, is_reserved
from btcore.status import NodeType
from btcore.xml.define import TreeDefinition
from btcore.xml.plan.node_plan import NodePlan
from btcore.xml.plan.tree_planner import PlanContext
from btcore.xml.read.dialect import EXPLICIT_TAGS, Dialect
from btcore.xml.read.document import Document
from btcore.xml.read.element import Element

_LEAVES = {NodeType.ACTION: "an action", NodeType.CONDITION: "a condition"}


def element_children(element: Element) -> list[Element]:
    """Return the child elements of *element*, without the obsolete `<Root>` of Groot 1."""
    return [child for child in element.children if child.tag != "Root"]


def count_text(count: int) -> str:
    """Return a number of children as text, such as `2 children`."""
    return "no child" if count == 0 else f"{count} children" if count > 1 else "1 child"


def outline_trees(context: PlanContext) -> dict[TreeDefinition, list[NodePlan]]:
    """Check the structure of all trees of the documents, whether they are used or not.

    Returns:
        The nodes of each definition in pre-order, beginning with its `<BehaviorTree>`.
    """
    definitions, dialect = context.definitions, context.dialect
    for document in definitions.sources.documents:
        models = list(document.root.iterchildren("TreeNodesModel"))
        if dialect.explicit_by_id and len(models) > 1:
            message = "second <TreeNodesModel> in the document"
            hint = "move its models into the first <TreeNodesModel>"
            context.found.add(document.diagnostic(DUPLICATE_MODELS, message, models[1], hint=hint))
    tags = _Tags(context)
    return {
        definition: _Outline(context, tags, definition.document).nodes(definition.element)
        for definition in definitions.all
    }


class _Tags:
    """What the outlines of all trees share about tags, each found once."""

    def __init__(self, context: PlanContext) -> None:
        self._context = context
        self.kinds: dict[str, NodeType | None] = {}
        self.leaves: set[str] = set()
        # The files that declare nodes in their TreeNodesModel, by ID; None before the first unknown node.
        self._declared: dict[str | None, str] | None = None

    def add(self, tag: str) -> NodeType | None:
        """Return the node type that limits the children of *tag*; None if *tag* is not the ID of a node."""
        manifest = self._context.palette.get(tag)
        dialect = self._context.dialect
        kind = None
        if manifest is not None and tag not in dialect.subtree_tags and tag not in EXPLICIT_TAGS:
            kind = manifest.type
            needed = dialect.controls_need_children
            may_be_empty = kind is NodeType.CONTROL and needed is not None and tag not in needed
            # UNDEFINED permits any number of children.
            if may_be_empty or (kind in _LEAVES and not dialect.leaves_checked):
                kind = NodeType.UNDEFINED
        self.kinds[tag] = kind
        if kind in _LEAVES:
            self.leaves.add(tag)
        return kind

    def unknown_node_hint(self, node: str) -> str:
        """Return a hint for the unknown *node*."""
        context = self._context
        if not context.found.has_time_for_hint(context.palette.names):
            return ""
        if self._declared is None:
            self._declared = {
                model.get("ID"): document.file
                for document in reversed(context.definitions.sources.documents)
                for models in document.root.iterchildren("TreeNodesModel")
                for model in models.iterchildren(*EXPLICIT_TAGS)
            }
        trees = context.definitions.by_id
        return context.palette.unknown_node_hint(node, trees, self._declared.get(node))


class _Outline:
    """Checks the structure of one tree."""

    def __init__(self, context: PlanContext, tags: _Tags, document: Document) -> None:
        self._dialect: Dialect = context.dialect
        self._palette = context.palette
        self._found = context.found
        self._tags = tags
        self._document = document

    def _error(
        self, code: DiagnosticCode, message: str, element: Element, attribute: str = "", hint: str = ""
    ) -> None:
        self._found.add(self._document.diagnostic(code, message, element, attribute, hint=hint))

    def nodes(self, top: Element) -> list[NodePlan]:
        """Return the nodes of the tree *top* in pre-order, beginning with *top*."""
        limit = self._document.max_depth or self._dialect.max_depth
        closed, ignored_below = self._dialect.closed_tags, self._dialect.ignoring_tags
        ignored: set[NodePlan] = set()
        kinds, leaves = self._tags.kinds, self._tags.leaves
        nodes: list[NodePlan] = []
        pending = [NodePlan(top, 0)]
        while pending:
            node = pending.pop()
            if node not in ignored:
                nodes.append(node)
            if len(nodes) > MAX_NODES + 1:  # the first is the <BehaviorTree>
                message = f"the tree has more than {MAX_NODES:,} nodes"
                self._error(TOO_LARGE, message, top, "ID", hint="nodes are numbered with 16 bits")
                nodes[0].children = []
                return nodes[:1]
            element = node.element
            tag = element.tag
            children = element.children
            if not children and tag in leaves:
                continue
            if children:
                children = element_children(element)
                if len(children) != len(element.children):
                    self._warn_obsolete_root(element)
            kind = kinds[tag] if tag in kinds else self._tags.add(tag)
            if kind is None:
                self._special(tag, element, children)
            elif children or tag not in leaves:
                self._count(tag, kind, element, children)
            if not children:
                continue
            depth = node.depth + 1
            if depth > limit:
                message = f"elements are nested more than {limit:,} deep"
                self._error(TOO_DEEP, message, element, hint="split the tree into subtrees")
            elif tag not in closed:
                below = [NodePlan(child, depth) for child in children]
                pending += reversed(below)
                if tag in ignored_below or node in ignored:
                    ignored.update(below)
                else:
                    node.children = below
        return nodes

    def _warn_obsolete_root(self, element: Element) -> None:
        for child in element.iterchildren("Root"):
            message = "the obsolete <Root> is ignored"
            self._error(CAPITALISED_ROOT, message, child, hint="remove it")

    def _special(self, tag: str, element: Element, children: list[Element]) -> None:
        """Check an element whose tag is not the ID of a node."""
        if tag == "BehaviorTree":
            self._tree(element, children)
        elif tag in self._dialect.subtree_tags:
            self._subtree(tag, element, children)
        elif tag in EXPLICIT_TAGS:
            self._explicit(tag, element, children)
        else:
            self._error(
                UNKNOWN_NODE, f"unknown node <{tag}>", element, hint=self._tags.unknown_node_hint(tag)
            )

    def _explicit(self, tag: str, element: Element, children: list[Element]) -> None:
        node = element.get("ID") or ""
        if not node:
            message = f"the ID of the node is missing in <{tag}>"
            hint = f'write <{tag} ID="…"/>'
            self._error(MISSING_ID, message, element, hint=hint)
            return
        manifest = self._palette.get(node)
        if manifest is None:
            self._error(
                UNKNOWN_NODE, f"unknown node '{node}'", element, "ID", self._tags.unknown_node_hint(node)
            )
            return
        kind = manifest.type if self._dialect.explicit_by_id else EXPLICIT_TAGS[tag]
        self._count(node, kind, element, children)

    def _count(self, node: str, kind: NodeType, element: Element, children: list[Element]) -> None:
        """Add an error if *children* are too few or too many for *node*, which is of *kind*."""
        count = len(children)
        has = count_text(count)
        if kind is NodeType.DECORATOR:
            if count != 1:
                hint = "put them into a <Sequence>" if count else ""
                self._error(
                    WRONG_CHILD_COUNT, f"<{node}> has {has}; a decorator has exactly 1", element, hint=hint
                )
        elif kind is NodeType.CONTROL:
            manifest = self._palette.get(node)
            least = 1 if manifest is None else max(manifest.cls.child_count_at_load[0], 1)
            if count < least:
                message = (
                    f"<{node}> has {has}; {'it' if least > 1 else 'a control node'} needs at least {least}"
                )
                hint = manifest.cls.child_roles if manifest is not None and least > 1 else ""
                self._error(WRONG_CHILD_COUNT, message, element, hint=hint)
            elif node == "ReactiveSequence":
                self._check_asynchronous(children)
        elif count and kind in _LEAVES:
            self._error(WRONG_CHILD_COUNT, f"<{node}> has {has}; {_LEAVES[kind]} has none", element)

    def _check_asynchronous(self, children: list[Element]) -> None:
        # W106 covers other asynchronous children, whose results must be inferred.
        asynchronous = [child for child in children if child.tag == "AsyncSequence"]
        if len(asynchronous) > 1 and self._dialect.explicit_by_id:
            message = "second AsyncSequence in a ReactiveSequence, which can have only one"
            hint = "only one child can be RUNNING at a time"
            self._error(SEVERAL_ASYNC_SEQUENCES, message, asynchronous[1], hint=hint)

    def _tree(self, element: Element, children: list[Element]) -> None:
        name = element.get("ID") or ""
        label = f"the tree '{name}'" if name else "the tree"
        if self._dialect.tree_ids_checked and name:
            self._not_a_node(name, element)
            char = forbidden_in(name)
            if char:
                message = f"invalid tree ID '{name}': {char!r} is not allowed"
                self._error(INVALID_NAME, message, element, "ID", "use letters, digits, '_' and '-'")
            elif is_reserved(name):
                self._error(INVALID_NAME, f"invalid tree ID '{name}': the name is reserved", element, "ID")
        if len(children) != 1:
            message = f"{label} has {count_text(len(children))}; a tree has exactly 1"
            hint = "put them into a <Sequence>" if children else ""
            self._error(WRONG_CHILD_COUNT, message, element, hint=hint)

    def _subtree(self, tag: str, element: Element, children: list[Element]) -> None:
        name = element.get("ID") or ""
        if element.get("ID") is None or (not name and self._dialect.explicit_by_id):
            message = f"the ID of the tree is missing in <{tag}>"
            self._error(MISSING_ID, message, element, hint=f'write <{tag} ID="…"/>')
        elif self._dialect.tree_ids_checked:
            self._not_a_node(name, element)
        if children and tag in self._dialect.ignoring_tags:
            message = f'the children of <{tag} ID="{name}"> are ignored'
            hint = "move them into the <BehaviorTree> that it calls, or remove them"
            self._error(UNREACHABLE_CHILD, message, children[0], hint=hint)
        elif children:
            message = f'<{tag} ID="{name}"> has children; they belong into the <BehaviorTree> that it calls'
            self._error(WRONG_CHILD_COUNT, message, children[0])

    def _not_a_node(self, name: str, element: Element) -> None:
        known = self._palette.get(name)
        if known is not None and not known.is_overridable:
            message = f"invalid tree ID '{name}': a node has this name"
            self._error(TREE_NAMED_AS_NODE, message, element, "ID", "rename the tree")
