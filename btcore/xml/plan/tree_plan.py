"""Plan trees in two passes: check their structure, then the attributes, ports and scripts of their nodes.

The caches of `PlanContext` and `_TagCache` only save time: without them the plans are the same.
"""

from collections.abc import Iterator, Sequence
from operator import attrgetter

from btcore.blackboard.ports import SCRIPT_ROLES, Binding, Input, Port, PortRole, braced_key
from btcore.diagnostic_codes import (
    CAPITALISED_ROOT,
    CONTROL_CHARACTER_IN_NAME,
    DUPLICATE_MODELS,
    INCONVERTIBLE_TEXT,
    INVALID_NAME,
    MISSING_ID,
    MISSING_SUBTREE_PORT,
    NOT_A_BOOLEAN,
    SEVERAL_ASYNC_SEQUENCES,
    TOO_DEEP,
    TOO_LARGE,
    TREE_NAMED_AS_NODE,
    UNEXPECTED_ID,
    UNKNOWN_NODE,
    UNKNOWN_PORT,
    UNKNOWN_TREE,
    UNREACHABLE_CHILD,
    WRONG_CHILD_COUNT,
    DiagnosticCode,
)
from btcore.engine.node_config import EMPTY_MAPPING, MAX_NODES
from btcore.errors import ConversionError
from btcore.names import FORBIDDEN, RESERVED_IDS, forbidden_in, is_port_name
from btcore.registry.manifest import Manifest
from btcore.registry.registry import Registry
from btcore.status import NodeType
from btcore.values import BOOL
from btcore.xml.define import Definitions, TreeDefinition, tree_hint
from btcore.xml.plan.hints import UnknownNodeHints, port_hint
from btcore.xml.read.diagnostics import DiagnosticCollector
from btcore.xml.read.dialect import (
    EXPLICIT_TAGS,
    POSTCONDITION_ATTRIBUTES,
    PRECONDITION_ATTRIBUTES,
    SCRIPT_ATTRIBUTES,
    Dialect,
)
from btcore.xml.read.element import Element, ElementPart
from btcore.xml.read.read import Document

_DEPTH_OF = attrgetter("depth")
_CONTROL_CHARACTERS = frozenset(chr(code) for code in (*range(32), 127))
_LEAVES = {NodeType.ACTION: "an action", NodeType.CONDITION: "a condition"}


class SubtreeCall:
    """A SubTree element: the tree that it calls, and how the two blackboards are connected.

    Attributes:
        tree_id: ID of the called tree.
        element: The SubTree element.
        remaps: For each remapped key of the called tree, the key in the calling tree.
        constants: For each key of the called tree that is set to a constant, the text of the constant.
        port_texts: The text of each port: as written in the XML, else the default in the subtree's model.
        autoremap: Whether `_autoremap`, or `__autoremap` of format 3, maps every inner key to the outer
            key of the same name.
        outer_constants: The keys of the constants that *autoremap* maps, too: they are written to the entries
            of the calling tree. All other constants stay in the inner blackboard.
        shares_blackboard: Whether both trees use one blackboard (`__shared_blackboard` of format 3).
    """

    __slots__ = (
        "autoremap", "constants", "element", "outer_constants", "port_texts", "remaps", "shares_blackboard",
        "tree_id",
    )  # fmt: skip

    def __init__(self, tree_id: str, element: Element) -> None:
        self.tree_id = tree_id
        self.element = element
        self.remaps: dict[str, str] = {}
        self.constants: dict[str, str] = {}
        self.port_texts: dict[str, str] = {}
        self.autoremap = False
        self.shares_blackboard = False
        self.outer_constants: set[str] = set()


