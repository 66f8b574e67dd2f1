"""Load a tree from a file or a text in one call."""

import reprlib
from collections.abc import Iterable, Sequence
from os import PathLike
from typing import Any

from btcore.blackboard.blackboard import Blackboard
from btcore.clock import Clock
from btcore.registry.registry import Registry
from btcore.tree.tree import Tree
from btcore.xml.build import build, pause_gc
from btcore.xml.plan.document_checks import analyse_document
from btcore.xml.read.document import parse_file, parse_text
from btcore.xml.read.includes import PackageResolver


@pause_gc()
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
    """Return the tree in an XML file, ready to be ticked.

    Args:
        path: The XML file.
        nodes: The nodes that the tree may use; default :meth:`Registry.standard`.
        resources: Objects that leaves get by the types of their parameters, for example a robot.
        tree: The ID of the tree to load; default the main tree of the document.
        blackboard: The blackboard of the main tree; it may have entries, and other trees may share it.
        format: The XML format, 3 or 4; default the document's ``BTCPP_format``, or 3 if it has none.
        clock: The clock; default the first clock among *resources*, else the system's clock.
        packages: A function that returns the share directory of a ROS package that an ``<include>`` names.

    Raises:
        TreeError: The document has errors. It holds all of them, with file, line and column.
        TypeError: *nodes* is not a Registry, or *resources* is not a list.
    """
    return build(
        parse_file(path), _registry(nodes), tree, format, blackboard, _listed(resources), clock, packages
    )


@pause_gc()
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
    """Return the tree in an XML text, ready to be ticked.

    Args:
        text: The XML. Paths of includes are relative to the working directory.
        nodes: As in :func:`load`, like all following arguments.
        resources: As in :func:`load`.
        tree: As in :func:`load`.
        blackboard: As in :func:`load`.
        format: As in :func:`load`.
        clock: As in :func:`load`.
        packages: As in :func:`load`.

    Raises:
        TreeError: The document has errors. It holds all of them, with line and column.
        TypeError: *nodes* is not a Registry, or *resources* is not a list.
    """
    return build(
        parse_text(text), _registry(nodes), tree, format, blackboard, _listed(resources), clock, packages
    )


def required_resources(
    path: str | PathLike[str],
    *,
    nodes: Registry | None = None,
    tree: str | None = None,
    format: int | None = None,
    packages: PackageResolver | None = None,
) -> list[Any]:
    """Return the types of the resources that the leaves of a tree need, each once.

    Args:
        path: The XML file.
        nodes: The nodes that the tree may use; default :meth:`Registry.standard`.
        tree: The ID of the tree; default the main tree of the document.
        format: The XML format, 3 or 4; default the document's ``BTCPP_format``, or 3 if it has none.
        packages: A function that returns the share directory of a ROS package that an ``<include>`` names.

    Raises:
        TreeError: The document has errors.
        TypeError: *nodes* is not a Registry.
    """
    analysis = analyse_document(parse_file(path), _registry(nodes), tree, format, packages)
    analysis.diagnostics.raise_errors()
    types: list[Any] = []
    for manifest in analysis.used_manifests():
        types += (resource for resource in manifest.required_resources if resource not in types)
    return types


def _registry(nodes: object) -> Registry:
    """Return *nodes*, or the standard registry for None. Raise TypeError if *nodes* is not a registry."""
    if nodes is None:
        return Registry.standard()
    if not isinstance(nodes, Registry):
        raise TypeError(
            f"nodes={reprlib.repr(nodes)} is not a Registry: nodes = Registry.standard(); nodes.add(…)"
        )
    return nodes


def _listed(resources: object) -> Sequence[object]:
    """Return *resources* as a list. Raise TypeError for a single object."""
    # A text can be iterated, but is a single object here.
    if isinstance(resources, (str, bytes)) or not isinstance(resources, Iterable):
        raise TypeError(f"resources={reprlib.repr(resources)} is not a list: write resources=[…]")
    return list(resources)
