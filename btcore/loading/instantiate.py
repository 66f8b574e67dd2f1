"""Create a tree from its plans: the last stage of loading."""

from collections.abc import Sequence
from typing import TypeGuard

from btcore.blackboard.blackboard import Blackboard
from btcore.clock import Clock, SystemClock
from btcore.engine.context import TreeContext
from btcore.engine.node import TreeNode
from btcore.engine.node_config import NodeConfig
from btcore.registry.manifest import Resources
from btcore.registry.registry import Registry
from btcore.tree.tree import Subtree, Tree
from btcore.xml.node_creator import NodeCreator
from btcore.xml.plan.plan import Plans


def instantiate(
    plans: Plans,
    resources: Sequence[object] = (),
    blackboard: Blackboard | None = None,
    clock: Clock | None = None,
    tick_limit: float | None = None,
) -> Tree:
    """Create the nodes of the main tree, and return the tree.

    Args:
        plans: The plans.
        resources: As in `LoadArguments`, like all following arguments.
        blackboard: The blackboard of the main tree.
        clock: The clock.
        tick_limit: The limit of a tick (s).

    Raises:
        TreeError: The plans have errors, or nodes could not be created. It holds all errors.
    """
    plans.diagnostics.raise_errors()
    main = plans.main_tree
    assert main is not None, "a missing main tree is an error"
    creator = NodeCreator(plans, resources, clock or _find_clock(resources), blackboard)
    creator.create_nodes(main)
    creator.collector.diagnostics.raise_errors()
    return Tree(
        main.id,
        creator.format,
        [Subtree(part.plan.id, part.path, part.blackboard, part.nodes) for part in creator.instances],
        creator.nodes,
        creator.context,
        plans.registry,
        tick_limit,
    )


def make_leaf_tree(leaf: type[TreeNode], ID: str, clock: Clock) -> Tree:
    """Return a tree of a single leaf, which no document describes.

    Args:
        leaf: The class of the leaf, without parameters.
        ID: The ID of the leaf and, with the suffix `Alone`, of the tree.
        clock: The clock.
    """
    registry = Registry.standard()
    registry.add(leaf, ID=ID)
    manifest = registry.get(ID, 4)
    assert manifest is not None
    config = NodeConfig(ID, ID, uid=1)
    config.path = f"{ID}::1"
    context, board = TreeContext(clock), Blackboard(clock=clock)
    nodes = [manifest.make(config, context, board, Resources(()), [])]
    main = f"{ID}Alone"
    return Tree(main, 4, [Subtree(main, "", board, nodes)], nodes, context, registry)


def _find_clock(resources: Sequence[object]) -> Clock:
    """Return the first of *resources* that is a clock, or else the system clock.

    An attribute `clock` of a resource is not used: in an arbitrary object it may be anything. `btcore.Run`
    uses it only for the provider that declares a clock.
    """
    return next((resource for resource in resources if is_clock(resource)), None) or SystemClock()


def is_clock(thing: object) -> TypeGuard[Clock]:
    """Return whether *thing* has the methods of a clock."""
    return hasattr(thing, "now") and hasattr(thing, "wait_until")
