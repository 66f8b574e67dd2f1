"""Plan one tree: check the attributes of its nodes, and find their manifests, ports and scripts."""

from operator import attrgetter

from btcore.blackboard.ports import Binding, Input, Port, braced_key
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
from btcore.errors import ConversionError
from btcore.names import is_port_name
from btcore.registry.manifest import Manifest
from btcore.values import BOOL
from btcore.xml.define import Definitions, TreeDefinition, tree_hint
from btcore.xml.plan.node_plan import NodePlan, SubtreeCall, TreePlan
from btcore.xml.plan.palette import NodePalette, port_hint
from btcore.xml.read.diagnostics import DiagnosticCollector
from btcore.xml.read.dialect import (
    EXPLICIT_TAGS,
    POSTCONDITION_ATTRIBUTES,
    PRECONDITION_ATTRIBUTES,
    SCRIPT_ATTRIBUTES,
    Dialect,
)
from btcore.xml.read.element import Element, ElementPart

_DEPTH_OF = attrgetter("depth")
_CONTROL_CHARACTERS = frozenset(chr(code) for code in (*range(32), 127))


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
    """What the planners of all trees of a document share: definitions, nodes, and what was found so far."""

    def __init__(self, definitions: Definitions, palette: NodePalette, found: DiagnosticCollector) -> None:
        self.definitions = definitions
        self.dialect: Dialect = definitions.dialect
        self.palette = palette
        self.found = found
        self.by_id: dict[str, BindingCache] = {}
        self.by_tag: dict[str, BindingCache] = {}
        # Names of attributes that _other_attributes() kept. Its decision depends only on the name, so it is
        # not called again for these names.
        self.kept: set[str] = set()


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
            self._nodes(nodes, plan)
        return plan

    def _error(
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

    def _nodes(self, nodes: list[NodePlan], tree: TreePlan) -> None:
        """Plan *nodes*, and remove unknown nodes, which are errors of the structure, from the tree."""
        tree.size = len(nodes)
        tree.depth = max(map(_DEPTH_OF, nodes))
        known_tags = self._context.by_tag
        unknown: set[NodePlan] = set()
        for node in nodes:
            tag = node.element.tag
            known = known_tags.get(tag)
            if known is None:
                if tag in self._dialect.subtree_tags:
                    if not self._subtree(tag, node, tree):
                        unknown.add(node)
                    continue
                known = self._look_up(tag, node.element)
                if known is None:
                    unknown.add(node)
                    continue
            node.id = known.id
            node.manifest = known.manifest
            self._attributes(node, known)
        if unknown:
            tree.has_unknown_nodes = True
            if tree.root in unknown:
                tree.root = None
            for node in nodes:
                node.children = [child for child in node.children if child not in unknown]

    def _look_up(self, tag: str, element: Element) -> BindingCache | None:
        """Return the bindings for the node that *element* names, or None if the node is unknown."""
        id = element.get("ID") or "" if tag in EXPLICIT_TAGS else tag
        known = self._context.by_id.get(id)
        if known is None:
            manifest = self._context.palette.get(id)
            if manifest is None:
                return None
            self._context.by_id[id] = known = BindingCache(id, manifest, self._dialect.format)
        if tag not in EXPLICIT_TAGS:
            self._context.by_tag[tag] = known
        return known

    def _attributes(self, plan: NodePlan, known: BindingCache) -> None:
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
                others = self._other_attributes(plan, known.manifest, others)
            plan.attributes = others
        if known.defaults and len(bindings) < len(known.bindings):
            given = {bound.port for bound in bindings}
            bindings += [bound for bound in known.defaults if bound.port not in given]
        plan.bindings = bindings

    def _other_attributes(self, plan: NodePlan, manifest: Manifest, others: dict[str, str]) -> dict[str, str]:
        """Return the attributes in *others* to keep. *others* holds neither ports nor the name.

        Scripts are stored in `plan.scripts`. Attributes that are neither kept nor scripts are errors.
        """
        dialect = self._dialect
        scripts: dict[str, str] = {}
        kept: dict[str, str] = {}
        for key, text in others.items():
            if key in SCRIPT_ATTRIBUTES and dialect.free_underscore:
                scripts[key] = text
            elif key == "ID":
                if dialect.explicit_by_id and plan.element.tag not in EXPLICIT_TAGS:
                    message = (
                        f'unexpected ID in <{plan.id}>: only explicit tags such as <Action ID="…"> have one'
                    )
                    self._error(UNEXPECTED_ID, message, plan.element, key, 'to name the node, write name="…"')
            elif key in dialect.reserved or (dialect.free_underscore and not is_port_name(key)):
                kept[key] = text
            else:
                message = f"<{plan.id}> has no port '{key}'"
                has_time = self._found.has_time_for_hint(manifest.ports)
                hint = port_hint(manifest, key) if has_time else ""
                self._error(UNKNOWN_PORT, message, plan.element, key, hint, name=True)
        if scripts:
            plan.scripts = {
                key: scripts[key]
                for key in (*PRECONDITION_ATTRIBUTES, *POSTCONDITION_ATTRIBUTES)
                if key in scripts
            }
        self._context.kept.update(kept)
        return kept

    def _check_name(self, plan: NodePlan, text: str) -> None:
        if self._dialect.free_underscore and not _CONTROL_CHARACTERS.isdisjoint(text):
            message = f"control character in the name {text!r}"
            self._error(CONTROL_CHARACTER_IN_NAME, message, plan.element, "name")

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
        self._error(INCONVERTIBLE_TEXT, message, plan.element, port.name, hint)
        return False

    # --- SubTree elements

    def _subtree(self, tag: str, plan: NodePlan, tree: TreePlan) -> bool:
        """Plan a SubTree element. Return whether the called tree exists."""
        element = plan.element
        id = element.get("ID") or ""
        plan.id = tag
        plan.manifest = self._context.palette.get(tag)
        call = SubtreeCall(id, element)
        plan.call = call
        tree.calls.append(call)
        if self._dialect.format == 3:
            self._call_of_3(plan, call, tag)
        else:
            self._call_of_4(plan, call)
        if id in self._context.definitions.by_id:
            return True
        if element.get("ID") is not None and self._context.definitions.are_complete:
            known = self._context.definitions.by_id
            hint = tree_hint(id, known) if self._found.has_time_for_hint(known) else ""
            self._error(UNKNOWN_TREE, f"unknown subtree '{id}'", element, "ID", hint)
        return False

    def _call_of_4(self, plan: NodePlan, call: SubtreeCall) -> None:
        given: dict[str, str] = {}
        scripts: dict[str, str] = {}
        attributes: dict[str, str] = {}
        for key, text in plan.element.attributes.items():
            if key == "_autoremap":
                call.autoremap = self._truth(plan, key, text)
            elif key == "name":
                plan.name = text
                self._check_name(plan, text)
            elif key in SCRIPT_ATTRIBUTES:
                scripts[key] = text
            elif is_port_name(key):
                given[key] = text
            elif key != "ID":
                attributes[key] = text
        plan.scripts, plan.attributes = scripts, attributes
        if not call.autoremap:
            for port, default in self._context.definitions.subtree_models.get(call.tree, {}).items():
                if port in given:
                    continue
                if default is None or default == "":
                    if self._found.is_full(MISSING_SUBTREE_PORT):
                        break
                    message = f"<SubTree> lacks the port '{port}', which the model of '{call.tree}' requires"
                    hint = f'write {port}="…", or declare a default in <TreeNodesModel>'
                    self._error(MISSING_SUBTREE_PORT, message, plan.element, "", hint)
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

    def _call_of_3(self, plan: NodePlan, call: SubtreeCall, tag: str) -> None:
        for key, text in plan.element.attributes.items():
            if key == "ID":
                continue
            if key == "__shared_blackboard" and tag == "SubTree":
                call.shared = self._truth(plan, key, text)
            elif key == "__autoremap" and tag == "SubTreePlus":
                call.autoremap = self._truth(plan, key, text)
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
        plan.name = call.tree

    def _truth(self, plan: NodePlan, key: str, text: str) -> bool:
        try:
            return BOOL.from_text(text, self._dialect.format) is True
        except ConversionError:
            message = f"{key} must be 'true' or 'false', not '{text}'"
            self._error(NOT_A_BOOLEAN, message, plan.element, key)
            return False
