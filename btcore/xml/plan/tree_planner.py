"""Make the plans of trees in two passes: first their nodes, then the attributes and ports of the nodes."""

from collections.abc import Mapping
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Final

from btcore.blackboard.ports import Binding, Input, Port
from btcore.diagnostic_codes import (
    CAPITALISED_ROOT,
    CONTROL_CHARACTER_IN_NAME,
    INCONVERTIBLE_TEXT,
    INVALID_NAME,
    MISSING_ID,
    MISSING_SUBTREE_PORT,
    NOT_A_BOOLEAN,
    SEVERAL_ASYNC_SEQUENCES,
    TOO_DEEP,
    TREE_NAMED_AS_NODE,
    TREE_TOO_LARGE,
    UNEXPECTED_ID,
    UNKNOWN_NODE,
    UNKNOWN_PORT,
    UNKNOWN_TREE,
    UNREACHABLE_CHILD,
    WRONG_CHILD_COUNT,
)
from btcore.diagnostics import HintAndFixes
from btcore.engine.node_config import MAX_NODES
from btcore.errors import ConversionError
from btcore.fixes import (
    AddChildren,
    CreateTree,
    Fix,
    RemoveAttribute,
    RemoveChildren,
    RemoveElement,
    RenameAttribute,
    SetAttributes,
    SetValue,
    wrapping_fixes,
)
from btcore.names import (
    FORBIDDEN,
    RESERVED_IDS,
    SCRIPT_ATTRIBUTES,
    forbidden_in,
    is_port_name,
)
from btcore.registry.manifest import Manifest
from btcore.registry.registry import Registry
from btcore.status import NodeType
from btcore.suggestions import child_count_text
from btcore.values import BOOL, ValueType
from btcore.values.types import literals_of
from btcore.xml.define import Definitions, TreeDefinition, tree_hint
from btcore.xml.plan.tree_plan import NodePlan, SubtreeCall, TreePlan
from btcore.xml.read.document import DiagnosticCollector
from btcore.xml.read.element import Element
from btcore.xml.read.tags import CONTROLS_WITH_CHILDREN_IN_3, EXPLICIT_TAGS, SUBTREE_TAGS

if TYPE_CHECKING:
    from btcore.xml.plan.hints import UnknownNameHints

MAX_SUGGESTED_TREES: Final = 20
"""Maximum number of trees that are suggested for a SubTree element without an ID."""
_LEAF_PHRASES: Final = {NodeType.ACTION: "an action", NodeType.CONDITION: "a condition"}
_CONTROL_CHARACTERS = frozenset(chr(code) for code in (*range(32), 127))


def _one_child_hint(count: int) -> HintAndFixes:
    return HintAndFixes("put them into a <Sequence>", wrapping_fixes(1)) if count else _more_children_hint(1)


def _more_children_hint(count: int, roles: str = "") -> HintAndFixes:
    text = "add a child" if count == 1 else f"add {count} children"
    return HintAndFixes(f"{text}: {roles}" if roles else text, [AddChildren(count)])


class _BindingCache:
    """The bindings of a node's ports: the plans of nodes with the same ID and equal texts share them.

    Attributes:
        bindings_by_port: The bindings by the name of the port, then by its text.
        defaults: A binding for each port that has a default.
    """

    __slots__ = ("bindings_by_port", "defaults", "manifest", "ports")

    def __init__(self, manifest: Manifest, format: int) -> None:
        self.manifest = manifest
        self.ports = manifest.ports
        self.bindings_by_port: dict[str, dict[str, Binding]] = {name: {} for name in manifest.ports}
        self.defaults = [
            (Input if port.reads else Binding)(port, port.default, format, is_explicit=False)
            for port in manifest.ports.values()
            if port.default is not None
        ]


def value_fixes(value_type: ValueType) -> tuple[Fix, ...]:
    """Return the fixes of a literal that is not of the type *value_type*."""
    literals = literals_of(value_type)
    return (SetValue(*literals),) if literals else ()


def _literal_error(binding: Binding) -> str:
    """Return why a text is neither a `{key}` nor a literal of the port's type, or ""."""
    port, text = binding.port, binding.text
    is_key = len(text) >= 3 and text[0] == "{" and text[-1] == "}"  # possibly in the notation of format 3
    if is_key or not port.checks_text:
        return ""
    if binding.key is None and text != port.default:
        return binding.error
    try:  # the binding has not converted the text
        port.type.from_text(text)
    except ConversionError as error:
        return str(error)
    return ""


