"""The plans of nodes and trees, and the second pass of planning: attributes, ports and conditions.

The caches of `PlanContext` only save time: without them the plans are the same.
"""

from collections.abc import Iterator, Mapping, Sequence
from operator import attrgetter
from typing import TYPE_CHECKING

from btcore.blackboard.ports import SCRIPT_ROLES, Binding, Input, Port, PortRole, braced_key
from btcore.diagnostic_codes import (
    CONTROL_CHARACTER_IN_NAME,
    INCONVERTIBLE_TEXT,
    MISSING_SUBTREE_PORT,
    NOT_A_BOOLEAN,
    UNEXPECTED_ID,
    UNKNOWN_PORT,
    UNKNOWN_TREE,
    DiagnosticCode,
)
from btcore.diagnostics import Hint
from btcore.engine.node_config import EMPTY_MAPPING
from btcore.errors import ConversionError
from btcore.fixes import CreateTree, Remove, RenameAttribute, SetAttributes, SetValue
from btcore.names import POSTCONDITION_ATTRIBUTES, PRECONDITION_ATTRIBUTES, SCRIPT_ATTRIBUTES, is_port_name
from btcore.registry.manifest import Manifest
from btcore.registry.registry import Registry
from btcore.values import BOOL
from btcore.xml.define import Definitions, TreeDefinition, tree_hint
from btcore.xml.read.diagnostic_collector import DiagnosticCollector
from btcore.xml.read.dialect import EXPLICIT_TAGS, Dialect
from btcore.xml.read.element import Element, ElementPart

if TYPE_CHECKING:
    from btcore.xml.plan.hints import UnknownNodeHints

_DEPTH_OF = attrgetter("depth")
_CONTROL_CHARACTERS = frozenset(chr(code) for code in (*range(32), 127))


class SubtreeCall:
    """A SubTree element: the tree that it calls, and how the two blackboards are connected.

    Args:
        format: The XML format, 3 or 4.
        defaults: The ports that the called tree's model declares, with their defaults.

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
        invalid_flags: The attributes that must be `true` or `false`, but are not.
    """

    __slots__ = (
        "autoremap", "constants", "element", "format", "invalid_flags", "outer_constants", "port_texts",
        "remaps", "shares_blackboard", "tree_id",
    )  # fmt: skip

    def __init__(self, element: Element, format: int, defaults: Mapping[str, str | None]) -> None:
        self.tree_id = element.get("ID") or ""
        self.element = element
        self.format = format
        self.remaps: dict[str, str] = {}
        self.constants: dict[str, str] = {}
        self.port_texts: dict[str, str] = {}
        self.autoremap = False
        self.shares_blackboard = False
        self.outer_constants: set[str] = set()
        self.invalid_flags: list[str] = []
        if format == 3:
            self._connect_3()
        else:
            self._connect_4(defaults)

    def outer_key(self, key: str) -> str | None:
        """Return the key of the calling tree whose entry a key of the called tree names.

        None means an entry of the called tree itself; or of the main tree, if the key begins with `@`.
        """
        is_4 = self.format == 4
        if self.shares_blackboard:
            return key
        if key in self.remaps or (is_4 and key.startswith("@")):
            return self.remaps.get(key)
        if key in self.constants:
            return key if key in self.outer_constants else None
        return key if self.autoremap and not (is_4 and key.startswith("_")) else None

    def _connect_4(self, defaults: Mapping[str, str | None]) -> None:
        for key, text in self.element.attributes.items():
            if key == "_autoremap":
                self.autoremap = self._read_flag(key, text)
            elif key != "ID" and key != "name" and is_port_name(key):
                self.port_texts[key] = text
        if not self.autoremap:
            for key, default in defaults.items():
                if default and key not in self.port_texts:
                    self.port_texts[key] = default
        for key, text in self.port_texts.items():
            # In a SubTree "=" is a constant, and only "{=}" stands for the key of the same name. As the
            # default of a model it stands for the key "=".
            outer = braced_key(text)
            if outer is not None:
                self.remaps[key] = key if text == "{=}" and key in self.element.attributes else outer
            else:
                self.constants[key] = text

    def _connect_3(self) -> None:
        tag = self.element.tag
        for key, text in self.element.attributes.items():
            if key == "ID":
                continue
            if key == "__shared_blackboard" and tag == "SubTree":
                self.shares_blackboard = self._read_flag(key, text)
            elif key == "__autoremap" and tag == "SubTreePlus":
                self.autoremap = self._read_flag(key, text)
            else:
                self.port_texts[key] = text
                # <SubTree> of format 3 has no braces: the text is the outer key itself.
                outer = text if tag == "SubTree" else braced_key(text, 3)
                if outer is not None:
                    self.remaps[key] = outer
                else:
                    self.constants[key] = text
                    # BehaviorTree.CPP 3.8 reads the attributes in order: autoremap maps those that follow.
                    if self.autoremap:
                        self.outer_constants.add(key)

    def _read_flag(self, key: str, text: str) -> bool:
        try:
            return BOOL.from_text(text, self.format) is True
        except ConversionError:
            self.invalid_flags.append(key)
            return False


