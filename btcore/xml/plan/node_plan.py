"""Plans of trees: what the document says about each node, with the ports and scripts of the node."""

from collections.abc import Iterator, Sequence

from btcore.blackboard.ports import SCRIPT_ROLES, Binding, Port, PortRole
from btcore.engine.node_config import EMPTY_MAPPING
from btcore.registry.manifest import Manifest
from btcore.xml.define import TreeDefinition
from btcore.xml.read.dialect import PRECONDITION_ATTRIBUTES
from btcore.xml.read.element import Element


class SubtreeCall:
    """A SubTree element: the tree that it calls, and how the two blackboards are connected.

    Attributes:
        tree: ID of the called tree.
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
        "autoremap", "constants", "element", "outer_constants", "remaps", "shared", "tree", "written",
    )  # fmt: skip

    def __init__(self, tree: str, element: Element) -> None:
        self.tree = tree
        self.element = element
        self.remaps: dict[str, str] = {}
        self.constants: dict[str, str] = {}
        self.written: dict[str, str] = {}
        self.autoremap = False
        self.shared = False
        self.outer_constants: set[str] = set()


class NodePlan:
    """One node of a tree definition.

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
