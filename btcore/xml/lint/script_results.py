"""W207, W208: scripts that can't but raise, and conditions that assign where they should compare."""

from collections.abc import Iterator, Mapping

from btcore.errors import ScriptFault
from btcore.ports import pointer
from btcore.script.expressions import Assignment, Expression, Name
from btcore.script.program import truth
from btcore.xml.check import nodes_of
from btcore.xml.dialect import BEFORE
from btcore.xml.lint.advice import Advice, tag
from btcore.xml.lint.rehearsal import SCRIPT_PORTS
from btcore.xml.lint.scripts import constant_value, is_constant, statements, sure_to_raise
from btcore.xml.plan import NodePlan, TreePlan


def check_script_results(plan: TreePlan, enums: Mapping[str, int], advice: Advice) -> None:
    """Warn of the scripts of *plan* whose result is certain to be of no use."""
    document = plan.definition.document
    for node in nodes_of(plan):
        for attribute, text, decides in _scripts(node):
            try:
                fault = sure_to_raise(text, enums)
                last = statements(text, enums)[-1]
            except ScriptFault:
                continue  # said already
            if fault is not None:
                said = f"the script in '{attribute}' of {tag(node)} raises whenever it runs: {fault.message}"
                advice.warn("W207", said, document, node, attribute, within=fault.column, width=fault.width)
            elif decides:
                _decision(node, attribute, last, enums, plan, advice)


def _scripts(node: NodePlan) -> Iterator[tuple[str, str, bool]]:
    """Each script of *node*: its attribute, its text, and whether its result decides something."""
    for attribute, text in node.scripts.items():
        yield attribute, text, attribute in BEFORE
    if node.manifest is not None:
        wanted = SCRIPT_PORTS.get(node.manifest.cls)
        for port, text, _ in node.ports:
            if port.name == wanted and pointer(text, port.name) is None:
                yield port.name, text, node.id != "Script"


def _decision(
    node: NodePlan,
    attribute: str,
    last: Expression,
    enums: Mapping[str, int],
    plan: TreePlan,
    advice: Advice,
) -> None:
    """Look at the statement whose value is the result of a condition."""
    document = plan.definition.document
    if isinstance(last, Assignment) and last.operator == "=" and isinstance(last.target, Name):
        said = f"'{attribute}' of {tag(node)} assigns to '{last.target.name}', and does not compare it"
        hint = f"to compare, write {last.target.name} == …"
        advice.warn("W208", said, document, node, attribute, hint, within=last.column, width=last.width)
        return
    value = last.value if isinstance(last, Assignment) else last
    if not is_constant(value, enums):
        return
    result = constant_value(value)
    try:
        truth(result)
    except ScriptFault:
        asked = f"'{attribute}' of {tag(node)} raises whenever it is asked"
        if isinstance(result, str):
            said = f"{asked}: its result is the text '{result}'"
            hint = f"write {result} without quotes" if result in ("true", "false") else "compare the text"
        else:
            said = f"{asked}: its result is {result}, neither true nor false"
            hint = "0 and 1 are, and reals from 0 up; or compare it with something"
        advice.warn("W207", said, document, node, attribute, hint, within=value.column, width=value.width)
