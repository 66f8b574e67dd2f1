"""One node as the document has it: first its element and place, then its ports and attributes."""

from collections.abc import Sequence

from btcore.blackboard.ports import Binding, Port
from btcore.engine.node_config import EMPTY_MAPPING
from btcore.registry.manifest import Manifest
from btcore.xml.read.element import Element


class SubtreeCall:
    """A SubTree element: which tree it is, and how the blackboards are connected.

    *remaps* leads inner keys to outer ones, *constants* are texts for inner keys; *shared* is
    format 3's one blackboard for both; *legacy_autoremap* its `__autoremap`, which maps the keys that the
    inner tree's ports name. *written* are its ports as the document (or the model) has them.
    """

    __slots__ = ("autoremap", "constants", "legacy_autoremap", "remaps", "shared", "tree", "written")

    def __init__(self, tree: str) -> None:
        self.tree = tree
        self.remaps: dict[str, str] = {}
        self.constants: dict[str, str] = {}
        self.written: dict[str, str] = {}
        self.autoremap = False
        self.shared = False
        self.legacy_autoremap = False


class NodePlan:
    """One node of a definition.

    *depth* counts from the ``<BehaviorTree>``, which has 0. *bindings* are those of its ports: what the
    document writes, in its order, then defaults. *attributes* are all attributes that are neither ports
    nor scripts.
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
        """The ports with their texts, and whether the document writes them."""
        return [(bound.port, bound.text, bound.is_explicit) for bound in self.bindings]
