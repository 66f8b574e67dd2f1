"""The table of built-in nodes, collected from the modules of this package."""

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Final

from btcore.engine.node import TreeNode


def node_classes() -> Iterator[type[TreeNode]]:
    """Yield the node classes defined in the modules of the package, in alphabetical order of the modules."""
    # Not by pkgutil, because importing it takes longer than this.
    stems = sorted(file.stem for file in Path(__file__).parent.glob("*.py") if file.stem != "__init__")
    for module in (f"btcore.nodes.{stem}" for stem in stems):
        if module != __name__:
            for cls in vars(import_module(module)).values():
                if isinstance(cls, type) and cls.__module__ == module and issubclass(cls, TreeNode):
                    yield cls


def _id_of(cls: type[TreeNode]) -> str:
    """Return the name of a class, without the final 3 of a class of format 3 alone, such as `Repeat3`."""
    return cls.__name__.removesuffix("3") if cls.spec.formats == (3,) else cls.__name__


BUILTIN_NODES: Final[dict[int, dict[str, type[TreeNode]]]] = {
    format: {_id_of(cls): cls for cls in node_classes() if format in cls.spec.formats} for format in (3, 4)
}
"""The classes of the built-in nodes by format and ID."""