class NodePlan:
    """The plan of a node.

    `outline_trees` creates it with *element*, *depth* and *children*; `TreePlanner` adds everything else.

    Attributes:
        element: The element of the node.
        depth: The depth of the element; that of the `<BehaviorTree>` is 0.
        id: The ID of the node.
        manifest: The registration of the node; None if it is unknown.
        name: The name of the node; None = its ID.
        conditions: The texts of the pre- and post-conditions, by attribute.
        attributes: The attributes that are neither ports nor conditions.
        bindings: The ports that the document sets, in its order, then the other ports that have a default.
        children: The plans of the children.
        subtree_call: The call of a tree; None for all nodes except SubTree.
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

    def iter_scripts(self) -> Iterator[tuple[str, str, bool]]:
        """Yield (attribute, text, whether the script is a condition) for each script of the node."""
        for attribute, text in self.conditions.items():
            yield attribute, text, attribute in PRECONDITION_ATTRIBUTES
        for binding in self.bindings:
            if binding.port.role in SCRIPT_ROLES and binding.key is None:
                yield binding.name, binding.text, binding.port.role is PortRole.CONDITION


class TreePlan:
    """A tree definition with its node plans.

    Attributes:
        definition: The definition of the tree.
        root: The plan of the root; None if the tree has no known root.
        calls: The calls of trees by its nodes.
        depth: The number of its levels.
        size: The number of its nodes.
        has_unknown_nodes: Whether plans of unknown nodes were removed.
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


