"""Analyse scripts: scripts that always raise (W207), and misused conditions (W208)."""

from collections.abc import Mapping, Sequence

from btcore.blackboard.blackboard import Blackboard
from btcore.diagnostic_codes import CONDITION_ASSIGNS, SCRIPT_RAISES
from btcore.errors import ScriptError
from btcore.fixes import ReplaceText
from btcore.lint.check_context import CheckContext
from btcore.script.expressions import Assignment, Expression, Name
from btcore.script.program import condition_result
from btcore.xml.plan.key_uses import iter_subexpressions, parse_statements
from btcore.xml.plan.tree_plan import NodePlan
from btcore.xml.read.document import Mark


def is_constant(expression: Expression, enums: Mapping[str, int]) -> bool:
    """Return whether *expression* has the same value for any content of the blackboard."""
    return all(
        not isinstance(part, Assignment) and (not isinstance(part, Name) or part.name in enums)
        for part in iter_subexpressions(expression)
    )


def find_certain_error(statements: Sequence[Expression], enums: Mapping[str, int]) -> ScriptError | None:
    """Return the error that every run of a script raises, or None if no error is certain."""
    for statement in statements:
        for part in iter_subexpressions(statement):
            if isinstance(part, Assignment) and not isinstance(part.target, Name):
                return part.error(f"the left side of '{part.operator}' is not the name of an entry")
        value = statement.value if isinstance(statement, Assignment) else statement
        if is_constant(value, enums):
            try:
                value.evaluate(Blackboard())
            except ScriptError as error:
                return error
    return None


def check_script_results(node: NodePlan, context: CheckContext) -> None:
    """Warn about scripts of *node* that always raise, and about conditions that assign, not compare."""
    enums = context.plans.registry.types.enums
    for attribute, text, is_condition in node.iter_scripts():
        if not text and is_condition and attribute not in node.conditions:
            message = f"the script in '{attribute}' of {node.label} always raises: it is empty"
            context.report(node, SCRIPT_RAISES, message, attribute=attribute)
        try:
            statements = parse_statements(text, enums)
        except ScriptError:
            continue  # `report_invalid_scripts` has reported it
        error = find_certain_error(statements, enums)
        if error is not None:
            message = f"the script in '{attribute}' of {node.label} always raises: {error.message}"
            mark: Mark = {"attribute": attribute, "column": error.column, "width": error.width}
            context.report(node, SCRIPT_RAISES, message, **mark)
        elif is_condition:
            _check_condition(node, attribute, statements[-1], enums, context)


def _check_condition(
    node: NodePlan, attribute: str, last: Expression, enums: Mapping[str, int], context: CheckContext
) -> None:
    """Check *last*, the last statement of a condition. Its value is the result of the condition."""
    if isinstance(last, Assignment) and last.operator == "=" and isinstance(last.target, Name):
        message = f"'{attribute}' of {node.label} assigns to '{last.target.name}' instead of comparing"
        hint, fixes = f"to compare, write {last.target.name} == …", [ReplaceText("==")]
        mark: Mark = {"attribute": attribute, "column": last.column, "width": last.width}
        context.report(node, CONDITION_ASSIGNS, message, hint=hint, fixes=fixes, **mark)
        return
    value = last.value if isinstance(last, Assignment) else last
    if not is_constant(value, enums):
        return
    result = value.evaluate(Blackboard())
    try:
        condition_result(result)
    except ScriptError:
        failure = f"'{attribute}' of {node.label} always raises"
        fixes = []
        if isinstance(result, str):
            message = f"{failure}: its result is the text '{result}'"
            hint = "compare the text"
            if result in ("true", "false"):
                hint, fixes = f"write {result} without quotes", [ReplaceText(result)]
        else:
            message = f"{failure}: its result is {result}, neither true nor false"
            hint = "valid results are 0, 1 and reals from 0 up; or write a comparison"
        mark = {"attribute": attribute, "column": value.column, "width": value.width}
        context.report(node, SCRIPT_RAISES, message, hint=hint, fixes=fixes, **mark)