class PlanningContext:
    """What the planners of a document's trees share. `leaf_tags` and the cache of bindings only save time.

    Attributes:
        leaf_tags: The tags of registered leaves so far.
    """

    def __init__(self, definitions: Definitions, registry: Registry, collector: DiagnosticCollector) -> None:
        self.definitions = definitions
        self.format = definitions.format
        self.collector = collector
        self.leaf_tags: set[str] = set()
        self.registry = registry
        self._binding_caches: dict[str, _BindingCache | None] = {}
        self._name_hints: UnknownNameHints | None = None

    @property
    def name_hints(self) -> "UnknownNameHints":
        """The hints for unknown names."""
        if self._name_hints is None:
            from btcore.xml.plan.hints import UnknownNameHints  # only errors need it

            self._name_hints = UnknownNameHints(self.definitions, self.registry, self.collector)
        return self._name_hints

    def manifest(self, id: str) -> Manifest | None:
        """Return the manifest of a node; None if it is unknown."""
        return self.registry.get(id, self.format)

    def binding_cache(self, id: str) -> _BindingCache | None:
        """Return the cache for the bindings of a node; None if the node is unknown."""
        if id not in self._binding_caches:
            manifest = self.manifest(id)
            cache = None if manifest is None else _BindingCache(manifest, self.format)
            self._binding_caches[id] = cache
        return self._binding_caches[id]


class _Item:
    """A node that the first pass has found.

    Attributes:
        element: The element of the node.
        depth: The depth of the element; that of the `<BehaviorTree>` is 0.
        parent: The index of the parent in the list of items.
    """

    __slots__ = ("depth", "element", "parent")

    def __init__(self, element: Element, depth: int, parent: int) -> None:
        self.element = element
        self.depth = depth
        self.parent = parent


