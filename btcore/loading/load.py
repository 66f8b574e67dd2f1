"""Load a tree from files or texts, or make a registered tree, in one call."""

import reprlib
from collections.abc import Callable, Iterable, Sequence
from os import PathLike
from typing import Any, TypeVar

from btcore.blackboard.blackboard import Blackboard
from btcore.clock import Clock
from btcore.diagnostic_codes import AMBIGUOUS_MAIN_TREE
from btcore.errors import Diagnostic, TreeError, XmlSyntaxError
from btcore.registry.registry import Registry
from btcore.tree.tree import Tree
from btcore.xml.build import build, pause_gc
from btcore.xml.plan.document_checks import analyse_document
from btcore.xml.read.document import Document, parse_file, parse_text
from btcore.xml.read.includes import PackageResolver

S = TypeVar("S")


@pause_gc()
def load(
    path: str | PathLike[str],
    *more: str | PathLike[str],
    nodes: Registry | None = None,
    resources: Sequence[object] = (),
    tree: str | None = None,
    blackboard: Blackboard | None = None,
    format: int | None = None,
    clock: Clock | None = None,
    packages: PackageResolver | None = None,
    tick_limit: float | None = None,
    confined: bool = False,
) -> Tree:
    """Return the tree in an XML file, ready to be ticked.

    Args:
        path: The XML file.
        more: Further XML files, whose trees the first file may call without an include.
        nodes: The nodes and trees that the tree may use; default `Registry.standard`.
        resources: Objects that leaves get by the types of their parameters, for example a robot.
        tree: The ID of the tree to load; default the main tree of the first file.
        blackboard: The blackboard of the main tree; it may have entries, and other trees may share it.
        format: The XML format, 3 or 4; default the `BTCPP_format` of the first file, or 3 if it has none.
        clock: The clock; default the first clock among *resources*, else the system's clock.
        packages: A function that returns the share directory of a ROS package that an `<include>` names.
        tick_limit: The longest time (s, real time) for which a tick may repeat nodes; default no limit. See
            `Tree`.
        confined: Whether includes from outside of the folder of the including XML file are errors, for trees
            from strangers.

    Raises:
        TreeError: The files have errors. It holds all of them, with file, line and column.
        TypeError: *nodes* is not a Registry, or *resources* is not a list.
        ValueError: *tick_limit* is not a positive number.

    Examples:
        >>> from pathlib import Path
        >>> import btcore
        >>> xml = '<root BTCPP_format="4"><BehaviorTree ID="Main"><AlwaysSuccess/></BehaviorTree></root>'
        >>> _ = Path("tree.xml").write_text(xml)
        >>> btcore.load("tree.xml").tick_while_running()
        <Status.SUCCESS: 2>
    """
    first, *others = _parse(parse_file, confined, path, *more)
    registry, given = _registry(nodes), _listed(resources)
    return build(first, registry, tree, format, blackboard, given, clock, packages, others, tick_limit)


@pause_gc()
def loads(
    text: str,
    *more: str,
    nodes: Registry | None = None,
    resources: Sequence[object] = (),
    tree: str | None = None,
    blackboard: Blackboard | None = None,
    format: int | None = None,
    clock: Clock | None = None,
    packages: PackageResolver | None = None,
    tick_limit: float | None = None,
    confined: bool = False,
) -> Tree:
    """Return the tree in an XML text, ready to be ticked.

    Args:
        text: The XML. Paths of includes are relative to the working directory.
        more: Further XML texts, whose trees the first text may call.
        nodes: As in `load`, like all following arguments.
        resources: As in `load`.
        tree: As in `load`.
        blackboard: As in `load`.
        format: As in `load`.
        clock: As in `load`.
        packages: As in `load`.
        tick_limit: As in `load`.
        confined: As in `load`, with the working directory as the folder.

    Raises:
        TreeError: The texts have errors. It holds all of them, with line and column.
        TypeError: *nodes* is not a Registry, or *resources* is not a list.
        ValueError: *tick_limit* is not a positive number.

    Examples:
        >>> import btcore
        >>> xml = '<root BTCPP_format="4"><BehaviorTree ID="Main"><AlwaysSuccess/></BehaviorTree></root>'
        >>> btcore.loads(xml).tick_while_running()
        <Status.SUCCESS: 2>
    """
    first, *others = _parse(parse_text, confined, text, *more)
    registry, given = _registry(nodes), _listed(resources)
    return build(first, registry, tree, format, blackboard, given, clock, packages, others, tick_limit)


