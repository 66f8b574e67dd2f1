"""What a tree is made from: its nodes with their ports sorted out, checked once per definition."""

from collections.abc import Mapping
from typing import cast

from lxml import etree

from btcore.errors import ConversionFault
from btcore.manifest import Manifest
from btcore.ports import Port, pointer
from btcore.values import BOOL
from btcore.xml.dialect import AFTER, BEFORE, EXPLICIT, SCRIPTS, Dialect, is_port_name
from btcore.xml.faults import Faults
from btcore.xml.forest import Definition, Forest, tree_hint
from btcore.xml.palette import Palette, port_hint
from btcore.xml.places import Part
from btcore.xml.shape import element_children


def attributes_of(element: etree._Element) -> list[tuple[str, str]]:
    """The attributes of *element*, in the order written."""
    return cast("list[tuple[str, str]]", element.items())


_CONTROL_CHARACTERS = frozenset(chr(code) for code in (*range(32), 127))


class NodePlan:
    """One node of a definition.

    *ports* are ports with their texts and whether the document writes them: those that it does, in its
    order, then defaults. *attributes* are all attributes that are neither ports nor scripts.
    """

    __slots__ = ("attributes", "call", "children", "element", "id", "manifest", "name", "ports", "scripts")

    def __init__(self, element: etree._Element, id: str, manifest: Manifest | None) -> None:
        self.element = element
        self.id = id
        self.manifest = manifest
        self.name: str | None = None
        self.ports: list[tuple[Port, str, bool]] = []
        self.scripts: dict[str, str] = {}
        self.attributes: dict[str, str] = {}
        self.children: list[NodePlan] = []
        self.call: Call | None = None


class Call:
    """A SubTree element: which tree it is, and how the blackboards are connected.

    *remaps* leads inner keys to outer ones, *constants* are texts for inner keys; *shared* is
    format 3's one blackboard for both; *every_key* its `__autoremap`, which maps the keys that the
    inner tree's ports name. *written* are its ports as the document (or the model) has them.
    """

    __slots__ = ("autoremap", "constants", "every_key", "remaps", "shared", "tree", "written")

    def __init__(self, tree: str) -> None:
        self.tree = tree
        self.remaps: dict[str, str] = {}
        self.constants: dict[str, str] = {}
        self.written: dict[str, str] = {}
        self.autoremap = False
        self.shared = False
        self.every_key = False


class TreePlan:
    """A definition with the plan of its nodes; *calls* are its SubTree nodes, *depth* its levels."""

    def __init__(self, definition: Definition, root: NodePlan | None) -> None:
        self.definition = definition
        self.root = root
        self.calls: list[NodePlan] = []
        self.depth = 0
        self.size = 0


