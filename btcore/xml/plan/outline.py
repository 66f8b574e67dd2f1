"""The first pass of planning: create the plans of nodes, and check the structure of their trees.

The cache of tags only saves time: without it the plans are the same.
"""

from itertools import islice
from typing import Final

from btcore.diagnostic_codes import (
    CAPITALISED_ROOT,
    DUPLICATE_MODELS,
    INVALID_NAME,
    MISSING_ID,
    SEVERAL_ASYNC_SEQUENCES,
    TOO_DEEP,
    TREE_NAMED_AS_NODE,
    TREE_TOO_LARGE,
    UNKNOWN_NODE,
    UNREACHABLE_CHILD,
    WRONG_CHILD_COUNT,
    DiagnosticCode,
)
from btcore.diagnostics import Hint
from btcore.engine.node_config import MAX_NODES
from btcore.fixes import AddChildren, Fix, Remove, RemoveChildren, SetAttributes, WrapChildren
from btcore.names import FORBIDDEN, RESERVED_IDS, forbidden_in
from btcore.status import NodeType
from btcore.xml.define import TreeDefinition
from btcore.xml.plan.tree_plan import NodePlan, PlanContext
from btcore.xml.read.dialect import EXPLICIT_TAGS, Dialect
from btcore.xml.read.element import Element
from btcore.xml.read.read import Document

MAX_SUGGESTED_TREES: Final = 20
"""Maximum number of trees that are suggested for a SubTree element without an ID."""
_LEAVES: Final = {NodeType.ACTION: "an action", NodeType.CONDITION: "a condition"}


def element_children(element: Element) -> list[Element]:
    """Return the child elements of *element*, without the obsolete `<Root>` of Groot 1."""
    return [child for child in element.children if child.tag != "Root"]


def count_text(count: int) -> str:
    """Return a number of children as text, such as `2 children`."""
    return "no child" if count == 0 else f"{count} children" if count > 1 else "1 child"


def _one_child_hint(count: int) -> Hint:
    if not count:
        return Hint("", (AddChildren(1),))
    return Hint("put them into a <Sequence>", wrapping_fixes(1))


def wrapping_fixes(most: int) -> tuple[Fix, ...]:
    """Return the fixes that put the last children into a control node, so that *most* are left.

    Args:
        most: The maximum number of children.
    """
    return tuple(WrapChildren(tag, most - 1) for tag in ("Sequence", "Fallback"))


def outline_trees(context: PlanContext) -> dict[TreeDefinition, list[NodePlan]]:
    """Create the node plans of all trees of the documents, used or not, and check their structure.

    Returns:
        The node plans of each definition in pre-order, beginning with the root; [] if there is no root.
    """
    definitions, dialect = context.definitions, context.dialect
    for document in definitions.sources.documents:
        models = list(document.root.iterchildren("TreeNodesModel"))
        if dialect.format == 4 and len(models) > 1:
            message = "second <TreeNodesModel> in the document"
            hint = "move its models into the first <TreeNodesModel>"
            context.collector.add(document.diagnostic(DUPLICATE_MODELS, message, models[1], hint=hint))
    tag_cache = _TagCache(context)
    return {
        definition: _TreeOutliner(context, tag_cache, definition.document).outline(definition.element)
        for definition in definitions.all
    }


class _TagCache:
    """The node types of the tags of all trees.

    Attributes:
        node_types: The types of the tags that `classify` was called with.
        leaf_tags: Those of them that have no children.
    """

    def __init__(self, context: PlanContext) -> None:
        self._context = context
        self.node_types: dict[str, NodeType | None] = {}
        self.leaf_tags: set[str] = set()

    def classify(self, tag: str) -> NodeType | None:
        """Find the node type that limits the children of *tag*; None if the tag alone does not tell it."""
        manifest = self._context.manifest(tag)
        dialect = self._context.dialect
        node_type = None
        if manifest is not None and tag not in dialect.subtree_tags and tag not in EXPLICIT_TAGS:
            node_type = manifest.type
            needed = dialect.controls_requiring_children
            may_be_empty = node_type is NodeType.CONTROL and needed is not None and tag not in needed
            # UNDEFINED permits any number of children.
            if may_be_empty or (node_type in _LEAVES and not dialect.checks_leaf_children):
                node_type = NodeType.UNDEFINED
        self.node_types[tag] = node_type
        if node_type in _LEAVES:
            self.leaf_tags.add(tag)
        return node_type


