"""What the builder tells a node of itself."""

from btcore.ports import Input, Output


class NodeConfig:
    """What the builder knows of one node: its place in the tree and in the XML, and its ports.

    *inputs* and *outputs* map port names to what they are bound to; *scripts* maps ``_skipIf``
    and the like to their texts; *attributes* keeps every other attribute as written. *where* is
    ``file:line`` of the element.
    """

    def __init__(self, id: str, name: str | None = None, where: str = "", format: int = 4) -> None:
        self.id = id
        self.name: str = id if name is None else name
        self.where = where
        self.format = format
        self.uid = 0
        self.path = self.name
        self.inputs: dict[str, Input] = {}
        self.outputs: dict[str, Output] = {}
        self.scripts: dict[str, str] = {}
        self.attributes: dict[str, str] = {}
        self.enums: dict[str, int] = {}
