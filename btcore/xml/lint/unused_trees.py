"""W104: trees that the main tree doesn't call, directly or indirectly."""

from collections.abc import Collection

from btcore.diagnostic_codes import UNUSED_TREE
from btcore.xml.plan.plan import TreePlanner
from btcore.xml.plan.tree_definitions import TreeDefinition
from btcore.xml.read.diagnostics import DiagnosticCollector


def check_unused(
    planner: TreePlanner, main: TreeDefinition, used: Collection[str], diagnostics: DiagnosticCollector
) -> None:
    """Warn about trees of the main document that neither *main* nor another unused tree calls.

    Args:
        planner: Plans the trees.
        main: The main tree.
        used: IDs of the main tree and of the trees that it calls, directly or indirectly.
        diagnostics: Collects the warnings.
    """
    definitions = planner.definitions
    document = definitions.documents[-1]
    unused = [
        tree for tree in definitions.by_id.values() if tree.id not in used and tree.document is document
    ]
    called = {
        node.call.tree
        for tree in unused
        for node in planner.plan(tree).calls
        if node.call is not None and node.call.tree != tree.id
    }
    for tree in unused:
        if tree.id not in called and tree.element.get("ID") is not None:
            message = f"the tree '{tree.id}' is unused: '{main.id}' doesn't call it, directly or indirectly"
            hint = f'call it with <SubTree ID="{tree.id}"/>, or remove it'
            diagnostics.add(tree.document.diagnostic(UNUSED_TREE, message, tree.element, "ID", hint=hint))
