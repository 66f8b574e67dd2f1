"""The table of built-in nodes, collected from the modules of this package."""

import pkgutil
from collections.abc import Iterator
from importlib import import_module
from typing import Final

import btcore.nodes
from btcore.engine.node import TreeNode


def node_classes() -> Iterator[type[TreeNode]]:
    """Yield the node classes defined in the modules of the package, in alphabetical order of the modules."""
    for module in pkgutil.iter_modules(btcore.nodes.__path__, "btcore.nodes."):
        if module.name != __name__:
            for thing in vars(import_module(module.name)).values():
                own = isinstance(thing, type) and thing.__module__ == module.name
                if own and issubclass(thing, TreeNode):
                    yield thing


def _by_id() -> dict[int, dict[str, type[TreeNode]]]:
    classes: dict[int, dict[str, type[TreeNode]]] = {3: {}, 4: {}}
    for cls in node_classes():
        # vars(), because these declarations are not inherited.
        own = vars(cls)
        for format in own.get("builtin_formats", ()):
            classes[format][own.get("builtin_id") or cls.__name__] = cls
    return classes


BUILTIN_NODES: Final = _by_id()
"""The classes of the built-in nodes by format and ID."""
