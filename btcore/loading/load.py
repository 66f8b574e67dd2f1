"""Load a tree from files or texts, or make a registered tree: all stages of loading in one call."""

import reprlib
from collections.abc import Callable, Iterable, Sequence
from os import PathLike

from btcore.blackboard.blackboard import Blackboard
from btcore.clock import Clock
from btcore.diagnostic_codes import UNDETERMINED_MAIN_TREE
from btcore.diagnostics import Diagnostic
from btcore.errors import TreeError
from btcore.loading.instantiate import instantiate
from btcore.registry.registry import Registry
from btcore.tree.tree import Tree
from btcore.xml.plan.plan import plan_document
from btcore.xml.read.document import CollectedDiagnostics, Document
from btcore.xml.read.read import PackageResolver, parse_file, parse_text


def load(
    path: str | PathLike[str],
    *more: str | PathLike[str],
    nodes: Registry | None = None,
    tree: str | None = None,
    format: int | None = None,
    packages: PackageResolver | None = None,
    confined: bool = False,
    resources: Sequence[object] = (),
    blackboard: Blackboard | None = None,
    clock: Clock | None = None,
    tick_limit: float | None = None,
) -> Tree:
    """Return the tree in an XML file, ready to be ticked.

    Args:
        path: The XML file.
        more: Further XML files, whose trees the first file may call without an include.
        nodes: The nodes and trees that the tree may use; default `Registry.standard`.
        tree: The ID of the tree to load; default the main tree of the first document.
        format: The XML format, 3 or 4; default the `BTCPP_format` of the first document, or 3 if it has none.
        packages: A function that returns the share directory of a ROS package that an `<include>` names.
        confined: Whether includes from outside of the folder of the main XML file are errors, for trees
            from strangers.
        resources: Objects that leaves get by the types of their parameters, for example a robot.
        blackboard: The blackboard of the main tree; it may have entries, and other trees may share it.
        clock: The clock; default the first of *resources* that is a clock, else the system's clock. The
            clock of a robot is not found by default: pass `clock=robot.clock`. Only `btcore.Run` uses the
            attribute `clock` of what a provider of a clock provides.
        tick_limit: The longest time (s, real time) for which a tick may repeat nodes; default no limit. See
            `Tree`.

    Raises:
        TreeError: The files have errors, see `TreeError`. It holds file, line and column of each.
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
    main, *shared = _parse_all(parse_file, (path, *more), confined)
    plans = plan_document(main, registry_or_standard(nodes), tree, format, shared, packages)
    return instantiate(plans, resources, blackboard, clock, tick_limit)


def loads(
    text: str,
    *more: str,
    nodes: Registry | None = None,
    tree: str | None = None,
    format: int | None = None,
    packages: PackageResolver | None = None,
    confined: bool = False,
    resources: Sequence[object] = (),
    blackboard: Blackboard | None = None,
    clock: Clock | None = None,
    tick_limit: float | None = None,
) -> Tree:
    """Return the tree in an XML text, ready to be ticked.

    Args:
        text: The XML. Paths of includes are relative to the working directory.
        more: Further XML texts, whose trees the first text may call.

    The other parameters and the exceptions are those of `load`; the folder of a text is the working
    directory.

    Examples:
        >>> import btcore
        >>> xml = '<root BTCPP_format="4"><BehaviorTree ID="Main"><AlwaysSuccess/></BehaviorTree></root>'
        >>> btcore.loads(xml).tick_while_running()
        <Status.SUCCESS: 2>
    """
    main, *shared = _parse_all(parse_text, (text, *more), confined)
    plans = plan_document(main, registry_or_standard(nodes), tree, format, shared, packages)
    return instantiate(plans, resources, blackboard, clock, tick_limit)


def make(
    id: str,
    /,
    *,
    nodes: Registry | None = None,
    format: int | None = None,
    packages: PackageResolver | None = None,
    resources: Sequence[object] = (),
    blackboard: Blackboard | None = None,
    clock: Clock | None = None,
    tick_limit: float | None = None,
) -> Tree:
    """Return a new instance of a tree that was registered with `Registry.add_trees`.

    Args:
        id: The ID of the tree.
        nodes: The registry of the tree. Whether includes are *confined* is an argument of its `add_trees`.

    The other parameters and the exceptions are those of `load`. An unknown tree is a TreeError, too.

    Examples:
        >>> import btcore
        >>> nodes = btcore.Registry.standard()
        >>> xml = '<root BTCPP_format="4"><BehaviorTree ID="Main"><AlwaysSuccess/></BehaviorTree></root>'
        >>> nodes.add_trees(xml)
        >>> first, second = btcore.make("Main", nodes=nodes), btcore.make("Main", nodes=nodes)
        >>> first is second
        False
    """
    registry = registry_or_standard(nodes)
    documents = registry.documents
    if not documents:
        hint = "register it: nodes.add_trees(…)"
        raise TreeError([Diagnostic(UNDETERMINED_MAIN_TREE, f"unknown tree '{id}'", hint=hint)])
    # The document of the tree; the last document if the tree is in an included file.
    main = next((document for document in reversed(documents) if _defines(document, id)), documents[-1])
    plans = plan_document(main, registry, id, format, packages=packages)
    return instantiate(plans, resources, blackboard, clock, tick_limit)


def _parse_all(
    parse: Callable[..., Document], inputs: Iterable[str | PathLike[str]], confined: bool
) -> list[Document]:
    """Parse files or texts.

    Raises:
        TreeError: Some cannot be read or parsed. It holds the errors of all of them.
    """
    documents: list[Document] = []
    errors: list[Diagnostic] = []
    for path_or_text in inputs:
        try:
            documents.append(parse(path_or_text, confined=confined))
        except TreeError as error:
            errors += error.diagnostics
    CollectedDiagnostics(tuple(errors)).raise_errors()
    return documents


def _defines(document: Document, tree: str) -> bool:
    return any(element.get("ID") == tree for element in document.root.iterchildren("BehaviorTree"))


def registry_or_standard(nodes: object) -> Registry:
    """Return the registry *nodes*; None stands for `Registry.standard`.

    Raises:
        TypeError: It is not a Registry.
    """
    if nodes is None:
        return Registry.standard()
    if not isinstance(nodes, Registry):
        raise TypeError(
            f"nodes={reprlib.repr(nodes)} is not a Registry: nodes = Registry.standard(); nodes.add(…)"
        )
    return nodes