class KnownNode:
    """A registered node, with a cache of the bindings of its ports: node plans with equal texts share them.

    Attributes:
        bindings_by_text: The bindings by the name of the port, then by its text.
        defaults: A binding for each port that has a default.
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
        self._unknown_node_hints: UnknownNodeHints | None = None

    def manifest(self, id: str) -> Manifest | None:
        """Return the manifest of a node, or None if it is unknown in the format of the document."""
        return self.registry.get(id, self.dialect.format)

    def unknown_node_hint(self, id: str) -> Hint:
        """Return a hint for a node that is not registered."""
        if self._unknown_node_hints is None:
            from btcore.xml.plan.hints import UnknownNodeHints  # only errors need it

            self._unknown_node_hints = UnknownNodeHints(self.definitions, self.registry, self.collector)
        return self._unknown_node_hints.hint(id)


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
        hint: str | Hint = "",
        part: ElementPart = "value",
    ) -> None:
        document = self._definition.document
        self._collector.add(document.diagnostic(code, message, element, attribute, hint, part))

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
                if known is None:  # reported by the first pass
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
            set_ports = {binding.port for binding in bindings}
            bindings += [binding for binding in known.defaults if binding.port not in set_ports]
        node.bindings = bindings

    def _select_attributes(
        self, node: NodePlan, manifest: Manifest, attributes: dict[str, str]
    ) -> dict[str, str]:
        """Return those of *attributes* that are kept. They hold neither ports nor the name.

        Conditions are stored in *node*. Attributes that are neither kept nor conditions are errors.
        """
        dialect = self._dialect
        conditions: dict[str, str] = {}
        kept: dict[str, str] = {}
        for key, text in attributes.items():
            if key in SCRIPT_ATTRIBUTES and dialect.has_conditions:
                conditions[key] = text
            elif key == "ID":
                if dialect.requires_explicit_tag_for_id and node.element.tag not in EXPLICIT_TAGS:
                    message = (
                        f'unexpected ID in <{node.id}>: only explicit tags such as <Action ID="…"> have one'
                    )
                    fixes = (RenameAttribute("name"), Remove())
                    hint = Hint('to name the node, write name="…"', fixes)
                    self._report(UNEXPECTED_ID, message, node.element, key, hint)
            elif key in dialect.comment_attributes or (
                dialect.allows_non_port_attributes and not is_port_name(key)
            ):
                kept[key] = text
            else:
                from btcore.xml.plan.hints import port_hint  # only errors need it

                message = f"<{node.id}> has no port '{key}'"
                may_search = self._collector.take_comparisons(manifest.ports)
                hint = port_hint(manifest, key) if may_search else Hint()
                self._report(UNKNOWN_PORT, message, node.element, key, hint, part="name")
        if conditions:
            node.conditions = {
                key: conditions[key]
                for key in (*PRECONDITION_ATTRIBUTES, *POSTCONDITION_ATTRIBUTES)
                if key in conditions
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
        port_type = port.type
        if not port.checks_text:
            return True
        error = binding.error
        if binding.key is not None or text == port.default:
            # The binding has not converted the text.
            try:
                port_type.from_text(text)
            except ConversionError as conversion_error:
                error = str(conversion_error)
        if not error:
            return True
        from btcore.xml.plan.hints import value_hint  # only errors need it

        hint = value_hint(port_type)
        if binding.key is not None:
            key = "{=}" if "=" in text else text.strip()
            fix = SetValue(key, is_safe=True)
            hint = Hint(f"write {key}" + (" without surrounding spaces" if key != "{=}" else ""), (fix,))
        elif is_port_name(text):
            fix = SetValue(f"{{{text}}}")
            hint = Hint(f"to use the blackboard entry, write {{{text}}}", (*hint.fixes, fix))
        message = f"the port '{port.name}' of <{node.id}> has the type {port_type.name}: {error}"
        self._report(INCONVERTIBLE_TEXT, message, node.element, port.name, hint)
        return False

    # --- SubTree elements

    def _plan_call(self, tag: str, node: NodePlan, tree: TreePlan) -> bool:
        element = node.element
        format, definitions = self._dialect.format, self._context.definitions
        node.id = tag
        node.manifest = self._context.manifest(tag)
        id = element.get("ID") or ""
        model = definitions.subtree_models.get(id, {})
        node.subtree_call = call = SubtreeCall(element, format, model)
        tree.calls.append(call)
        if format == 3:
            node.name = id  # format 3 ignores the name of a call
        else:
            self._select_call_attributes(node, call)
        self._report_call(call, model)
        if id in definitions.by_id:
            return True
        if element.get("ID") is not None and definitions.are_complete:
            trees = definitions.by_id
            hint = tree_hint(id, trees) if self._collector.take_comparisons(trees) else Hint()
            if id:
                hint = Hint(hint.text, (*hint.fixes, CreateTree(id)))
            self._report(UNKNOWN_TREE, f"unknown subtree '{id}'", element, "ID", hint)
        return False

    def _select_call_attributes(self, node: NodePlan, call: SubtreeCall) -> None:
        conditions: dict[str, str] = {}
        attributes: dict[str, str] = {}
        for key, text in node.element.attributes.items():
            if key == "name":
                node.name = text
                self._check_name(node, text)
            elif key in SCRIPT_ATTRIBUTES:
                conditions[key] = text
            elif key not in call.port_texts and key != "ID" and key != "_autoremap":
                attributes[key] = text
        node.conditions, node.attributes = conditions, attributes

    def _report_call(self, call: SubtreeCall, model: Mapping[str, str | None]) -> None:
        element = call.element
        for key in call.invalid_flags:
            from btcore.xml.plan.hints import value_hint  # only errors need it

            message = f"{key} must be 'true' or 'false', not '{element.get(key)}'"
            self._report(NOT_A_BOOLEAN, message, element, key, value_hint(BOOL))
        if call.format == 3 or call.autoremap:
            return
        for port, default in model.items():
            if default or port in call.port_texts:
                continue
            if self._collector.is_full(MISSING_SUBTREE_PORT):
                break
            message = f"<SubTree> lacks the port '{port}', which the model of '{call.tree_id}' requires"
            fix = SetAttributes({port: f"{{{port}}}"})
            hint = Hint(f'write {port}="…", or declare a default in <TreeNodesModel>', (fix,))
            self._report(MISSING_SUBTREE_PORT, message, element, "", hint)
