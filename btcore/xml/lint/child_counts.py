"""E119: children that are too few or too many for the node's first tick, though not for loading it."""

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
_HINT = "the tree is loaded all the same, as by BehaviorTree.CPP, but the node raises when it is ticked"


def check_arity(plan: TreePlan, reporter: LintReporter) -> None:
    """Tell of the nodes of *plan* that raise in every tick for the number of their children."""
    for node in nodes_of(plan):
        if node.manifest is None:
            continue
        # Unknown ones are no part of the plan, but they are children.
        count = len(element_children(node.element))
        has = "no child" if count == 0 else f"{count} children" if count > 1 else "1 child"
        wanted = _wanted(node.manifest.cls, count)
        if wanted:
            reporter.warn(
                FIRST_TICK_REFUSED,
                f"<{node.id}> has {has}; {wanted}",
                plan.definition.document,
                node,
                hint=_HINT,
            )
        for port, number, what in _thresholds(node, count):
            message = f"<{node.id}> has {has}, which can never give {number} {what}"
            reporter.warn(FIRST_TICK_REFUSED, message, plan.definition.document, node, port, _HINT)


def _wanted(cls: type[TreeNode], count: int) -> str:
    """What a node of *cls* needs instead of *count* children, or "" if that is fine."""
    least, most = cls.child_count
    if cls.child_count == cls.child_count_at_load or (least <= count and (most is None or count <= most)):
        return ""
    if most is None:
        wanted = f"at least {least}"
    else:
        wanted = str(least) if most == least else f"{least} {'or' if most == least + 1 else 'to'} {most}"
    return f"it needs {wanted}" + (f": {cls.child_roles}" if cls.child_roles else "")


def _thresholds(node: NodePlan, count: int) -> Iterator[tuple[str, int, str]]:
    """The ports of *node* that ask for more results than *count* children give."""
    for bound in node.bindings:
        what = _THRESHOLDS.get(bound.port.role)
        if what is not None and bound.key is None and isinstance(bound.literal, int):
            number = threshold(bound.literal, count)
            if number > count:
                yield bound.name, number, what
