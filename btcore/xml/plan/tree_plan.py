"""Plan one tree: check its structure, then the attributes of its nodes, and find their ports and scripts."""

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
        written: The text of each port: as written in the document, else the default in the subtree's model.
        autoremap: Whether `_autoremap`, or `__autoremap` of format 3, maps every inner key to the outer
            key of the same name.
        outer_constants: The keys of the constants that *autoremap* maps, too: they are written to the entries
            of the calling tree. All other constants stay in the inner blackboard.
        shared: Whether both trees use one blackboard (`__shared_blackboard` of format 3).
    """

    __slots__ = (
        "autoremap", "constants", "element", "outer_constants", "remaps", "shared", "tree_id", "written",
    )  # fmt: skip

    def __init__(self, tree_id: str, element: Element) -> None:
        self.tree_id = tree_id
        self.element = element
        self.remaps: dict[str, str] = {}
        self.constants: dict[str, str] = {}
        self.written: dict[str, str] = {}
        self.autoremap = False
        self.shared = False
        self.outer_constants: set[str] = set()


class NodePlan:
    """One node of a tree definition. `_Outline` creates it, and `TreePlanner` adds what the registry knows.

    *depth* counts from the `<BehaviorTree>`, which has depth 0. *bindings* holds the ports that the
    document sets, in its order, then the other ports that have a default. *attributes* holds the attributes
    that are neither ports nor scripts.
    """

    __slots__ = (
        "attributes", "bindings", "call", "children", "depth", "element", "id", "manifest", "name", "scripts",
    )  # fmt: skip

    def __init__(self, element: Element, depth: int) -> None:
        self.element = element
        self.depth = depth
        self.id = ""
        self.manifest: Manifest | None = None
        self.name: str | None = None
        self.scripts = EMPTY_MAPPING
        self.attributes = EMPTY_MAPPING
        self.bindings: Sequence[Binding] = ()
        self.children: Sequence[NodePlan] = ()
        self.call: SubtreeCall | None = None

    @property
    def ports(self) -> list[tuple[Port, str, bool]]:
        """The ports, as (port, text, whether the document sets the port)."""
        return [(bound.port, bound.text, bound.is_explicit) for bound in self.bindings]

    def every_script(self) -> Iterator[tuple[str, str, bool]]:
        """Yield (attribute, text, whether the script is a condition) for each script of the node."""
        for attribute, text in self.scripts.items():
            yield attribute, text, attribute in PRECONDITION_ATTRIBUTES
        for bound in self.bindings:
            if bound.port.role in SCRIPT_ROLES and bound.key is None:
                yield bound.name, bound.text, bound.port.role is PortRole.CONDITION


class TreePlan:
    """A tree definition with the plans of its nodes.

    *calls* holds a SubtreeCall for each of its SubTree nodes. *depth* is the number of its levels, *size* the
    number of its nodes. *has_unknown_nodes* is True if unknown nodes were removed.
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
        """Return the nodes in pre-order, without the nodes of the trees that it calls."""
        nodes: list[NodePlan] = []
        pending = [self.root] if self.root is not None else []
        while pending:
            node = pending.pop()
            nodes.append(node)
            pending += reversed(node.children)
        return nodes


# --- what all trees of a document share


class BindingCache:
    """The port bindings of one manifest that were created so far. Nodes with equal port texts share them.

    *bindings* maps the name of a port, then its text, to the binding. *defaults* holds a binding for each
    port that has a default.
    """

    __slots__ = ("bindings", "defaults", "id", "manifest", "ports")

    def __init__(self, id: str, manifest: Manifest, format: int) -> None:
        self.id = id
        self.manifest = manifest
        self.ports = manifest.ports
        self.bindings: dict[str, dict[str, Binding]] = {name: {} for name in manifest.ports}
        self.defaults = [
            (Input if port.reads else Binding)(port, port.default, format, written=False)
            for port in manifest.ports.values()
            if port.default is not None
        ]


