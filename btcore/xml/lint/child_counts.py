"""E119: a number of children that the loader accepts, but for which every tick of the node raises."""

from collections.abc import Iterator

from btcore.blackboard.ports import PortRole
from btcore.diagnostic_codes import FIRST_TICK_REFUSED
from btcore.engine.node import TreeNode
from btcore.nodes.parallel import threshold
from btcore.xml.lint.advice import LintReporter
from btcore.xml.plan.document_checks import nodes_of
from btcore.xml.plan.plan import NodePlan, TreePlan
from btcore.xml.plan.structure_checks import element_children

_THRESHOLDS = {PortRole.SUCCESSES: "successes", PortRole.FAILURES: "failures"}
_HINT = "the tree loads, as in BehaviorTree.CPP, but the node raises when it is ticked"


def check_arity(plan: TreePlan, reporter: LintReporter) -> None:
    """Report the nodes of *plan* that raise in every tick because of the number of their children."""
    for node in nodes_of(plan):
        if node.manifest is None:
            continue
        # Unknown nodes are not in the plan, but count as children.
        count = len(element_children(node.element))
        has = "no child" if count == 0 else f"{count} children" if count > 1 else "1 child"
        requirement = _child_requirement(node.manifest.cls, count)
        if requirement:
            reporter.warn(
                FIRST_TICK_REFUSED,
                f"<{node.id}> has {has}; {requirement}",
                plan.definition.document,
                node,
                hint=_HINT,
            )
        for port, number, results in _thresholds(node, count):
            message = f"<{node.id}> has {has}, too few for {number} {results}"
            reporter.warn(FIRST_TICK_REFUSED, message, plan.definition.document, node, port, _HINT)


def _child_requirement(cls: type[TreeNode], count: int) -> str:
    """Return what a node of *cls* needs instead of *count* children, or "" if *count* is valid."""
    least, most = cls.child_count
    if cls.child_count == cls.child_count_at_load or (least <= count and (most is None or count <= most)):
        return ""
    if most is None:
        needed = f"at least {least}"
    else:
        needed = str(least) if most == least else f"{least} {'or' if most == least + 1 else 'to'} {most}"
    return f"it needs {needed}" + (f": {cls.child_roles}" if cls.child_roles else "")


def _thresholds(node: NodePlan, count: int) -> Iterator[tuple[str, int, str]]:
    """Yield name, number and kind of result for each port that requires more results than *count*."""
    for bound in node.bindings:
        results = _THRESHOLDS.get(bound.port.role)
        if results is not None and bound.key is None and isinstance(bound.literal, int):
            number = threshold(bound.literal, count)
            if number > count:
                yield bound.name, number, results