@pause_gc()
def make(
    tree: str,
    *,
    nodes: Registry,
    resources: Sequence[object] = (),
    blackboard: Blackboard | None = None,
    format: int | None = None,
    clock: Clock | None = None,
    packages: PackageResolver | None = None,
    tick_limit: float | None = None,
) -> Tree:
    """Return a new instance of a tree that was registered with `Registry.add_trees`.

    Args:
        tree: The ID of the tree.
        nodes: The registry of the tree and its nodes.
        resources: As in `load`.
        blackboard: As in `load`.
        format: The XML format, 3 or 4; default the format of the tree's document.
        clock: As in `load`.
        packages: As in `load`.
        tick_limit: As in `load`.

    Raises:
        TreeError: There is no such tree, or the registered documents have errors. It holds all of them.
        TypeError: *nodes* is not a Registry, or *resources* is not a list.
        ValueError: *tick_limit* is not a positive number.

    Examples:
        >>> import btcore
        >>> nodes = btcore.Registry.standard()
        >>> xml = '<root BTCPP_format="4"><BehaviorTree ID="Main"><AlwaysSuccess/></BehaviorTree></root>'
        >>> nodes.add_trees(xml)
        >>> first, second = btcore.make("Main", nodes=nodes), btcore.make("Main", nodes=nodes)
        >>> first is second
        False
    """
    registry, given = _registry(nodes), _listed(resources)
    documents = registry.documents
    if not documents:
        hint = "register it: nodes.add_trees(…)"
        raise TreeError([Diagnostic(AMBIGUOUS_MAIN_TREE, f"unknown tree '{tree}'", hint=hint)])
    # The document of the tree; the last document if the tree is in an included file.
    main = next((document for document in reversed(documents) if _defines(document, tree)), documents[-1])
    return build(main, registry, tree, format, blackboard, given, clock, packages, tick_limit=tick_limit)


def required_resources(
    path: str | PathLike[str],
    *more: str | PathLike[str],
    nodes: Registry | None = None,
    tree: str | None = None,
    format: int | None = None,
    packages: PackageResolver | None = None,
    confined: bool = False,
) -> list[Any]:
    """Return the types of the resources that the leaves of a tree need, each once.

    Args:
        path: The XML file.
        more: As in `load`, like all following arguments.
        nodes: As in `load`.
        tree: As in `load`.
        format: As in `load`.
        packages: As in `load`.
        confined: As in `load`.

    Raises:
        TreeError: The files have errors.
        TypeError: *nodes* is not a Registry.

    Examples:
        >>> from pathlib import Path
        >>> import btcore
        >>> class Gripper:
        ...     pass
        >>> @btcore.action
        ... def grasp(gripper: Gripper):
        ...     pass
        >>> xml = '<root BTCPP_format="4"><BehaviorTree ID="Main"><Grasp/></BehaviorTree></root>'
        >>> _ = Path("grasp.xml").write_text(xml)
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(grasp)
        >>> btcore.required_resources("grasp.xml", nodes=nodes) == [Gripper]
        True
    """
    first, *others = _parse(parse_file, confined, path, *more)
    analysis = analyse_document(first, _registry(nodes), tree, format, packages, others)
    analysis.diagnostics.raise_errors()
    types: list[Any] = []
    for manifest in analysis.used_manifests():
        types += (resource for resource in manifest.required_resources if resource not in types)
    return types


def _parse(parse: Callable[[S], Document], confined: bool, *sources: S) -> list[Document]:
    """Return the documents of *sources*. Raise XmlSyntaxError, which holds the errors of all sources."""
    documents: list[Document] = []
    errors: list[Diagnostic] = []
    for source in sources:
        try:
            documents.append(parse(source))
        except XmlSyntaxError as error:
            errors += error.diagnostics
    if errors:
        raise XmlSyntaxError(errors)
    for document in documents if confined else ():
        document.confine()
    return documents


def _defines(document: Document, tree: str) -> bool:
    return any(element.get("ID") == tree for element in document.root.iterchildren("BehaviorTree"))


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
