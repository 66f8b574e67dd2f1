"""The plans of trees, their nodes and their calls of other trees: what `plan` returns, before nodes exist."""

from collections.abc import Iterator, Mapping, Sequence

from btcore.blackboard.ports import SCRIPT_ROLES, Binding, PortRole, braced_key
from btcore.engine.node_config import EMPTY_MAPPING
from btcore.errors import ConversionError
from btcore.names import PRECONDITION_ATTRIBUTES, is_port_name
from btcore.registry.manifest import Manifest
from btcore.values import BOOL
from btcore.xml.define import TreeDefinition
from btcore.xml.read.element import Element


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

    Attributes:
        element: The element of the node.
        id: The ID of the node.
        manifest: The registration of the node.
        name: The name of the node; None = its ID.
        conditions: The texts of the pre- and post-conditions, by attribute.
        attributes: The attributes that are neither ports nor conditions.
        bindings: The ports that the document sets, in its order, then the other ports that have a default.
        children: The plans of the children.
        subtree_call: The call of a tree; None for all nodes except SubTree.
    """

    __slots__ = (
        "attributes", "bindings", "children", "conditions", "element", "id", "manifest", "name",
        "subtree_call",
    )  # fmt: skip

    def __init__(self, element: Element, id: str, manifest: Manifest) -> None:
        self.element = element
        self.id = id
        self.manifest = manifest
        self.name: str | None = None
        self.conditions = EMPTY_MAPPING
        self.attributes = EMPTY_MAPPING
        self.bindings: Sequence[Binding] = ()
        self.children: list[NodePlan] = []
        self.subtree_call: SubtreeCall | None = None

    @property
    def label(self) -> str:
        """The text that names the node in messages, such as `<Sleep>` or `<SubTree ID="Dock">`."""
        call = self.subtree_call
        return f"<{self.id}>" if call is None else f'<SubTree ID="{call.tree_id}">'

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
        has_unknown_nodes: Whether unknown nodes, which have no plans, are among them.
    """

    def __init__(self, definition: TreeDefinition) -> None:
        self.definition = definition
        self.root: NodePlan | None = None
        self.calls: list[SubtreeCall] = []
        self.depth = 0
        self.size = 0
        self.has_unknown_nodes = False

    @property
    def id(self) -> str:
        """The ID of the tree."""
        return self.definition.id

    def node_plans(self) -> list[NodePlan]:
        """Return the plans of the nodes in pre-order, without those of the trees that it calls."""
        node_plans: list[NodePlan] = []
        pending = [self.root] if self.root is not None else []
        while pending:
            node_plan = pending.pop()
            node_plans.append(node_plan)
            pending += reversed(node_plan.children)
        return node_plans