class TreePlanner:
    """Plans one tree in two passes, and reports its errors.

    The first pass, `outline`, concerns all trees, because BehaviorTree.CPP rejects a document in which an
    unused tree has a wrong structure. The second, `plan`, concerns the trees that are used.
    """

    def __init__(self, definition: TreeDefinition, context: PlanningContext) -> None:
        # The result of the first pass: the <BehaviorTree> and its nodes, in pre-order.
        self._items: list[_Item] = []
        self._definition = definition
        self._context = context
        self._definitions = context.definitions
        self._format = context.format
        self._collector = context.collector
        self._report = partial(context.collector.report, definition.document)

    # --- the first pass: find the nodes, and check the structure of the tree

    def outline(self) -> None:
        """Find the nodes, and check the structure of the tree."""
        definition, leaf_tags = self._definition, self._context.leaf_tags
        items: list[_Item] = []
        # Ignored nodes are checked, as in BehaviorTree.CPP, but not planned.
        ignored: set[_Item] = set()
        pending = [_Item(definition.element, 0, 0)]
        while pending:
            item = pending.pop()
            if item not in ignored:
                items.append(item)
            if len(items) > MAX_NODES + 1:  # the first is the <BehaviorTree>
                message = f"the tree has more than {MAX_NODES:,} nodes"
                hint = "nodes are numbered with 16 bits"
                self._report(TREE_TOO_LARGE, message, definition.element, attribute="ID", hint=hint)
                return
            element, depth, index = item.element, item.depth + 1, len(items) - 1
            if element.tag in leaf_tags and not element.children:  # most elements need no further check
                continue
            children = [_Item(child, depth, index) for child in self._check_element(element, depth)]
            pending += reversed(children)
            if self._ignores_children(element.tag) or item in ignored:
                ignored.update(children)
            elif not item.depth:  # a tree has one root: further roots are an error, and ignored
                ignored.update(children[1:])
        self._items = items

    def _check_element(self, element: Element, child_depth: int) -> list[Element]:
        """Check the tag, the number of the children and their depth. Return the children to check next."""
        tag, children, format = element.tag, element.children, self._format
        if children:
            children = element.node_children()
            if len(children) != len(element.children):
                message, removal = "the obsolete <Root> is ignored", [RemoveElement(is_safe=True)]
                for obsolete in element.iterchildren("Root"):
                    self._report(CAPITALISED_ROOT, message, obsolete, hint="remove it", fixes=removal)
        if tag == "BehaviorTree":
            self._check_tree(element, children)
        elif tag in SUBTREE_TAGS[format]:
            self._check_call(tag, element, children)
        elif tag in EXPLICIT_TAGS:
            self._check_explicit(tag, element, children)
        elif (manifest := self._context.manifest(tag)) is None:
            advice = self._context.name_hints.for_node(tag)
            self._report(UNKNOWN_NODE, f"unknown node <{tag}>", element, *advice)
        elif manifest.type in _LEAF_PHRASES:
            self._context.leaf_tags.add(tag)
            if format == 4:  # format 3 ignores them
                self._check_child_count(manifest, manifest.type, element, children)
        elif format == 4 or tag in CONTROLS_WITH_CHILDREN_IN_3 or manifest.type is NodeType.DECORATOR:
            self._check_child_count(manifest, manifest.type, element, children)
        limit = self._definition.document.max_depth
        if children and child_depth > limit:
            hint = "split the tree into subtrees"
            self._report(TOO_DEEP, f"elements are nested more than {limit:,} deep", element, hint=hint)
            return []
        return [] if tag == "SubTree" and format == 3 else children

    def _ignores_children(self, tag: str) -> bool:
        return tag == "SubTreePlus" and self._format == 3

    def _check_explicit(self, tag: str, element: Element, children: list[Element]) -> None:
        id = element.get("ID") or ""
        if not id:
            message, hint = f"the ID of the node is missing in <{tag}>", f'write <{tag} ID="…"/>'
            self._report(MISSING_ID, message, element, attribute="ID", hint=hint)
            return
        manifest = self._context.manifest(id)
        if manifest is None:
            advice = self._context.name_hints.for_node(id)
            self._report(UNKNOWN_NODE, f"unknown node '{id}'", element, *advice, attribute="ID")
            return
        node_type = manifest.type if self._format == 4 else EXPLICIT_TAGS[tag]  # 3: the tag decides
        self._check_child_count(manifest, node_type, element, children)

    def _check_child_count(
        self, manifest: Manifest, node_type: NodeType, element: Element, children: list[Element]
    ) -> None:
        label, count = f"<{manifest.id}>", len(children)
        if node_type is NodeType.DECORATOR:
            if count != 1:
                rule = "a decorator has exactly 1"
                self._report_child_count(label, count, rule, element, _one_child_hint(count))
        elif node_type is NodeType.CONTROL:
            least = max(manifest.spec.child_count_at_load[0], 1)
            if count < least:
                from btcore.registry.nodes_without_code import is_mock  # only errors need it

                rule = f"{'it' if least > 1 else 'a control node'} needs at least {least}"
                roles = manifest.spec.child_roles if least > 1 else ""
                # More children may be needed at the first tick than to load the tree.
                needed = least if is_mock(manifest.cls) else max(least, manifest.spec.child_count[0])
                advice = _more_children_hint(needed - count, roles)
                self._report_child_count(label, count, rule, element, advice)
            elif manifest.id == "ReactiveSequence":  # BehaviorTree.CPP's parser knows this name only
                self._check_asynchronous(children)
        elif count and node_type in _LEAF_PHRASES:
            advice = HintAndFixes("remove it" if count == 1 else "remove them", [RemoveChildren()])
            self._report_child_count(label, count, f"{_LEAF_PHRASES[node_type]} has none", element, advice)

    def _report_child_count(
        self, label: str, count: int, rule: str, element: Element, advice: HintAndFixes
    ) -> None:
        message = f"{label} has {child_count_text(count)}; {rule}"
        self._report(WRONG_CHILD_COUNT, message, element, *advice)

    def _check_asynchronous(self, children: list[Element]) -> None:
        # W106 covers other asynchronous children, whose results must be inferred.
        found = [child for child in children if child.tag == "AsyncSequence"]
        if len(found) > 1 and self._format == 4:
            message = "second AsyncSequence in a ReactiveSequence, which can have only one"
            hint = "only one child can be RUNNING at a time"
            self._report(SEVERAL_ASYNC_SEQUENCES, message, found[1], hint=hint)

    def _check_tree(self, element: Element, children: list[Element]) -> None:
        id = element.get("ID") or ""
        label = f"the tree '{id}'" if id else "the tree"
        if self._format == 4 and id:
            self._check_not_a_node(id, element)
            if not FORBIDDEN.isdisjoint(id):
                message = f"invalid tree ID '{id}': {forbidden_in(id)!r} is not allowed"
                hint = "use letters, digits, '_' and '-'"
                self._report(INVALID_NAME, message, element, attribute="ID", hint=hint)
            elif id in RESERVED_IDS:
                message = f"invalid tree ID '{id}': the name is reserved"
                self._report(INVALID_NAME, message, element, attribute="ID")
        count = len(children)
        if count != 1:
            self._report_child_count(label, count, "a tree has exactly 1", element, _one_child_hint(count))

    def _check_call(self, tag: str, element: Element, children: list[Element]) -> None:
        id = element.get("ID") or ""
        if element.get("ID") is None or (not id and self._format == 4):
            message = f"the ID of the tree is missing in <{tag}>"
            others = (tree_id for tree_id in self._definitions.by_id if tree_id != self._definition.id)
            fixes = [SetAttributes({"ID": other}) for other in islice(others, MAX_SUGGESTED_TREES)]
            hint = f'write <{tag} ID="…"/>'
            self._report(MISSING_ID, message, element, attribute="ID", hint=hint, fixes=fixes)
        elif self._format == 4:
            self._check_not_a_node(id, element)
        hint = "move them into the <BehaviorTree> that it calls, or remove them"
        if children and self._ignores_children(tag):
            message = f'the children of <{tag} ID="{id}"> are ignored'
            self._report(UNREACHABLE_CHILD, message, children[0], hint=hint)
        elif children:
            label, rule = f'<{tag} ID="{id}">', "a call of a tree has none"
            advice = HintAndFixes(hint, [RemoveChildren()])
            self._report_child_count(label, len(children), rule, element, advice)

    def _check_not_a_node(self, id: str, element: Element) -> None:
        if self._context.registry.is_taken(id, self._format):
            message, hint = f"invalid tree ID '{id}': a node has this name", "rename the tree"
            self._report(TREE_NAMED_AS_NODE, message, element, attribute="ID", hint=hint)

    # --- the second pass: plan the nodes with their attributes, conditions, ports and calls of trees

    def plan(self) -> TreePlan:
        """Return the plan of the tree, without unknown nodes and calls of unknown trees, which are errors."""
        tree_plan = TreePlan(self._definition)
        subtree_tags = SUBTREE_TAGS[self._format]
        plans: list[NodePlan | None] = [None]  # the <BehaviorTree> has no plan
        for item in self._items[1:]:
            element = item.element
            tag = element.tag
            node_plan: NodePlan | None = None
            if tag in subtree_tags:
                node_plan = self._plan_call(tag, element, tree_plan)
            else:
                id = (element.get("ID") or "") if tag in EXPLICIT_TAGS else tag
                cache = self._context.binding_cache(id)
                if cache is not None:  # else the first pass has reported the unknown node
                    node_plan = NodePlan(element, id, cache.manifest)
                    self._plan_attributes(node_plan, cache)
            plans.append(node_plan)
            parent = plans[item.parent]
            if node_plan is None:
                tree_plan.has_unknown_nodes = True
            elif parent is not None:
                parent.children.append(node_plan)
            elif item.depth == 1:
                tree_plan.root = node_plan
            tree_plan.size += 1
            tree_plan.depth = max(tree_plan.depth, item.depth)
        return tree_plan

    def _plan_attributes(self, node_plan: NodePlan, cache: _BindingCache) -> None:
        bindings: list[Binding] = []
        others: dict[str, str] = {}
        for key, text in node_plan.element.attributes.items():
            by_text = cache.bindings_by_port.get(key)
            if by_text is not None:
                port = cache.ports[key]
                bindings.append(by_text.get(text) or self._create_binding(node_plan, port, text, by_text))
            elif key == "name":
                node_plan.name = text
                if not text.isprintable():
                    self._check_name(node_plan, text)
            else:
                others[key] = text
        if others:
            if self._format == 4:
                node_plan.conditions = {key: others.pop(key) for key in SCRIPT_ATTRIBUTES if key in others}
            node_plan.attributes = self._select_attributes(node_plan, others)
        if cache.defaults and len(bindings) < len(cache.ports):
            set_ports = {binding.port for binding in bindings}
            bindings += [binding for binding in cache.defaults if binding.port not in set_ports]
        node_plan.bindings = bindings

    def _select_attributes(self, node_plan: NodePlan, others: Mapping[str, str]) -> dict[str, str]:
        """Return the attributes that a node may have beside its ports, of *others*; report the rest."""
        format, element = self._format, node_plan.element
        attributes = {}
        for key, text in others.items():
            if key == "ID":
                if format == 4 and element.tag not in EXPLICIT_TAGS:
                    rule = 'only explicit tags such as <Action ID="…"> have one'
                    message = f"unexpected ID in <{node_plan.id}>: {rule}"
                    hint = 'to name the node, write name="…"'
                    fixes = [RenameAttribute("name"), RemoveAttribute()]
                    self._report(UNEXPECTED_ID, message, element, hint, fixes, attribute=key)
            elif (format == 4 and not is_port_name(key)) or (format == 3 and key == "_description"):
                attributes[key] = text
            else:
                message = f"<{node_plan.id}> has no port '{key}'"
                advice = self._context.name_hints.for_port(node_plan.manifest, key)
                self._report(UNKNOWN_PORT, message, element, *advice, attribute=key, part="name")
        return attributes

    def _check_name(self, node_plan: NodePlan, text: str) -> None:
        if self._format == 4 and not _CONTROL_CHARACTERS.isdisjoint(text):
            message = f"control character in the name {text!r}"
            self._report(CONTROL_CHARACTER_IN_NAME, message, node_plan.element, attribute="name")

    def _create_binding(
        self, node_plan: NodePlan, port: Port, text: str, by_text: dict[str, Binding]
    ) -> Binding:
        """Return the binding of *port* to *text*, and cache it in *by_text* unless it is an error."""
        binding = (Input if port.reads else Binding)(port, text, self._format)
        error = _literal_error(binding) if self._format == 4 else ""  # 3: when a leaf reads the port
        if error:
            self._report_literal(node_plan, binding, error)
        else:
            by_text[text] = binding
        return binding

    def _report_literal(self, node_plan: NodePlan, binding: Binding, error: str) -> None:
        port, text = binding.port, binding.text
        hint, fixes = "", value_fixes(port.type)
        if binding.key is not None:
            key = "{=}" if "=" in text else text.strip()
            hint = f"write {key}" + (" without surrounding spaces" if key != "{=}" else "")
            fixes = (SetValue(key, is_safe=True),)
        elif is_port_name(name := text.strip("{}")):  # a brace may be missing
            hint = f"to use the blackboard entry, write {{{name}}}"
            fixes += (SetValue(f"{{{name}}}"),)
        message = f"the port '{port.name}' of <{node_plan.id}> has the type {port.type.name}: {error}"
        self._report(INCONVERTIBLE_TEXT, message, node_plan.element, hint, fixes, attribute=port.name)

    # --- SubTree elements

    def _plan_call(self, tag: str, element: Element, tree_plan: TreePlan) -> NodePlan | None:
        """Return the plan of a SubTree element; None if its node or the called tree is unknown."""
        manifest = self._context.manifest(tag)
        if manifest is None:
            advice = self._context.name_hints.for_node(tag)
            self._report(UNKNOWN_NODE, f"unknown node <{tag}>", element, *advice)
            return None
        format, definitions = self._format, self._definitions
        node_plan = NodePlan(element, tag, manifest)
        id = element.get("ID") or ""
        model = definitions.subtree_models.get(id, {})
        node_plan.subtree_call = call = SubtreeCall(element, format, model)
        tree_plan.calls.append(call)
        if format == 3:
            node_plan.name = id  # format 3 ignores the name of a call
        else:
            self._select_call_attributes(node_plan, call)
        self._check_connections(call, model)
        if id in definitions.by_id:
            return node_plan
        if element.get("ID") is not None and definitions.are_complete:
            trees = definitions.by_id
            hint, fixes = tree_hint(id, trees) if self._collector.take_comparisons(trees) else HintAndFixes()
            if id:
                fixes = [*fixes, CreateTree(id)]
            self._report(UNKNOWN_TREE, f"unknown subtree '{id}'", element, hint, fixes, attribute="ID")
        return None

    def _select_call_attributes(self, node_plan: NodePlan, call: SubtreeCall) -> None:
        conditions: dict[str, str] = {}
        attributes: dict[str, str] = {}
        for key, text in node_plan.element.attributes.items():
            if key == "name":
                node_plan.name = text
                self._check_name(node_plan, text)
            elif key in SCRIPT_ATTRIBUTES:
                conditions[key] = text
            elif key not in call.port_texts and key != "ID" and key != "_autoremap":
                attributes[key] = text
        node_plan.conditions, node_plan.attributes = conditions, attributes

    def _check_connections(self, call: SubtreeCall, model: Mapping[str, str | None]) -> None:
        element = call.element
        for key in call.invalid_flags:
            message = f"{key} must be 'true' or 'false', not '{element.get(key)}'"
            self._report(NOT_A_BOOLEAN, message, element, attribute=key, fixes=value_fixes(BOOL))
        if call.format == 3 or call.autoremap:
            return
        for port, default in model.items():
            if default or port in call.port_texts:
                continue
            if self._collector.is_full(MISSING_SUBTREE_PORT):
                break
            message = f"<SubTree> lacks the port '{port}', which the model of '{call.tree_id}' requires"
            hint = f'write {port}="…", or declare a default in <TreeNodesModel>'
            fixes = [SetAttributes({port: f"{{{port}}}"})]
            self._report(MISSING_SUBTREE_PORT, message, element, hint=hint, fixes=fixes)
