"""A port as an attribute of a leaf: what reading it and assigning it does."""

from collections.abc import Callable
from typing import Any, Final

from btcore.blackboard.ports import Port
from btcore.engine.node import TreeNode

PORT_PLACEHOLDER: Final = object()
"""What a generated ``__init__`` (a dataclass's) is given for a port, whose value the tree has."""


def port_getter(port: Port) -> Callable[[Any], object]:
    """A function of a node that reads its *port*."""
    name = port.name
    if not port.reads:

        def refuse(node: TreeNode) -> object:
            raise AttributeError(f"port [{name}] is written, not read")

        return refuse

    def read(node: TreeNode) -> object:
        return node.config.input(name).read()

    return read


def port_setter(port: Port) -> Callable[[Any, object], None]:
    """A function of a node and a value that writes it to the node's *port*."""
    name, writes = port.name, port.writes

    def write(node: TreeNode, value: object) -> None:
        if value is PORT_PLACEHOLDER:
            return
        if not writes:
            raise AttributeError(f"port [{name}] is read, not written")
        node.config.output(name).write(value)

    return write
