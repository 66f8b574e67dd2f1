"""Check the children of nodes: numbers with which every tick raises, and children not ticked as intended.

The codes are E119 (number of children), W105 (unreachable child) and W106 (second asynchronous child).
"""

from collections.abc import Iterator
from typing import Final

from btcore.blackboard.ports import PortRole
from btcore.diagnostic_codes import FIRST_TICK_REFUSED, SECOND_ASYNC_CHILD, UNREACHABLE_CHILD
from btcore.engine.control import ControlNode, DecoratorNode, results_in_order
from btcore.engine.node import TreeNode
from btcore.fixes import AddChildren, Fix, wrapping_fixes
from btcore.lint.check_context import CheckContext
from btcore.lint.possible_results import all_children_known, behaviour_of
from btcore.nodes.parallel import threshold
from btcore.nodes.sequences_and_fallbacks import ReactiveNode
from btcore.nodes.try_catch import TryCatch
from btcore.registry.nodes_without_code import is_mock
from btcore.status import FAILURE, SUCCESS, PossibleResults, Status
from btcore.suggestions import child_count_text
from btcore.xml.plan.tree_plan import NodePlan

_THRESHOLDS: Final = {PortRole.SUCCESSES: "successes", PortRole.FAILURES: "failures"}
_TICK_RAISES: Final = "the tree loads, as in BehaviorTree.CPP, but the node raises when it is ticked"
_WORD: Final = {SUCCESS: "succeeds", FAILURE: "fails"}


def check_child_count(node: NodePlan, context: CheckContext) -> None:
    """Report *node* if the loader accepts the number of its children, but every tick raises."""
    # Unknown nodes are not in the plan, but count as children.
    count = len(node.element.node_children())
    has = f"<{node.id}> has {child_count_text(count)}"
    requirement = _child_requirement(node.manifest.cls, count)
    is_leaf_in_3 = context.plans.format == 3 and node.element.tag in ("Action", "Condition")
    if is_leaf_in_3 and count == 0 and issubclass(node.manifest.cls, DecoratorNode):
        # Format 3 counts the children by the tag.
        requirement = "a decorator has exactly 1"
    if requirement:
        message, fixes = f"{has}; {requirement}", _fixes(node.manifest.cls, count)
        context.report(node, FIRST_TICK_REFUSED, message, hint=_TICK_RAISES, fixes=fixes)
    for port, number, results in _thresholds(node, count):
        message = f"{has}, too few for {number} {results}"
        context.report(node, FIRST_TICK_REFUSED, message, attribute=port, hint=_TICK_RAISES)


def _child_requirement(cls: type[TreeNode], count: int) -> str:
    """Return what a node of *cls* needs instead of *count* children, or "" if *count* is valid."""
    least, most = cls.spec.child_count
    if cls.spec.child_count == cls.spec.child_count_at_load or (
        least <= count and (most is None or count <= most)
    ):
        return ""
    if most is None:
        needed = f"at least {least}"
    else:
        needed = str(least) if most == least else f"{least} {'or' if most == least + 1 else 'to'} {most}"
    return f"it needs {needed}" + (f": {cls.spec.child_roles}" if cls.spec.child_roles else "")


def _fixes(cls: type[TreeNode], count: int) -> tuple[Fix, ...]:
    least, most = cls.spec.child_count
    if count < least:
        return (AddChildren(least - count),)
    return wrapping_fixes(most) if most is not None and 0 < most < count else ()


def _thresholds(node: NodePlan, count: int) -> Iterator[tuple[str, int, str]]:
    """Yield (port, number, kind of result) for each port that requires more results than *count* children."""
    for binding in node.bindings:
        results = _THRESHOLDS.get(binding.port.role)
        if results is not None and binding.key is None and isinstance(binding.literal, int):
            number = threshold(binding.literal, count)
            if number > count:
                yield binding.name, number, results


def check_reachable_children(node: NodePlan, context: CheckContext) -> None:
    """Warn about children of *node* that are never ticked, or that each tick halts."""
    if node.subtree_call is not None or len(node.children) < 2:
        return
    cls = behaviour_of(node.manifest.cls)
    if is_mock(node.manifest.cls) or not issubclass(cls, ControlNode) or not all_children_known(node):
        return
    children = [context.results.results_of(child) for child in node.children]
    continue_on = cls.spec.continue_on
    if continue_on is not None:
        # The last child of a TryCatch is its handler, which is ticked after a failure of the others.
        has_handler = issubclass(cls, TryCatch)
        tried = children[:-1] if has_handler else children
        _check_order(node, tried, continue_on, context)
        catches_halt = any(
            binding.name == "catch_on_halt" and binding.is_explicit for binding in node.bindings
        )
        if has_handler and not catches_halt and FAILURE not in results_in_order(tried, continue_on).results:
            _warn_unreached(node.children[-1], "the children before it never fail", context)
        if issubclass(cls, ReactiveNode):
            _check_asynchronous_children(node, children, continue_on, context)
    for chosen, branch in zip(cls.spec.branch_results, node.children[1:], strict=False):
        if chosen not in children[0].results:
            reason = f"the condition {node.children[0].label} never {_WORD[chosen]}"
            _warn_unreached(branch, reason, context)


def _check_order(
    node: NodePlan, children: list[PossibleResults], continue_on: Status, context: CheckContext
) -> None:
    """Warn about the first child that is never ticked, as the child before it never returns *continue_on*."""
    for index, outcome in enumerate(children[:-1]):
        if not outcome.passes(continue_on):
            before = node.children[index]
            # A child that is always RUNNING has no results.
            never = "ends" if not outcome.results else _WORD[continue_on]
            reason = f"{before.label} before it (line {context.document.line(before.element)}) never {never}"
            _warn_unreached(node.children[index + 1], reason, context)
            return  # the following children are unreachable for the same reason


def _warn_unreached(node: NodePlan, reason: str, context: CheckContext) -> None:
    message = f"{node.label} is never ticked: {reason}"
    context.report(node, UNREACHABLE_CHILD, message, hint="remove it, or the cause")


def _check_asynchronous_children(
    node: NodePlan, children: list[PossibleResults], continue_on: Status, context: CheckContext
) -> None:
    """Warn about a child that may be RUNNING after an earlier child that may be RUNNING.

    An earlier child that may let *node* continue in its first tick does not count.
    """
    first: NodePlan | None = None
    for child, outcome in zip(node.children, children, strict=True):
        if first is not None and outcome.may_run:
            before = f"{first.label} (line {context.document.line(first.element)})"
            message = (
                f"{child.label} is a second asynchronous child of <{node.id}>: each tick begins with "
                f"{before}, which halts {child.label} unless it completes at once"
            )
            hint = f"put both into a <{'Sequence' if continue_on is SUCCESS else 'Fallback'}>"
            context.report(child, SECOND_ASYNC_CHILD, message, hint=hint)
            return
        if not outcome.passes(continue_on):
            return
        passes_at_once = PossibleResults(outcome.in_first_tick).passes(continue_on)
        if first is None and outcome.may_run and not passes_at_once:
            first = child
