"""Find loops that never end a tick: they repeat, without a limit, nodes that are never RUNNING (W110)."""

from collections.abc import Iterable
from typing import Final

from btcore.blackboard.ports import PortRole
from btcore.diagnostic_codes import ENDLESS_TICK
from btcore.lint.check_context import CheckContext
from btcore.lint.possible_results import all_children_known, behaviour_of
from btcore.nodes.repeat import RepeatedNode
from btcore.registry.nodes_without_code import is_mock
from btcore.status import FAILURE, SUCCESS, NodeType
from btcore.xml.plan.tree_plan import NodePlan, TreePlan

_FOREVER: Final = -1
_CHECKED_WHILE_RUNNING: Final = "_while"  # the only pre-condition that may halt a node that is RUNNING
_SKIPPING: Final = frozenset({"_skipIf", "_while"})


class EndlessTickCheck:
    """Reports the loops of trees that never end a tick, each once."""

    def __init__(self, context: CheckContext) -> None:
        self._context = context
        # In format 3 a loop repeats within its own tick, so that no other node can halt it.
        self._repeats_at_once = context.plans.format == 3
        # The results of _may_pause and _has_action, because many loops may contain the same nodes.
        self._pauses: dict[NodePlan, bool] = {}
        self._acts: dict[NodePlan, bool] = {}

    def check(self, roots: Iterable[TreePlan]) -> None:
        """Check the trees *roots* and the trees that they call, which must not be recursive."""
        to_do = list(roots)
        done: set[str] = set()
        while to_do:
            tree = to_do.pop()
            if tree.id in done:
                continue
            done.add(tree.id)
            nodes = [tree.root] if tree.root is not None else []
            while nodes:
                node = nodes.pop()
                if _CHECKED_WHILE_RUNNING in node.conditions:
                    continue
                cls = behaviour_of(node.manifest.cls)
                if issubclass(cls, RepeatedNode):
                    self._check_loop(node, cls, tree)
                if self._repeats_at_once or cls.spec.never_pauses:
                    nodes += node.children
                    if node.subtree_call is not None and (inner := self._called(node)) is not None:
                        to_do.append(inner)

    def _check_loop(self, node: NodePlan, cls: type[RepeatedNode], tree: TreePlan) -> None:
        forever = any(
            binding.port.role is PortRole.REPETITIONS and binding.key is None and binding.literal == _FOREVER
            for binding in node.bindings
        )
        if not forever or len(node.children) != 1 or not all_children_known(node):
            return
        child = node.children[0]
        if self._may_pause(child):
            return
        label, repeated = node.label, child.label
        ends = self._context.results.results_of(child).results - {cls.repeat_on}
        # A loop that checks a condition may be endless by design: its actions may change what is checked.
        is_while_loop = FAILURE in ends or not _SKIPPING.isdisjoint(child.conditions)
        if is_while_loop and self._has_action(child):
            return
        until = "succeeds" if SUCCESS in ends else "fails" if FAILURE in ends else "is skipped"
        if ends:
            message = f"{label} does not end a tick until {repeated} {until}"
        else:
            message = f"{label} never ends a tick: it repeats {repeated} forever"
        message += ", and no node below it can be RUNNING"
        hint = "add a pause, such as a <Delay>, or limit the number of repetitions"
        context = self._context._replace(document=tree.definition.document)
        context.report(node, ENDLESS_TICK, message, hint=hint)

    def _may_pause(self, node: NodePlan) -> bool:
        """Return whether *node* may be RUNNING without requesting the next tick at once."""
        known = self._pauses.get(node)
        if known is None:
            known = self._pauses[node] = self._find_pause(node)
        return known

    def _find_pause(self, node: NodePlan) -> bool:
        if node.subtree_call is not None:
            inner = self._called(node)
            return inner is None or inner.root is None or self._may_pause(inner.root)
        if is_mock(node.manifest.cls) or not all_children_known(node):
            return True
        if behaviour_of(node.manifest.cls).spec.never_pauses:
            # A comprehension, because `any` would recurse on the stack of C, which is small for deep trees.
            return True in [self._may_pause(child) for child in node.children]
        return self._context.results.results_of(node).may_run

    def _has_action(self, node: NodePlan) -> bool:
        """Return whether *node* or a node below it is an action, which may change what conditions check."""
        known = self._acts.get(node)
        if known is None:
            known = self._acts[node] = self._find_action(node)
        return known

    def _find_action(self, node: NodePlan) -> bool:
        if node.subtree_call is not None:
            inner = self._called(node)
            return inner is None or inner.root is None or self._has_action(inner.root)
        is_action = node.manifest.spec.node_type is NodeType.ACTION
        return is_action or True in [self._has_action(child) for child in node.children]

    def _called(self, node: NodePlan) -> TreePlan | None:
        return None if node.subtree_call is None else self._context.plans.trees.get(node.subtree_call.tree_id)
