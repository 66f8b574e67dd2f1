"""From a file or a text to a tree, in one call."""

from collections.abc import Sequence
from os import PathLike
from typing import Any

from btcore.blackboard import Blackboard
from btcore.clock import Clock
from btcore.registry import Registry
from btcore.tree import Tree
from btcore.xml.build import build, wanted_by
from btcore.xml.includes import PackageResolver
from btcore.xml.source import read_file, read_text


def load(
    path: str | PathLike[str],
    *,
    nodes: Registry | None = None,
    resources: Sequence[object] = (),
    tree: str | None = None,
    blackboard: Blackboard | None = None,
    format: int | None = None,
    clock: Clock | None = None,
    packages: PackageResolver | None = None,
) -> Tree:
    """The tree in the XML file *path*, ready to be ticked.

    - *nodes*: what tags it may use; default :meth:`Registry.standard`.
    - *resources*: what leaves ask for by type, say, a robot.
    - *tree*: the ID of the tree to make; default the document's main one.
    - *blackboard*: the main tree's, perhaps filled, perhaps shared with other trees.
    - *format*: 3 or 4; default what the document says (``BTCPP_format``; none = 3).
    - *clock*: default the first clock among *resources*, else the system's.
    - *packages*: finds the folder of a ROS package that an ``<include>`` names.

    Raises TreeError with every fault found, each with file, line and column.
    """
    return build(
        read_file(path),
        nodes if nodes is not None else Registry.standard(),
        tree=tree,
        format=format,
        blackboard=blackboard,
        resources=resources,
        clock=clock,
        packages=packages,
    )


def loads(
    text: str,
    *,
    nodes: Registry | None = None,
    resources: Sequence[object] = (),
    tree: str | None = None,
    blackboard: Blackboard | None = None,
    format: int | None = None,
    clock: Clock | None = None,
    packages: PackageResolver | None = None,
) -> Tree:
    """The tree in the XML *text*; as :func:`load`. Includes are sought from the working directory."""
    return build(
        read_text(text),
        nodes if nodes is not None else Registry.standard(),
        tree=tree,
        format=format,
        blackboard=blackboard,
        resources=resources,
        clock=clock,
        packages=packages,
    )


def wanted(
    path: str | PathLike[str],
    *,
    nodes: Registry | None = None,
    tree: str | None = None,
    format: int | None = None,
    packages: PackageResolver | None = None,
) -> list[Any]:
    """The types of the resources that the leaves of the tree in *path* ask for. Raises as :func:`load`."""
    registry = nodes if nodes is not None else Registry.standard()
    return wanted_by(read_file(path), registry, tree=tree, format=format, packages=packages)