class NodePlan:
    """The plan of a node. `outline_trees` creates it, and `TreePlanner` adds ports and conditions.

    *depth* counts from the `<BehaviorTree>`, which has depth 0. *bindings* holds the ports that the
    document sets, in its order, then the other ports that have a default. *attributes* holds the attributes
    that are neither ports nor conditions. The first tree that is created takes over the bindings.
    """

    __slots__ = (
        "attributes", "bindings", "children", "conditions", "depth", "element", "id", "manifest",
        "name", "subtree_call",
    )  # fmt: skip

    def __init__(self, element: Element, depth: int) -> None:
        self.element = element
        self.depth = depth
        self.id = ""
        self.manifest: Manifest | None = None
        self.name: str | None = None
        self.conditions = EMPTY_MAPPING
        self.attributes = EMPTY_MAPPING
        self.bindings: Sequence[Binding] = ()
        self.children: Sequence[NodePlan] = ()
        self.subtree_call: SubtreeCall | None = None

    @property
    def ports(self) -> list[tuple[Port, str, bool]]:
        """The ports, as (port, text, whether the document sets the port)."""
        return [(binding.port, binding.text, binding.is_explicit) for binding in self.bindings]

    def iter_scripts(self) -> Iterator[tuple[str, str, bool]]:
        """Yield (attribute, text, whether the script is a condition) for each script of the node."""
        for attribute, text in self.conditions.items():
            yield attribute, text, attribute in PRECONDITION_ATTRIBUTES
        for binding in self.bindings:
            if binding.port.role in SCRIPT_ROLES and binding.key is None:
                yield binding.name, binding.text, binding.port.role is PortRole.CONDITION


class TreePlan:
    """A tree definition with its node plans.

    *calls* holds a SubtreeCall for each of its SubTree nodes. *depth* is the number of its levels, *size* the
    number of its nodes. *has_unknown_nodes* is True if the plans of unknown nodes were removed.
    """

    def __init__(self, definition: TreeDefinition, root: NodePlan | None) -> None:
        self.definition = definition
        self.root = root
        self.calls: list[SubtreeCall] = []
        self.depth = 0
        self.size = 0
        self.has_unknown_nodes = False

    @property
    def id(self) -> str:
        """The ID of the tree."""
        return self.definition.id

    def nodes(self) -> list[NodePlan]:
        """Return the node plans in pre-order, without those of the trees that it calls."""
        nodes: list[NodePlan] = []
        pending = [self.root] if self.root is not None else []
        while pending:
            node = pending.pop()
            nodes.append(node)
            pending += reversed(node.children)
        return nodes


# --- what all trees of a document share


class KnownNode:
    """A registered node, with a cache of the bindings of its ports: node plans with equal texts share them.

    *bindings_by_text* maps the name of a port, then its text, to the binding. *defaults* holds a binding for
    each port that has a default.
    """

    __slots__ = ("bindings_by_text", "defaults", "id", "manifest", "ports")

    def __init__(self, id: str, manifest: Manifest, format: int) -> None:
        self.id = id
        self.manifest = manifest
        self.ports = manifest.ports
        self.bindings_by_text: dict[str, dict[str, Binding]] = {name: {} for name in manifest.ports}
        self.defaults = [
            (Input if port.reads else Binding)(port, port.default, format, is_explicit=False)
            for port in manifest.ports.values()
            if port.default is not None
        ]


class PlanContext:
    """What the planners of all trees of a document share: definitions, registry, diagnostics."""

    def __init__(self, definitions: Definitions, registry: Registry, collector: DiagnosticCollector) -> None:
        self.definitions = definitions
        self.dialect: Dialect = definitions.dialect
        self.registry = registry
        self.collector = collector
        self.known_nodes_by_id: dict[str, KnownNode] = {}
        self.known_nodes_by_tag: dict[str, KnownNode] = {}
        # Names of attributes that _select_attributes() kept. Its decision depends only on the name, so it is
        # not called again for these names.
        self.kept_attributes: set[str] = set()

    def manifest(self, id: str) -> Manifest | None:
        """Return the manifest of a node, or None if it is unknown in the format of the document."""
        return self.registry.get(id, self.dialect.format)


# --- the structure


def element_children(element: Element) -> list[Element]:
    """Return the child elements of *element*, without the obsolete `<Root>` of Groot 1."""
    return [child for child in element.children if child.tag != "Root"]


