"""Getters and setters of ports that are attributes of a leaf.

The attributes are properties with these functions, and not compiled descriptors, because mypyc drops the
`__set__` of a descriptor class. The functions are in this module because it is compiled; their class,
`PortAttribute`, is in `signature.py`, which is not, because mypyc cannot compile a subclass of property.
"""

from collections.abc import Callable
from typing import Any, Final

from btcore.blackboard.ports import Port
from btcore.engine.node import TreeNode

PORT_PLACEHOLDER: Final = object()
"""The argument for a port in the `__init__` of a dataclass: assigning it to the port has no effect."""


def port_getter(port: Port) -> Callable[[Any], object]:
    """Return a function that reads *port* of a node, or raises AttributeError for an output."""
    name = port.name
    if not port.reads:

        def refuse(node: TreeNode) -> object:
            raise AttributeError(
                f"port [{name}] is an output: it can be assigned, but not read; to read and assign it, "
                "annotate it with InOut[…]"
            )

        return refuse

    def read(node: TreeNode) -> object:
        return node.config.input(name).read()

    return read


def port_setter(port: Port) -> Callable[[Any, object], None]:
    """Return a function that writes a value to *port* of a node, or raises AttributeError for an input."""
    name, writes = port.name, port.writes

    def write(node: TreeNode, value: object) -> None:
        if value is PORT_PLACEHOLDER:
            return
        if not writes:
            raise AttributeError(f"port [{name}] is an input: it can be read, but not assigned")
        node.config.output(name).write(value)

    return write
