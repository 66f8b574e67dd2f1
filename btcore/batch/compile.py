"""From an ordinary tree to the nodes of a batch, or a refusal with the place of each node that can't be."""

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

from btcore.batch import branch, script_nodes
from btcore.batch.column_table import ColumnTable
from btcore.batch.context import BatchContext
from btcore.batch.expressions import compile_batch_script
from btcore.batch.leaf_declaration import LeafDeclaration
from btcore.batch.leaf_nodes import FunctionNode, StatefulNode
from btcore.batch.node import BatchConditions, BatchNode
from btcore.batch.ports import BatchInput, BatchOutput
from btcore.batch.script import Scope
from btcore.blackboard.blackboard import Blackboard
from btcore.blackboard.ports import remapped_key
from btcore.diagnostic_codes import NOT_FOR_A_BATCH
from btcore.engine.node import TreeNode
from btcore.errors import Diagnostic, NodeError, TreeError
from btcore.nodes.builtin_nodes import BUILTIN_NODES
from btcore.suggestions import nearest_name
from btcore.tree.tree import Tree


def batch_class(cls: type[TreeNode]) -> type[BatchNode] | None:
    """The counterpart that *cls* itself declares, not a base class of it."""
    declared = vars(cls).get("batch_class", "")
    if not declared:
        return None
    module, name = declared.split(":")
    found: type[BatchNode] = getattr(import_module(module), name)
    return found


class BatchCompiler:
    """Makes the nodes of a batch. *scopes* are the batch's, by the identity of the plan's blackboards."""

    def __init__(
        self,
        context: BatchContext,
        schema: ColumnTable,
        scopes: Mapping[int, Blackboard],
        leaves: Mapping[str, LeafDeclaration],
        resources: Sequence[object],
    ) -> None:
        self.context = context
        self.schema = schema
        self.scopes = scopes
        self.leaves = leaves
        self.resources = resources
        self.nodes: list[BatchNode] = []
        self.faults: list[Diagnostic] = []

    def compile(self, tree: Tree) -> BatchNode:
        """The root, for a batch; *nodes* are all in pre-order. Raises TreeError with every refusal."""
        if tree.format != 4:
            where = tree.root.config
            said = f"the batch engine runs trees of format 4, and '{tree.id}' is of format {tree.format}"
            hint = "btcore convert makes one of format 4 of it"
            raise TreeError([Diagnostic(NOT_FOR_A_BATCH, said, where.file, where.line, hint=hint)])
        root = self._node(tree.root)
        if self.faults:
            raise TreeError(self.faults)
        self.nodes.sort(key=lambda node: node.uid)
        return root

    def _refuse(self, plan: TreeNode, said: str, hint: str) -> None:
        config = plan.config
        self.faults.append(Diagnostic(NOT_FOR_A_BATCH, said, config.file, config.line, hint=hint))

    def _node(self, plan: TreeNode) -> BatchNode:
        children = [self._node(child) for child in plan.children]
        node = self._made(plan, children)
        self.nodes.append(node)
        scope = self._scope(plan)
        if plan.config.scripts:
            programs = {
                key: compile_batch_script(text, scope, node, self.context)
                for key, text in plan.config.scripts.items()
            }
            node.conditions = BatchConditions(programs)
        return node

    def _scope(self, plan: TreeNode) -> Scope:
        return Scope(self.schema, self.scopes[id(plan.blackboard)], plan.config.enums)

    def _made(self, plan: TreeNode, children: list[BatchNode]) -> BatchNode:
        kind = batch_class(type(plan))
        if kind is not None:
            node = kind(plan, self.context, children)
            self._connect(plan, node)
            return node
        leaf = self.leaves.get(plan.id)
        if leaf is not None and not children:
            made = FunctionNode if leaf.function is not None else StatefulNode
            try:
                return made(plan, self.context, leaf, self._connector(plan, leaf), self.resources)
            except NodeError as fault:
                self._refuse(plan, str(fault), "BatchTree.load(…, resources=[…]) takes the batch's own")
        else:
            self._refuse(plan, f"the batch engine doesn't run <{plan.id}>", self._hint(plan, children))
        return BatchNode(plan, self.context, children)

    def _hint(self, plan: TreeNode, children: list[BatchNode]) -> str:
        if children:
            known = [id for id, cls in BUILTIN_NODES[4].items() if batch_class(cls) is not None]
            return f"it runs {', '.join(sorted(known))}"
        guess = nearest_name(plan.id, self.leaves)
        meant = f"did you mean <{guess}>? " if guess else ""
        cure = f"write it for all agents at once, @batch.action(ID='{plan.id}'), and give it in leaves=[…]"
        return meant + cure

    def _connector(self, plan: TreeNode, leaf: LeafDeclaration) -> Any:
        declared = {port.name: port for port in leaf.ports}
        board = self.scopes[id(plan.blackboard)]

        def connect(node: BatchNode, name: str) -> BatchInput | BatchOutput:
            if name.endswith("="):
                bound = plan.config.outputs.get(name[:-1])
                return BatchOutput(node, self.context, self.schema, board, name[:-1], bound)
            given = plan.config.inputs.get(name)
            return BatchInput(node, self.context, self.schema, board, name, given, declared[name])

        return connect

    def _reader(self, plan: TreeNode, node: BatchNode, name: str) -> BatchInput:
        board = self.scopes[id(plan.blackboard)]
        return BatchInput(node, self.context, self.schema, board, name, plan.config.inputs.get(name))

    def _connect(self, plan: TreeNode, node: BatchNode) -> None:
        """Give a built-in node its ports and its script."""
        for port, attribute in node.input_ports.items():
            setattr(node, attribute, self._reader(plan, node, port))
        if isinstance(node, branch.Switch):
            count = plan.child_count[0]
            node.cases = [self._reader(plan, node, f"case_{number}") for number in range(1, count)]
        if node.script_port:
            self._script(plan, node, node.script_port)
        if isinstance(node, script_nodes.SetBlackboard):
            self._set_blackboard(plan, node)

    def _script(self, plan: TreeNode, node: Any, port: str) -> None:
        bound = plan.config.inputs[port]
        if bound.key is not None:
            said = f"the script of <{plan.id}> is on the blackboard, where each agent may have another"
            self._refuse(plan, said, f'write the script itself: {port}="…"')
            return
        node.program = compile_batch_script(str(bound.read()), self._scope(plan), node, self.context)

    def _set_blackboard(self, plan: TreeNode, node: script_nodes.SetBlackboard) -> None:
        inputs = plan.config.inputs
        target, value = inputs.get("output_key"), inputs.get("value")
        if target is None or target.key is not None or value is None:
            said = '<SetBlackboard> of a batch needs value="…" and the name of an entry in output_key="…"'
            self._refuse(plan, said, "write the name itself, without braces")
            return
        source = None if value.text in ("=", "{=}") else remapped_key(value.text, "value", 4)
        scope = self._scope(plan)
        node.connect(self.schema, scope.board, value.text, source, str(target.read()))
