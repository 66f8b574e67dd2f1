"""W207, W208: scripts that always raise, and conditions that assign instead of comparing."""

from collections.abc import Iterator, Mapping

from btcore.blackboard.ports import SCRIPT_ROLES, PortRole
from btcore.diagnostic_codes import CONDITION_ASSIGNS, SCRIPT_RAISES
from btcore.errors import ScriptError
from btcore.script.expressions import Assignment, Expression, Name
from btcore.script.program import condition_result
from btcore.xml.lint.advice import LintReporter, node_label
from btcore.xml.lint.script_analysis import constant_value, find_certain_error, is_constant, parse_statements
from btcore.xml.plan.document_checks import nodes_of
from btcore.xml.plan.plan import NodePlan, TreePlan
from btcore.xml.read.dialect import PRECONDITION_ATTRIBUTES


def check_script_results(plan: TreePlan, enums: Mapping[str, int], reporter: LintReporter) -> None:
    """Warn about scripts of *plan* that always raise, or whose result is no valid condition.

    Args:
        plan: The tree to check.
        enums: Values of the registered enum names.
        reporter: Collects the warnings.
    """
    document = plan.definition.document
    for node in nodes_of(plan):
        for attribute, text, is_condition in _scripts(node):
            try:
                error = find_certain_error(text, enums)
                last = parse_statements(text, enums)[-1]
            except ScriptError:
                continue  # check_scripts has reported it
            if error is not None:
                where = f"'{attribute}' of {node_label(node)}"
                message = f"the script in {where} always raises: {error.message}"
                reporter.warn(
                    SCRIPT_RAISES, message, document, node, attribute, within=error.column, width=error.width
                )
            elif is_condition:
                _check_condition(node, attribute, last, enums, plan, reporter)


def _scripts(node: NodePlan) -> Iterator[tuple[str, str, bool]]:
    """Yield attribute, text, and whether the result is a condition, for each script of *node*."""
    for attribute, text in node.scripts.items():
        yield attribute, text, attribute in PRECONDITION_ATTRIBUTES
    for bound in node.bindings:
        if bound.port.role in SCRIPT_ROLES and bound.key is None:
            yield bound.name, bound.text, bound.port.role is PortRole.CONDITION


def _check_condition(
    node: NodePlan,
    attribute: str,
    last: Expression,
    enums: Mapping[str, int],
    plan: TreePlan,
    reporter: LintReporter,
) -> None:
    """Check *last*, the statement of a condition whose value is the result."""
    document = plan.definition.document
    if isinstance(last, Assignment) and last.operator == "=" and isinstance(last.target, Name):
        message = f"'{attribute}' of {node_label(node)} assigns to '{last.target.name}' instead of comparing"
        hint = f"to compare, write {last.target.name} == …"
        reporter.warn(
            CONDITION_ASSIGNS, message, document, node, attribute, hint, within=last.column, width=last.width
        )
        return
    value = last.value if isinstance(last, Assignment) else last
    if not is_constant(value, enums):
        return
    result = constant_value(value)
    try:
        condition_result(result)
    except ScriptError:
        failure = f"'{attribute}' of {node_label(node)} always raises"
        if isinstance(result, str):
            message = f"{failure}: its result is the text '{result}'"
            hint = f"write {result} without quotes" if result in ("true", "false") else "compare the text"
        else:
            message = f"{failure}: its result is {result}, neither true nor false"
            hint = "valid results are 0, 1 and reals from 0 up; or write a comparison"
        reporter.warn(
            SCRIPT_RAISES, message, document, node, attribute, hint, within=value.column, width=value.width
        )
