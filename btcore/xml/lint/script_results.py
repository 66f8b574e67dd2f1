"""W207, W208: scripts that can't but raise, and conditions that assign where they should compare."""

from collections.abc import Iterator, Mapping

from btcore.blackboard.ports import SCRIPT_ROLES, PortRole
from btcore.diagnostic_codes import CONDITION_ASSIGNS, SCRIPT_RAISES
from btcore.errors import ScriptError
from btcore.script.expressions import Assignment, Expression, Name
from btcore.script.program import condition_result
from btcore.xml.lint.advice import LintReporter, node_label
from btcore.xml.lint.script_analysis import (
    constant_value,
    find_certain_error,
    is_constant,
    parse_statements,
)
from btcore.xml.plan.document_checks import nodes_of
from btcore.xml.plan.plan import NodePlan, TreePlan
from btcore.xml.read.dialect import PRECONDITION_ATTRIBUTES


def check_script_results(plan: TreePlan, enums: Mapping[str, int], reporter: LintReporter) -> None:
    """Warn of the scripts of *plan* whose result is certain to be of no use."""
    document = plan.definition.document
    for node in nodes_of(plan):
        for attribute, text, decides in _scripts(node):
            try:
                error = find_certain_error(text, enums)
                last = parse_statements(text, enums)[-1]
            except ScriptError:
                continue  # said already
            if error is not None:
                where = f"'{attribute}' of {node_label(node)}"
                message = f"the script in {where} raises whenever it runs: {error.message}"
                reporter.warn(
                    SCRIPT_RAISES, message, document, node, attribute, within=error.column, width=error.width
                )
            elif decides:
                _decision(node, attribute, last, enums, plan, reporter)


def _scripts(node: NodePlan) -> Iterator[tuple[str, str, bool]]:
    """Each script of *node*: its attribute, its text, and whether its result decides something."""
    for attribute, text in node.scripts.items():
        yield attribute, text, attribute in PRECONDITION_ATTRIBUTES
    for bound in node.bindings:
        if bound.port.role in SCRIPT_ROLES and bound.key is None:
            yield bound.name, bound.text, bound.port.role is PortRole.CONDITION


def _decision(
    node: NodePlan,
    attribute: str,
    last: Expression,
    enums: Mapping[str, int],
    plan: TreePlan,
    reporter: LintReporter,
) -> None:
    """Look at the statement whose value is the result of a condition."""
    document = plan.definition.document
    if isinstance(last, Assignment) and last.operator == "=" and isinstance(last.target, Name):
        message = (
            f"'{attribute}' of {node_label(node)} assigns to '{last.target.name}', and does not compare it"
        )
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
        asked = f"'{attribute}' of {node_label(node)} raises whenever it is asked"
        if isinstance(result, str):
            message = f"{asked}: its result is the text '{result}'"
            hint = f"write {result} without quotes" if result in ("true", "false") else "compare the text"
        else:
            message = f"{asked}: its result is {result}, neither true nor false"
            hint = "0 and 1 are, and reals from 0 up; or compare it with something"
        reporter.warn(
            SCRIPT_RAISES, message, document, node, attribute, hint, within=value.column, width=value.width
        )