def count_text(count: int) -> str:
    """Return a number of children as text, such as `2 children`."""
    return "no child" if count == 0 else f"{count} children" if count > 1 else "1 child"


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
    """What is known about the tags of all trees: the node types, and hints for unknown nodes."""

    def __init__(self, context: PlanContext) -> None:
        self._context = context
        self.node_types: dict[str, NodeType | None] = {}
        self.leaf_tags: set[str] = set()
        self._hints: UnknownNodeHints | None = None
        # The files that declare nodes in their TreeNodesModel, by ID; None before the first unknown node.
        self._declaring_files: dict[str | None, str] | None = None

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

    def unknown_node_hint(self, id: str) -> str:
        """Return a hint for the unknown node *id*."""
        context = self._context
        if self._hints is None:
            self._hints = UnknownNodeHints(context.registry, context.dialect.format)
        if not context.collector.take_comparisons(self._hints.names):
            return ""
        if self._declaring_files is None:
            self._declaring_files = {
                model.get("ID"): document.file
                for document in reversed(context.definitions.sources.documents)
                for models in document.root.iterchildren("TreeNodesModel")
                for model in models.iterchildren(*EXPLICIT_TAGS)
            }
        trees = context.definitions.by_id
        return self._hints.hint(id, trees, self._declaring_files.get(id))


class _TreeOutliner:
    """Creates the node plans of one tree, without ports, and checks their structure."""

    def __init__(self, context: PlanContext, tag_cache: _TagCache, document: Document) -> None:
        self._dialect: Dialect = context.dialect
        self._context = context
        self._collector = context.collector
        self._tag_cache = tag_cache
        self._document = document

    def _report(
        self, code: DiagnosticCode, message: str, element: Element, attribute: str = "", hint: str = ""
    ) -> None:
        self._collector.add(self._document.diagnostic(code, message, element, attribute, hint=hint))

    def outline(self, top: Element) -> list[NodePlan]:
        """Return the node plans below the `<BehaviorTree>` *top*, in pre-order."""
        dialect = self._dialect
        limit = self._document.max_depth or dialect.max_depth
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
                self._report(TOO_LARGE, message, top, "ID", hint="nodes are numbered with 16 bits")
                return []
            element = node.element
            tag = element.tag
            children = element.children
            if not children and tag in leaf_tags:
                continue
            if children:
                children = element_children(element)
                if len(children) != len(element.children):
                    self._warn_obsolete_root(element)
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

    def _warn_obsolete_root(self, element: Element) -> None:
        for child in element.iterchildren("Root"):
            message = "the obsolete <Root> is ignored"
            self._report(CAPITALISED_ROOT, message, child, hint="remove it")

    def _check_other_tag(self, tag: str, element: Element, children: list[Element]) -> None:
        """Check an element whose tag is not the ID of a node."""
        if tag == "BehaviorTree":
            self._check_tree(element, children)
        elif tag in self._dialect.subtree_tags:
            self._check_call(tag, element, children)
        elif tag in EXPLICIT_TAGS:
            self._check_explicit(tag, element, children)
        else:
            self._report(
                UNKNOWN_NODE, f"unknown node <{tag}>", element, hint=self._tag_cache.unknown_node_hint(tag)
            )

    def _check_explicit(self, tag: str, element: Element, children: list[Element]) -> None:
        id = element.get("ID") or ""
        if not id:
            message = f"the ID of the node is missing in <{tag}>"
            hint = f'write <{tag} ID="…"/>'
            self._report(MISSING_ID, message, element, hint=hint)
            return
        manifest = self._context.manifest(id)
        if manifest is None:
            self._report(
                UNKNOWN_NODE, f"unknown node '{id}'", element, "ID", self._tag_cache.unknown_node_hint(id)
            )
            return
        node_type = manifest.type if self._dialect.type_from_id else EXPLICIT_TAGS[tag]
        self._check_child_count(id, node_type, element, children)

    def _check_child_count(
        self, id: str, node_type: NodeType, element: Element, children: list[Element]
    ) -> None:
        """Add an error if *children* are too few or too many for the node *id*, which is of *node_type*."""
        count = len(children)
        has = count_text(count)
        if node_type is NodeType.DECORATOR:
            if count != 1:
                hint = "put them into a <Sequence>" if count else ""
                self._report(
                    WRONG_CHILD_COUNT, f"<{id}> has {has}; a decorator has exactly 1", element, hint=hint
                )
        elif node_type is NodeType.CONTROL:
            manifest = self._context.manifest(id)
            least = 1 if manifest is None else max(manifest.spec.child_count_at_load[0], 1)
            if count < least:
                message = (
                    f"<{id}> has {has}; {'it' if least > 1 else 'a control node'} needs at least {least}"
                )
                hint = manifest.spec.child_roles if manifest is not None and least > 1 else ""
                self._report(WRONG_CHILD_COUNT, message, element, hint=hint)
            elif id == "ReactiveSequence":  # as BehaviorTree.CPP's parser, which knows this name only
                self._check_asynchronous(children)
        elif count and node_type in _LEAVES:
            self._report(WRONG_CHILD_COUNT, f"<{id}> has {has}; {_LEAVES[node_type]} has none", element)

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
            hint = "put them into a <Sequence>" if children else ""
            self._report(WRONG_CHILD_COUNT, message, element, hint=hint)

    def _check_call(self, tag: str, element: Element, children: list[Element]) -> None:
        id = element.get("ID") or ""
        if element.get("ID") is None or (not id and self._dialect.format == 4):
            message = f"the ID of the tree is missing in <{tag}>"
            self._report(MISSING_ID, message, element, hint=f'write <{tag} ID="…"/>')
        elif self._dialect.checks_names:
            self._check_not_a_node(id, element)
        if children and tag in self._dialect.tags_with_ignored_children:
            message = f'the children of <{tag} ID="{id}"> are ignored'
            hint = "move them into the <BehaviorTree> that it calls, or remove them"
            self._report(UNREACHABLE_CHILD, message, children[0], hint=hint)
        elif children:
            message = f'<{tag} ID="{id}"> has children; they belong into the <BehaviorTree> that it calls'
            self._report(WRONG_CHILD_COUNT, message, children[0])

    def _check_not_a_node(self, id: str, element: Element) -> None:
        known = self._context.manifest(id)
        if known is not None and not known.is_overridable:
            message = f"invalid tree ID '{id}': a node has this name"
            self._report(TREE_NAMED_AS_NODE, message, element, "ID", "rename the tree")


