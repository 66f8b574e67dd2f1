"""E119: children that are too few or too many for the node's first tick, though not for loading it."""

from collections.abc import Iterator

from btcore.diagnostic_codes import FIRST_TICK_REFUSED
from btcore.nodes.branch import BranchNode
from btcore.nodes.format3 import Parallel3, WhileDoElse3
from btcore.nodes.parallel import Parallel, ParallelAll, threshold
from btcore.nodes.switch import SwitchNode
from btcore.xml.lint.advice import LintReporter
from btcore.xml.plan.document_checks import nodes_of
from btcore.xml.plan.plan import NodePlan, TreePlan
from btcore.xml.plan.structure_checks import element_children

_THRESHOLDS = {
    "success_count": "successes",
    "success_threshold": "successes",
    "failure_count": "failures",
    "failure_threshold": "failures",
    "max_failures": "failures",
}
_HINT = "the tree is loaded all the same, as by BehaviorTree.CPP, but the node raises when it is ticked"


def check_arity(plan: TreePlan, advice: LintReporter) -> None:
    """Tell of the nodes of *plan* that raise in every tick for the number of their children."""
    for node in nodes_of(plan):
        if node.manifest is None:
            continue
        # Unknown ones are no part of the plan, but they are children.
        count = len(element_children(node.element))
        has = "no child" if count == 0 else f"{count} children" if count > 1 else "1 child"
        wanted = _wanted(node.manifest.cls, count)
        if wanted:
            advice.warn(
                FIRST_TICK_REFUSED,
                f"<{node.id}> has {has}; {wanted}",
                plan.definition.document,
                node,
                hint=_HINT,
            )
        for port, number, what in _thresholds(node, count):
            said = f"<{node.id}> has {has}, which can never give {number} {what}"
            advice.warn(FIRST_TICK_REFUSED, said, plan.definition.document, node, port, _HINT)


def _wanted(cls: type, count: int) -> str:
    """What a node of *cls* needs instead of *count* children, or "" if that is fine."""
    if issubclass(cls, SwitchNode) and count != cls.cases + 1:
        return f"it needs {cls.cases + 1}: one for each of its {cls.cases} cases, and a default"
    if issubclass(cls, BranchNode) and count not in (2, 3):
        return "it needs 2 or 3: a condition, and one or two branches"
    if issubclass(cls, WhileDoElse3) and count != 3:
        return "it needs 3: a condition, and two branches"
    return ""


def _thresholds(node: NodePlan, count: int) -> Iterator[tuple[str, int, str]]:
    """The ports of a parallel *node* that ask for more results than *count* children give."""
    assert node.manifest is not None
    if not issubclass(node.manifest.cls, (Parallel, ParallelAll, Parallel3)):
        return
    for bound in node.bindings:
        what = _THRESHOLDS.get(bound.name)
        if what is not None and bound.key is None and isinstance(bound.literal, int):
            number = threshold(bound.literal, count)
            if number > count:
                yield bound.name, number, what
