"""The configuration that a node gets when it is created."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from btcore.blackboard.ports import Input, Output
from btcore.errors import NodeError

EMPTY_MAPPING: Final[Mapping[str, str]] = MappingProxyType({})
"""The conditions or attributes of a node that has none: one read-only mapping for all nodes."""
# Shared by many nodes, so never modify them. Plain dicts, because each tick reads them, and dicts are fast.
NO_INPUTS: Final[dict[str, Input]] = {}
NO_OUTPUTS: Final[dict[str, Output]] = {}
NO_ENUMS: Final[dict[str, int]] = {}

MAX_NODES: Final = 65_535
"""The maximum number of nodes of a tree: a uid has 16 bits in Groot's protocols, and 0 is not a uid."""


class NodeConfig:
    """The configuration of one node: its position in the tree and in the XML, and its ports.

    Attributes:
        id: The registration ID.
        name: The instance name.
        path: The full path, in BehaviorTree.CPP 4's notation.
        uid: The number of the node within the tree, from 1, in depth-first pre-order.
        format: The XML format of the tree, 3 or 4.
        inputs: The bindings of the input ports, by name.
        outputs: The bindings of the output ports, by name.
        conditions: The texts of the pre- and post-conditions, by attribute name, such as `_skipIf`.
        attributes: All other attributes, as written.
        enums: The enum names that scripts may use, with their numbers.
        file: The file of the element; "" = the XML was given as a text.
        line: The line in which the element begins, from 1; 0 = the node is not from a document.
    """

    __slots__ = (
        "attributes", "conditions", "enums", "file", "format", "id", "inputs", "line", "name", "outputs",
        "path", "uid",
    )  # fmt: skip

    def __init__(
        self,
        id: str,
        name: str = "",
        uid: int = 0,
        format: int = 4,
        file: str = "",
        line: int = 0,
        conditions: Mapping[str, str] = EMPTY_MAPPING,
        attributes: Mapping[str, str] = EMPTY_MAPPING,
        enums: dict[str, int] = NO_ENUMS,
    ) -> None:
        self.id = id
        self.name = name
        self.path = name
        self.uid = uid
        self.format = format
        self.file = file
        self.line = line
        self.conditions = conditions
        self.attributes = attributes
        self.inputs: dict[str, Input] = NO_INPUTS
        self.outputs: dict[str, Output] = NO_OUTPUTS
        self.enums = enums

    def input(self, name: str) -> Input:
        """Return input port *name*. Raise NodeError if it has neither a text in the XML nor a default."""
        port = self.inputs.get(name)
        if port is None:
            raise NodeError(f"<{self.id}> has no value for port [{name}]: set it in the tree")
        return port

    def output(self, name: str) -> Output:
        """Return output port *name*. Raise NodeError if it has neither a text in the XML nor a default."""
        port = self.outputs.get(name)
        if port is None:
            raise NodeError(f"<{self.id}> has no entry for port [{name}]: set it in the tree")
        return port

    @property
    def where(self) -> str:
        """`file:line` of the element, or "" if the node is not from a document."""
        return f"{self.file or '<text>'}:{self.line}" if self.line else ""