class Planner:
    """Plans definitions as they are asked for; what is wrong goes to *faults*."""

    def __init__(
        self,
        forest: Forest,
        palette: Palette,
        subtree_models: Mapping[str, Mapping[str, str | None]],
        faults: Faults,
    ) -> None:
        self.forest = forest
        self.dialect: Dialect = forest.dialect
        self._palette = palette
        self._models = subtree_models
        self._faults = faults
        self._plans: dict[str, TreePlan] = {}
        self._converted: set[tuple[Port, str]] = set()
        self._document = forest.documents[-1]

    def plan(self, definition: Definition) -> TreePlan:
        """The plan of *definition*, without those of the trees that it calls."""
        known = self._plans.get(definition.id)
        if known is not None:
            return known
        self._document = definition.document
        children = element_children(definition.element)
        plan = TreePlan(definition, None)
        self._plans[definition.id] = plan
        if children:
            plan.root = self._node(children[0], plan, 1)
        return plan

    def _error(
        self,
        code: str,
        said: str,
        element: etree._Element,
        attribute: str,
        hint: str = "",
        name: bool = False,
    ) -> None:
        part: Part = "name" if name else "value"
        self._faults.add(self._document.diagnostic(code, said, element, attribute, part, hint))

    def _node(self, element: etree._Element, tree: TreePlan, depth: int) -> NodePlan | None:
        """The plan of *element*; None if nobody knows the node (the shape says so)."""
        tag = element.tag
        tree.size += 1
        if depth > tree.depth:
            tree.depth = depth
        if tag in self.dialect.subtree_tags:
            return self._subtree(tag, element, tree)
        id = str(element.get("ID") or "") if tag in EXPLICIT else tag
        manifest = self._palette.manifests.get(id)
        plan = NodePlan(element, id, manifest)
        if manifest is not None:
            self._attributes(plan, manifest)
        for child in element_children(element) if len(element) else ():
            planned = self._node(child, tree, depth + 1)
            if planned is not None:
                plan.children.append(planned)
        return plan if manifest is not None else None

    def _attributes(self, plan: NodePlan, manifest: Manifest) -> None:
        ports = manifest.ports
        bound = plan.ports
        checked = self.dialect.literals_checked
        for key, text in attributes_of(plan.element):
            port = ports.get(key)
            if port is not None:
                if checked and (port, text) not in self._converted:
                    self._literal(plan, port, text)
                bound.append((port, text, True))
            elif key == "name":
                self._name(plan, text)
            else:
                self._attribute(plan, manifest, key, text)
        if len(plan.scripts) > 1:
            order = [key for key in (*BEFORE, *AFTER) if key in plan.scripts]
            plan.scripts = {key: plan.scripts[key] for key in order}
        if len(bound) < len(ports):
            given = {port.name for port, _, _ in bound}
            for port in ports.values():
                if port.default is not None and port.name not in given:
                    bound.append((port, port.default, False))

    def _attribute(self, plan: NodePlan, manifest: Manifest, key: str, text: str) -> None:
        """An attribute that is neither a port nor the name."""
        dialect = self.dialect
        if key in SCRIPTS and dialect.free_underscore:
            plan.scripts[key] = text
        elif key == "ID":
            if dialect.explicit_by_id and plan.element.tag not in EXPLICIT:
                said = f'<{plan.id}> has an ID, which only explicit tags such as <Action ID="…"> have'
                self._error("E103", said, plan.element, key, 'to name the node, write name="…"')
        elif key in dialect.reserved or (dialect.free_underscore and not is_port_name(key)):
            plan.attributes[key] = text
        else:
            said = f"<{plan.id}> has no port '{key}'"
            self._error("E201", said, plan.element, key, port_hint(manifest, key), name=True)

    def _name(self, plan: NodePlan, text: str) -> None:
        plan.name = text
        if (
            not text.isprintable()
            and self.dialect.free_underscore
            and not _CONTROL_CHARACTERS.isdisjoint(text)
        ):
            self._error("E116", f"a name has no control characters, but {text!r} does", plan.element, "name")

    def _literal(self, plan: NodePlan, port: Port, text: str) -> None:
        """Refuse a *text* that is no ``{key}`` and doesn't convert to the type of *port*."""
        if len(text) >= 3 and text[0] == "{" and text[-1] == "}":
            return
        kind = port.type
        if not kind.strong or not kind.converts:
            return
        try:
            kind.from_text(text)
        except ConversionFault as fault:
            hint = ""
            if pointer(text, port.name) is not None:
                hint = "write {=}" if "=" in text else f"write {text.strip()}, without spaces around"
            elif is_port_name(text):
                hint = f"for the blackboard's entry write {{{text}}}"
            said = f"the port '{port.name}' of <{plan.id}> takes {kind.name}: {fault}"
            self._error("E202", said, plan.element, port.name, hint)
        else:
            self._converted.add((port, text))

    # --- SubTree elements

    def _subtree(self, tag: str, element: etree._Element, tree: TreePlan) -> NodePlan | None:
        id = str(element.get("ID") or "")
        plan = NodePlan(element, tag, self._palette.manifests.get(tag))
        call = Call(id)
        plan.call = call
        tree.calls.append(plan)
        if self.dialect.format == 3:
            self._call_of_3(plan, call, tag)
        else:
            self._call_of_4(plan, call)
        if id not in self.forest.by_id:
            if element.get("ID") is not None and self.forest.complete:
                self._error(
                    "E109", f"no tree is called '{id}'", element, "ID", tree_hint(id, self.forest.by_id)
                )
            return None
        return plan

    def _call_of_4(self, plan: NodePlan, call: Call) -> None:
        given: dict[str, str] = {}
        for key, text in attributes_of(plan.element):
            if key == "_autoremap":
                call.autoremap = self._truth(plan, key, text)
            elif key == "name":
                self._name(plan, text)
            elif key in SCRIPTS:
                plan.scripts[key] = text
            elif is_port_name(key):
                given[key] = text
            elif key != "ID":
                plan.attributes[key] = text
        if not call.autoremap:
            for port, default in self._models.get(call.tree, {}).items():
                if port in given:
                    continue
                if default is None or default == "":
                    said = (
                        f"<SubTree> is not given the port '{port}', which the model of '{call.tree}' demands"
                    )
                    hint = f'write {port}="…", or give it a default in <TreeNodesModel>'
                    self._error("E204", said, plan.element, "", hint)
                else:
                    given[port] = default
        call.written = given
        for key, text in given.items():
            outer = pointer(text, key) if text != "=" else None
            if outer is not None:
                call.remaps[key] = outer
            else:
                call.constants[key] = text

    def _call_of_3(self, plan: NodePlan, call: Call, tag: str) -> None:
        for key, text in attributes_of(plan.element):
            if key == "ID":
                continue
            if key == "__shared_blackboard" and tag == "SubTree":
                call.shared = self._truth(plan, key, text)
            elif key == "__autoremap" and tag == "SubTreePlus":
                call.every_key = self._truth(plan, key, text)
            elif tag == "SubTree":
                call.written[key] = text
                # Without braces: what is written is the outer key itself.
                call.remaps[key] = text
            else:
                call.written[key] = text
                outside = pointer(text, key, 3) if text != "=" else None
                if outside is not None:
                    call.remaps[key] = outside
                else:
                    call.constants[key] = text
        plan.name = call.tree

    def _truth(self, plan: NodePlan, key: str, text: str) -> bool:
        try:
            return BOOL.from_text(text, self.dialect.format) is True
        except ConversionFault:
            said = f"{key} is 'true' or 'false', not '{text}'"
            self._error("E207", said, plan.element, key)
            return False


def calling_order(planner: Planner, main: Definition, faults: Faults) -> list[TreePlan] | None:
    """The plans below *main* and its own, called trees before those that call them.

    None if trees call each other in a circle; every call that closes one goes to *faults*.
    """
    order: dict[str, TreePlan] = {}
    in_circle = False
    path: dict[str, None] = {}
    pending: list[tuple[str, bool]] = [(main.id, False)]
    while pending:
        id, leaving = pending.pop()
        if leaving:
            del path[id]
            order[id] = planner.plan(planner.forest.by_id[id])
            continue
        if id in order:
            continue
        path[id] = None
        pending.append((id, True))
        plan = planner.plan(planner.forest.by_id[id])
        for node in plan.calls:
            called = node.call.tree if node.call is not None else ""
            if called in path:
                in_circle = True
                way = [*path, called]
                said = f"the trees call each other in a circle: {' → '.join(way[way.index(called) :])}"
                document = plan.definition.document
                hint = "a tree can't contain itself"
                faults.add(document.diagnostic("E110", said, node.element, "ID", hint=hint))
            elif called in planner.forest.by_id and called not in order:
                pending.append((called, False))
    return None if in_circle else list(order.values())
