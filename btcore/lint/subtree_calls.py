"""Check calls of trees: unused trees (W104), and SubTree attributes without effect (W204, W205)."""

from collections.abc import Mapping, Sequence

from btcore.blackboard.ports import remapped_key
from btcore.diagnostic_codes import BRACES_IN_FORMAT_3, INCOMPLETE_POINTER, UNUSED_TREE, USELESS_REMAPPING
from btcore.diagnostics import HintAndFixes
from btcore.fixes import Fix, RenameElement, SetValue
from btcore.lint.check_context import CheckContext
from btcore.suggestions import join_names, nearest_name
from btcore.xml.plan.key_uses import NON_KEY_ATTRIBUTES
from btcore.xml.plan.plan import Plans, reachable_trees
from btcore.xml.plan.tree_plan import NodePlan, TreePlan
from btcore.xml.read.document import DiagnosticCollector


def check_unused_trees(plans: Plans, main: TreePlan, collector: DiagnosticCollector) -> None:
    """Warn about trees of the main document that neither *main* nor another unused tree calls."""
    document = plans.definitions.sources.main_document
    used = reachable_trees(plans.trees, main)
    unused = [
        tree for tree in plans.trees.values() if tree not in used and tree.definition.document is document
    ]
    called = {call.tree_id for tree in unused for call in tree.calls if call.tree_id != tree.id}
    for tree in unused:
        element = tree.definition.element
        if tree.id not in called and element.get("ID") is not None:
            message = f"the tree '{tree.id}' is unused: '{main.id}' doesn't call it, directly or indirectly"
            hint = f'call it with <SubTree ID="{tree.id}"/>, or remove it'
            collector.report(document, UNUSED_TREE, message, element, attribute="ID", hint=hint)


def check_remappings(node: NodePlan, context: CheckContext) -> None:
    """Warn about attributes of a SubTree element that the called tree doesn't use."""
    call = node.subtree_call
    if call is None:
        return
    used = context.tree_keys.keys_of(call.tree_id)
    declared = context.plans.definitions.subtree_models.get(call.tree_id, {})
    for key, text in call.port_texts.items():
        if key in NON_KEY_ATTRIBUTES:
            continue
        if node.id == "SubTree" and call.remaps.get(key) == text and remapped_key(text, key, 3) is not None:
            message = f"in format 3 {node.label} takes keys without braces: '{key}' has no effect"
            hint = f'write {key}="{text[1:-1]}", or <SubTreePlus ID="{call.tree_id}" {key}="{text}"/>'
            fixes: Sequence[Fix] = [SetValue(text[1:-1]), RenameElement("SubTreePlus")]
            context.report(node, BRACES_IN_FORMAT_3, message, attribute=key, hint=hint, fixes=fixes)
        if call.remaps.get(key) == "=" and node.element.get(key) is None:
            message = (
                f"the model of '{call.tree_id}' has the default '{text}' for '{key}', which means the entry "
                "'=' of the calling tree"
            )
            hint = f'write default="{{{key}}}" in the model'
            context.report(node, INCOMPLETE_POINTER, message, hint=hint)
        if used is None or key in used or key in declared or node.element.get(key) is None:
            continue
        message = f"no port or script in the tree of {node.label} uses '{key}'"
        may_search = context.collector.take_comparisons(used)
        advice = _unused_key_hint(key, used, call.port_texts) if may_search else HintAndFixes()
        context.report(node, USELESS_REMAPPING, message, *advice, attribute=key, part="name")


def _unused_key_hint(key: str, used: set[str], written: Mapping[str, str]) -> HintAndFixes:
    # A key with "@" is on the main tree's blackboard, whatever the remapping.
    free = sorted(name for name in used if name not in written and not name.startswith("@"))
    near = nearest_name(key, free)
    if near is not None:
        return HintAndFixes.similar_name(near)
    names = join_names([f"'{name}'" for name in sorted(used)])
    return HintAndFixes(f"its keys are {names}" if names else "it uses no keys")