class _TreeOutliner:
    """Creates the node plans of one tree, without ports, and checks their structure."""

    def __init__(self, context: PlanContext, tag_cache: _TagCache, document: Document) -> None:
        self._dialect: Dialect = context.dialect
        self._context = context
        self._collector = context.collector
        self._tag_cache = tag_cache
        self._document = document
        self._own_id: str | None = None

    def _report(
        self, code: DiagnosticCode, message: str, element: Element, attribute: str = "", hint: str | Hint = ""
    ) -> None:
        self._collector.add(self._document.diagnostic(code, message, element, attribute, hint=hint))

    def outline(self, top: Element) -> list[NodePlan]:
        """Return the node plans below the `<BehaviorTree>` *top*, in pre-order."""
        self._own_id = top.get("ID")
        dialect = self._dialect
        limit = self._document.max_depth
        ignored: set[NodePlan] = set()
        node_types, leaf_tags = self._tag_cache.node_types, self._tag_cache.leaf_tags
        nodes: list[NodePlan] = []
        pending = [NodePlan(top, 0)]
        while pending:
            node = pending.pop()
            if node not in ignored:
                nodes.append(node)
            if len(nodes) > MAX_NODES + 1:  # the first is the <BehaviorTree>
                message = f"the tree has more than {MAX_NODES:,} nodes"
                self._report(TREE_TOO_LARGE, message, top, "ID", hint="nodes are numbered with 16 bits")
                return []
            element = node.element
            tag = element.tag
            children = element.children
            if not children and tag in leaf_tags:
                continue
            if children:
                children = element_children(element)
                if len(children) != len(element.children):
                    for child in element.iterchildren("Root"):
                        hint = Hint("remove it", (Remove(is_safe=True),))
                        self._report(CAPITALISED_ROOT, "the obsolete <Root> is ignored", child, hint=hint)
            node_type = node_types[tag] if tag in node_types else self._tag_cache.classify(tag)
            if node_type is None:
                self._check_other_tag(tag, element, children)
            elif children or tag not in leaf_tags:
                self._check_child_count(tag, node_type, element, children)
            if not children:
                continue
            depth = node.depth + 1
            if depth > limit:
                message = f"elements are nested more than {limit:,} deep"
                self._report(TOO_DEEP, message, element, hint="split the tree into subtrees")
            elif tag not in dialect.tags_with_unchecked_children:
                child_nodes = [NodePlan(child, depth) for child in children]
                pending += reversed(child_nodes)
                if tag in dialect.tags_with_ignored_children or node in ignored:
                    ignored.update(child_nodes)
                else:
                    node.children = child_nodes
        # A tree has one root: further roots are an error, reported above, and left out.
        further_roots = nodes[0].children[1:]
        return nodes[1 : nodes.index(further_roots[0])] if further_roots else nodes[1:]

    def _check_other_tag(self, tag: str, element: Element, children: list[Element]) -> None:
        if tag == "BehaviorTree":
            self._check_tree(element, children)
        elif tag in self._dialect.subtree_tags:
            self._check_call(tag, element, children)
        elif tag in EXPLICIT_TAGS:
            self._check_explicit(tag, element, children)
        else:
            hint = self._context.unknown_node_hint(tag)
            self._report(UNKNOWN_NODE, f"unknown node <{tag}>", element, hint=hint)

    def _check_explicit(self, tag: str, element: Element, children: list[Element]) -> None:
        id = element.get("ID") or ""
        if not id:
            message = f"the ID of the node is missing in <{tag}>"
            self._report(MISSING_ID, message, element, hint=f'write <{tag} ID="…"/>')
            return
        manifest = self._context.manifest(id)
        if manifest is None:
            hint = self._context.unknown_node_hint(id)
            self._report(UNKNOWN_NODE, f"unknown node '{id}'", element, "ID", hint)
            return
        node_type = manifest.type if self._dialect.type_from_id else EXPLICIT_TAGS[tag]
        self._check_child_count(id, node_type, element, children)

    def _check_child_count(
        self, id: str, node_type: NodeType, element: Element, children: list[Element]
    ) -> None:
        count = len(children)
        has = count_text(count)
        if node_type is NodeType.DECORATOR:
            if count != 1:
                self._report(
                    WRONG_CHILD_COUNT,
                    f"<{id}> has {has}; a decorator has exactly 1",
                    element,
                    hint=_one_child_hint(count),
                )
        elif node_type is NodeType.CONTROL:
            manifest = self._context.manifest(id)
            least = 1 if manifest is None else max(manifest.spec.child_count_at_load[0], 1)
            if count < least:
                message = (
                    f"<{id}> has {has}; {'it' if least > 1 else 'a control node'} needs at least {least}"
                )
                roles, needed = "", least
                if manifest is not None:
                    from btcore.registry.mock_nodes import is_mock  # only errors need it

                    roles = manifest.spec.child_roles if least > 1 else ""
                    # More children may be needed at the first tick than to load the tree.
                    needed = least if is_mock(manifest.cls) else max(least, manifest.spec.child_count[0])
                hint = Hint(roles, (AddChildren(needed - count),))
                self._report(WRONG_CHILD_COUNT, message, element, hint=hint)
            elif id == "ReactiveSequence":  # as BehaviorTree.CPP's parser, which knows this name only
                self._check_asynchronous(children)
        elif count and node_type in _LEAVES:
            message = f"<{id}> has {has}; {_LEAVES[node_type]} has none"
            self._report(WRONG_CHILD_COUNT, message, element, hint=Hint("", (RemoveChildren(),)))

    def _check_asynchronous(self, children: list[Element]) -> None:
        # W106 covers other asynchronous children, whose results must be inferred.
        asynchronous = [child for child in children if child.tag == "AsyncSequence"]
        if len(asynchronous) > 1 and self._dialect.format == 4:
            message = "second AsyncSequence in a ReactiveSequence, which can have only one"
            hint = "only one child can be RUNNING at a time"
            self._report(SEVERAL_ASYNC_SEQUENCES, message, asynchronous[1], hint=hint)

    def _check_tree(self, element: Element, children: list[Element]) -> None:
        id = element.get("ID") or ""
        label = f"the tree '{id}'" if id else "the tree"
        if self._dialect.checks_names and id:
            self._check_not_a_node(id, element)
            if not FORBIDDEN.isdisjoint(id):
                message = f"invalid tree ID '{id}': {forbidden_in(id)!r} is not allowed"
                self._report(INVALID_NAME, message, element, "ID", "use letters, digits, '_' and '-'")
            elif id in RESERVED_IDS:
                self._report(INVALID_NAME, f"invalid tree ID '{id}': the name is reserved", element, "ID")
        if len(children) != 1:
            message = f"{label} has {count_text(len(children))}; a tree has exactly 1"
            self._report(WRONG_CHILD_COUNT, message, element, hint=_one_child_hint(len(children)))

    def _check_call(self, tag: str, element: Element, children: list[Element]) -> None:
        id = element.get("ID") or ""
        if element.get("ID") is None or (not id and self._dialect.format == 4):
            message = f"the ID of the tree is missing in <{tag}>"
            others = (tree_id for tree_id in self._context.definitions.by_id if tree_id != self._own_id)
            fixes = [SetAttributes({"ID": other}) for other in islice(others, MAX_SUGGESTED_TREES)]
            self._report(MISSING_ID, message, element, hint=Hint(f'write <{tag} ID="…"/>', tuple(fixes)))
        elif self._dialect.checks_names:
            self._check_not_a_node(id, element)
        if children and tag in self._dialect.tags_with_ignored_children:
            message = f'the children of <{tag} ID="{id}"> are ignored'
            hint = "move them into the <BehaviorTree> that it calls, or remove them"
            self._report(UNREACHABLE_CHILD, message, children[0], hint=hint)
        elif children:
            message = f'<{tag} ID="{id}"> has children; they belong into the <BehaviorTree> that it calls'
            self._report(WRONG_CHILD_COUNT, message, element, hint=Hint("", (RemoveChildren(),)))

    def _check_not_a_node(self, id: str, element: Element) -> None:
        known = self._context.manifest(id)
        if known is not None and not known.is_overridable:
            message = f"invalid tree ID '{id}': a node has this name"
            self._report(TREE_NAMED_AS_NODE, message, element, "ID", "rename the tree")
