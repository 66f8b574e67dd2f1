"""What the builder tells a node of itself."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from btcore.blackboard.ports import Input, Output
from btcore.errors import NodeError

EMPTY_MAPPING: Final[Mapping[str, str]] = MappingProxyType({})
"""The scripts, or the attributes, of a node that has none: one for all, and unchangeable."""
# Plain dicts, since every tick of a leaf looks into them; nobody writes to these.
NO_INPUTS: Final[dict[str, Input]] = {}
NO_OUTPUTS: Final[dict[str, Output]] = {}
NO_ENUMS: Final[dict[str, int]] = {}


class NodeConfig:
    """What the builder knows of one node: its place in the tree and in the XML, and its ports.

    *inputs* and *outputs* map port names to what they are bound to; *scripts* maps ``_skipIf``
    and the like to their texts; *attributes* keeps every other attribute as written. The element
    begins in line *line* (from 1, 0 = none) of *file* ("" = a text).
    """

    __slots__ = (
        "attributes", "enums", "file", "format", "id", "inputs", "line", "name", "outputs", "path", "scripts",
        "uid",
    )  # fmt: skip

    def __init__(
        self,
        id: str,
        name: str = "",
        uid: int = 0,
        format: int = 4,
        file: str = "",
        line: int = 0,
        scripts: Mapping[str, str] = EMPTY_MAPPING,
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
        self.scripts = scripts
        self.attributes = attributes
        self.inputs: dict[str, Input] = NO_INPUTS
        self.outputs: dict[str, Output] = NO_OUTPUTS
        self.enums = enums

    def input(self, name: str) -> Input:
        """The input port *name*. Raises NodeError when the tree doesn't give it."""
        port = self.inputs.get(name)
        if port is None:
            raise NodeError(f"<{self.id}> needs port [{name}], which the tree does not give")
        return port

    def output(self, name: str) -> Output:
        """The output port *name*. Raises NodeError when the tree doesn't give it."""
        port = self.outputs.get(name)
        if port is None:
            raise NodeError(f"<{self.id}> writes port [{name}], which the tree does not give")
        return port

    @property
    def where(self) -> str:
        """``file:line`` of the element, "" if it comes from no document."""
        return f"{self.file or '<text>'}:{self.line}" if self.line else ""
