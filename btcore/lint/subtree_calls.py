"""Check calls of trees: unused trees (W104), and SubTree attributes without effect (W204, W205)."""

from collections.abc import Mapping

from btcore.blackboard.ports import SCRIPT_ROLES, remapped_key
from btcore.diagnostic_codes import BRACES_IN_FORMAT_3, INCOMPLETE_POINTER, UNUSED_TREE, USELESS_REMAPPING
from btcore.errors import Fix, Hint
from btcore.lint.dry_run import uses_whole_blackboard
from btcore.lint.key_uses import find_name_uses, port_uses
from btcore.lint.reporter import LintReporter, node_label
from btcore.suggestions import join_names, nearest_name
from btcore.xml.plan.plan import Plans, reachable_trees
from btcore.xml.plan.tree_plan import NodePlan, SubtreeCall, TreePlan
from btcore.xml.read.read import Document

_OF_THE_ELEMENT = ("name", "_description")


def check_unused_trees(plans: Plans, main: TreePlan, reporter: LintReporter) -> None:
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
            reporter.collector.add(document.diagnostic(UNUSED_TREE, message, element, "ID", hint=hint))


class TreeKeys:
    """The keys that each tree uses in its own blackboard; None for a tree that may use any key.

    *bounded* must be False if trees are recursive or too large: then SubTree calls are not followed.
    """

    def __init__(self, plans: Plans, enums: Mapping[str, int], bounded: bool) -> None:
        self._plans = plans
        self._bounded = bounded
        self._format = plans.dialect.format
        self._enums = enums
        self._known: dict[str, set[str] | None] = {}

    def keys_of(self, tree: str) -> set[str] | None:
        """Return the keys of *tree* and of called trees that share its blackboard; None means any key."""
        if tree not in self._known:
            self._known[tree] = None  # ends the recursion of trees that call each other
            plan = self._plans.trees.get(tree)
            if plan is not None:
                self._known[tree] = self._plan_keys(plan)
        return self._known[tree]

    def _plan_keys(self, plan: TreePlan) -> set[str] | None:
        if plan.has_unknown_nodes:
            return None
        keys: set[str] = set()
        for node in plan.nodes():
            own = self._node_keys(node) if node.subtree_call is None else self._call_keys(node.subtree_call)
            if own is None:
                return None
            for text in node.conditions.values():
                own |= self._script_keys(text)
            keys |= own
        return keys

    def _node_keys(self, node: NodePlan) -> set[str] | None:
        manifest = node.manifest
        if manifest is None or uses_whole_blackboard(manifest):
            return None
        keys: set[str] = set()
        for port, text, is_explicit in node.ports:
            key, _ = port_uses(port, text, is_explicit, self._format)
            is_script = port.role in SCRIPT_ROLES
            if key is None:
                keys |= self._script_keys(text) if is_script else set()
            elif is_script:
                return None  # a script from an entry may use any key
            else:
                keys.add(key)
        return keys

    def _script_keys(self, text: str) -> set[str]:
        return {use.name for use in find_name_uses(text, self._enums)}

    def _call_keys(self, call: SubtreeCall) -> set[str] | None:
        keys = {outer for key, outer in call.remaps.items() if key not in _OF_THE_ELEMENT}
        if call.shares_blackboard or call.autoremap:
            inner = self.keys_of(call.tree_id) if self._bounded else None
            if inner is None:
                return None
            keys |= inner - call.remaps.keys() - call.constants.keys()
        return keys


def check_remappings(
    node: NodePlan,
    document: Document,
    tree_keys: TreeKeys,
    models: Mapping[str, Mapping[str, str | None]],
    reporter: LintReporter,
) -> None:
    """Warn about attributes of a SubTree element that the called tree doesn't use.

    Args:
        node: The node to check; nodes other than SubTree are ignored.
        tree_keys: The keys that each tree uses.
        models: The ports that subtree models declare, by ID of the tree.
    """
    call = node.subtree_call
    if call is None:
        return
    used = tree_keys.keys_of(call.tree_id)
    declared = models.get(call.tree_id, {})
    for key, text in call.port_texts.items():
        if key in _OF_THE_ELEMENT:
            continue
        if node.id == "SubTree" and call.remaps.get(key) == text and remapped_key(text, key, 3) is not None:
            message = f"in format 3 {node_label(node)} takes keys without braces: '{key}' has no effect"
            hint = Hint(
                f'write {key}="{text[1:-1]}", or <SubTreePlus ID="{call.tree_id}" {key}="{text}"/>',
                (Fix("write_value", (text[1:-1],)), Fix("rename_element", ("SubTreePlus",))),
            )
            reporter.report(BRACES_IN_FORMAT_3, message, document, node, key, hint)
        if call.remaps.get(key) == "=" and node.element.get(key) is None:
            message = (
                f"the model of '{call.tree_id}' has the default '{text}' for '{key}', which means the entry "
                "'=' of the calling tree"
            )
            hint = Hint(f'write default="{{{key}}}" in the model')
            reporter.report(INCOMPLETE_POINTER, message, document, node, hint=hint)
        if used is None or key in used or key in declared or node.element.get(key) is None:
            continue
        message = f"no port or script in the tree of {node_label(node)} uses '{key}'"
        may_search = reporter.collector.take_comparisons(used)
        unused = _unused_key_hint(key, used, call.port_texts) if may_search else ""
        reporter.report(USELESS_REMAPPING, message, document, node, key, unused, part="name")


def _unused_key_hint(key: str, used: set[str], written: Mapping[str, str]) -> str | Hint:
    # A key with "@" is on the main tree's blackboard, whatever the remapping.
    free = sorted(name for name in used if name not in written and not name.startswith("@"))
    near = nearest_name(key, free)
    if near is not None:
        return Hint.similar_name(near)
    names = join_names([f"'{name}'" for name in sorted(used)])
    return f"its keys are {names}" if names else "it uses no keys"