# --- the attributes


class TreePlanner:
    """The second pass: completes the outlines of one tree's nodes."""

    def __init__(self, context: PlanContext, definition: TreeDefinition) -> None:
        self._context = context
        self._dialect = context.dialect
        self._collector = context.collector
        self._definition = definition

    def complete(self, nodes: list[NodePlan]) -> TreePlan:
        """Complete *nodes*, the result of `outline_trees`; return the plan of the tree."""
        tree = TreePlan(self._definition, nodes[0] if nodes else None)
        if nodes:
            self._complete_nodes(nodes, tree)
        return tree

    def _report(
        self,
        code: DiagnosticCode,
        message: str,
        element: Element,
        attribute: str,
        hint: str = "",
        at_name: bool = False,
    ) -> None:
        part: ElementPart = "name" if at_name else "value"
        self._collector.add(
            self._definition.document.diagnostic(code, message, element, attribute, part, hint)
        )

    def _complete_nodes(self, nodes: list[NodePlan], tree: TreePlan) -> None:
        """Complete *nodes*, and remove the plans of unknown nodes and of calls of unknown trees: errors."""
        tree.size = len(nodes)
        tree.depth = max(map(_DEPTH_OF, nodes))
        known_nodes = self._context.known_nodes_by_tag
        unknown: set[NodePlan] = set()
        for node in nodes:
            tag = node.element.tag
            known = known_nodes.get(tag)
            if known is None:
                if tag in self._dialect.subtree_tags:
                    if not self._plan_call(tag, node, tree):
                        unknown.add(node)
                    continue
                known = self._find_known_node(tag, node.element)
                if known is None:  # reported by _TreeOutliner
                    unknown.add(node)
                    continue
            node.id = known.id
            node.manifest = known.manifest
            self._plan_attributes(node, known)
        if unknown:
            tree.has_unknown_nodes = True
            if tree.root in unknown:
                tree.root = None
            for node in nodes:
                node.children = [child for child in node.children if child not in unknown]

    def _find_known_node(self, tag: str, element: Element) -> KnownNode | None:
        """Return the registered node that *element* names, or None if it is unknown."""
        id = element.get("ID") or "" if tag in EXPLICIT_TAGS else tag
        known = self._context.known_nodes_by_id.get(id)
        if known is None:
            manifest = self._context.manifest(id)
            if manifest is None:
                return None
            self._context.known_nodes_by_id[id] = known = KnownNode(id, manifest, self._dialect.format)
        if tag not in EXPLICIT_TAGS:
            self._context.known_nodes_by_tag[tag] = known
        return known

    def _plan_attributes(self, node: NodePlan, known: KnownNode) -> None:
        bindings: list[Binding] = []
        other_attributes: dict[str, str] = {}
        cached_bindings = known.bindings_by_text
        for key, text in node.element.attributes.items():
            by_text = cached_bindings.get(key)
            if by_text is not None:
                port = known.ports[key]
                bindings.append(by_text.get(text) or self._create_binding(node, port, text, by_text))
            elif key == "name":
                node.name = text
                if not text.isprintable():
                    self._check_name(node, text)
            else:
                other_attributes[key] = text
        if other_attributes:
            if not self._context.kept_attributes.issuperset(other_attributes):
                other_attributes = self._select_attributes(node, known.manifest, other_attributes)
            node.attributes = other_attributes
        if known.defaults and len(bindings) < len(known.ports):
            given = {binding.port for binding in bindings}
            bindings += [binding for binding in known.defaults if binding.port not in given]
        node.bindings = bindings

    def _select_attributes(
        self, node: NodePlan, manifest: Manifest, attributes: dict[str, str]
    ) -> dict[str, str]:
        """Return those of *attributes* that are kept. They hold neither ports nor the name.

        Scripts are stored in `node.conditions`. Attributes that are neither kept nor scripts are errors.
        """
        dialect = self._dialect
        scripts: dict[str, str] = {}
        kept: dict[str, str] = {}
        for key, text in attributes.items():
            if key in SCRIPT_ATTRIBUTES and dialect.has_conditions:
                scripts[key] = text
            elif key == "ID":
                if dialect.requires_explicit_tag_for_id and node.element.tag not in EXPLICIT_TAGS:
                    message = (
                        f'unexpected ID in <{node.id}>: only explicit tags such as <Action ID="…"> have one'
                    )
                    self._report(
                        UNEXPECTED_ID, message, node.element, key, 'to name the node, write name="…"'
                    )
            elif key in dialect.comment_attributes or (
                dialect.allows_non_port_attributes and not is_port_name(key)
            ):
                kept[key] = text
            else:
                message = f"<{node.id}> has no port '{key}'"
                may_search = self._collector.take_comparisons(manifest.ports)
                hint = port_hint(manifest, key) if may_search else ""
                self._report(UNKNOWN_PORT, message, node.element, key, hint, at_name=True)
        if scripts:
            node.conditions = {
                key: scripts[key]
                for key in (*PRECONDITION_ATTRIBUTES, *POSTCONDITION_ATTRIBUTES)
                if key in scripts
            }
        self._context.kept_attributes.update(kept)
        return kept

    def _check_name(self, node: NodePlan, text: str) -> None:
        if self._dialect.checks_names and not _CONTROL_CHARACTERS.isdisjoint(text):
            message = f"control character in the name {text!r}"
            self._report(CONTROL_CHARACTER_IN_NAME, message, node.element, "name")

    def _create_binding(self, node: NodePlan, port: Port, text: str, by_text: dict[str, Binding]) -> Binding:
        """Return the binding of *port* to *text*, and cache it in *by_text* unless it is an error."""
        binding = (Input if port.reads else Binding)(port, text, self._dialect.format)
        if binding.key is None:
            is_fine = not binding.error and text != port.default
        else:
            is_fine = text[0] == "{" and text[-1] == "}"
        if is_fine or not self._dialect.checks_literals or self._check_literal(node, binding):
            by_text[text] = binding
        return binding

    def _check_literal(self, node: NodePlan, binding: Binding) -> bool:
        """Return whether the text is a `{key}` or converts to the port's type; otherwise add an error."""
        port, text = binding.port, binding.text
        if len(text) >= 3 and text[0] == "{" and text[-1] == "}":
            return True  # a key, possibly in the notation of the other format
        kind = port.type
        if not port.checks_text:
            return True
        error = binding.error
        if binding.key is not None or text == port.default:
            # The binding has not converted the text.
            try:
                kind.from_text(text)
            except ConversionError as conversion_error:
                error = str(conversion_error)
        if not error:
            return True
        hint = ""
        if binding.key is not None:
            hint = "write {=}" if "=" in text else f"write {text.strip()} without surrounding spaces"
        elif is_port_name(text):
            hint = f"to use the blackboard entry, write {{{text}}}"
        message = f"the port '{port.name}' of <{node.id}> has the type {kind.name}: {error}"
        self._report(INCONVERTIBLE_TEXT, message, node.element, port.name, hint)
        return False

    # --- SubTree elements

    def _plan_call(self, tag: str, node: NodePlan, tree: TreePlan) -> bool:
        """Plan a SubTree element. Return whether the called tree exists."""
        element = node.element
        id = element.get("ID") or ""
        node.id = tag
        node.manifest = self._context.manifest(tag)
        call = SubtreeCall(id, element)
        node.subtree_call = call
        tree.calls.append(call)
        if self._dialect.format == 3:
            self._connect_call_of_3(node, call, tag)
        else:
            self._connect_call_of_4(node, call)
        if id in self._context.definitions.by_id:
            return True
        if element.get("ID") is not None and self._context.definitions.are_complete:
            trees = self._context.definitions.by_id
            hint = tree_hint(id, trees) if self._collector.take_comparisons(trees) else ""
            self._report(UNKNOWN_TREE, f"unknown subtree '{id}'", element, "ID", hint)
        return False

    def _connect_call_of_4(self, node: NodePlan, call: SubtreeCall) -> None:
        given: dict[str, str] = {}
        scripts: dict[str, str] = {}
        attributes: dict[str, str] = {}
        for key, text in node.element.attributes.items():
            if key == "_autoremap":
                call.autoremap = self._read_bool(node, key, text)
            elif key == "name":
                node.name = text
                self._check_name(node, text)
            elif key in SCRIPT_ATTRIBUTES:
                scripts[key] = text
            elif key == "ID":
                continue
            elif is_port_name(key):
                given[key] = text
            else:
                attributes[key] = text
        node.conditions, node.attributes = scripts, attributes
        if not call.autoremap:
            for port, default in self._context.definitions.subtree_models.get(call.tree_id, {}).items():
                if port in given:
                    continue
                if default is None or default == "":
                    if self._collector.is_full(MISSING_SUBTREE_PORT):
                        break
                    message = (
                        f"<SubTree> lacks the port '{port}', which the model of '{call.tree_id}' requires"
                    )
                    hint = f'write {port}="…", or declare a default in <TreeNodesModel>'
                    self._report(MISSING_SUBTREE_PORT, message, node.element, "", hint)
                else:
                    given[port] = default
        call.port_texts = given
        for key, text in given.items():
            # In a SubTree "=" is a constant, and only "{=}" stands for the key of the same name. As the
            # default of a model it stands for the key "=".
            outer = braced_key(text)
            if outer is not None:
                call.remaps[key] = key if text == "{=}" and key in node.element.attributes else outer
            else:
                call.constants[key] = text

    def _connect_call_of_3(self, node: NodePlan, call: SubtreeCall, tag: str) -> None:
        for key, text in node.element.attributes.items():
            if key == "ID":
                continue
            if key == "__shared_blackboard" and tag == "SubTree":
                call.shares_blackboard = self._read_bool(node, key, text)
            elif key == "__autoremap" and tag == "SubTreePlus":
                call.autoremap = self._read_bool(node, key, text)
            elif tag == "SubTree":
                call.port_texts[key] = text
                # <SubTree> of format 3 has no braces: the text is the outer key itself.
                call.remaps[key] = text
            else:
                call.port_texts[key] = text
                outer = braced_key(text, 3)
                if outer is not None:
                    call.remaps[key] = outer
                else:
                    call.constants[key] = text
                    # BehaviorTree.CPP 3.8 reads the attributes in order: autoremap maps those that follow.
                    if call.autoremap:
                        call.outer_constants.add(key)
        # Format 3 ignores the name of a call.
        node.name = call.tree_id

    def _read_bool(self, node: NodePlan, key: str, text: str) -> bool:
        try:
            return BOOL.from_text(text, self._dialect.format) is True
        except ConversionError:
            message = f"{key} must be 'true' or 'false', not '{text}'"
            self._report(NOT_A_BOOLEAN, message, node.element, key)
            return False