class PlanContext:
    """What the planners of all trees of a document share: definitions, registry, what was found so far."""

    def __init__(self, definitions: Definitions, registry: Registry, found: DiagnosticCollector) -> None:
        self.definitions = definitions
        self.dialect: Dialect = definitions.dialect
        self.registry = registry
        self.found = found
        self.bindings_by_id: dict[str, BindingCache] = {}
        self.bindings_by_tag: dict[str, BindingCache] = {}
        # Names of attributes that _sort_attributes() kept. Its decision depends only on the name, so it is
        # not called again for these names.
        self.kept: set[str] = set()

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
    """Check the structure of all trees of the documents, whether they are used or not.

    Returns:
        The nodes of each definition in pre-order, beginning with its `<BehaviorTree>`.
    """
    definitions, dialect = context.definitions, context.dialect
    for document in definitions.sources.documents:
        models = list(document.root.iterchildren("TreeNodesModel"))
        if dialect.format == 4 and len(models) > 1:
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
        self._hints: UnknownNodeHints | None = None
        # The files that declare nodes in their TreeNodesModel, by ID; None before the first unknown node.
        self._declared: dict[str | None, str] | None = None

    def kind_of(self, tag: str) -> NodeType | None:
        """Return the node type that limits the children of *tag*; None if *tag* is not the ID of a node."""
        manifest = self._context.manifest(tag)
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
        if self._hints is None:
            self._hints = UnknownNodeHints(context.registry, context.dialect.format)
        if not context.found.has_time_for_hint(self._hints.names):
            return ""
        if self._declared is None:
            self._declared = {
                model.get("ID"): document.file
                for document in reversed(context.definitions.sources.documents)
                for models in document.root.iterchildren("TreeNodesModel")
                for model in models.iterchildren(*EXPLICIT_TAGS)
            }
        trees = context.definitions.by_id
        return self._hints.hint(node, trees, self._declared.get(node))


class _Outline:
    """Checks the structure of one tree."""

    def __init__(self, context: PlanContext, tags: _Tags, document: Document) -> None:
        self._dialect: Dialect = context.dialect
        self._context = context
        self._found = context.found
        self._tags = tags
        self._document = document

    def _report(
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
                self._report(TOO_LARGE, message, top, "ID", hint="nodes are numbered with 16 bits")
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
            kind = kinds[tag] if tag in kinds else self._tags.kind_of(tag)
            if kind is None:
                self._check_other_tag(tag, element, children)
            elif children or tag not in leaves:
                self._check_child_count(tag, kind, element, children)
            if not children:
                continue
            depth = node.depth + 1
            if depth > limit:
                message = f"elements are nested more than {limit:,} deep"
                self._report(TOO_DEEP, message, element, hint="split the tree into subtrees")
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
                UNKNOWN_NODE, f"unknown node <{tag}>", element, hint=self._tags.unknown_node_hint(tag)
            )

    def _check_explicit(self, tag: str, element: Element, children: list[Element]) -> None:
        node = element.get("ID") or ""
        if not node:
            message = f"the ID of the node is missing in <{tag}>"
            hint = f'write <{tag} ID="…"/>'
            self._report(MISSING_ID, message, element, hint=hint)
            return
        manifest = self._context.manifest(node)
        if manifest is None:
            self._report(
                UNKNOWN_NODE, f"unknown node '{node}'", element, "ID", self._tags.unknown_node_hint(node)
            )
            return
        kind = manifest.type if self._dialect.explicit_by_id else EXPLICIT_TAGS[tag]
        self._check_child_count(node, kind, element, children)

    def _check_child_count(
        self, node: str, kind: NodeType, element: Element, children: list[Element]
    ) -> None:
        """Add an error if *children* are too few or too many for *node*, which is of *kind*."""
        count = len(children)
        has = count_text(count)
        if kind is NodeType.DECORATOR:
            if count != 1:
                hint = "put them into a <Sequence>" if count else ""
                self._report(
                    WRONG_CHILD_COUNT, f"<{node}> has {has}; a decorator has exactly 1", element, hint=hint
                )
        elif kind is NodeType.CONTROL:
            manifest = self._context.manifest(node)
            least = 1 if manifest is None else max(manifest.spec.child_count_at_load[0], 1)
            if count < least:
                message = (
                    f"<{node}> has {has}; {'it' if least > 1 else 'a control node'} needs at least {least}"
                )
                hint = manifest.spec.child_roles if manifest is not None and least > 1 else ""
                self._report(WRONG_CHILD_COUNT, message, element, hint=hint)
            elif node == "ReactiveSequence":  # as BehaviorTree.CPP's parser, which knows this name only
                self._check_asynchronous(children)
        elif count and kind in _LEAVES:
            self._report(WRONG_CHILD_COUNT, f"<{node}> has {has}; {_LEAVES[kind]} has none", element)

    def _check_asynchronous(self, children: list[Element]) -> None:
        # W106 covers other asynchronous children, whose results must be inferred.
        asynchronous = [child for child in children if child.tag == "AsyncSequence"]
        if len(asynchronous) > 1 and self._dialect.format == 4:
            message = "second AsyncSequence in a ReactiveSequence, which can have only one"
            hint = "only one child can be RUNNING at a time"
            self._report(SEVERAL_ASYNC_SEQUENCES, message, asynchronous[1], hint=hint)

    def _check_tree(self, element: Element, children: list[Element]) -> None:
        name = element.get("ID") or ""
        label = f"the tree '{name}'" if name else "the tree"
        if self._dialect.tree_ids_checked and name:
            self._check_not_a_node(name, element)
            if not FORBIDDEN.isdisjoint(name):
                message = f"invalid tree ID '{name}': {forbidden_in(name)!r} is not allowed"
                self._report(INVALID_NAME, message, element, "ID", "use letters, digits, '_' and '-'")
            elif name in RESERVED_IDS:
                self._report(INVALID_NAME, f"invalid tree ID '{name}': the name is reserved", element, "ID")
        if len(children) != 1:
            message = f"{label} has {count_text(len(children))}; a tree has exactly 1"
            hint = "put them into a <Sequence>" if children else ""
            self._report(WRONG_CHILD_COUNT, message, element, hint=hint)

    def _check_call(self, tag: str, element: Element, children: list[Element]) -> None:
        name = element.get("ID") or ""
        if element.get("ID") is None or (not name and self._dialect.format == 4):
            message = f"the ID of the tree is missing in <{tag}>"
            self._report(MISSING_ID, message, element, hint=f'write <{tag} ID="…"/>')
        elif self._dialect.tree_ids_checked:
            self._check_not_a_node(name, element)
        if children and tag in self._dialect.ignoring_tags:
            message = f'the children of <{tag} ID="{name}"> are ignored'
            hint = "move them into the <BehaviorTree> that it calls, or remove them"
            self._report(UNREACHABLE_CHILD, message, children[0], hint=hint)
        elif children:
            message = f'<{tag} ID="{name}"> has children; they belong into the <BehaviorTree> that it calls'
            self._report(WRONG_CHILD_COUNT, message, children[0])

    def _check_not_a_node(self, name: str, element: Element) -> None:
        known = self._context.manifest(name)
        if known is not None and not known.is_overridable:
            message = f"invalid tree ID '{name}': a node has this name"
            self._report(TREE_NAMED_AS_NODE, message, element, "ID", "rename the tree")


