"""Compilation of an ordinary tree, the plan, to the nodes of a batch."""

from collections.abc import Mapping

from btcore.engine.leaf import StatefulAction
from btcore.engine.node import TreeNode
from btcore.errors import Diagnostic, TreeError
from btcore.nodes.builtin_nodes import BUILTIN_NODES
from btcore.suggestions import nearest_name
from btcore.tree.tree import Tree
from btcore_batch.context import BatchContext
from btcore_batch.leaf_declaration import LeafDeclaration
from btcore_batch.leaf_nodes import FunctionNode, StatefulNode
from btcore_batch.node import BatchNode, unsupported
from btcore_batch.node_classes import BATCH_CLASSES


class BatchCompiler:
    """Creates the nodes of a batch.

    Args:
        context: The shared state of the batch.
        leaves: The declarations of the leaves, by registration ID.

    Attributes:
        nodes: All nodes, in pre-order after `compile`.
    """

    def __init__(self, context: BatchContext, leaves: Mapping[str, LeafDeclaration]) -> None:
        self.context = context
        self.leaves = leaves
        self.nodes: list[BatchNode] = []
        self._diagnostics: list[Diagnostic] = []

    def compile(self, tree: Tree) -> BatchNode:
        """Return the root of the batch for *tree*.

        Raises:
            TreeError: The batch engine cannot run *tree*; the error lists all nodes that it cannot run.
        """
        if tree.format != 4:
            message = f"the batch engine runs trees of format 4, and '{tree.id}' is of format {tree.format}"
            raise unsupported(tree.root.config, message, "convert it to format 4 with btcore convert")
        root = self._node(tree.root)
        if self._diagnostics:
            raise TreeError(self._diagnostics)
        self.nodes.sort(key=lambda node: node.uid)
        return root

    def _node(self, plan: TreeNode) -> BatchNode:
        children = [self._node(child) for child in plan.children]
        try:
            node = self._create(plan, children)
        except TreeError as error:
            # Continue with a placeholder, to report the errors of all nodes.
            self._diagnostics += error.diagnostics
            node = BatchNode(plan, self.context, children)
        self.nodes.append(node)
        return node

    def _create(self, plan: TreeNode, children: list[BatchNode]) -> BatchNode:
        cls = BATCH_CLASSES.get(type(plan))
        if cls is not None:
            return cls(plan, self.context, children)
        leaf = self.leaves.get(plan.config.id)
        if leaf is None or children:
            message = f"the batch engine does not run <{plan.config.id}>"
            raise unsupported(plan.config, message, self._hint(plan, children))
        leaf_class = StatefulNode if issubclass(leaf.base_class, StatefulAction) else FunctionNode
        return leaf_class(plan, self.context, leaf)

    def _hint(self, plan: TreeNode, children: list[BatchNode]) -> str:
        if children:
            supported = [ID for ID, cls in BUILTIN_NODES[4].items() if cls in BATCH_CLASSES]
            return f"it runs {', '.join(sorted(supported))}"
        nearest = nearest_name(plan.config.id, self.leaves)
        question = f"did you mean <{nearest}>? " if nearest else ""
        declared = f"@batch.action(ID='{plan.config.id}')"
        advice = f"write it for all agents at once, {declared}, and pass it in leaves=[…]"
        return question + advice
