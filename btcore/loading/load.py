"""From a file or a text to a tree, in one call."""

import reprlib
from collections.abc import Iterable, Sequence
from os import PathLike
from typing import Any

from btcore.blackboard.blackboard import Blackboard
from btcore.clock import Clock
from btcore.registry.registry import Registry
from btcore.tree.tree import Tree
from btcore.xml.build import build, required_resources_of
from btcore.xml.read.document import parse_file, parse_text
from btcore.xml.read.includes import PackageResolver


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

    Raises TreeError with every fault found, each with file, line and column, and TypeError for *nodes* or
    *resources* that are no such thing.
    """
    return build(
        parse_file(path),
        _registry(nodes),
        tree=tree,
        format=format,
        blackboard=blackboard,
        resources=_listed(resources),
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
        parse_text(text),
        _registry(nodes),
        tree=tree,
        format=format,
        blackboard=blackboard,
        resources=_listed(resources),
        clock=clock,
        packages=packages,
    )


def required_resources(
    path: str | PathLike[str],
    *,
    nodes: Registry | None = None,
    tree: str | None = None,
    format: int | None = None,
    packages: PackageResolver | None = None,
) -> list[Any]:
    """The types of the resources that the leaves of the tree in *path* ask for. Raises as :func:`load`."""
    return required_resources_of(
        parse_file(path), _registry(nodes), tree=tree, format=format, packages=packages
    )


def _registry(nodes: object) -> Registry:
    """*nodes*, or by default the standard ones. Raises TypeError for what is no registry."""
    if nodes is None:
        return Registry.standard()
    if not isinstance(nodes, Registry):
        raise TypeError(
            f"nodes={reprlib.repr(nodes)} is no Registry: nodes = Registry.standard(); nodes.add(…)"
        )
    return nodes


def _listed(resources: object) -> Sequence[object]:
    """*resources* as a list. Raises TypeError for a single thing."""
    if isinstance(resources, (str, bytes)) or not isinstance(resources, Iterable):
        raise TypeError(f"resources={reprlib.repr(resources)} is no list: write resources=[…]")
    return list(resources)
