"""W105, W106: children that are never ticked, and reactive nodes whose children halt each other."""

from typing import Final

from btcore.diagnostic_codes import SECOND_ASYNC_CHILD, UNREACHABLE_CHILD
from btcore.engine.control import ControlNode, results_in_order
from btcore.status import FAILURE, SUCCESS, UNKNOWN_RESULTS, PossibleResults, Status
from btcore.xml.lint.advice import LintReporter, is_stub, line_of, node_label
from btcore.xml.lint.possible_results import behaviour_of, infer_results, with_conditions
from btcore.xml.plan.document_checks import nodes_of
from btcore.xml.plan.plan import NodePlan, TreePlan, TreePlanner
from btcore.xml.plan.structure_checks import element_children

_WORD: Final = {SUCCESS: "succeeds", FAILURE: "fails"}


class ResultAnalysis:
    """The possible results of the nodes of a document, computed on first use.

    *bounded* must be False if trees are recursive or too large: then SubTree calls are not followed.
    """

    def __init__(self, planner: TreePlanner, bounded: bool) -> None:
        self._planner = planner
        self._bounded = bounded
        self._known: dict[NodePlan, PossibleResults] = {}

    def results_of(self, node: NodePlan) -> PossibleResults:
        """Return the possible results of *node*, including the effect of its pre-conditions."""
        results = self._known.get(node)
        if results is None:
            self._known[node] = results = with_conditions(node, self._bare(node))
        return results

    def _bare(self, node: NodePlan) -> PossibleResults:
        if node.call is not None:
            inner = self._planner.definitions.by_id.get(node.call.tree) if self._bounded else None
            root = self._planner.plan(inner).root if inner is not None else None
            return self.results_of(root) if root is not None else UNKNOWN_RESULTS
        if node.manifest is None or not all_children_known(node):
            return UNKNOWN_RESULTS
        children = [self.results_of(child) for child in node.children]
        return infer_results(node, children)


def all_children_known(node: NodePlan) -> bool:
    """Return whether all children of *node* are known nodes."""
    return not node.element.children or len(node.children) == len(element_children(node.element))


def check_reach(plan: TreePlan, analysis: ResultAnalysis, reporter: LintReporter) -> None:
    """Warn about children in *plan* that are never ticked, or that each tick halts.

    Args:
        plan: The tree to check.
        analysis: The possible results of its nodes.
        reporter: Collects the warnings.
    """
    for node in nodes_of(plan):
        if (
            node.manifest is None
            or node.call is not None
            or not all_children_known(node)
            or len(node.children) < 2
        ):
            continue
        cls = behaviour_of(node.manifest.cls)
        if is_stub(node.manifest) or not issubclass(cls, ControlNode):
            continue
        children = [analysis.results_of(child) for child in node.children]
        going = cls.continue_on
        if going is not None:
            tried = children if cls.handler_port is None else children[:-1]
            _in_turn(plan, node, tried, going, reporter)
            never_fails = FAILURE not in results_in_order(tried, going).results
            if cls.handler_port is not None and never_fails and not _is_written(node, cls.handler_port):
                _unreached(plan, node.children[-1], "the children before it never fail", reporter)
            if cls.runs_one_child:
                _one_at_a_time(plan, node, children, going, reporter)
        for chosen, branch in zip(cls.branch_results, node.children[1:], strict=False):
            if chosen not in children[0].results:
                reason = f"the condition {node_label(node.children[0])} never {_WORD[chosen]}"
                _unreached(plan, branch, reason, reporter)


def _in_turn(
    plan: TreePlan, node: NodePlan, children: list[PossibleResults], going: Status, reporter: LintReporter
) -> None:
    for index, outcome in enumerate(children[:-1]):
        if not outcome.passes(going):
            before = node.children[index]
            where = line_of(plan.definition.document, before)
            never = "ends" if not outcome.results else _WORD[going]
            reason = f"{node_label(before)} before it ({where}) never {never}"
            _unreached(plan, node.children[index + 1], reason, reporter)
            return  # the children after that are unreachable for the same reason


def _unreached(plan: TreePlan, node: NodePlan, reason: str, reporter: LintReporter) -> None:
    message = f"{node_label(node)} is never ticked: {reason}"
    reporter.warn(
        UNREACHABLE_CHILD,
        message,
        plan.definition.document,
        node,
        hint="remove it, or the cause",
    )


def _is_written(node: NodePlan, port: str) -> bool:
    return any(bound.name == port and bound.is_explicit for bound in node.bindings)


def _one_at_a_time(
    plan: TreePlan, node: NodePlan, children: list[PossibleResults], going: Status, reporter: LintReporter
) -> None:
    """Warn if an asynchronous child follows a child that is asynchronous in its first tick."""
    document = plan.definition.document
    first: NodePlan | None = None
    for child, outcome in zip(node.children, children, strict=True):
        if first is not None and outcome.may_run:
            before = f"{node_label(first)} ({line_of(document, first)})"
            message = (
                f"{node_label(child)} is a second asynchronous child of <{node.id}>: each tick begins with "
                f"{before}, which halts {node_label(child)} unless it completes at once"
            )
            hint = f"put both into a <{'Sequence' if going is SUCCESS else 'Fallback'}>"
            reporter.warn(SECOND_ASYNC_CHILD, message, document, child, hint=hint)
            return
        if not outcome.passes(going):
            return
        if first is None and outcome.may_run and not PossibleResults(outcome.in_first_tick).passes(going):
            first = child
