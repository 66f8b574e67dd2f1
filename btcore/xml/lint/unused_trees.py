"""W104: trees that the main one never gets to."""

from collections.abc import Collection

from btcore.diagnostic_codes import UNUSED_TREE
from btcore.xml.plan.plan import TreePlanner
from btcore.xml.plan.tree_definitions import TreeDefinition
from btcore.xml.read.diagnostics import DiagnosticCollector


def check_unused(
    planner: TreePlanner, main: TreeDefinition, used: Collection[str], diagnostics: DiagnosticCollector
) -> None:
    """Warn of the trees of the main document that neither *main* nor another unused one calls."""
    definitions = planner.definitions
    document = definitions.documents[-1]
    unused = [one for one in definitions.by_id.values() if one.id not in used and one.document is document]
    called = {
        call.call.tree
        for one in unused
        for call in planner.plan(one).calls
        if call.call is not None and call.call.tree != one.id
    }
    for one in unused:
        if one.id not in called and one.element.get("ID") is not None:
            message = f"the tree '{one.id}' is never used: '{main.id}' doesn't lead to it"
            hint = f'call it by <SubTree ID="{one.id}"/>, or remove it'
            diagnostics.add(one.document.diagnostic(UNUSED_TREE, message, one.element, "ID", hint=hint))