# --- the attributes


class TreePlanner:
    """Plans one tree."""

    def __init__(self, context: PlanContext, definition: TreeDefinition) -> None:
        self._context = context
        self._dialect = context.dialect
        self._found = context.found
        self._definition = definition

    def plan(self, outline: list[NodePlan]) -> TreePlan:
        """Return the plan of the tree, without the trees that it calls.

        Args:
            outline: The nodes of the tree in pre-order, beginning with its `<BehaviorTree>`.
        """
        plan = TreePlan(self._definition, None)
        top, *nodes = outline
        if nodes:
            plan.root = nodes[0]
            if len(top.children) > 1:
                # A tree has one root; further roots are an error of the structure, and ignored here.
                nodes = nodes[: nodes.index(top.children[1])]
            self._plan_nodes(nodes, plan)
        return plan

    def _report(
        self,
        code: DiagnosticCode,
        message: str,
        element: Element,
        attribute: str,
        hint: str = "",
        name: bool = False,
    ) -> None:
        part: ElementPart = "name" if name else "value"
        self._found.add(self._definition.document.diagnostic(code, message, element, attribute, part, hint))

    def _plan_nodes(self, nodes: list[NodePlan], tree: TreePlan) -> None:
        """Plan *nodes*, and remove unknown nodes, which are errors of the structure, from the tree."""
        tree.size = len(nodes)
        tree.depth = max(map(_DEPTH_OF, nodes))
        known_tags = self._context.bindings_by_tag
        unknown: set[NodePlan] = set()
        for node in nodes:
            tag = node.element.tag
            known = known_tags.get(tag)
            if known is None:
                if tag in self._dialect.subtree_tags:
                    if not self._plan_call(tag, node, tree):
                        unknown.add(node)
                    continue
                known = self._look_up(tag, node.element)
                if known is None:
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

    def _look_up(self, tag: str, element: Element) -> BindingCache | None:
        """Return the bindings for the node that *element* names, or None if the node is unknown."""
        id = element.get("ID") or "" if tag in EXPLICIT_TAGS else tag
        known = self._context.bindings_by_id.get(id)
        if known is None:
            manifest = self._context.manifest(id)
            if manifest is None:
                return None
            self._context.bindings_by_id[id] = known = BindingCache(id, manifest, self._dialect.format)
        if tag not in EXPLICIT_TAGS:
            self._context.bindings_by_tag[tag] = known
        return known

    def _plan_attributes(self, plan: NodePlan, known: BindingCache) -> None:
        bindings: list[Binding] = []
        others: dict[str, str] = {}
        known_bindings = known.bindings
        for key, text in plan.element.attributes.items():
            by_text = known_bindings.get(key)
            if by_text is not None:
                bindings.append(by_text.get(text) or self._bind(plan, known.ports[key], text, by_text))
            elif key == "name":
                plan.name = text
                if not text.isprintable():
                    self._check_name(plan, text)
            else:
                others[key] = text
        if others:
            if not self._context.kept.issuperset(others):
                others = self._sort_attributes(plan, known.manifest, others)
            plan.attributes = others
        if known.defaults and len(bindings) < len(known.bindings):
            given = {bound.port for bound in bindings}
            bindings += [bound for bound in known.defaults if bound.port not in given]
        plan.bindings = bindings

    def _sort_attributes(self, plan: NodePlan, manifest: Manifest, others: dict[str, str]) -> dict[str, str]:
        """Return the attributes in *others* to keep. *others* holds neither ports nor the name.

        Scripts are stored in `plan.scripts`. Attributes that are neither kept nor scripts are errors.
        """
        dialect = self._dialect
        scripts: dict[str, str] = {}
        kept: dict[str, str] = {}
        for key, text in others.items():
            if key in SCRIPT_ATTRIBUTES and dialect.has_conditions:
                scripts[key] = text
            elif key == "ID":
                if dialect.explicit_by_id and plan.element.tag not in EXPLICIT_TAGS:
                    message = (
                        f'unexpected ID in <{plan.id}>: only explicit tags such as <Action ID="…"> have one'
                    )
                    self._report(
                        UNEXPECTED_ID, message, plan.element, key, 'to name the node, write name="…"'
                    )
            elif key in dialect.reserved or (dialect.free_underscore and not is_port_name(key)):
                kept[key] = text
            else:
                message = f"<{plan.id}> has no port '{key}'"
                has_time = self._found.has_time_for_hint(manifest.ports)
                hint = port_hint(manifest, key) if has_time else ""
                self._report(UNKNOWN_PORT, message, plan.element, key, hint, name=True)
        if scripts:
            plan.scripts = {
                key: scripts[key]
                for key in (*PRECONDITION_ATTRIBUTES, *POSTCONDITION_ATTRIBUTES)
                if key in scripts
            }
        self._context.kept.update(kept)
        return kept

    def _check_name(self, plan: NodePlan, text: str) -> None:
        if self._dialect.has_conditions and not _CONTROL_CHARACTERS.isdisjoint(text):
            message = f"control character in the name {text!r}"
            self._report(CONTROL_CHARACTER_IN_NAME, message, plan.element, "name")

    def _bind(self, plan: NodePlan, port: Port, text: str, by_text: dict[str, Binding]) -> Binding:
        """Return the binding of *port* to *text*, and cache it in *by_text* unless it is an error."""
        bound = (Input if port.reads else Binding)(port, text, self._dialect.format)
        if bound.key is None:
            is_fine = not bound.error and text != port.default
        else:
            is_fine = text[0] == "{" and text[-1] == "}"
        if is_fine or not self._dialect.literals_checked or self._is_convertible(plan, bound):
            by_text[text] = bound
        return bound

    def _is_convertible(self, plan: NodePlan, bound: Binding) -> bool:
        """Return whether the text is a `{key}` or converts to the port's type; otherwise add an error."""
        port, text = bound.port, bound.text
        if len(text) >= 3 and text[0] == "{" and text[-1] == "}":
            return True  # a key, possibly in the notation of the other format
        kind = port.type
        if not port.checks_text:
            return True
        error = bound.error
        if bound.key is not None or text == port.default:
            # The binding has not converted the text.
            try:
                kind.from_text(text)
            except ConversionError as conversion_error:
                error = str(conversion_error)
        if not error:
            return True
        hint = ""
        if bound.key is not None:
            hint = "write {=}" if "=" in text else f"write {text.strip()} without surrounding spaces"
        elif is_port_name(text):
            hint = f"to use the blackboard entry, write {{{text}}}"
        message = f"the port '{port.name}' of <{plan.id}> has the type {kind.name}: {error}"
        self._report(INCONVERTIBLE_TEXT, message, plan.element, port.name, hint)
        return False

    # --- SubTree elements

    def _plan_call(self, tag: str, plan: NodePlan, tree: TreePlan) -> bool:
        """Plan a SubTree element. Return whether the called tree exists."""
        element = plan.element
        id = element.get("ID") or ""
        plan.id = tag
        plan.manifest = self._context.manifest(tag)
        call = SubtreeCall(id, element)
        plan.call = call
        tree.calls.append(call)
        if self._dialect.format == 3:
            self._connect_call_of_3(plan, call, tag)
        else:
            self._connect_call_of_4(plan, call)
        if id in self._context.definitions.by_id:
            return True
        if element.get("ID") is not None and self._context.definitions.are_complete:
            known = self._context.definitions.by_id
            hint = tree_hint(id, known) if self._found.has_time_for_hint(known) else ""
            self._report(UNKNOWN_TREE, f"unknown subtree '{id}'", element, "ID", hint)
        return False

    def _connect_call_of_4(self, plan: NodePlan, call: SubtreeCall) -> None:
        given: dict[str, str] = {}
        scripts: dict[str, str] = {}
        attributes: dict[str, str] = {}
        for key, text in plan.element.attributes.items():
            if key == "_autoremap":
                call.autoremap = self._read_bool(plan, key, text)
            elif key == "name":
                plan.name = text
                self._check_name(plan, text)
            elif key in SCRIPT_ATTRIBUTES:
                scripts[key] = text
            elif key == "ID":
                continue
            elif is_port_name(key):
                given[key] = text
            else:
                attributes[key] = text
        plan.scripts, plan.attributes = scripts, attributes
        if not call.autoremap:
            for port, default in self._context.definitions.subtree_models.get(call.tree_id, {}).items():
                if port in given:
                    continue
                if default is None or default == "":
                    if self._found.is_full(MISSING_SUBTREE_PORT):
                        break
                    message = (
                        f"<SubTree> lacks the port '{port}', which the model of '{call.tree_id}' requires"
                    )
                    hint = f'write {port}="…", or declare a default in <TreeNodesModel>'
                    self._report(MISSING_SUBTREE_PORT, message, plan.element, "", hint)
                else:
                    given[port] = default
        call.written = given
        for key, text in given.items():
            # In a SubTree "=" is a constant, and only "{=}" stands for the key of the same name. As the
            # default of a model it stands for the key "=".
            outer = braced_key(text)
            if outer is not None:
                call.remaps[key] = key if text == "{=}" and key in plan.element.attributes else outer
            else:
                call.constants[key] = text

    def _connect_call_of_3(self, plan: NodePlan, call: SubtreeCall, tag: str) -> None:
        for key, text in plan.element.attributes.items():
            if key == "ID":
                continue
            if key == "__shared_blackboard" and tag == "SubTree":
                call.shared = self._read_bool(plan, key, text)
            elif key == "__autoremap" and tag == "SubTreePlus":
                call.autoremap = self._read_bool(plan, key, text)
            elif tag == "SubTree":
                call.written[key] = text
                # <SubTree> of format 3 has no braces: the text is the outer key itself.
                call.remaps[key] = text
            else:
                call.written[key] = text
                outer = braced_key(text, 3)
                if outer is not None:
                    call.remaps[key] = outer
                else:
                    call.constants[key] = text
                    # BehaviorTree.CPP 3.8 reads the attributes in order: autoremap maps those that follow.
                    if call.autoremap:
                        call.outer_constants.add(key)
        # Format 3 ignores the name of a call.
        plan.name = call.tree_id

    def _read_bool(self, plan: NodePlan, key: str, text: str) -> bool:
        try:
            return BOOL.from_text(text, self._dialect.format) is True
        except ConversionError:
            message = f"{key} must be 'true' or 'false', not '{text}'"
            self._report(NOT_A_BOOLEAN, message, plan.element, key)
            return False
